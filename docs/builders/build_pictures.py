"""Makes docs/pictures/ again by running the pages that show them: ``make pictures``."""

from __future__ import annotations

import re
import shutil
import tempfile
from pathlib import Path

from doc_pages import ROOT, read_page, run_shell

PICTURES = ROOT / "docs" / "pictures"


def pages() -> list[str]:
    """Return the pages that make pictures for this folder, by their paths in the repository."""
    found = sorted((ROOT / "docs").rglob("*.md"))
    return [path.relative_to(ROOT).as_posix() for path in found if pictures_of(path)]


def pictures_of(path: Path) -> list[str]:
    """Return the names of the pictures that a page shows."""
    return re.findall(r"!\[[^\]]*\]\([^)]*\bpictures/([\w.-]+)\)", path.read_text(encoding="utf-8"))


def main() -> None:
    """Run every page in a folder of its own and keep what it shows."""
    PICTURES.mkdir(exist_ok=True)
    for name in pages():
        with tempfile.TemporaryDirectory() as work:
            page = read_page(name)
            page.write(Path(work))
            done = run_shell("\n".join(page.commands), Path(work), timeout=600.0)
            if done.returncode:
                raise SystemExit(f"{name}: {done.stderr}")
            for picture in pictures_of(ROOT / name):
                shutil.copyfile(Path(work) / picture, PICTURES / picture)


if __name__ == "__main__":
    main()
