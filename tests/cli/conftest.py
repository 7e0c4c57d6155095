"""The command line run in the process of the tests, in an empty folder."""

from __future__ import annotations

import io
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from cli_support import Outcome

Cli = Callable[..., Outcome]


@pytest.fixture
def cli(
    capsysbinary: pytest.CaptureFixture[bytes], monkeypatch: pytest.MonkeyPatch, plain_settings: None, tmp_path: Path
) -> Cli:
    """Run ``nlosctl WORDS...`` in the folder of the test; ``stdin`` takes bytes."""
    from nlosctl.cli.main import run

    monkeypatch.chdir(tmp_path)

    def call(*words: Any, stdin: bytes = b"") -> Outcome:
        monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(stdin)))
        capsysbinary.readouterr()
        code = run([str(word) for word in words])
        captured = capsysbinary.readouterr()
        return Outcome(code=code, out=captured.out, err=captured.err.decode())

    return call
