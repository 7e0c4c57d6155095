"""Unit suffixes, direction vectors, directions relative to a heading, and nodes of triplets from the scene."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from reading_support import Gathered, read, save, whole

from nlosctl.contract.scene import Scene, Sensor
from nlosctl.errors import DataError, GatheredError

QUICK = settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
LIGHT_M_S = 299_792_458.0
METRES = {"m": 1.0, "km": 1e3, "cm": 1e-2, "mm": 1e-3}
SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
RADIANS = {"rad": 1.0, "deg": math.pi / 180.0, "mdeg": math.pi / 180e3}


def columns_of(path: Path, **options: Any) -> dict[str, Any]:
    """Return the contract's columns of a file."""
    return dict(whole(read([path], **options)).columns)


@QUICK
@given(
    units=st.tuples(*[st.sampled_from(sorted(METRES))] * 3), x=st.lists(st.floats(-1e4, 1e4), min_size=1, max_size=4)
)
def test_units_of_length(tmp_path: Path, units: tuple[str, ...], x: list[float]) -> None:
    """Positions, ranges and their standard deviations in any unit of length are metres times its size."""
    count, (place, range_unit, std_unit) = len(x), units
    table = pa.table(
        {
            "snapshot": list(range(count)),
            "sensor": ["a"] * count,
            f"sensor_x_{place}": x,
            f"sensor_y_{place}": x[::-1],
            f"sensor_z_{place}": [2.0] * count,
            f"range_{range_unit}": [7.0] * count,
            f"range_std_{std_unit}": [0.5] * count,
        }
    )
    found = columns_of(save(table, tmp_path / "r.parquet"))
    np.testing.assert_allclose(found["sensor_x_m"], np.array(x) * METRES[place], rtol=1e-15)
    np.testing.assert_allclose(found["sensor_y_m"], np.array(x[::-1]) * METRES[place], rtol=1e-15)
    np.testing.assert_allclose(found["sensor_z_m"], 2.0 * METRES[place], rtol=1e-15)
    np.testing.assert_allclose(found["range_m"], 7.0 * METRES[range_unit], rtol=1e-15)
    np.testing.assert_allclose(found["range_std_m"], 0.5 * METRES[std_unit], rtol=1e-15)


@pytest.mark.parametrize("angle", RADIANS)
@pytest.mark.parametrize("time", SECONDS)
def test_units_of_triplets(tmp_path: Path, angle: str, time: str) -> None:
    """Angles in degrees and thousandths, delays in any unit of time."""
    table = pa.table(
        {
            **{
                name: [value]
                for name, value in zip(("tx_x_km", "tx_y_km", "rx_x_mm", "rx_y_mm"), (1.0, 2.0, 3.0, 4.0), strict=True)
            },
            "snapshot": [1],
            "path": [0],
            f"dod_{angle}": [0.5],
            f"doa_{angle}": [-0.25],
            f"toa_{time}": [3.0],
            f"dod_std_{angle}": [0.1],
            f"doa_std_{angle}": [0.2],
            f"toa_std_{time}": [0.01],
        }
    )
    found = columns_of(save(table, tmp_path / "t.parquet"))
    expected = {
        "tx_x_m": 1e3,
        "tx_y_m": 2e3,
        "rx_x_m": 3e-3,
        "rx_y_m": 4e-3,
        "dod_rad": 0.5 * RADIANS[angle],
        "doa_rad": -0.25 * RADIANS[angle],
        "path_length_m": 3.0 * SECONDS[time] * LIGHT_M_S,
        "dod_std_rad": 0.1 * RADIANS[angle],
        "doa_std_rad": 0.2 * RADIANS[angle],
        "path_length_std_m": 0.01 * SECONDS[time] * LIGHT_M_S,
    }
    for name, value in expected.items():
        assert found[name][0] == pytest.approx(value, rel=1e-14)


def bearings(**columns: Any) -> Any:
    """Return a table of bearings without the bearing; columns can be replaced."""
    count = len(next(iter(columns.values())))
    standard = {"sensor": ["a"] * count, "sensor_x_m": [0.0] * count, "sensor_y_m": [0.0] * count}
    return pa.table({"snapshot": list(range(count)), **standard, "bearing_std_rad": [0.01] * count, **columns})


