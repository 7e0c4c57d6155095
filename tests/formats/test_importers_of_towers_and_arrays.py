"""Azimuths from towers (White and Garrott), directions of microphone arrays (ODAS), and angle events with elevation."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest
from program import run_here

import nlosctl
from nlosctl.errors import DataError, UsageError
from nlosctl.pipeline.convert.importer import Import

FORMATS = Path(__file__).parents[2] / "fixtures" / "formats"

PUBLISHED = """06/10/84   13:31:34   340 S  6  48 7 331 8 160
06/10/84   14:34:55   340 S  6  47 7 323 8 167
06/10/84   20:09:15   340 S  6   0 7 324 8 154
06/10/84   22:10:16   340 M  6  49 7   0 8 164
08/03/84   00:33:41   340 M  6  35 7 343 8  59
"""
FIXES = [(751147, 4394578), (751087, 4394506), (751643, 4393672), (751126, 4394529), (751202, 4395153)]
"""Lines of the published azimuth.dat, and the fixes of the published fixes.dat (Lenth's estimator, whole metres)."""

TOWERS = {"6": (750142, 4393673), "7": (751674, 4393630), "8": (750985, 4395022)}


def tower_scene(folder: Path) -> str:
    """Write a scene of the towers, named by their numbers."""
    text = "".join(f'[[sensor]]\nname = "{name}"\nposition = [{x}, {y}]\n' for name, (x, y) in TOWERS.items())
    (folder / "towers.toml").write_text(text)
    return str(folder / "towers.toml")


def test_published_fixes_of_white_and_garrott(tmp_path: Path) -> None:
    """Two and three towers, a 0 for no bearing: the fixes are those of the published program, within 2 m."""
    (tmp_path / "azimuth.dat").write_text(PUBLISHED)
    words = ["--from", "white-garrott", "--scene", tower_scene(tmp_path), "-q", "-o", "b.parquet"]
    assert run_here("convert", "azimuth.dat", *words, folder=tmp_path).returncode == 0
    words = [
        "--bearing-std-deg",
        "3",
        "--carry",
        "animal",
        "--carry",
        "sex",
        "--carry",
        "time",
        "-q",
        "-o",
        "e.parquet",
    ]
    done = run_here("localize", "b.parquet", *words, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    table = nlosctl.read(tmp_path / "e.parquet")
    for row, (x, y) in zip(table.select(["x_m", "y_m"]).to_pylist(), FIXES, strict=True):
        assert math.hypot(row["x_m"] - x, row["y_m"] - y) < 2.0
    assert table["animal"].to_pylist() == ["340"] * 5
    assert table["sex"].to_pylist() == ["S", "S", "S", "M", "M"]
    assert table["time"].to_pylist()[-1] == "1984-08-03T00:33:41"


def towers(folder: Path, text: str, **parameters: Any) -> Any:
    """Return the table of an azimuth.dat with the towers of the scene, or of the parameters."""
    (folder / "a.dat").write_text(text)
    scene = None if "towers" in parameters else tower_scene(folder)
    return Import("white-garrott", parameters, scene_file=scene).read(str(folder / "a.dat")).table


def test_towers_of_a_file(tmp_path: Path) -> None:
    """Tower k is line k of the file; a tower that it lacks is named, and so is a file that is not of positions."""
    (tmp_path / "t.dat").write_text("0.,0.\n100.,0.\n")
    table = towers(tmp_path, "6/1/84 1:02:03 F2 M 1 45 2 315\n", towers=str(tmp_path / "t.dat"))
    assert table["sensor"].to_pylist() == ["1", "2"]
    assert table["sensor_x_m"].to_pylist() == [0.0, 100.0]
    assert table["snapshot"].to_pylist() == ["F2/1984-06-01T01:02:03"] * 2
    with pytest.raises(DataError, match="line 1, field 'tower': got '3', expected a tower: 1, 2"):
        towers(tmp_path, "6/1/84 1:02:03 F2 M 1 45 3 315\n", towers=str(tmp_path / "t.dat"))
    (tmp_path / "t.dat").write_text("0.,0.\nx,1\n")
    with pytest.raises(DataError, match=r"t\.dat, line 2: got 'x', expected a number"):
        towers(tmp_path, PUBLISHED, towers=str(tmp_path / "t.dat"))
    with pytest.raises(DataError, match="has no positions of the towers: `parameters` towers=FILE"):
        Import("white-garrott", {}).read(str(tmp_path / "a.dat"))


def test_attempts_are_snapshots_or_grouped(tmp_path: Path) -> None:
    """Every line is a snapshot, also a repeated one; ``group`` pools the lines of a day."""
    line = PUBLISHED.splitlines(keepends=True)[0]
    table = towers(tmp_path, line * 2)
    assert table["snapshot"].to_pylist() == ["340/1984-06-10T13:31:34"] * 3 + ["340/1984-06-10T13:31:34#2"] * 3
    table = towers(tmp_path, line * 2, group="animal,date", declination_deg=2)
    assert set(table["snapshot"].to_pylist()) == {"340/06/10/84"}
    assert table["sensor"].to_pylist() == ["6", "7", "8", "6#2", "7#2", "8#2"]
    assert table["azimuth_deg"].to_pylist()[0] == 50.0


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("06/10/84 13:31:34 340 S 6 48 7\n", "got 7 fields, expected date, time, animal, sex and pairs"),
        ("13/10/84 13:31:34 340 S 6 48\n", "field 'date': got '13/10/84 13:31:34', expected month/day/year"),
        ("06/10/84 13:31:34 340 S 6 361\n", "field 'azimuth of tower 6': got '361', expected a number from 0 to 360"),
    ],
)
def test_bad_attempts(tmp_path: Path, text: str, says: str) -> None:
    """A bad line is reported with what was expected."""
    with pytest.raises(DataError, match=f"line 1.*{says}"):
        towers(tmp_path, text)


