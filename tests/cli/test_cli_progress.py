"""The progress bar's stream: it outlives the terminal that it writes to."""

from __future__ import annotations

import io

import pytest

from nlosctl.cli import terminal


@pytest.mark.parametrize("ends", ["closed", "hung up"])
def test_a_bar_goes_quietly_after_its_terminal(ends: str) -> None:
    """What is left of a bar is let go where standard error is closed, or answers no more: flushed, closed, deleted."""

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
