"""Reading in three dimensions: which columns decide, what they become, and the faults of rows and files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from nlosctl.contract.run_options import InputOptions
from nlosctl.errors import DataError
from nlosctl.io.measurements.reader import MeasurementReader
from nlosctl.io.paths.inputs import expand_inputs

BEARINGS: dict[str, list[Any]] = {
    "snapshot": [1, 1, 2, 2],
    "sensor": ["a", "b", "a", "b"],
    "sensor_x_m": [0.0, 10.0, 0.0, 10.0],
    "sensor_y_m": [0.0, 1.0, 0.0, 1.0],
    "sensor_z_m": [2.0, 3.0, 2.0, 3.0],
    "bearing_deg": [10.0, 20.0, 30.0, 40.0],
    "bearing_std_deg": [1.0] * 4,
    "elevation_deg": [5.0, -6.0, 7.0, ""],
    "elevation_std_deg": [2.0] * 4,
}
TRIPLETS: dict[str, list[Any]] = {
    "snapshot": [1, 1],
    "path": [0, 1],
    **{f"{node}_{axis}_m": [float(i), float(i)] for i, node in enumerate(["tx", "rx"]) for axis in "xyz"},
    **{f"{name}_deg": [10.0, 20.0] for name in ("dod", "doa", "dod_elevation", "doa_elevation")},
    **{f"{name}_std_deg": [1.0, 1.0] for name in ("dod", "doa", "dod_elevation", "doa_elevation")},
    "path_length_m": [30.0, 40.0],
    "path_length_std_m": [0.1, 0.1],
}
RANGES: dict[str, list[Any]] = {
    **{name: BEARINGS[name] for name in ("snapshot", "sensor", "sensor_x_m", "sensor_y_m", "sensor_z_m")},
    "range_m": [5.0, 6.0, 7.0, 8.0],
    "range_std_m": [0.1] * 4,
}
SPHERE = '[[reflector]]\nname = "layer"\nkind = "sphere"\ncenter = [0, 0, 0]\nradius = 20.0\nblocker_radius = 5.0\n'
PLANE = '[[reflector]]\nname = "floor"\nkind = "plane"\npoint = [0, 0, 0]\nnormal = [0, 0, 1]\n'


def written(folder: Path, columns: dict[str, list[Any]], scene: str = "") -> Path:
    """Write a CSV file, with a scene beside it."""
    rows = zip(*columns.values(), strict=True)
    (folder / "in.csv").write_text("\n".join([",".join(columns), *(",".join(map(str, row)) for row in rows)]) + "\n")
    if scene:
        (folder / "in.scene.toml").write_text(scene)
    return folder / "in.csv"


def reader_of(path: Path, **options: Any) -> MeasurementReader:
    """Open a file."""
    return MeasurementReader(expand_inputs([str(path)]), InputOptions(use_threads=False, **options))


def remarks_of(path: Path, **options: Any) -> list[str]:
    """Return the remarks of the survey of a file."""
    reader = reader_of(path, **options)
    reader.close()
    return reader.report.remarks


def columns_of(path: Path, **options: Any) -> dict[str, np.ndarray]:
    """Return the contract's columns of a file."""
    chunks = list(reader_of(path, **options).chunks())
    return {name: np.concatenate([chunk.columns[name] for chunk in chunks]) for name in chunks[0].columns}


def without(columns: dict[str, list[Any]], *names: str) -> dict[str, list[Any]]:
    """Return the columns but those named."""
    return {name: values for name, values in columns.items() if name not in names}


@pytest.mark.parametrize(
    ("columns", "options", "scene", "dimension"),
    [
        (BEARINGS, {}, "", 3),
        (BEARINGS, {"dimensions": 2}, "", 2),
        (without(BEARINGS, "elevation_deg"), {}, "", 2),
        (without(BEARINGS, "elevation_std_deg"), {}, "", 2),
        (without(BEARINGS, "elevation_std_deg"), {"constants": {"elevation_std_rad": 0.1}}, "", 3),
        (without(BEARINGS, "elevation_std_deg", "bearing_std_deg") | {"direction_std_deg": [1.0] * 4}, {}, "", 3),
        (without(BEARINGS, "sensor_z_m"), {}, "", 2),
        (
            without(BEARINGS, "sensor_x_m", "sensor_y_m", "sensor_z_m"),
            {},
            '[[sensor]]\nname = "a"\nposition = [0, 0, 2]\n[[sensor]]\nname = "b"\nposition = [10, 1, 3]\n',
            3,
        ),
        (TRIPLETS, {}, "", 3),
        (without(TRIPLETS, "doa_elevation_deg", "doa_elevation_std_deg"), {}, "", 3),
        (without(TRIPLETS, "rx_z_m"), {}, "", 2),
        (RANGES, {}, "", 2),
        (RANGES, {"dimensions": 3}, "", 3),
    ],
)
def test_columns_decide_the_dimension(
    tmp_path: Path, columns: dict[str, list[Any]], options: dict[str, Any], scene: str, dimension: int
) -> None:
    """Elevations, their stds and heights of all sensors make three dimensions; ranges only when asked."""
    reader = reader_of(written(tmp_path, columns, scene), **options)
    assert reader.dimension == dimension
    assert sum(len(chunk.snapshot) for chunk in reader.chunks()) == len(set(columns["snapshot"]))


