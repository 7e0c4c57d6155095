"""Degrees read as metres, radians as degrees, other programs' files and missing columns: remarks and messages."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pytest

from tests.support.program import run_here

_FORMATS = Path(__file__).parents[2] / "fixtures" / "formats"


def _remarks(folder: Path, table: pa.Table, *options: str) -> list[str]:
    pa.csv.write_csv(table, folder / "in.csv")
    done = run_here("validate", "in.csv", "--json", *options, folder=folder)
    assert done.returncode == 0, done.stderr
    return [text for text in json.loads(done.stdout)["remarks"] if "look like" in text or "expected" in text]


def _bearings(x: list[float], y: list[float], names: tuple[str, str] = ("sensor_x_m", "sensor_y_m")) -> pa.Table:
    angles = [10.0 + 7.0 * row for row in range(len(x))]
    columns = {"snapshot": [1] * len(x), "sensor": [f"s{row}" for row in range(len(x))], names[0]: x, names[1]: y}
    return pa.table(columns | {"azimuth_deg": angles, "bearing_std_deg": [1.0] * len(x)})


_LON_LAT = ([8.540, 8.600, 8.620], [47.370, 47.400, 47.330])


@pytest.mark.parametrize("names", [("Lon", "Lat"), ("longitude", "Latitude"), ("gps.lng", "gps.lat"), ("X", "Y")])
def test_degrees_read_as_metres_are_remarked_on(tmp_path: Path, names: tuple[str, str]) -> None:
    """Longitudes and latitudes under any header are noted in `validate` and in `localize`, with the option to give."""
    options = ("--column", f"sensor_x_m={names[0]}", "--column", f"sensor_y_m={names[1]}")
    (remark,) = _remarks(tmp_path, _bearings(*_LON_LAT, names), *options)
    assert f"columns {names[0]!r} and {names[1]!r} are read as metres" in remark
    assert f"--column sensor_lon_deg={names[0]}" in remark
    done = run_here("localize", "-m", "ls", "in.csv", *options, "-o", "e.csv", folder=tmp_path)
    assert b"note: in.csv: columns" in done.stderr


@pytest.mark.parametrize(
    ("x", "y"),
    [
        ([0.0, 5.0, 0.0, 5.0], [0.0, 0.0, 3.5, 3.5]),  # a room
        ([0.125, 0.875, 0.125], [0.125, 0.125, 0.875]),  # a table
        ([-0.4321, 0.4321, 0.1234], [0.3333, 0.3333, -0.2222]),  # an array around the origin
        ([120.5, 121.0, 121.5], [40.0, 40.5, 41.5]),  # a corner of a site, to half a metre
        ([465270.123, 469817.456], [5246385.789, 5249694.321]),  # UTM
        ([8.5, 108.6, -60.2], [47.3, 47.4, -50.3]),  # a site of 170 m
    ],
)
def test_metres_are_not_remarked_on(tmp_path: Path, x: list[float], y: list[float]) -> None:
    """Rooms, arrays, sites and UTM coordinates in metres are not taken for degrees."""
    assert _remarks(tmp_path, _bearings(x, y)) == []


@pytest.mark.parametrize("name", ["bearing_deg", "azimuth_deg", "dod_deg", "doa_deg"])
@pytest.mark.parametrize(("rows", "words"), [(4, "may be radians"), (400, "are probably radians")])
def test_radians_read_as_degrees_are_remarked_on(tmp_path: Path, name: str, rows: int, words: str) -> None:
    """Every column of angles in degrees with all values within 2 pi is remarked on, with few rows as a hint."""
    angles = np.random.default_rng(1).uniform(-math.pi, math.pi, rows)
    kind = "triplets" if name.startswith("do") else "bearings"
    table = _bearings([200.0 * row for row in range(rows)], [0.0] * rows).drop_columns(["azimuth_deg"])
    if kind == "triplets":
        other = {"dod_deg": "doa_deg", "doa_deg": "dod_deg"}[name]
        table = pa.table(
            {"snapshot": range(rows), "path": [1] * rows, "tx_x_m": [0.0] * rows, "tx_y_m": [0.0] * rows}
            | {"rx_x_m": [40.0] * rows, "rx_y_m": [10.0] * rows, "toa_ns": [300.0] * rows, other: angles * 57.0}
            | {"dod_std_deg": [1.0] * rows, "doa_std_deg": [1.0] * rows, "path_length_std_m": [0.3] * rows}
        )
    (remark,) = _remarks(tmp_path, table.append_column(name, pa.array(angles)))
    assert f"column {name!r}: all {rows} values are within 2 pi and {words}, expected degrees" in remark


@pytest.mark.parametrize("angles", [[1.0, 2.0, 3.0], [0.5, 3.5, 6.5], [45.5, 1.5, 2.5]])
def test_small_degrees_are_not_remarked_on(tmp_path: Path, angles: list[float]) -> None:
    """Whole degrees, and angles beyond 2 pi, are degrees."""
    table = _bearings([0.0, 100.0, 200.0], [0.0] * 3).drop_columns(["azimuth_deg"])
    assert _remarks(tmp_path, table.append_column("azimuth_deg", pa.array(angles))) == []


@pytest.mark.parametrize("std", [[0.0175] * 3, [0.0349, 0.0524, 0.0873], [0.017453292519943295] * 3, [0.00873] * 3])
def test_stds_in_radians_are_remarked_on(tmp_path: Path, std: list[float]) -> None:
    """A standard deviation in degrees that is a whole or half number of degrees as radians is remarked on."""
    table = _bearings([0.0, 100.0, 200.0], [0.0] * 3).drop_columns(["bearing_std_deg"])
    (remark,) = _remarks(tmp_path, table.append_column("bearing_std_deg", pa.array(std)))
    assert "--column bearing_std_rad=bearing_std_deg" in remark
    assert "column 'bearing_std_deg'" in remark


@pytest.mark.parametrize("std", [[0.02] * 3, [0.1, 0.05, 0.07], [0.5] * 3, [0.013] * 3, [1.0] * 3])
def test_small_stds_are_not_remarked_on(tmp_path: Path, std: list[float]) -> None:
    """Round and larger standard deviations are degrees."""
    table = _bearings([0.0, 100.0, 200.0], [0.0] * 3).drop_columns(["bearing_std_deg"])
    assert _remarks(tmp_path, table.append_column("bearing_std_deg", pa.array(std))) == []


@pytest.mark.parametrize(("std", "remarked"), [([1.0, 2.0, 3.0], True), ([0.5, 2.0, 3.0], False), ([0.02] * 3, False)])
def test_stds_in_degrees_read_as_radians(tmp_path: Path, std: list[float], remarked: bool) -> None:
    """Standard deviations that would all be 46 degrees and more are remarked on."""
    table = _bearings([0.0, 100.0, 200.0], [0.0] * 3).drop_columns(["bearing_std_deg"])
    remarks = _remarks(tmp_path, table.append_column("bearing_std_rad", pa.array(std)))
    assert [("--column bearing_std_deg=bearing_std_rad" in remark) for remark in remarks] == [True] * remarked


def test_latitudes_in_radians_are_remarked_on(tmp_path: Path) -> None:
    """Latitudes within pi / 2 with longitudes within pi are remarked on; those of a real place are not."""
    names = ("sensor_lon_deg", "sensor_lat_deg")
    radians = [[math.radians(value) for value in axis] for axis in _LON_LAT]
    (remark,) = _remarks(tmp_path, _bearings(*radians, names))
    assert "may be radians" in remark
    assert _remarks(tmp_path, _bearings(*_LON_LAT, names)) == []


@pytest.mark.parametrize("shift", [0.0, 500000.0])
def test_degrees_in_the_scene_are_remarked_on(tmp_path: Path, shift: float) -> None:
    """Positions of the scene that look like longitudes and latitudes are remarked on; metres are not."""
    sensors = "".join(
        f'[[sensor]]\nname = "s{row}"\nposition = [{x + shift}, {y + shift}]\n'
        for row, (x, y) in enumerate(zip(*_LON_LAT, strict=True))
    )
    (tmp_path / "scene.toml").write_text(sensors)
    remarks = _remarks(tmp_path, _bearings(*_LON_LAT).drop_columns(["sensor_x_m", "sensor_y_m"]))
    assert len(remarks) == (shift == 0.0)
    assert all("the positions of the scene's sensors are read as metres" in remark for remark in remarks)


@pytest.mark.parametrize(
    ("file", "importer"),
    [
        ("kraken_app.csv", "kraken-csv"),
        ("df_aggregator.xml", "kraken-xml"),
        ("u_connect_locate.log", "uudf"),
        ("bear_bearings.csv", "wildlife"),
        ("uwb_ranges.csv", "uwb"),
        ("anchor_azimuths.csv", "anchor-azimuths"),
    ],
)
def test_a_file_of_another_program_names_its_importer(tmp_path: Path, file: str, importer: str) -> None:
    """A table command on a file of another program names the importer that reads it."""
    (tmp_path / file).write_bytes((_FORMATS / file).read_bytes())
    for command in (("localize", file), ("validate", file), ("convert", file, "-o", "x.parquet")):
        done = run_here(*command, folder=tmp_path)
        if command[0] != "convert" or done.returncode:
            assert done.returncode in (1, 2)
            assert f"it looks like a file for the importer {importer!r}: convert it by --from {importer}" in (
                done.stderr.decode()
            )


def _message(folder: Path, header: str, *options: str) -> str:
    (folder / "in.csv").write_text(f"{header}\n" + ",".join(["1"] * len(header.split(","))) + "\n")
    return run_here("localize", "in.csv", *options, folder=folder).stderr.decode()


def test_a_missing_std_is_not_the_bearing(tmp_path: Path) -> None:
    """A bearing is not proposed as its own standard deviation; a column that is one, is."""
    header = "snapshot,sensor,sensor_x_m,sensor_y_m"
    assert "did you mean" not in _message(tmp_path, f"{header},bearing,azimuth_deg")
    assert "(did you mean 'bearing_std'?)" in _message(tmp_path, f"{header},azimuth_deg,bearing_std")


def test_the_message_lists_the_headers_of_the_file(tmp_path: Path) -> None:
    """The file's own names are listed, not those after renaming, and no coordinates that latitudes give."""
    header = "Time,sensor,sensor_lat_deg,sensor_lon_deg,Azimuth"
    message = _message(tmp_path, header, "--column", "snapshot=Time")
    assert "The file has: Time, sensor, sensor_lat_deg, sensor_lon_deg, Azimuth;" in message
    assert "(did you mean 'Azimuth'?)" in message


def test_latitudes_under_other_headers_are_proposed(tmp_path: Path) -> None:
    """`Lat` and `Lon` are proposed as latitude and longitude of the sensor."""
    message = _message(tmp_path, "snapshot,sensor,Lat,Lon,azimuth_deg", "--bearing-std-deg", "1")
    assert "--column sensor_lat_deg=Lat and --column sensor_lon_deg=Lon" in message


def test_a_std_of_ranges_speaks_of_ranges(tmp_path: Path) -> None:
    """With a constant of ranges, a file without bearings and ranges lacks ranges."""
    message = _message(tmp_path, "snapshot,sensor,sensor_x_m,sensor_y_m,dist", "--range-std-m", "1")
    assert "missing column 'range_m'" in message
    assert "bearing" not in message
