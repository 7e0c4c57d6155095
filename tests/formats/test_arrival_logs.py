"""Logs of arrival times: OpenSky (aircraft), Sound Finder (animals), UTIL (differences of pairs of UWB anchors)."""

from __future__ import annotations

import csv
import json
import math
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from program import run_here

import nlosctl
from nlosctl.errors import DataError, UsageError
from nlosctl.pipeline.convert.importer import Import

FORMATS = Path(__file__).parents[2] / "fixtures" / "formats"
MESSAGES = "id,timeAtServer,aircraft,latitude,longitude,baroAltitude,geoAltitude,numMeasurements,measurements\n"
RECEIVERS = "serial,latitude,longitude,height,type\n114,47.1,8.5,470,Radarcape\n-131,46.9,7.4,612.4,dump1090\n"


def opensky(folder: Path, *lines: str, receivers: str = RECEIVERS, bad_rows: Any = None, **parameters: Any) -> Any:
    """Return the table of messages, with the receivers of a file."""
    (folder / "log.csv").write_text(MESSAGES + "".join(f"{line}\n" for line in lines))
    (folder / "receivers.csv").write_text(receivers)
    parameters = {"sensors": str(folder / "receivers.csv"), **parameters}
    return Import("opensky", parameters, bad_rows=bad_rows).read(str(folder / "log.csv")).table


def test_published_lines_of_the_competition(tmp_path: Path) -> None:
    """A line of the competition's guide: a row per measurement, times as integers, positions as truth."""
    table = opensky(
        tmp_path,
        '1439066,929.714,179,46.55903,14.060371,11277.60,11506.20,2,"[[114,930672432312,116],[-131,930672970687,74]]"',
    )
    assert table["arrival_ns"].type == pa.int64()
    assert table["arrival_ns"].to_pylist() == [930672432312, 930672970687]
    assert table["sensor"].to_pylist() == ["114", "-131"]
    assert table["snapshot"].to_pylist() == [1439066] * 2
    first = table.slice(0, 1).to_pylist()[0]
    assert (first["sensor_lat_deg"], first["sensor_lon_deg"], first["sensor_height_m"]) == (47.1, 8.5, 470.0)
    assert (first["truth_lat_deg"], first["truth_lon_deg"], first["truth_z_m"]) == (46.55903, 14.060371, 11506.2)
    assert (first["target_height_m"], first["target_height_std_m"]) == (11277.6, 200.0)
    assert (first["time_s"], first["aircraft"], first["signal_strength"]) == (929.714, "179", 116.0)
    assert table["sensor_type"].to_pylist() == ["Radarcape", "dump1090"]


def test_times_since_1970_stay_exact_integers(tmp_path: Path) -> None:
    """Nanoseconds beyond 2^53 keep their last digit, fractions are rounded, and absent values are null."""
    stamps = [1_700_000_000_123_456_789, 1_700_000_000_123_456_790]
    table = opensky(tmp_path, f'7,5.5,80,,,,,2,"[[114,{stamps[0]},null],[-131,{stamps[1] - 1}.6,65.5]]"')
    assert table["arrival_ns"].to_pylist() == stamps
    assert table["signal_strength"].to_pylist() == [None, 65.5]
    assert not {"truth_lat_deg", "target_height_m", "target_height_std_m"} & set(table.column_names)


def test_missing_values_are_empty_or_na(tmp_path: Path) -> None:
    """Quoted headers and NA, as R writes them; a message without an altitude has no height, nor its std."""
    lines = '"1",5,"a",NA,NA,NA,NA,2,"[[114,5,1],[-131,6,1]]"\n"2",5,"a",NA,NA,100,NA,2,"[[114,5,1],[-131,6,1]]"\n'
    header = ",".join(f'"{name}"' for name in MESSAGES.strip().split(","))
    (tmp_path / "log.csv").write_text(f"{header}\n{lines}")
    (tmp_path / "r.csv").write_text(RECEIVERS)
    found = Import("auto", {"sensors": str(tmp_path / "r.csv"), "altitude_std_m": "50"}).read(str(tmp_path / "log.csv"))
    assert found.importer == "opensky"
    assert found.table["target_height_m"].to_pylist() == [None, None, 100.0, 100.0]
    assert found.table["target_height_std_m"].to_pylist() == [None, None, 50.0, 50.0]


