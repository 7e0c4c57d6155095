"""README.md: its blocks run in order from an empty folder, and its tables list every command and method."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
import typer.main
from doc_pages import ROOT, run_shell

from nlosctl import registry
from nlosctl.cli.main import app

pytestmark = [pytest.mark.process, pytest.mark.xdist_group("readme")]

TEXT = (ROOT / "README.md").read_text(encoding="utf-8")
BLOCK = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
INSTALL = re.compile(r"^## Install\n.*?(?=^## )", re.MULTILINE | re.DOTALL)
INSTALLING = ("make demo", "make test", "pip install ", "nlosctl --install-completion")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder after all blocks have run in order, each as it stands; those under "Install" are left out."""
    folder = tmp_path_factory.mktemp("readme")
    for number, (language, block) in enumerate(BLOCK.findall(INSTALL.sub("", TEXT))):
        script = block
        if language == "python":
            (folder / "block.py").write_text(block, encoding="utf-8")
            script = "python block.py"
        done = run_shell(script, folder)
        assert done.returncode == 0, f"block {number}:\n{block}\n{done.stderr}"
        (folder / f"{number}.out").write_text(done.stdout, encoding="utf-8")
    return folder


def test_every_block_can_run() -> None:
    """Every block is shell or Python, none is indented, and only the blocks under "Install" install."""
    assert {language for language, _ in BLOCK.findall(TEXT)} == {"sh", "python"}
    assert re.findall(r"^    .*", BLOCK.sub("", TEXT), re.MULTILINE) == []
    installing = [
        line for _, block in BLOCK.findall(TEXT) for line in block.splitlines() if line.startswith(INSTALLING)
    ]
    section = INSTALL.search(TEXT)
    assert section is not None
    assert [line for _, block in BLOCK.findall(section[0]) for line in block.splitlines()] == installing


def test_the_two_commands_that_set_up_are_targets() -> None:
    """``make demo`` and ``make test`` are the targets of the Makefile that set up what they need."""
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    assert re.findall(r"^make (\w+)", TEXT, re.MULTILINE) == ["demo", "test"]
    assert re.search(r"^demo: \$\(RUNTIME\)", makefile, re.MULTILINE)
    assert re.search(r"^test: \$\(DEV\)", makefile, re.MULTILINE)


def test_the_first_command_flags_the_roof(folder: Path) -> None:
    """The first block gives a fix, and flags the bearing of the roof alone."""
    assert ",ok," in (folder / "fixes.csv").read_text(encoding="utf-8")
    lines = (folder / "flags.csv").read_text(encoding="utf-8").splitlines()
    column = lines[0].split(",").index("los")
    flags = {line.split(",")[1]: line.split(",")[column] for line in lines[1:]}
    assert flags == {"hill": "true", "tower": "true", "van": "true", "roof": "false", "church": "true"}


def test_the_picture_is_drawn(folder: Path) -> None:
    """A block of the first screen draws the picture that the README shows."""
    assert "docs/figures/direction-finding.png" in TEXT
    assert (folder / "direction-finding.png").stat().st_size > 10_000


def test_own_headers_and_geographic_coordinates_become_a_map(folder: Path) -> None:
    """A log with headers of its own, compass bearings and latitudes becomes fixes at the source, on a map."""
    features = json.loads((folder / "drive.geojson").read_text(encoding="utf-8"))["features"]
    points = [feature for feature in features if feature["geometry"]["type"] == "Point"]
    assert [point["properties"]["status"] for point in points] == ["ok", "ok"]
    assert points[0]["geometry"]["coordinates"] == pytest.approx([8.58, 47.36], abs=0.002)


def test_the_pipelines_end_in_figures(folder: Path) -> None:
    """Both pipelines print a table of figures: three methods in the first, one in the second."""
    tables = [
        (folder / f"{number}.out").read_text(encoding="utf-8")
        for number, (_, block) in enumerate(BLOCK.findall(INSTALL.sub("", TEXT)))
        if "| nlosctl evaluate" in block
    ]
    assert [len(table.splitlines()) for table in tables] == [4, 2]


def test_all_commands_are_listed() -> None:
    """The table of commands has each command, and no other."""
    table = re.search(r"\| command \| job \|\n\|.*\n((?:\|.*\n)+)", TEXT)
    assert table is not None
    listed = re.findall(r"^\| `([\w-]+)`", table[1], re.MULTILINE)
    assert sorted(listed) == sorted(typer.main.get_command(app).commands)  # type: ignore[attr-defined]


def test_all_built_in_methods_are_listed() -> None:
    """The tables of methods have each built-in method."""
    built_in = [entry.name for entry in registry.entries() if entry.distribution == "nlosctl"]
    assert [name for name in built_in if f"| `{name}` |" not in TEXT] == []
