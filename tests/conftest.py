"""Fixtures for all tests."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator

import pytest
from plugins import ActInCall, act_in_call, install_plugin


@pytest.fixture(scope="session", autouse=True)
def heed_signals() -> None:
    """Restore the handling of SIGINT and SIGHUP, which a background shell or nohup makes child processes ignore."""
    for number, handler in ((signal.SIGINT, signal.default_int_handler), (signal.SIGHUP, lambda number, frame: None)):
        if signal.getsignal(number) is signal.SIG_IGN:
            signal.signal(number, handler)


@pytest.fixture
def plain_settings(monkeypatch: pytest.MonkeyPatch) -> None:
    """Remove all variables of nlosctl from the environment."""
    for name in [name for name in os.environ if name.startswith(("NLOSCTL", "_NLOSCTL"))]:
        monkeypatch.delenv(name)


@pytest.fixture
def small_chunks(plain_settings: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Read measurements 37 rows at a time, so that small files come in several chunks."""
    monkeypatch.setenv("NLOSCTL_CHUNK_ROWS", "37")


@pytest.fixture
def acting_method(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Iterator[ActInCall]:
    """Install the method ``acting`` and yield the function that sets its action, ``act_in_call(number, action)``."""
    install_plugin(tmp_path_factory.mktemp("plugin"), monkeypatch, "bearings.acting", "plugins:ACTING")
    yield act_in_call
    act_in_call(-1, lambda: None)