@pytest.mark.parametrize(
    ("line", "fault"),
    [
        ('1,5,a,,,1,,1,"[[114,5]]"', "expected a list of [serial, time in ns, signal strength]"),
        ('1,5,a,,,1,,1,"[[114,""x"",1]]"', "expected a list of"),
        ('1,5,a,,,1,,1,"[[114,NaN,1]]"', "expected a list of"),
        ('1,5,a,,,1,,2,"[[114,5,1]]"', "got 1 measurements, expected 2 as in numMeasurements"),
        ('1,5,a,,,1,,1,"[[114,9223372036854775807,1]]"', "expected at most 4611686018427387904"),
        ('1,5,a,,,1,,1,"[[9,5,1]]"', "receivers.csv has no sensor '9'"),
        ('1,5,a,91,0,1,,1,"[[114,5,1]]"', "field 'latitude': got '91', expected a number from -90 to 90"),
        ('1.5,5,a,,,1,,1,"[[114,5,1]]"', "field 'id': got '1.5', expected an integer"),
        ("1,5,a,,,1,,1,[[114,5,1]]", "got 11 fields, expected 9 as in the header"),
    ],
)
def test_bad_messages_name_line_and_value(tmp_path: Path, line: str, fault: str) -> None:
    """One line per fault with file, line and what was expected; set aside, the others remain."""
    with pytest.raises(DataError, match=re.escape(fault)) as caught:
        opensky(tmp_path, '0,5,a,,,1,,1,"[[114,5,1]]"', line)
    assert "line 3" in str(caught.value)
    table = opensky(tmp_path, '0,5,a,,,1,,1,"[[114,5,1]]"', line, bad_rows=lambda rows: None)
    assert table["snapshot"].to_pylist() == [0]


def test_a_receiver_without_a_position_costs_only_its_rows(tmp_path: Path) -> None:
    """A receiver whose position is unknown (null) is a bad row of its own; the rest of the message remains."""
    bad: list[Any] = []
    receivers = "serial,latitude,longitude,height,type\n114,47,8,5,a\n7,NA,NA,NA,b\n"
    line = '0,5,a,,,1,,3,"[[114,5,1],[7,6,1],[114,8,2]]"'
    table = opensky(tmp_path, line, receivers=receivers, bad_rows=bad.extend)
    assert table["arrival_ns"].to_pylist() == [5, 8]
    assert [row.raw_line for row in bad] == ["[7,6]"]


@pytest.mark.parametrize(
    ("receivers", "message"),
    [
        ("serial,latitude,longitude\n1,2,3\n", "no column 'height'"),
        ("serial,latitude,longitude,height\n1,far,3,4\n", "line 2, field 'latitude': got 'far', expected a number"),
        ("serial,latitude,longitude,height\n1,2\n", "line 2: got 2 fields, expected 4"),
        ("serial,latitude,longitude,height\n1,,,\n", "contains no position"),
        ("", "the file is empty"),
    ],
)
def test_bad_tables_of_receivers(tmp_path: Path, receivers: str, message: str) -> None:
    """A fault in the table of receivers names that file, the line and the column."""
    with pytest.raises(DataError, match=re.escape(message)) as caught:
        opensky(tmp_path, '0,5,a,,,1,,1,"[[114,5,1]]"', receivers=receivers)
    assert "receivers.csv" in str(caught.value)


@pytest.mark.parametrize(
    ("importer", "file", "cure"),
    [
        ("opensky", "opensky.csv", "sensors"),
        ("soundfinder", "sounds.csv", "recorders"),
        ("util-tdoa", "util_tdoa.csv", "anchors"),
    ],
)
def test_logs_without_positions_name_both_cures(tmp_path: Path, importer: str, file: str, cure: str) -> None:
    """Neither a file of positions nor a scene: one line with the parameter and the scene; a missing file is named."""
    shutil.copy(FORMATS / file, tmp_path)
    done = run_here("convert", file, "--from", importer, "-o", "t.parquet", folder=tmp_path)
    assert done.returncode == 1
    (line,) = done.stderr.decode().splitlines()
    assert f"-p {cure}=FILE" in line or f"--param {cure}=FILE" in line
    assert "[[sensor]]" in line
    with pytest.raises(DataError, match=r"nowhere\.csv: can't be read"):
        Import(importer, {cure: "nowhere.csv"}).read(str(tmp_path / file))


def sounds(folder: Path, text: str, recorders: str = "recorder,x,y\na,0,0\nb,30,0\n", **parameters: Any) -> Any:
    """Return the table of sounds, with the recorders of a file."""
    (folder / "s.csv").write_text(text)
    (folder / "r.csv").write_text(recorders)
    return Import("soundfinder", {"recorders": str(folder / "r.csv"), **parameters}).read(str(folder / "s.csv")).table


