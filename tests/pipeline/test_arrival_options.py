"""Options that arrival times can't have are usage errors, and descriptions have their commands."""

from __future__ import annotations

from pathlib import Path

import pytest
from program import run_here


@pytest.mark.process
@pytest.mark.parametrize(("words", "expected"), [
    (["describe", "in.csv"], "nlosctl localize -m ml in.csv"),
    (["plot", "in.csv", "-o", "out.png", "--target-z-m", "3"], "--target-z-m needs ranges, or three dimensions"),
])  # fmt: skip
def test_arrivals_have_their_own_limits(tmp_path: Path, words: list[str], expected: str) -> None:
    """A command that takes no arrivals, or not with an option, states it in one line."""
    assert run_here("simulate", "arrivals", "-n", "5", "-q", "-o", "in.csv", folder=tmp_path).returncode == 0
    done = run_here(*words, folder=tmp_path)
    assert expected in (done.stdout + done.stderr).decode()
    assert b"internal error" not in done.stderr
