"""docs/formats.md: its commands run on the fixtures, and each kind of log becomes a map in two commands."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import pyproj
import pytest
from doc_pages import ROOT, read_page, run_shell
from warm_program import warm_path

from nlosctl import registry

pytestmark = [pytest.mark.process, pytest.mark.xdist_group("formats_page")]

PAGE = read_page("docs/formats.md")
SOURCE, HALL, AIRCRAFT, MEADOW = (47.36, 8.58), (47.3765, 8.5485), (47.15, 8.5507), (47.37671, 8.548685)
MAPS = {
    "kraken.geojson": (SOURCE, 20.0),
    "aggregator.geojson": (SOURCE, 20.0),
    "pro.geojson": (SOURCE, 20.0),
    "bear.geojson": (SOURCE, 20.0),
    "telemetry.geojson": (SOURCE, 20.0),
    "azimuth.geojson": (SOURCE, 60.0),
    "sound.geojson": (HALL, 12.0),
    "wide.geojson": (HALL, 12.0),
    "aircraft.geojson": (AIRCRAFT, 70.0),
    "sounds.geojson": (MEADOW, 20.0),
    "differences.geojson": (HALL, 1.5),
    "tags.geojson": (HALL, 12.0),
    "anchors.geojson": (HALL, 12.0),
    "ranges.geojson": (HALL, 12.0),
    "mimo.geojson": ((47.3769, 8.5417), 40.0),
    "paths.geojson": ((47.3769, 8.5417), 40.0),
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the fixtures after all commands of the page, in order."""
    folder = tmp_path_factory.mktemp("formats") / "files"
    shutil.copytree(ROOT / "fixtures" / "formats", folder)
    done = run_shell("\n".join(PAGE.commands), folder, PATH=warm_path())
    assert done.returncode == 0, done.stderr
    return folder


@pytest.mark.parametrize("name", MAPS)
def test_each_kind_of_log_becomes_a_map(folder: Path, name: str) -> None:
    """Two commands lead from the log to points near the source, within the distance in metres of ``MAPS``."""
    source, within_m = MAPS[name]
    features = json.loads((folder / name).read_text(encoding="utf-8"))["features"]
    fixes = [feature for feature in features if feature["properties"]["feature"] == "estimate"]
    points = [feature["geometry"]["coordinates"] for feature in fixes]
    assert points
    for lon, lat, *_ in points:
        assert pyproj.Geod(ellps="WGS84").inv(lon, lat, source[1], source[0])[2] < within_m


def test_two_commands_are_enough() -> None:
    """Every block that ends in a map has two commands."""
    to_maps = [block for block in PAGE.commands if re.search(r"-o \w+\.geojson", block)]
    assert len(to_maps) == len(MAPS)
    assert {len(block.splitlines()) for block in to_maps} == {2}


def test_the_page_has_every_format() -> None:
    """The page names every built-in importer and exporter."""
    text = (ROOT / PAGE.name).read_text(encoding="utf-8")
    names = [entry.name for entry in registry.format_entries() if entry.distribution == "nlosctl"]
    assert [name for name in names if f"`{name}`" not in text] == []
