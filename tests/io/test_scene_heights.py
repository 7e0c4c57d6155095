"""Heights of the sensors in the scene, and the schema of scenes."""

from __future__ import annotations

import json
from pathlib import Path

import msgspec
import pytest
from program import run_here

from nlosctl.errors import DataError
from nlosctl.io.scenes.scene_entries import REFLECTOR_KINDS, FrameEntry, SensorEntry
from nlosctl.io.scenes.scene_file import scene_from_toml, scene_to_toml
from nlosctl.io.scenes.scene_schema import scene_keys, scene_schema

HALL = "".join(
    f'[[sensor]]\nname = "A{n}"\nposition = {position}\n\n'
    for n, position in enumerate([[0, 0, 4], [10, 0, 4], [10, 8, 4], [0, 8, 4]], 1)
)
LOG = "time,anchor,range\n" + "".join(f"0.0{n},A{n},{r}\n" for n, r in enumerate([5.83, 7.35, 8.37, 7.07], 1))


def test_heights_survive_a_round_trip() -> None:
    """A scene with heights reads back equal; one without is written as before."""
    scene = scene_from_toml(HALL, "s.toml")
    assert [sensor.z_m for sensor in scene.sensors] == [4.0] * 4
    assert [sensor.position for sensor in scene.sensors][1] == (10.0, 0.0)
    assert "position = [10.0, 0.0, 4.0]" in scene_to_toml(scene)
    assert scene_from_toml(scene_to_toml(scene), "again") == scene


@pytest.mark.parametrize(
    ("position", "message"),
    [
        ("[0, 0]", r"sensor\[4\].position: got \[0.0, 0.0\], expected 3 numbers as for sensor\[0\]"),
        ("[0]", r"expected two numbers, \[x, y\], or three with the height"),
        ("[0, 0, 0, 0]", r"expected two numbers, \[x, y\], or three with the height"),
        ('[0, 0, "high"]', r"expected two numbers, \[x, y\], or three with the height"),
    ],
)
def test_all_sensors_or_none_have_a_height(position: str, message: str) -> None:
    """Two and three coordinates in one scene, and any other number of them, are errors that name the sensor."""
    with pytest.raises(DataError, match=message):
        scene_from_toml(f'{HALL}[[sensor]]\nname = "A5"\nposition = {position}\n', "s.toml")


@pytest.mark.parametrize("output", ["r.parquet", "r.csv"])
def test_slant_ranges_need_heights_once(tmp_path: Path, output: str) -> None:
    """Heights in the scene serve ``--target-z-m`` after an import: the fix is where the column puts it, at (4, 3)."""
    (tmp_path / "s.toml").write_text(HALL)
    (tmp_path / "log.csv").write_text(LOG)
    words = ["log.csv", "--from", "uwb", "--scene", "s.toml", "-p", "range_std_m=0.05", "--window", "1s", "-o", output]
    done = run_here("convert", *words, "-q", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    done = run_here("localize", output, "--target-z-m", "1", "-q", "--format", "jsonl", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    fix = json.loads(done.stdout)
    assert (fix["x_m"], fix["y_m"]) == (pytest.approx(4.0, abs=0.01), pytest.approx(3.0, abs=0.01))


def test_heights_that_are_missing(tmp_path: Path) -> None:
    """Without heights ``--target-z-m`` names both places where they may be."""
    (tmp_path / "s.toml").write_text(HALL.replace(", 4]", "]"))
    rows = "".join(f"1,A{n},{r},0.05\n" for n, r in enumerate([5.83, 7.35, 8.37, 7.07], 1))
    (tmp_path / "r.csv").write_text(f"snapshot,sensor,range_m,range_std_m\n{rows}")
    words = ["localize", "r.csv", "--scene", "s.toml", "--target-z-m", "1"]
    done = run_here(*words, folder=tmp_path)
    assert done.returncode == 2
    assert b"a column 'sensor_z_m', or position = [x, y, z] in the scene" in done.stderr
    (tmp_path / "s.toml").write_text(HALL)
    assert run_here(*words, "-q", folder=tmp_path).returncode == 0
    (tmp_path / "s.toml").write_text(HALL.rpartition("[[sensor]]")[0])
    anchors = [(0, 0, 5.83), (10, 0, 7.35), (10, 8, 8.37), (0, 8, 7.07)]
    rows = "".join(f"1,A{n},{x},{y},{r},0.05\n" for n, (x, y, r) in enumerate(anchors, 1))
    (tmp_path / "r.csv").write_text(f"snapshot,sensor,sensor_x_m,sensor_y_m,range_m,range_std_m\n{rows}")
    done = run_here(*words, folder=tmp_path)
    assert (done.returncode, b"the scene lacks some sensors" in done.stderr) == (2, True), done.stderr


def test_the_schema_of_a_scene(tmp_path: Path) -> None:
    """``schema scene`` has every key of the entries that read scenes; with --json it is a JSON Schema."""
    keys = {(row["table"], row["key"]) for row in scene_keys()}
    entries = {"[[sensor]]": SensorEntry, "[frame]": FrameEntry}
    entries |= {f"[[reflector]] {kind}": entry for kind, entry in REFLECTOR_KINDS.items()}
    expected = {
        (table, field.encode_name) for table, entry in entries.items() for field in msgspec.structs.fields(entry)
    }
    assert keys == expected | {(f"[[reflector]] {kind}", "kind") for kind in REFLECTOR_KINDS}
    done = run_here("schema", "scene", "--json", folder=tmp_path)
    assert json.loads(done.stdout) == json.loads(json.dumps(scene_schema()))
    jsonschema = pytest.importorskip("jsonschema")
    import tomllib

    jsonschema.validate(tomllib.loads(HALL), scene_schema())
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(tomllib.loads(HALL.replace("[0, 0, 4]", "[0]")), scene_schema())
    shown = run_here("schema", "scene", folder=tmp_path).stdout.decode()
    assert "position" in shown
    assert "blocker_radius" in shown
