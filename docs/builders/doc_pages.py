"""Pages of the documentation as files to write and commands to run."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

__all__ = ["ROOT", "Page", "read_page", "run_shell"]

ROOT = Path(__file__).parents[2]

_BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_NAME = re.compile(r"`([\w./-]+)`[^`\n]*:\s*\Z")


@dataclass(frozen=True)
class Page:
    """The blocks of a page: ``files`` by name, ``commands`` (the ``sh`` blocks) in order.

    A block is a file if the text before it ends in a file name as code and a colon.
    """

    name: str
    files: dict[str, str]
    commands: list[str]

    def write(self, folder: Path) -> None:
        """Write the files."""
        for name, text in self.files.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(text, encoding="utf-8")


def read_page(path: str) -> Page:
    """The blocks of a page, by its path in the repository."""
    text = (ROOT / path).read_text(encoding="utf-8")
    files: dict[str, str] = {}
    commands: list[str] = []
    for block in _BLOCK.finditer(text):
        named = _NAME.search(text[: block.start()])
        if block[1] == "sh":
            commands.append(block[2])
        elif named is not None:
            files[named[1]] = block[2]
    return Page(name=path, files=files, commands=commands)


def run_shell(
    script: str, folder: Path, *, timeout: float = 600.0, **environment: str
) -> subprocess.CompletedProcess[str]:
    """Run lines of shell in a folder as a reader would; stop at the first that fails."""
    removed = ("NLOSCTL", "MAKE", "MFLAGS")  # within a make, the make of a page would print folders and inherit flags
    plain = {name: value for name, value in os.environ.items() if not name.startswith(removed)}
    path = f"{Path(sys.executable).parent}{os.pathsep}{plain['PATH']}"
    return subprocess.run(
        ["bash", "-e", "-o", "pipefail", "-c", script],
        cwd=folder,
        env={**plain, "PATH": path, "OMP_NUM_THREADS": "1", **environment},
        capture_output=True,
        text=True,
        check=False,
        timeout=timeout,
    )
