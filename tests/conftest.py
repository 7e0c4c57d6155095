"""Fixtures for all tests."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

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


_STARTS = frozenset({"os.exec", "os.fork", "os.forkpty", "os.posix_spawn", "subprocess.Popen"})
_started: list[str] = []


def _note_start(event: str, arguments: tuple[Any, ...]) -> None:
    """Record that this process starts another; not `fc-list`, which matplotlib runs once to find the fonts."""
    if event in _STARTS and not (event == "subprocess.Popen" and Path(str(arguments[0])).name == "fc-list"):
        _started.append(event)


sys.addaudithook(_note_start)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup() -> None:
    """Forget the processes that earlier tests have started."""
    _started.clear()


@pytest.hookimpl(trylast=True)
def pytest_runtest_teardown(item: pytest.Item) -> None:
    """Fail a test that has started a process and lacks the marker ``process``, in runs that leave those out."""
    if _started and "not process" in item.config.getoption("markexpr"):
        pytest.fail(f"starts a process ({_started[0]}): mark it with pytest.mark.process", pytrace=False)
