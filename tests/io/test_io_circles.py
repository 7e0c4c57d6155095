"""Circles in scene files, and sensors at impossible positions."""

from __future__ import annotations

import pyarrow as pa
import pytest

from nlosctl.contract.run_options import InputOptions
from nlosctl.contract.scene import CircleReflector, LineReflector, Scene
from nlosctl.errors import DataError
from nlosctl.io.measurements.reader import MeasurementReader
from nlosctl.io.results.in_memory import input_of_table
from nlosctl.io.scenes.scene_file import scene_from_toml, scene_to_toml

CIRCLE = '[[reflector]]\nname = "c"\nkind = "circle"\n'
LAYER = CircleReflector(name="layer", center=(0.0, -100.0), radius=150.0, blocker_radius=100.0, min_elevation_deg=2.5)


def test_circles_read_back_equal() -> None:
    """A scene with circles is unchanged after writing and reading, with and without the optional keys."""
    scene = Scene(reflectors=(LAYER, CircleReflector(name="open", center=(1.5, -2.0), radius=1e-3)))
    assert scene_from_toml(scene_to_toml(scene), "s.toml") == scene


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ("center = [0, 0]\n", "reflector[0].radius: missing, expected a number"),
        ("radius = 5\n", "reflector[0].center: missing, expected two numbers"),
        ("center = [0, 0]\nradius = 0\n", "reflector[0].radius: got 0, expected a radius above 0"),
        ("center = [0, 0]\nradius = inf\n", "expected finite numbers"),
        ("center = [0, 0]\nradius = 5\nblocker_radius = 5\n", "expected one inside the reflector: in (0, 5)"),
        ("center = [0, 0]\nradius = 5\nblocker_radius = -1\n", "reflector[0].blocker_radius: got -1"),
        ("center = [0, 0]\nradius = 5\nmin_elevation_deg = 3\n", "without a blocker there is no horizon"),
        (
            "center = [0, 0]\nradius = 5\nblocker_radius = 4\nmin_elevation_deg = 90\n",
            "reflector[0].min_elevation_deg: got 90, expected an angle in [0, 90)",
        ),
        ("center = [0, 0]\nradius = 5\nblocker = 4\n", "reflector[0].blocker: unknown key"),
    ],
)
def test_a_fault_of_a_circle_is_reported_with_its_key(keys: str, message: str) -> None:
    """Each fault of a circle names the key, the value and the expectation."""
    with pytest.raises(DataError) as caught:
        scene_from_toml(CIRCLE + keys, "s.toml")
    assert message in str(caught.value)


def read(x: list[float], reflector: list[str | None]) -> list[int]:
    """Read rows of one sensor each at (x, 0) in a scene of a layer, an open circle and a line; return their codes."""
    scene = Scene(
        reflectors=(
            LineReflector(name="line", point=(0.0, 500.0), direction=(1.0, 0.0)),
            CircleReflector(name="layer", center=(0.0, 0.0), radius=150.0, blocker_radius=100.0),
            CircleReflector(name="open", center=(0.0, 0.0), radius=50.0),
        )
    )
    size = len(x)
    table = pa.table(
        {
            "sensor": [f"s{number}" for number in range(size)],
            "sensor_x_m": x,
            "sensor_y_m": [0.0] * size,
            "bearing_rad": [1.0] * size,
            "bearing_std_rad": [0.01] * size,
            "reflector": pa.array(reflector, pa.string()),
        }
    )
    reader = MeasurementReader([input_of_table(table)], InputOptions(scene=scene))
    return [int(code) for chunk in reader.chunks() for code in chunk.columns["reflector"]]


def test_sensors_in_their_place_are_taken() -> None:
    """Sensors between the circles or on the ground, and any sensor of direct and line rows, are valid."""
    assert read([100.0, 149.0, 99.99995, 3.0, 900.0, 900.0], ["layer", "layer", "layer", "open", None, "line"]) == [
        1,
        1,
        1,
        2,
        -1,
        0,
    ]


@pytest.mark.parametrize(
    ("x", "reflector", "message"),
    [
        (150.0, "layer", "the sensor is 150 m from the centre of its circle, expected less than its radius, 150 m"),
        (60.0, "open", "the sensor is 60 m from the centre of its circle, expected less than its radius, 50 m"),
        (
            99.0,
            "layer",
            "the sensor is 99 m from the centre of its circle, expected at least the radius of its blocker",
        ),
    ],
)
def test_a_sensor_outside_its_circle_is_a_bad_row(x: float, reflector: str, message: str) -> None:
    """A row whose sensor is not inside its circle, or within the blocker, is reported with row and column."""
    with pytest.raises(DataError) as caught:
        read([120.0, x], ["layer", reflector])
    assert "row 2, column 'sensor_x_m'" in str(caught.value)
    assert message in str(caught.value)
