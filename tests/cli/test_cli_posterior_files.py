"""Files of posterior maps: ASCII grids with a CRS, GeoJSON, pictures."""

from __future__ import annotations

import json
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pyarrow.parquet
import pyproj
import pytest
from cli_support import Outcome

import nlosctl

Cli = Callable[..., Outcome]
FIELD = "--field=-500,500,-400,400"
ORIGIN = "--origin=48.1,11.5"


@pytest.fixture(autouse=True)
def _bearings(tmp_path: Path) -> None:
    """Five snapshots of bearings."""
    table = nlosctl.simulate("ring", trials=5, seed=2, sensors=3, bearing_std_deg=9.0)
    pyarrow.parquet.write_table(table, tmp_path / "m.parquet")


def test_an_ascii_grid_has_north_on_top(cli: Cli, tmp_path: Path) -> None:
    """The grid has the probabilities of the table, from the north-west, and the CRS is beside it."""
    words = ("posterior", "m.parquet", "--snapshot", 1, FIELD, "--cell", 50)
    assert cli(*words, "--crs", "EPSG:32632", "-o", "map.asc").code == 0
    assert cli(*words, "-o", "map.parquet").code == 0
    lines = (tmp_path / "map.asc").read_text().splitlines()
    header = dict(line.split() for line in lines[:6])
    assert header == {
        "ncols": "20",
        "nrows": "16",
        "xllcorner": "-500",
        "yllcorner": "-400",
        "cellsize": "50",
        "NODATA_value": "-9999",
    }
    grid = np.array([line.split() for line in lines[6:]], dtype=np.float64)
    table = pyarrow.parquet.read_table(tmp_path / "map.parquet")
    np.testing.assert_array_equal(grid[::-1].ravel(), table["probability"].to_numpy())
    assert pyproj.CRS.from_wkt((tmp_path / "map.prj").read_text()).to_epsg() == 32632
    again = cli(*words, "--crs", "EPSG:32632", "-o", "map.asc")
    assert (again.code, again.err.count("\n")) == (1, 1)
    assert "map.asc: exists already; --overwrite replaces it" in again.err


def test_a_grid_in_no_place_has_no_crs(cli: Cli, tmp_path: Path) -> None:
    """Without a frame there is no ``.prj``; all maps do not fit into one grid."""
    assert cli("posterior", "m.parquet", "--combine", "-o", "map.asc").code == 0
    assert not (tmp_path / "map.prj").exists()
    outcome = cli("posterior", "m.parquet", "--all", "-o", "maps.asc")
    assert outcome.code == 2
    assert "an ASCII grid has one map; choose one with --snapshot, or set --combine" in outcome.err
    assert not (tmp_path / "maps.asc").exists()


def test_regions_as_geojson_hold_what_they_state(cli: Cli, tmp_path: Path) -> None:
    """Closed polygons in longitude and latitude; the cells in them have the probability of the level, or just more."""
    words = ("posterior", "m.parquet", "--snapshot", 1, FIELD, "--cell", 25)
    assert cli(*words, ORIGIN, "-o", "map.geojson").code == 0
    assert cli(*words, "-o", "map.parquet").code == 0
    features = json.loads((tmp_path / "map.geojson").read_text())["features"]
    assert [feature["properties"]["probability"] for feature in features] == [0.5, 0.9, 0.95]
    table = pyarrow.parquet.read_table(tmp_path / "map.parquet")
    x, y, probability = (table[name].to_numpy() for name in ("x_m", "y_m", "probability"))
    plane = pyproj.Proj("+proj=aeqd +lat_0=48.1 +lon_0=11.5 +datum=WGS84")
    for feature in features:
        inside = np.zeros(x.shape, dtype=bool)
        geometry = feature["geometry"]
        polygons = geometry["coordinates"] if geometry["type"] == "MultiPolygon" else [geometry["coordinates"]]
        for rings in polygons:
            for ring in rings:
                assert ring[0] == ring[-1]
                inside ^= _within(np.stack(plane(*np.array(ring).T), axis=1), x, y)
        level, held = feature["properties"]["probability"], probability[inside].sum()
        assert level <= held < level + probability[inside].min() + 1e-9
        assert probability[inside].min() >= probability[~inside].max() - 1e-15


def _within(ring: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    inside = np.zeros(x.shape, dtype=bool)
    for (x0, y0), (x1, y1) in pairwise(ring):
        if y0 != y1:
            inside ^= ((y0 > y) != (y1 > y)) & (x < x0 + (y - y0) * (x1 - x0) / (y1 - y0))
    return inside


def test_all_maps_as_geojson_name_their_snapshots(cli: Cli, tmp_path: Path) -> None:
    """Three features a snapshot; ``convert`` makes the same regions of a table of maps, also as KML."""
    words = ("posterior", "m.parquet", "--all", FIELD, "--cell", 50)
    assert cli(*words, ORIGIN, "-o", "maps.geojson").code == 0
    features = json.loads((tmp_path / "maps.geojson").read_text())["features"]
    assert [feature["properties"]["snapshot"] for feature in features] == [i for i in range(5) for _ in range(3)]
    assert cli(*words, "-o", "maps.parquet").code == 0
    assert cli("convert", "maps.parquet", ORIGIN, "-o", "again.geojson").code == 0
    assert (tmp_path / "again.geojson").read_bytes() == (tmp_path / "maps.geojson").read_bytes()
    assert cli("convert", "maps.parquet", ORIGIN, "-o", "maps.kml").code == 0
    assert (tmp_path / "maps.kml").read_text().count("<Placemark>") == 15


def test_a_map_without_a_place_on_earth_is_no_geojson(cli: Cli, tmp_path: Path) -> None:
    """The message names ``--origin``; nothing is written."""
    outcome = cli("posterior", "m.parquet", "--snapshot", 1, FIELD, "--cell", 50, "-o", "map.geojson")
    assert (outcome.code, outcome.err.count("\n")) == (1, 1)
    assert "--origin" in outcome.err
    assert not (tmp_path / "map.geojson").exists()


def test_plot_draws_a_map(cli: Cli, tmp_path: Path) -> None:
    """The view of one map, of a snapshot among several, and beside the measurements."""
    assert cli("posterior", "m.parquet", "--all", FIELD, "--cell", 50, "-o", "maps.parquet").code == 0
    assert cli("posterior", "m.parquet", "--combine", FIELD, "--cell", 50, "-o", "map.csv").code == 0
    assert cli("plot", "maps.parquet", "--snapshot", 3, "-o", "three.svg").code == 0
    assert "snapshot 3" in (tmp_path / "three.svg").read_text()
    assert cli("plot", "map.csv", "m.parquet", "-o", "both.svg").code == 0
    assert "s2" in (tmp_path / "both.svg").read_text()
    assert cli("plot", "maps.parquet", "--snapshot", 9, "-o", "none.svg").code == 1