def test_sound_travels_at_the_speed_of_the_temperature(tmp_path: Path) -> None:
    """Times become lengths at 331.3 sqrt(1 + T / 273.15) m/s of each sound; a std in seconds does too."""
    table = sounds(tmp_path, "idx,a,b,temp\nwren,0.5,0.25,20\n7,0.1,,0.0\n", arrival_std_s=1e-3)
    speed = 331.3 * math.sqrt(1 + 20 / 273.15)
    assert table["snapshot"].to_pylist() == ["wren", "wren", "7"]
    assert table["sensor"].to_pylist() == ["a", "b", "a"]
    np.testing.assert_allclose(table["arrival_m"], [0.5 * speed, 0.25 * speed, 33.13])
    np.testing.assert_allclose(table["arrival_std_m"], [1e-3 * speed, 1e-3 * speed, 0.3313])


def test_sounds_without_a_temperature(tmp_path: Path) -> None:
    """The parameter gives the temperature of sounds without one; else the line is a fault. Further columns are kept."""
    text = "idx,a,b,temp,species\n1,0.5,0.25,,wren\n"
    with pytest.raises(DataError, match="field 'temp': empty, expected degrees Celsius"):
        sounds(tmp_path, text)
    table = sounds(tmp_path, text, temperature_c=0.0, keep="species")
    np.testing.assert_allclose(table["arrival_m"], [165.65, 82.825])
    assert table["species"].to_pylist() == ["wren"] * 2
    without = sounds(tmp_path, "idx,species,a,b\n1,wren,0.5,0.25\n", temperature_c=0.0, keep="species")
    assert without["sensor"].to_pylist() == ["a", "b"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("idx,a,c,temp\n1,0.5,0.2,20\n", "r.csv has no sensor 'c'"),
        ("idx,a,b,temp\n1,soon,0.2,20\n", "field 'a': got 'soon', expected a number"),
        ("idx,temp\n1,20\n", "no column of a recorder between 'idx' and 'temp'"),
        ("name,a,b,temp\n1,0.5,0.2,20\n", "no column 'idx'"),
    ],
)
def test_bad_sounds(tmp_path: Path, text: str, message: str) -> None:
    """Unknown recorders, text for a time and tables of another form are named."""
    with pytest.raises(DataError, match=re.escape(message)):
        sounds(tmp_path, text)


def test_heights_of_recorders_come_from_the_table(tmp_path: Path) -> None:
    """The z of the published positions becomes the height of the sensors, for three dimensions."""
    table = sounds(tmp_path, "idx,a,b,temp\n1,0.5,0.25,20\n", "recorder,x,y,z\na,0,0,3\nb,30,0,4\n")
    assert table["sensor_z_m"].to_pylist() == [3.0, 4.0]


def util(folder: Path, rows: list[tuple[Any, ...]], **parameters: Any) -> Any:
    """Return the table of differences, with the anchors of a survey."""
    with (folder / "log.csv").open("w", newline="") as file:
        csv.writer(file).writerows([("t_tdoa", "idA", "idB", "tdoa_meas", "t_acc", "acc_x"), *rows])
    parameters = {"anchors": str(FORMATS / "anchor_survey.txt"), **parameters}
    return Import("util-tdoa", parameters).read(str(folder / "log.csv")).table


def test_differences_are_of_idb_to_the_reference_ida(tmp_path: Path) -> None:
    """tdoa_meas = d(idB) - d(idA): idA is the reference; lines of other sensors alone are no measurements."""
    rows = [(0.01, 7.0, 0.0, -1.5, 0.0, 0.1), (0.02, "0", "1", 2.25, "", ""), ("", "", "", "", 0.3, 0.1)]
    table = util(tmp_path, rows, keep="acc_x", arrival_std_m=0.1)
    assert table["sensor"].to_pylist() == ["0", "1"]
    assert table["reference"].to_pylist() == ["7", "0"]
    assert table["tdoa_m"].to_pylist() == [-1.5, 2.25]
    assert table["reference_x_m"].to_pylist() == [-2.7228, -2.4175]
    assert table["reference_z_m"].to_pylist() == [0.1583, 0.1818]
    assert table["sensor_y_m"].to_pylist() == [-4.0208, 3.525]
    assert table["time_s"].to_pylist() == [0.01, 0.02]
    assert table["acc_x"].to_pylist() == ["0.1", None]
    assert table["snapshot"].to_pylist() == ["0.01", "0.01"]