def test_what_the_plane_does_not_use_is_named(tmp_path: Path) -> None:
    """A remark names the columns of space that are not used, and what is missing for them."""
    path = written(tmp_path, without(BEARINGS, "sensor_z_m"))
    (remark,) = remarks_of(path)
    assert remark == (
        "solved in two dimensions: elevation_deg, elevation_std_deg are not used, since there are no heights of the "
        "sensors"
    )
    assert "elevation_rad" not in columns_of(path)
    path = written(tmp_path, without(BEARINGS, "elevation_std_deg"))
    assert "no standard deviations of elevations" in remarks_of(path)[0]
    (remark,) = remarks_of(path, dimensions=2)
    assert remark == "solved in two dimensions: sensor_z_m, elevation_deg are not used"


def test_columns_have_the_units_of_the_contract(tmp_path: Path) -> None:
    """Degrees become radians; an empty elevation is NaN."""
    columns = columns_of(written(tmp_path, BEARINGS))
    np.testing.assert_allclose(columns["elevation_rad"], np.radians([5.0, -6.0, 7.0, np.nan]), rtol=1e-15)
    np.testing.assert_allclose(columns["elevation_std_rad"], np.radians(2.0), rtol=1e-15)
    assert columns["sensor_z_m"].tolist() == [2.0, 3.0, 2.0, 3.0]


def test_a_std_across_the_ray_gives_that_of_the_azimuth(tmp_path: Path) -> None:
    """The azimuth's std is the direction's over cos(elevation), the same where there is no elevation."""
    given = without(BEARINGS, "elevation_std_deg", "bearing_std_deg") | {"direction_std_deg": [1.0, 2.0, 1.0, 2.0]}
    columns = columns_of(written(tmp_path, given))
    expected = np.radians([1.0 / np.cos(np.radians(5)), 2.0 / np.cos(np.radians(6)), 1.0 / np.cos(np.radians(7)), 2.0])
    np.testing.assert_allclose(columns["bearing_std_rad"], expected, rtol=1e-14)


def test_direction_vectors_give_elevations(tmp_path: Path) -> None:
    """``unit_z`` is the elevation of a vector of any length."""
    given = without(BEARINGS, "bearing_deg", "elevation_deg")
    given |= {"unit_x": [1.0, 0.0, 2.0, 0.831], "unit_y": [0.0, 1.0, 2.0, 0.554], "unit_z": [1.0, 0.0, -1.0, -0.055]}
    columns = columns_of(written(tmp_path, given))
    expected = [0.25 * np.pi, 0.0, -np.arctan(1.0 / np.sqrt(8.0)), np.arctan2(-0.055, np.hypot(0.831, 0.554))]
    np.testing.assert_allclose(columns["elevation_rad"], expected, atol=1e-15)
    np.testing.assert_allclose(columns["bearing_rad"], [0.0, 0.5 * np.pi, 0.25 * np.pi, np.arctan2(0.554, 0.831)])


def test_a_height_without_a_std_is_exact(tmp_path: Path) -> None:
    """A column of heights alone has the std 0; empty cells are snapshots without a height."""
    columns = columns_of(written(tmp_path, BEARINGS | {"target_z_m": [1.5, 1.5, "", ""]}))
    np.testing.assert_array_equal(columns["target_z_m"], [1.5, 1.5, np.nan, np.nan])
    np.testing.assert_array_equal(columns["target_z_std_m"], [0.0, 0.0, np.nan, np.nan])


