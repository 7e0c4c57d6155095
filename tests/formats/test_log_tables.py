"""Importers of tables: ISO 8601 times, tabs, semicolons, JSON Lines, and one column per sensor."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from nlosctl.errors import DataError, UsageError
from nlosctl.pipeline.convert.importer import Import

SCENE = "".join(f'[[sensor]]\nname = "A{n}"\nposition = [{n}, 0]\nheading_deg = 0\n' for n in (1, 2, 3))


def table(folder: Path, importer: str, text: str, **parameters: Any) -> Any:
    """Return the table of a log with the anchors A1 to A3."""
    (folder / "log").write_text(text)
    (folder / "log.scene.toml").write_text(SCENE)
    return Import(importer, parameters).read(str(folder / "log")).table


@pytest.mark.parametrize("separator", [",", "\t", ";"])
@pytest.mark.parametrize(("importer", "value"), [("uwb", "range"), ("anchor-azimuths", "azimuth_deg")])
def test_iso_times_and_separators(tmp_path: Path, importer: str, value: str, separator: str) -> None:
    """ISO times stay as they are in column ``time``, and make windows across offsets; separators are found."""
    names = {"time": "t", "anchor" if importer == "uwb" else "sensor": "who"}
    rows = [
        ["t", "who", value],
        ["2024-06-10T08:00:00.000Z", "A1", "5"],
        ["2024-06-10T10:00:00.020+02:00", "A2", "6"],
        ["2024-06-10T08:00:01.000Z", "A1", "7"],
    ]
    text = "\n".join(separator.join(row) for row in rows) + "\n"
    read = table(tmp_path, importer, text, **names)
    assert read["snapshot"].to_pylist() == ["2024-06-10T08:00:00Z", "2024-06-10T08:00:00Z", "2024-06-10T08:00:01Z"]
    assert read["time"].to_pylist() == [row[0] for row in rows[1:]]
    assert "time_s" not in read.column_names


@pytest.mark.parametrize(
    ("first", "second", "says"),
    [
        ("2024-06-10T08:00:00Z", "2024-06-10T08:00:01", "expected ISO 8601 with an offset or Z as in line 2"),
        ("2024-06-10T08:00:00", "2024-06-10T08:00:01Z", "expected ISO 8601 without an offset as in line 2"),
        ("2024-06-10T08:00:00Z", "12.5", "got '12.5', expected ISO 8601 with an offset or Z as in line 2"),
        ("1", "2024-06-10T08:00:00Z", "expected a number as in line 2"),
        ("1", "2024-06-31T08:00:00Z", "expected a time such as 2024-06-10T06:13:19.985Z"),
    ],
)
def test_mixed_and_impossible_times(tmp_path: Path, first: str, second: str, says: str) -> None:
    """A log has one form of times; a row of another is a bad line."""
    with pytest.raises(DataError, match=f"line 3, field 'time': .*{says}"):
        table(tmp_path, "uwb", f"time,anchor,range\n{first},A1,5\n{second},A2,6\n")


def test_json_lines(tmp_path: Path) -> None:
    """JSON Lines are tables: numbers or texts, keys in any order, absent ones empty, other keys to keep."""
    text = (
        '{"time": 1.5, "anchor": "A1", "range": 5, "rssi": -60}\n'
        '{"range": "6.25", "anchor": "A2", "time": 1.52, "nested": {"a": [1]}}\n'
    )
    read = table(tmp_path, "uwb", text, keep="rssi")
    assert read["range_m"].to_pylist() == [5.0, 6.25]
    assert read["time_s"].to_pylist() == [1.5, 1.52]
    assert read["rssi"].to_pylist() == ["-60", None]
    with pytest.raises(DataError, match="line 2, field 'range': got '', expected a number"):
        table(tmp_path, "uwb", text.replace('"range": "6.25", ', ""))
    with pytest.raises(DataError, match=r"no column 'dist'. The file has: time, anchor, range, rssi"):
        table(tmp_path, "uwb", text, range="dist")


def test_one_column_per_anchor(tmp_path: Path) -> None:
    """What * matches is the sensor, or the whole header where that is a sensor; empty cells are no ranges."""
    text = "timestamp,A1,A2,A3,note\n0,5,,7,x\n1,6,6.5,7.5,y\n"
    read = table(tmp_path, "uwb", text, time="timestamp", range="A*", keep="note")
    assert read["sensor"].to_pylist() == ["A1", "A3", "A1", "A2", "A3"]
    assert read["range_m"].to_pylist() == [5.0, 7.0, 6.0, 6.5, 7.5]
    assert read["note"].to_pylist() == ["x", "x", "y", "y", "y"]
    assert read["snapshot"].to_pylist() == ["0", "0", "1", "1", "1"]
    wide = "t;az_A1_deg;az_A2_deg\n0;5;-5\n"
    read = table(tmp_path, "anchor-azimuths", wide, time="t", azimuth="az_*_deg")
    assert read.select(["sensor", "azimuth_deg"]).to_pylist() == [
        {"sensor": "A1", "azimuth_deg": 5.0},
        {"sensor": "A2", "azimuth_deg": 355.0},
    ]


def test_faults_of_columns_per_anchor(tmp_path: Path) -> None:
    """A pattern without columns, with two stars, and stds in columns are errors; a bad cell names its column."""
    text = "time,d_A1,d_A2\n0,5,far\n"
    with pytest.raises(DataError, match=r"no column fits 'r_\*'. It has: time, d_A1, d_A2"):
        table(tmp_path, "uwb", text, range="r_*")
    with pytest.raises(UsageError, match=r"a name with one \*"):
        table(tmp_path, "uwb", text, range="*_*")
    with pytest.raises(UsageError, match="takes range_std_m, not std or variance"):
        table(tmp_path, "uwb", text, range="d_*", std="s")
    with pytest.raises(DataError, match=r"line 2, field 'd_A2': got 'far', expected a number"):
        table(tmp_path, "uwb", text, range="d_*")


def test_groups_separate_snapshots(tmp_path: Path) -> None:
    """``group=A,B`` gives each pair of values snapshots of its own, in place of the tag."""
    text = "time,anchor,range,day,run\n0,A1,5,mo,1\n0,A1,6,mo,2\n0.01,A2,7,mo,1\n"
    read = table(tmp_path, "uwb", text, group="day,run")
    assert read["snapshot"].to_pylist() == ["day-mo/run-1/0", "day-mo/run-1/0", "day-mo/run-2/0"]
    assert read["range_m"].to_pylist() == [5.0, 7.0, 6.0]


@pytest.mark.parametrize("separator", ["\t", ";", ","])
def test_wildlife_tables_of_other_programs(tmp_path: Path, separator: str) -> None:
    """Columns of razimuth are known, those of others are named, with any separator."""
    grouse = (
        "indiv,obs_id,utm_x,utm_y,azimuth,date,prior_r\nhen,1,0,0,45,2018-05-04,1000\nhen,1,100,0,315,2018-05-04,1000\n"
    )
    read = table(tmp_path, "wildlife", grouse.replace(",", separator), keep="indiv")
    assert read.select(["snapshot", "azimuth_deg", "indiv"]).to_pylist()[1] == {
        "snapshot": "1",
        "azimuth_deg": 315.0,
        "indiv": "hen",
    }
    other = "Group,Station,X,Y,Bearing\nF013,s1,0,0,45\nF013,s2,100,0,315\n".replace(",", separator)
    read = table(tmp_path, "wildlife", other, group="Group", x="X", y="Y", azimuth="Bearing", station="Station")
    assert read["sensor"].to_pylist() == ["s1", "s2"]
