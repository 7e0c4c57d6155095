"""The program run within the process of the tests."""

from __future__ import annotations

import contextlib
import io
import os
import subprocess
import sys
from pathlib import Path

import pytest


def run_here(*words: str, stdin: bytes = b"", folder: Path | None = None) -> subprocess.CompletedProcess[bytes]:
    """Run ``nlosctl WORDS...`` in this process, in ``folder``, without settings; the result is that of a process."""
    from nlosctl.cli.main import run

    out, err = io.BytesIO(), io.BytesIO()
    with pytest.MonkeyPatch.context() as patch, contextlib.chdir(folder or Path.cwd()):
        for name in [name for name in os.environ if name.startswith(("NLOSCTL", "_NLOSCTL"))]:
            patch.delenv(name)
        patch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(stdin)))
        patch.setattr(sys, "stdout", io.TextIOWrapper(out, write_through=True))
        patch.setattr(sys, "stderr", io.TextIOWrapper(err, write_through=True))
        code = run(words)
        return subprocess.CompletedProcess(words, code, out.getvalue(), err.getvalue())
