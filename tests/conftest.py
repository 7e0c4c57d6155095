"""What holds for all tests."""

from __future__ import annotations

import signal

import pytest


@pytest.fixture(scope="session", autouse=True)
def heed_signals() -> None:
    """Let what the tests start heed signals: a shell's background, or nohup, hands on that they are ignored."""
    for number, handler in ((signal.SIGINT, signal.default_int_handler), (signal.SIGHUP, lambda number, frame: None)):
        if signal.getsignal(number) is signal.SIG_IGN:
            signal.signal(number, handler)
