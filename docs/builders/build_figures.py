"""Draw the figures of all pages that show how they are made, by running the commands there: ``make figures``."""

from __future__ import annotations

import re
import shutil
import tempfile
from pathlib import Path

from doc_pages import ROOT, read_page, run_shell

FIGURES = ROOT / "docs" / "figures"


def pages() -> list[str]:
    """The pages that show figures, as paths in the repository."""
    paths = sorted((ROOT / "docs").rglob("*.md"))
    return [path.relative_to(ROOT).as_posix() for path in paths if shown_on(path.relative_to(ROOT).as_posix())]


def shown_on(page: str) -> list[str]:
    """Names of the figures that a page shows."""
    text = (ROOT / page).read_text(encoding="utf-8")
    return re.findall(r"!\[[^\]]*\]\([^)]*\bfigures/([\w.-]+)\)", text)


def made_on(page: str) -> list[str]:
    """Names of the figures of a page that a command on it writes."""
    commands = "\n".join(read_page(page).commands)
    return [figure for figure in shown_on(page) if f"-o {figure}" in commands]


def main() -> None:
    """Run every page that makes figures in a temporary folder, and copy the figures to docs/figures."""
    for name in pages():
        if not made_on(name):
            continue
        with tempfile.TemporaryDirectory() as work:
            page = read_page(name)
            page.write(Path(work))
            done = run_shell("\n".join(page.commands), Path(work), timeout=600.0)
            if done.returncode:
                raise SystemExit(f"{name}: {done.stderr}")
            for figure in made_on(name):
                shutil.copyfile(Path(work) / figure, FIGURES / figure)


if __name__ == "__main__":
    main()
