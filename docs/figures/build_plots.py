"""Makes the pictures of docs/plotting.md with the commands that stand there: ``make figures``."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "plotting.md"


def commands() -> list[str]:
    """Return the lines of the page that are commands."""
    return re.findall(r"^    (nlosctl .*)$", PAGE.read_text(encoding="utf-8"), re.MULTILINE)


def main() -> None:
    """Run the commands in a folder of their own, and keep the pictures."""
    environment = {**os.environ, "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
    with tempfile.TemporaryDirectory() as folder:
        for line in commands():
            subprocess.run(["/bin/sh", "-c", line], cwd=folder, env=environment, check=True)
        for picture in sorted(Path(folder).glob("*.svg")):
            target = ROOT / "docs" / "figures" / picture.name
            target.write_bytes(picture.read_bytes())
            sys.stdout.write(f"{shlex.quote(str(target.relative_to(ROOT)))}\n")


if __name__ == "__main__":
    main()