def test_an_older_name_stands_beside_a_unit_that_had_no_meaning(tmp_path: Path) -> None:
    """A file with ``sensor_x_m`` and ``sensor_x_km``, or a constant and ``bearing_std_mdeg``, reads as before."""
    table = bearings(bearing_rad=[0.1], sensor_x_km=[9.0], bearing_mdeg=[7.0])
    found = columns_of(save(table, tmp_path / "b.parquet"))
    assert (found["sensor_x_m"][0], found["bearing_rad"][0]) == (0.0, 0.1)
    table = table.drop_columns(["bearing_std_rad"]).append_column("bearing_std_mdeg", [[1.0]])
    found = columns_of(save(table, tmp_path / "c.parquet"), constants={"bearing_std_rad": 0.02})
    assert found["bearing_std_rad"][0] == 0.02


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (
            ("range_furlong",),
            "column 'range_furlong': unknown unit 'furlong', expected one of the suffixes _m, _km, _cm, _mm",
        ),
        (("range_km", "range_cm"), "'range_km' and 'range_cm' are the same quantity"),
        (("bearing_gon",), "column 'bearing_gon': unknown unit 'gon'.* _rad, _deg, _mdeg"),
        (("bearing_mdeg", "azimuth_mdeg"), "are the same quantity"),
        (("toa_fortnight",), "unknown unit 'fortnight'.* _s, _ns, _us, _ms"),
    ],
)
def test_unknown_and_double_units(tmp_path: Path, names: tuple[str, ...], message: str) -> None:
    """An unknown unit names the column and the known suffixes; two units of one quantity are an error."""
    table = bearings(range_std_m=[1.0], **{name: [1.0] for name in names})
    with pytest.raises(DataError, match=message):
        read([save(table, tmp_path / "u.parquet")])


def test_an_unknown_unit_of_an_optional_quantity_is_left_alone(tmp_path: Path) -> None:
    """A file of bearings with ``range_furlong`` reads as it always did."""
    found = columns_of(save(bearings(bearing_rad=[0.1], range_furlong=[2.0]), tmp_path / "u.parquet"))
    assert "range_m" not in found


@QUICK
@given(
    vectors=st.lists(
        st.tuples(*[st.floats(-1e3, 1e3)] * 3).filter(lambda v: math.hypot(*v[:2]) > 1e-6), min_size=1, max_size=5
    ),
    with_z=st.booleans(),
)
def test_direction_vectors(tmp_path: Path, vectors: list[tuple[float, ...]], with_z: bool) -> None:
    """The bearing of a vector of any length is the complex argument of its horizontal part; results keep the vector."""
    names = ("unit_x", "unit_y", "unit_z")[: 2 + with_z]
    table = bearings(**{name: [vector[k] for vector in vectors] for k, name in enumerate(names)})
    found = whole(read([save(table, tmp_path / "v.parquet")]))
    expected = np.angle([complex(*vector[:2]) for vector in vectors])
    np.testing.assert_allclose(found.columns["bearing_rad"], expected, atol=1e-15)
    assert found.table.column_names == table.column_names


def test_vectors_without_a_direction_are_bad_rows(tmp_path: Path) -> None:
    """Zero, vertical and empty vectors are bad rows; one component alone is an error."""
    table = bearings(unit_x=[1.0, 0.0, 0.0, None], unit_y=[1.0, 0.0, 0.0, 1.0], unit_z=[0.0, 0.0, 1.0, 1.0])
    bad = Gathered()
    assert whole(read([save(table, tmp_path / "v.parquet")], bad)).ids == [0]
    assert [row.problem.row for row in bad] == [2, 3, 4]
    assert "expected a direction of any length except zero" in bad[0].problem.fault
    with pytest.raises(DataError, match="needs 'unit_y'"):
        read([save(bearings(unit_x=[1.0]), tmp_path / "w.parquet")])


@QUICK
@given(
    relative=st.floats(-360.0, 360.0),
    heading=st.floats(-360.0, 360.0),
    std=st.one_of(st.none(), st.floats(0.0, 10.0)),
    sense=st.sampled_from(["", "_ccw"]),
    unit=st.sampled_from(["deg", "rad"]),
    in_scene=st.booleans(),
)
def test_bearings_relative_to_a_heading(
    tmp_path: Path, relative: float, heading: float, std: float | None, sense: str, unit: str, in_scene: bool
) -> None:
    """A compass azimuth is the heading plus the clockwise angle; the variance of a row's heading adds to its own.

    That of a heading in the scene is an error that all bearings of the sensor share.
    """
    azimuth_deg = heading + (-relative if sense else relative)
    given = relative if unit == "deg" else math.radians(relative)
    table = bearings(**{f"relative_bearing{sense}_{unit}": [given]})
    scene = Scene()
    if in_scene:
        scene = Scene(sensors=(Sensor(name="a", position=(0.0, 0.0), heading_deg=heading, heading_std_deg=std),))
    else:
        table = table.append_column("heading_deg", [[heading]])
        if std is not None:
            table = table.append_column("heading_std_deg", [[std]])
    found = columns_of(save(table, tmp_path / "b.parquet"), scene=scene)
    direction = complex(math.cos(found["bearing_rad"][0]), math.sin(found["bearing_rad"][0]))
    expected = complex(math.sin(math.radians(azimuth_deg)), math.cos(math.radians(azimuth_deg)))
    assert direction == pytest.approx(expected, abs=1e-12)
    own, shared = (0.0, std) if in_scene else (std, 0.0)
    assert found["bearing_std_rad"][0] == pytest.approx(math.hypot(0.01, math.radians(own or 0.0)), rel=1e-12)
    assert found.get("offset_std", [0.0])[0] == pytest.approx(math.radians(shared or 0.0))