def sound(
    folder: Path, frames: dict[str, list[tuple[int, list[dict[str, Any]]]]], scene: str, **parameters: Any
) -> Any:
    """Return the table of arrays by name, with their frames of time stamp and slots."""
    for name, content in frames.items():
        text = "\n".join(json.dumps({"timeStamp": stamp, "src": slots}, indent=4) for stamp, slots in content)
        (folder / f"{name}.json").write_text(text)
    (folder / "s.toml").write_text(scene)
    job = Import("odas", parameters, scene_file=str(folder / "s.toml"))
    return job.read(*(str(folder / f"{name}.json") for name in frames)).table


def slot(azimuth_deg: float, elevation_deg: float = 0.0, **more: Any) -> dict[str, Any]:
    """Return the unit vector of a direction counter-clockwise from +x, with three decimals."""
    azimuth, elevation = math.radians(azimuth_deg), math.radians(elevation_deg)
    x, y = math.cos(elevation) * math.cos(azimuth), math.cos(elevation) * math.sin(azimuth)
    return {"x": round(x, 3), "y": round(y, 3), "z": round(math.sin(elevation), 3), **more}


OFF = {"x": 0.0, "y": 0.0, "z": 0.0, "E": 0.0}
PLAIN = '[[sensor]]\nname = "a"\nposition = [0, 0, 1.5]\n[[sensor]]\nname = "b"\nposition = [4, 0, 1.5]\n'


def test_arrays_in_the_axes_of_the_frame(tmp_path: Path) -> None:
    """Without heading the array's axes are the frame's; files are joined by time stamp, unused slots left out."""
    frames = {
        "a": [(7, [slot(30, 10, E=0.5), OFF]), (8, [slot(45), OFF])],
        "b": [(7, [slot(120)]), (8, [slot(135)]), (9, [OFF])],
    }
    table = sound(tmp_path, frames, PLAIN)
    assert table["snapshot"].to_pylist() == [7, 7, 8, 8]
    assert table["sensor"].to_pylist() == ["a", "b", "a", "b"]
    assert table["bearing_deg"].to_pylist() == pytest.approx([30, 120, 45, 135], abs=0.06)
    assert table["elevation_deg"].to_pylist() == pytest.approx([10, 0, 0, 0], abs=0.06)
    assert table["sensor_z_m"].to_pylist() == [1.5] * 4
    assert "path" not in table.column_names
    assert table["energy"].to_pylist() == [0.5, None, None, None]


def test_a_heading_turns_the_array(tmp_path: Path) -> None:
    """``heading_deg`` is the azimuth of the array's +x axis, clockwise; directions turn counter-clockwise from it."""
    scene = PLAIN.replace("1.5]", "1.5]\nheading_deg = 90")
    table = sound(tmp_path, {"a": [(1, [slot(30)])]}, scene)
    assert table["azimuth_deg"].to_pylist() == pytest.approx([60], abs=0.06)
    table = sound(tmp_path, {"a": [(1, [slot(30)])]}, scene.replace("heading_deg = 90", "heading_deg = 0"))
    assert table["azimuth_deg"].to_pylist() == pytest.approx([330], abs=0.06)
    with pytest.raises(DataError, match="only some arrays have a heading_deg"):
        sound(tmp_path, {"a": [(1, [slot(3)])], "b": [(1, [slot(3)])]}, scene.replace("heading_deg = 90", "", 1))


