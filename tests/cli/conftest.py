"""Running the command line within the test's own process, in an empty folder."""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from cli_support import Outcome

Cli = Callable[..., Outcome]


@pytest.fixture
def cli(capsysbinary: pytest.CaptureFixture[bytes], monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Cli:
    """Run ``nlosctl WORDS...`` with the test's folder as the current one; ``stdin`` takes bytes."""
    from nlosctl.cli.main import run

    monkeypatch.chdir(tmp_path)
    for name in [name for name in os.environ if name.startswith(("NLOSCTL", "_NLOSCTL"))]:
        monkeypatch.delenv(name)

    def call(*words: Any, stdin: bytes = b"") -> Outcome:
        monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(stdin)))
        capsysbinary.readouterr()
        code = run([str(word) for word in words])
        captured = capsysbinary.readouterr()
        return Outcome(code=code, out=captured.out, err=captured.err.decode())

    return call


@pytest.fixture
def small_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Read measurements 37 rows at a time, so that small files come in several chunks."""
    from nlosctl.io.measurements import reader as measurements

    monkeypatch.setattr(measurements, "ReadOptions", partial(measurements.ReadOptions, chunk_rows=37))
