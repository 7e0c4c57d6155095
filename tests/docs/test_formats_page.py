"""The commands of docs/formats.md, run as they stand on the fixtures; each kind of file gets onto a map in two."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pyproj
import pytest

from nlosctl import registry

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "formats.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"(?:^    nlosctl .*\n)+", PAGE, re.MULTILINE)
SOURCE, HALL = (47.36, 8.58), (47.3765, 8.5485)
MAPS = {
    "kraken.geojson": (SOURCE, 20.0),
    "aggregator.geojson": (SOURCE, 20.0),
    "bear.geojson": (SOURCE, 20.0),
    "tags.geojson": (HALL, 12.0),
    "anchors.geojson": (HALL, 12.0),
    "ranges.geojson": (HALL, 12.0),
    "paths.geojson": ((47.3769, 8.5417), 40.0),
}


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the fixtures after all commands of the page, in order."""
    folder = tmp_path_factory.mktemp("formats") / "files"
    shutil.copytree(ROOT / "fixtures" / "formats", folder)
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    for block in BLOCKS:
        for line in block.splitlines():
            done = subprocess.run(
                ["bash", "-c", f"set -o pipefail; {line}"],
                cwd=folder,
                capture_output=True,
                text=True,
                check=False,
                env={**os.environ, "PATH": path},
            )
            assert done.returncode == 0, f"{line}\n{done.stderr}"
    return folder


@pytest.mark.parametrize("name", MAPS)
def test_each_kind_of_file_gets_onto_a_map(ran: Path, name: str) -> None:
    """Two commands lead from the fixture to points where the source is."""
    place, within_m = MAPS[name]
    features = json.loads((ran / name).read_text(encoding="utf-8"))["features"]
    fixes = [feature for feature in features if feature["properties"]["feature"] == "estimate"]
    points = [feature["geometry"]["coordinates"] for feature in fixes]
    assert points
    for lon, lat in points:
        assert pyproj.Geod(ellps="WGS84").inv(lon, lat, place[1], place[0])[2] < within_m


def test_two_commands_are_enough() -> None:
    """No block that ends in a map has more than two commands."""
    to_maps = [block for block in BLOCKS if re.search(r"-o \w+\.geojson", block)]
    assert len(to_maps) == len(MAPS)
    assert {len(block.splitlines()) for block in to_maps} == {2}


def test_the_page_has_every_format() -> None:
    """Every built-in importer and exporter is on the page."""
    names = [entry.name for entry in registry.format_entries() if entry.distribution == "nlosctl"]
    assert [name for name in names if f"`{name}`" not in PAGE] == []
