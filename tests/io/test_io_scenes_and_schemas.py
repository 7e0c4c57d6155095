"""Scene files and table schemas."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from reading_support import FIXTURES

from nlosctl.contract.scene import LineReflector, Scene, Sensor
from nlosctl.contract.tables import TABLES
from nlosctl.errors import DataError
from nlosctl.io.scenes.scene_file import SCENE_KEY, find_scene, scene_from_toml, scene_to_toml
from nlosctl.io.schemas import schema_text, write_schemas

_NUMBER = re.compile(r"(\d+\.\d+(?:e[+-]?\d+)?)")
"""Numbers with a decimal point, without their sign."""

ROOT = FIXTURES.parent
NUMBERS = st.floats(-1e15, 1e15)
NAMES = st.lists(st.text(min_size=1, max_size=8), unique=True, max_size=3)
LINE = '[[reflector]]\nname = "w"\nkind = "line"\n'


@pytest.mark.extensive
@settings(max_examples=50, deadline=None)
@given(names=NAMES, x=NUMBERS, y=NUMBERS, heading=st.none() | NUMBERS)
def test_a_scene_reads_back_equal(names: list[str], x: float, y: float, heading: float | None) -> None:
    """A scene is unchanged after writing and reading, for any names and numbers."""
    scene = Scene(
        sensors=tuple(Sensor(name=name, position=(x, y), heading_deg=heading) for name in names),
        reflectors=tuple(LineReflector(name=name, point=(y, x), direction=(1.0, y)) for name in names),
    )
    assert scene_from_toml(scene_to_toml(scene), "scene.toml") == scene


def test_slope_and_intercept_are_a_line() -> None:
    """y = slope x + intercept goes through (0, intercept) along (1, slope)."""
    (line,) = scene_from_toml(LINE + "slope = 0.5\nintercept = 5000", "s.toml").reflectors
    assert (line.point, line.direction) == ((0.0, 5000.0), (1.0, 0.5))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[[reflector]\n", "line 1"),
        ("[[reflectors]]\n", "did you mean 'reflector'"),
        ('[[reflector]]\nname = "w"\nkind = "lin"\n', "did you mean 'line'"),
        ('[[reflector]]\nname = "w"\n', "reflector[0].kind: got nothing"),
        (LINE + "point = [0, 0]\n", "reflector[0].direction: missing"),
        (LINE + "point = [0, 0]\ndirection = [0, 0]\n", "got [0, 0]"),
        (LINE + "point = [0, nan]\ndirection = [0, 1]\n", "expected finite numbers"),
        (LINE + "point = [0]\ndirection = [0, 1]\n", "reflector[0].point: got [0], expected two numbers"),
        (LINE + "point = [0, 0]\ndirecton = [0, 1]\n", "did you mean 'direction'"),
        (LINE + "point = [0, 0]\nslope = 1\n", "one of the two pairs"),
        (2 * (LINE + "slope = 1\nintercept = 0\n"), "reflector[1].name: 'w' is taken by reflector[0]"),
        ('[[sensor]]\nname = "a"\n', "sensor[0].position: missing, expected two numbers"),
        ("[[sensor]]\nname = 5\nposition = [0, 0]\n", "sensor[0].name: got 5, expected text"),
        ('[sensor]\nname = "a"\n', "[[sensor]]"),
    ],
)
def test_a_malformed_scene_names_the_key(text: str, message: str) -> None:
    """The error names file, key, value and expectation."""
    with pytest.raises(DataError) as caught:
        scene_from_toml(text, "my.scene.toml")
    assert str(caught.value).startswith("my.scene.toml: ")
    assert message in str(caught.value)


def test_the_nearest_scene_wins(tmp_path: Path) -> None:
    """The option, then the metadata, then STEM.scene.toml, then scene.toml; else the scene is empty."""

    def text(name: str) -> str:
        return scene_to_toml(Scene(sensors=(Sensor(name=name, position=(0.0, 0.0)),)))

    data = tmp_path / "run.1.csv.gz"
    metadata = {SCENE_KEY: text("metadata").encode()}
    assert find_scene(None, {}, data) == Scene()
    for file in ("scene.toml", "run.1.scene.toml", "option.toml"):
        (tmp_path / file).write_text(text(file))
        found = find_scene(None, {}, data).sensors[0].name
        assert found == ("scene.toml" if file == "scene.toml" else "run.1.scene.toml")
    assert find_scene(None, metadata, data).sensors[0].name == "metadata"
    assert find_scene(str(tmp_path / "option.toml"), metadata, data).sensors[0].name == "option.toml"
    with pytest.raises(DataError, match="can't be read"):
        find_scene(str(tmp_path / "absent.toml"), {}, None)


def test_schemas_are_fresh(tmp_path: Path) -> None:
    """schemas/ follows from the table definitions; `write_schemas` generates it."""
    assert {path.name for path in (ROOT / "schemas").iterdir()} == {path.name for path in write_schemas(tmp_path)}
    for name, table in TABLES.items():
        assert (ROOT / "schemas" / f"{name}.json").read_text(encoding="utf-8") == schema_text(table)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(
    ("name", "valid"),
    [
        ("good_bearings.csv", True),
        ("good_triplets.csv", True),
        ("good_triplets_toa.csv", True),
        ("bad_triplets_zero_std.csv", False),
        ("bad_triplets_degrees_as_radians.csv", False),
        ("good_bearings.csv.gz", True),
        ("good_bearings_azimuth.csv", True),
        ("good_bearings_scene_sensors.csv", True),
        ("good_over_the_horizon.csv", True),
        ("bad_zero_std.csv", False),
        ("bad_wrong_type.csv", False),
        ("bad_degrees_as_radians.csv", False),
    ],
)
def test_frictionless_validates_by_the_schema(name: str, valid: bool) -> None:
    """A public validator accepts the good fixtures by the schema, and refuses a bad one."""
    frictionless = pytest.importorskip("frictionless")
    kind = "triplets" if "triplets" in name else "bearings"
    schema = frictionless.Schema.from_descriptor(str(ROOT / "schemas" / f"{kind}.json"))
    with frictionless.system.use_context(trusted=True):
        report = frictionless.Resource(path=str(FIXTURES / name), schema=schema).validate()
    assert report.valid is valid, report.flatten(["rowNumber", "fieldName", "message"])


@pytest.mark.parametrize("builder", sorted((FIXTURES / "builders").glob("build_*.py")), ids=lambda path: path.stem)
def test_fixtures_are_what_the_builder_makes(builder: Path, tmp_path: Path) -> None:
    """Building the fixtures again gives the same files, numbers up to the last digits.

    Those depend on the vector instructions of the processor, which numpy uses for sines.
    """
    spec = importlib.util.spec_from_file_location(builder.stem, builder)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    module.main(tmp_path)
    assert list(tmp_path.rglob("*.csv")) != []
    for path in tmp_path.rglob("*"):
        if path.suffix in (".csv", ".toml", ".jsonl", ".xml", ".log"):
            stored = FIXTURES / path.relative_to(tmp_path)
            built, kept = (_NUMBER.split(file.read_text(encoding="latin-1")) for file in (path, stored))
            assert built[::2] == kept[::2], path.name
            assert list(map(float, built[1::2])) == pytest.approx(list(map(float, kept[1::2])), rel=1e-12), path.name