def test_headings_of_rows_take_precedence_over_the_scene(tmp_path: Path) -> None:
    """An empty heading is that of the scene; a row without any is a bad row."""
    scene = Scene(sensors=(Sensor(name="a", position=(0.0, 0.0), heading_deg=90.0),))
    table = bearings(sensor=["a", "a", "b"], relative_bearing_deg=[0.0] * 3, heading_deg=[0.0, None, None])
    bad = Gathered()
    found = whole(read([save(table, tmp_path / "b.parquet")], bad, scene=scene))
    assert found.columns["bearing_rad"].tolist() == pytest.approx([math.pi / 2, 0.0])
    assert [row.problem.row for row in bad] == [3]
    assert "the scene no heading of 'b'" in bad[0].problem.fault
    with pytest.raises(GatheredError, match="got -1, expected a number from 0"):
        read([save(table.append_column("heading_std_deg", [[-1.0, 0.0, 0.0]]), tmp_path / "n.parquet")], scene=scene)
    with pytest.raises(DataError, match="no column 'heading_deg'"):
        read([save(table.drop_columns(["heading_deg"]), tmp_path / "c.parquet")])


def test_a_heading_beside_absolute_bearings_has_no_meaning(tmp_path: Path) -> None:
    """A column of headings, even of text, is copied where the bearings are absolute."""
    table = bearings(bearing_rad=[0.1], heading_deg=["north-east"], heading_std_deg=["?"])
    found = whole(read([save(table, tmp_path / "b.parquet")]))
    assert found.columns["bearing_rad"][0] == 0.1
    assert found.table["heading_deg"].to_pylist() == ["north-east"]


SOUNDER = Scene(
    sensors=(
        Sensor(name="tx", position=(1.0, 2.0), heading_deg=30.0),
        Sensor(name="rx", position=(3.0, 4.0), heading_deg=-60.0, heading_std_deg=2.0),
        Sensor(name="roof", position=(5.0, 6.0), heading_deg=0.0),
    )
)


def triplets(**columns: Any) -> Any:
    """Return a table of two paths without positions and angles."""
    standard = {"snapshot": [1, 1], "path": [0, 1], "toa_ns": [30.0, 40.0], "toa_std_ns": [1.0, 1.0]}
    stds = {"dod_std_deg": [1.0, 1.0], "doa_std_deg": [1.0, 1.0]}
    return pa.table({**standard, **stds, **columns})


def test_triplets_with_nodes_and_orientations_of_the_scene(tmp_path: Path) -> None:
    """Transmitter and receiver are the scene's ``tx`` and ``rx``, or those that the rows name."""
    table = triplets(relative_dod_deg=[10.0, 20.0], relative_doa_ccw_deg=[10.0, 20.0], rx=["rx", "roof"])
    found = columns_of(save(table, tmp_path / "t.parquet"), scene=SOUNDER)
    assert found["tx_x_m"].tolist() == [1.0, 1.0]
    assert (found["rx_x_m"].tolist(), found["rx_y_m"].tolist()) == ([3.0, 5.0], [4.0, 6.0])
    assert np.degrees(found["dod_rad"]).tolist() == pytest.approx([90.0 - 40.0, 90.0 - 50.0])
    assert np.degrees(found["doa_rad"]).tolist() == pytest.approx([90.0 + 70.0, 90.0 + 20.0])
    assert np.degrees(found["doa_std_rad"]).tolist() == pytest.approx([math.sqrt(5.0), 1.0])


def test_triplets_with_azimuths_from_north(tmp_path: Path) -> None:
    """Azimuths of departure and arrival are clockwise from north, and take a declination."""
    table = triplets(dod_azimuth_deg=[0.0, 90.0], doa_azimuth_deg=[180.0, 270.0])
    path = save(table, tmp_path / "t.parquet")
    found = columns_of(path, scene=SOUNDER)
    assert np.degrees(found["dod_rad"]).tolist() == pytest.approx([90.0, 0.0])
    assert np.degrees(found["doa_rad"]).tolist() == pytest.approx([-90.0, -180.0])
    turned = columns_of(path, scene=SOUNDER, declination_deg=5.0)
    assert np.degrees(found["dod_rad"] - turned["dod_rad"]).tolist() == pytest.approx([5.0, 5.0])


def test_triplets_without_a_transmitter(tmp_path: Path) -> None:
    """Without positions, and with a scene that lacks the node, the message names the columns or the sensor."""
    table = triplets(dod_deg=[0.0, 90.0], doa_deg=[180.0, 270.0])
    with pytest.raises(DataError, match="missing columns 'tx_x_m'"):
        read([save(table, tmp_path / "t.parquet")])
    named = table.append_column("tx", [["roof", "rof"]])
    with pytest.raises(GatheredError, match="the scene has no sensor 'rof' \\(did you mean 'roof'"):
        read([save(named, tmp_path / "n.parquet")], scene=SOUNDER)
