"""The stream of the progress bar after its terminal has closed."""

from __future__ import annotations

import io

import pytest

from nlosctl.cli import terminal
from nlosctl.contract.step_progress import note_step


@pytest.mark.parametrize("ends", ["closed", "hung up"])
def test_a_bar_ignores_a_closed_terminal(ends: str) -> None:
    """Flushing, closing and deleting a bar's stream on a closed standard error raises nothing."""

    class Terminal(io.StringIO):
        def flush(self) -> None:
            if ends == "hung up":
                raise OSError(5, "Input/output error")
            super().flush()

    stream = Terminal()
    shown = terminal._ForgivingTerminal(stream)
    shown.write("half a bar")
    assert stream.getvalue() == "half a bar"
    if ends == "closed":
        stream.close()
    shown.flush()
    shown.close()


def test_a_long_step_shows_its_share(monkeypatch: pytest.MonkeyPatch) -> None:
    """Within a snapshot of thousands of rows the bar shows the finished share; a short loop shows nothing."""

    class Screen(io.StringIO):
        def isatty(self) -> bool:
            return True

    screen = Screen()
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr("sys.stderr", screen)
    with terminal.Terminal().progress("localize"):
        note_step(32, 64)
        note_step(1600, 2400)
    note_step(0, 2400)
    assert "67 % of the present step" in screen.getvalue()
    assert "50 %" not in screen.getvalue()