def test_several_sources_are_paths(tmp_path: Path) -> None:
    """Several directions of an array at a time have path numbers; ``group`` separates them by a field."""
    two = [slot(30, id=5, tag="left", activity=0.9), slot(60, id=6, tag="right", activity=0.8)]
    table = sound(tmp_path, {"a": [(1, two), (2, two[:1])]}, PLAIN)
    assert table["path"].to_pylist() == [0, 1, 0]
    assert table["source_id"].to_pylist() == [5, 6, 5]
    table = sound(tmp_path, {"a": [(1, two), (2, two)]}, PLAIN, group="tag", keep="tag")
    assert table["snapshot"].to_pylist() == ["left/1", "right/1", "left/2", "right/2"]
    assert table["tag"].to_pylist() == ["left", "right"] * 2


@pytest.mark.parametrize(
    ("frames", "says"),
    [
        ([(2, [slot(1)]), (1, [slot(1)])], "line .*: the timeStamp goes back from 2 to 1: several recordings"),
        ([(1, [{"x": 0.5, "y": 0.0, "z": 0.0}])], "field 'x, y, z': got a vector of length 0.5, expected 1"),
        ([(1, [{"x": 0.5}])], "field 'y': got '', expected a number"),
        ([(-1, [slot(1)])], "field 'timeStamp': got '-1', expected an integer"),
        ([(1, "none")], "expected an object with timeStamp and a list src"),
    ],
)
def test_bad_frames(tmp_path: Path, frames: Any, says: str) -> None:
    """A bad frame is reported with its line and column."""
    with pytest.raises(DataError, match=says):
        sound(tmp_path, {"a": frames}, PLAIN)


def test_the_array_must_be_in_the_scene(tmp_path: Path) -> None:
    """The file's stem, or the parameter, is the name of a sensor; a name for several files is a usage error."""
    frames = {"c": [(1, [slot(1)])]}
    with pytest.raises(DataError, match="the scene has no sensor 'c'"):
        sound(tmp_path, frames, PLAIN)
    assert sound(tmp_path, frames, PLAIN, sensor="a")["sensor"].to_pylist() == ["a"]
    with pytest.raises(UsageError, match="'sensor' only with one file"):
        sound(tmp_path, {**frames, "a": frames["c"]}, PLAIN, sensor="a")


def test_files_of_different_programs_are_not_one_table(tmp_path: Path) -> None:
    """Several files need an importer that joins them, and one and the same."""
    done = run_here(
        "convert", *map(str, [FORMATS / "array_a.json", FORMATS / "kraken_app.csv"]), "--from", "auto", "-o", "x.csv"
    )
    assert (done.returncode, b"is for the importer 'kraken-csv'" in done.stderr) == (1, True)
    twice = [str(FORMATS / "kraken_app.csv")] * 2
    done = run_here("convert", *twice, "--from", "kraken-csv", "-o", str(tmp_path / "x.csv"))
    assert (done.returncode, b"got 2 files, expected one file" in done.stderr) == (2, True)


def test_angle_events_keep_heights_and_fields(tmp_path: Path) -> None:
    """Elevation and the anchor's height are columns, and so are fields by their names in the manual."""
    (tmp_path / "l.log").write_text('+UUDF:6C1DEBA4241B,-52,10,-35,-43,37,"A","x",15869,23\n')
    (tmp_path / "l.scene.toml").write_text('[[sensor]]\nname = "A"\nposition = [1, 2, 2.5]\nheading_deg = 0\n')
    table = Import("uudf", {"keep": "user_defined_str", "group": "channel"}).read(str(tmp_path / "l.log")).table
    assert table.select(["elevation_deg", "sensor_z_m", "user_defined_str"]).to_pylist() == [
        {"elevation_deg": -35.0, "sensor_z_m": 2.5, "user_defined_str": "x"}
    ]


def test_several_files_from_python() -> None:
    """``read`` takes a list of paths for an importer that joins files; anything else than paths is a usage error."""
    paths = [FORMATS / "array_a.json", FORMATS / "array_b.json"]
    table = nlosctl.read(paths, importer="auto")
    assert table["sensor"].to_pylist() == ["array_a", "array_b"] * 2
    for wrong in ([], [1], {"a": [1]}):
        with pytest.raises(UsageError, match="an importer reads files; give their paths"):
            nlosctl.read(wrong, importer="auto")  # type: ignore[arg-type]