def test_pairs_that_repeat_in_a_window_keep_their_names(tmp_path: Path) -> None:
    """The same pair twice in a window are two rows of one sensor; another width makes other snapshots."""
    rows = [(0.01 * step, step % 2, 2 + step % 2, 0.5, "", "") for step in range(6)]
    table = util(tmp_path, rows, window="1s")
    assert set(table["sensor"].to_pylist()) == {"2", "3"}
    assert len(set(table["snapshot"].to_pylist())) == 1
    assert len(set(util(tmp_path, rows, window="20ms")["snapshot"].to_pylist())) == 3


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ((0.1, 0.5, 1, 2.0), "field 'idA': got '0.5', expected the number of an anchor"),
        ((0.1, 0, 9, 2.0), "anchor_survey.txt has no sensor '9'"),
        ((0.1, 0, 1, "x"), "field 'tdoa_meas': got 'x', expected a number"),
        ((0.1, 0, 1, ""), "field 'tdoa_meas': got '', expected a number"),
    ],
)
def test_bad_differences(tmp_path: Path, row: tuple[Any, ...], message: str) -> None:
    """A line with a time has both anchors and a difference, each reported with line and column."""
    with pytest.raises(DataError, match=re.escape(message)) as caught:
        util(tmp_path, [(*row, "", "")])
    assert "line 2" in str(caught.value)


def test_a_survey_with_a_fault(tmp_path: Path) -> None:
    """Orientations of a survey are passed over; a position that is not three numbers is named."""
    (tmp_path / "survey.txt").write_text("an0_quat,1,0,0,0\nan0_p,1,2\n")
    with pytest.raises(DataError, match=r"survey.txt, line 2: got 3 fields, expected an0_p,x,y,z"):
        util(tmp_path, [(0.1, 0, 1, 2.0, "", "")], anchors=str(tmp_path / "survey.txt"))
    (tmp_path / "survey.txt").write_text("an0_quat,1,0,0,0\n")
    with pytest.raises(DataError, match=r"survey.txt: contains no position"):
        util(tmp_path, [(0.1, 0, 1, 2.0, "", "")], anchors=str(tmp_path / "survey.txt"))


def test_the_sample_without_a_clock_is_left_out_by_its_type(tmp_path: Path) -> None:
    """With the unsynchronized receiver the fix is far off; without it, by ``--where``, the truth is met."""
    for name in ("opensky.csv", "opensky_sensors.csv"):
        shutil.copy(FORMATS / name, tmp_path)
    convert = ["convert", "opensky.csv", "--from", "auto", "-p", "sensors=opensky_sensors.csv", "-q", "-o"]
    assert (
        run_here(*convert, "synchronized.parquet", "--where", "sensor_type != dump1090", folder=tmp_path).returncode
        == 0
    )
    words = ["--dimensions", "3", "-m", "ml", "--arrival-std-ns", "50", "-q"]
    assert run_here("localize", "synchronized.parquet", *words, "-o", "fix.parquet", folder=tmp_path).returncode == 0
    assert run_here("evaluate", "fix.parquet", "--fail-if", "horizontal_rmse_m>10", folder=tmp_path).returncode == 0
    assert run_here("convert", "fix.parquet", "-o", "fix.geojson", folder=tmp_path).returncode == 0
    features = json.loads((tmp_path / "fix.geojson").read_text())["features"]
    heights = [feature["geometry"]["coordinates"][2] for feature in features if feature["geometry"]["type"] == "Point"]
    assert all(abs(height - 10850.0) < 120.0 for height in heights)
    assert nlosctl.read(tmp_path / "fix.parquet").num_rows == 4


def test_a_column_for_each_sensor_needs_no_importer(tmp_path: Path) -> None:
    """``--wide`` reads integers of a column per sensor; they stay integers, and the fix is the published one."""
    stamps = {"g1": 12510210, "g2": 12513627, "g3": 12515278, "g4": 12514654}
    epoch = 1_700_000_000_000_000_000
    (tmp_path / "wide.csv").write_text(
        ",".join(["snapshot", *(f"toa_{name}" for name in stamps)])
        + "\n"
        + ",".join(["a", *(str(epoch + stamp) for stamp in stamps.values())])
        + "\n"
    )
    places = {"g1": (0, 0), "g2": (6200, 400), "g3": (5100, 5600), "g4": (-900, 4800)}
    (tmp_path / "wide.scene.toml").write_text(
        "".join(f'[[sensor]]\nname = "{name}"\nposition = [{x}, {y}]\n' for name, (x, y) in places.items())
    )
    words = ["localize", "wide.csv", "--wide", "arrival_ns=toa_*", "-m", "ml", "--arrival-std-ns", "1", "-q"]
    done = run_here(*words, "-o", "fix.csv", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    (fix,) = nlosctl.read(tmp_path / "fix.csv").to_pylist()
    assert math.dist((float(fix["x_m"]), float(fix["y_m"])), (2400.0, 1900.0)) < 0.5


def test_parameters_of_positions_are_those_of_each_importer() -> None:
    """A parameter of another importer is a usage error that lists those there are."""
    with pytest.raises(UsageError, match="no parameter 'sensors'"):
        Import("soundfinder", {"sensors": "x"})
