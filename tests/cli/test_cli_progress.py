"""The stream of the progress bar after its terminal has closed."""

from __future__ import annotations

import io

import pytest

from nlosctl.cli import terminal


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