FAULTS: dict[str, tuple[dict[str, list[Any]], dict[str, Any], str, str]] = {
    "beyond": (BEARINGS | {"elevation_deg": [5.0, 91.0, 7.0, 8.0]}, {}, "",
               "row 2 (line 3), column 'elevation_deg': got 91, expected -90 to 90 deg"),
    "degrees as radians": (
        without(BEARINGS, "elevation_deg") | {"elevation_rad": [5.0, 6.0, 7.0, 8.0]}, {}, "",
        "column 'elevation_rad': 4 of 4 values are beyond ±1.571 rad; they seem to be degrees: rename the column to "
        "elevation_deg"),
    "no std": (without(BEARINGS, "elevation_std_deg"), {"dimensions": 3}, "",
               "missing column 'elevation_std_rad', also accepted: elevation_std_deg, or set "
               "`constants['elevation_std_rad']`"),
    "std alone": (without(BEARINGS, "elevation_deg"), {"dimensions": 3}, "",
                  "column 'elevation_std_deg' needs 'elevation_rad'; give both, or neither"),
    "both stds": (BEARINGS | {"direction_std_deg": [1.0] * 4}, {}, "", "are the same quantity; drop one"),
    "std of zero": (BEARINGS | {"elevation_std_deg": [1.0, 0.0, 1.0, 1.0]}, {}, "",
                    "row 2 (line 3), column 'elevation_std_deg': got 0, expected a number larger than 0"),
    "empty std": (BEARINGS | {"elevation_std_deg": [1.0, "", 1.0, ""]}, {}, "",
                  "row 2 (line 3), column 'elevation_std_deg': got an empty cell (null), expected the "
                  "standard deviation of the row's elevation"),
    "no heights": (without(BEARINGS, "sensor_z_m"), {"dimensions": 3}, "", "missing column 'sensor_z_m'"),
    "no heights of ranges": (without(RANGES, "sensor_z_m"), {"dimensions": 3}, "", "missing column 'sensor_z_m'"),
    "empty height": (BEARINGS | {"sensor_z_m": [1.0, "", 1.0, 1.0]}, {}, "",
                     "row 2 (line 3), column 'sensor_z_m': got an empty cell (null), expected a finite number"),
    "scene without heights": (without(BEARINGS, "sensor_z_m"), {"dimensions": 3},
                              '[[sensor]]\nname = "a"\nposition = [0, 0]\n', "missing column 'sensor_z_m'"),
    "circle": (BEARINGS, {}, '[[reflector]]\nname = "r"\nkind = "circle"\ncenter = [0, 0]\nradius = 20.0\n',
               "reflector 'r' is a circle, of two dimensions; in three give kind = 'sphere'"),
    "outside": (BEARINGS | {"sensor_z_m": [6.0, 18.0, 6.0, 6.0], "reflector": ["layer"] * 4}, {}, SPHERE,
                "row 2 (line 3), column 'sensor_x_m': the sensor is 20.61552813 m from the centre of its sphere, "
                "expected less than its radius, 20 m"),
    "under": (BEARINGS | {"sensor_z_m": [4.0, 18.0, 6.0, 6.0], "reflector": ["layer", "", "layer", "layer"]}, {},
              SPHERE,
              "row 1 (line 2), column 'sensor_x_m': the sensor is 4 m from the centre of its sphere, expected at "
              "least the radius of its blocker, 5 m"),
    "plane in the plane": (BEARINGS | {"reflector": ["floor", "", "", ""]}, {"dimensions": 2}, PLANE,
                           "row 1 (line 2), column 'reflector': got 'floor', a reflector of space; set "
                           "`dimensions` to 3"),
    "height's std alone": (BEARINGS | {"target_z_std_m": [1.0] * 4}, {}, "",
                           "column 'target_z_std_m' needs 'target_z_m'; give both, or neither"),
    "negative std": (BEARINGS | {"target_z_m": [1.0] * 4, "target_z_std_m": [1.0, 1.0, -1.0, -1.0]}, {}, "",
                     "row 3 (line 4), column 'target_z_std_m': got -1, expected a number of at least 0"),
    "two heights": (BEARINGS | {"target_z_m": [1.0, 1.0, 1.0, 2.0]}, {}, "",
                    "snapshot 2, column 'target_z_m': got 2 beside 1, expected one height in all rows of a snapshot"),
    "zero normal": (BEARINGS, {}, PLANE.replace("[0, 0, 1]", "[0, 0, 0]"),
                    "reflector[0].normal: got [0, 0, 0], expected a direction of any length except zero"),
    "two numbers": (BEARINGS, {}, PLANE.replace("point = [0, 0, 0]", "point = [0, 0]"),
                    "reflector[0].point: got [0, 0], expected three numbers, [x, y, z]"),
    "no elevation of triplets": (without(TRIPLETS, "dod_elevation_std_deg"), {"dimensions": 3}, "",
                                 "missing column 'dod_elevation_std_rad'"),
}  # fmt: skip


@pytest.mark.parametrize("name", list(FAULTS))
def test_faults_of_space_are_one_clear_line(tmp_path: Path, name: str) -> None:
    """Each input that three dimensions reject has a message with what was found, expected, and the cure."""
    columns, options, scene, message = FAULTS[name]
    with pytest.raises(DataError) as raised:
        columns_of(written(tmp_path, columns, scene), **options)
    assert message in str(raised.value), str(raised.value)


def test_planes_and_spheres_round_trip_in_scenes(tmp_path: Path) -> None:
    """A scene with the reflectors of space is written and read back as the same scene."""
    from nlosctl.io.scenes.scene_file import scene_from_toml, scene_to_toml

    scene = scene_from_toml(SPHERE + PLANE, "scene.toml")
    assert scene_from_toml(scene_to_toml(scene), "again.toml") == scene
    assert scene.reflectors[1].normal == (0.0, 0.0, 1.0)  # type: ignore[union-attr]
