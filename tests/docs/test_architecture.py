"""docs/architecture.md: its packages and modules exist, the path is short, and the forms of a row are seven."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "nlosctl"
TEXT = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")


def first_column(header: str) -> list[str]:
    """The first cells of the table whose header begins so."""
    table = re.search(rf"^\| {header} \|.*\n\|.*\n((?:\|.*\n)+)", TEXT, re.MULTILINE)
    assert table is not None
    return [line.split("|")[1].strip() for line in table[1].splitlines()]


def test_all_rooms_are_listed() -> None:
    """The table of packages has every folder, and every module beside them except `__main__.py` and `version.py`."""
    rooms = {path.name + "/" for path in PACKAGE.iterdir() if (path / "__init__.py").is_file()}
    modules = {path.name for path in PACKAGE.glob("*.py")} - {"__init__.py", "__main__.py", "version.py"}
    assert {cell.strip("`") for cell in first_column("package")} == rooms | modules


@pytest.mark.parametrize("name", sorted(set(re.findall(r"`([\w/]+\.py)`", TEXT))))
def test_modules_exist(name: str) -> None:
    """Every module that the page names exists, from the package or from the root of the repository."""
    assert (PACKAGE / name).is_file() or (ROOT / name).is_file() or list((PACKAGE).rglob(name))


def test_the_road_has_at_most_14_stations() -> None:
    """The drawing numbers its stations from 1 to at most 14, each once."""
    drawing = "".join(re.findall(r"^     .*\n", TEXT, re.MULTILINE))
    stations = sorted(int(number) for number in re.findall(r"(?<!\S)(\d+)  \w", drawing))
    assert stations == list(range(1, len(stations) + 1))
    assert len(stations) <= 14


def test_a_row_has_seven_forms() -> None:
    """The page names the seven forms of a row, and the drawing shows each."""
    forms = first_column("form")
    assert len(forms) == 7
    assert [form for form in forms if form.upper() not in TEXT] == []
