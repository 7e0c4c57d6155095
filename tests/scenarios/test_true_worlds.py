"""Simulated measurements in scenes whose sensors and reflectors are not exactly known."""

from __future__ import annotations

import numpy as np
import pytest

import nlosctl
from nlosctl.contract.scene import LineReflector, PlaneReflector, Scene, SegmentReflector, Sensor

PLACES = ((0.0, 0.0), (100.0, 0.0), (100.0, 100.0))


def scene(*reflectors, z_m=None, **stds) -> Scene:
    """Return three sensors with these standard deviations, and reflectors."""
    sensors = (Sensor(name=f"s{n}", position=place, z_m=z_m, **stds) for n, place in enumerate(PLACES))
    return Scene(sensors=tuple(sensors), reflectors=reflectors)


def columns(kind: str, own: Scene, trials: int = 250, **parameters):
    """Return the columns of a simulation with errors of the rows that are very small."""
    table = nlosctl.simulate(kind, trials=trials, seed=3, scene=own, **parameters)
    return {name: np.array(table[name].to_pylist()) for name in table.column_names}


@pytest.mark.parametrize("worlds", ["snapshot", "file"])
def test_headings_turn_all_bearings_of_a_sensor(worlds: str) -> None:
    """Each sensor has one error in a snapshot, or in the file; its standard deviation is that of the scene."""
    drawn = columns("bearings", scene(heading_std_deg=2.0), bearing_std_deg=1e-6, worlds=worlds)
    exact = np.arctan2(drawn["truth_y_m"] - drawn["sensor_y_m"], drawn["truth_x_m"] - drawn["sensor_x_m"])
    error = np.degrees(np.angle(np.exp(1j * (drawn["bearing_rad"] - exact)))).reshape(250, 3)
    if worlds == "file":
        np.testing.assert_allclose(error, np.broadcast_to(error[0], error.shape), atol=1e-4)
        assert np.abs(error[0]).max() > 0.1
    else:
        assert error.std() == pytest.approx(2.0, rel=0.1)
        assert np.abs(np.corrcoef(error.T)[np.triu_indices(3, 1)]).max() < 0.2


def test_offsets_and_places_of_ranges() -> None:
    """Offsets add to ranges; rows state the positions of the scene, and are measured from those of the world."""
    drawn = columns("ranges", scene(range_offset_std_m=3.0, position_std_m=4.0), range_std_m=1e-6)
    assert set(drawn["sensor_x_m"]) == {0.0, 100.0}
    exact = np.hypot(drawn["truth_x_m"] - drawn["sensor_x_m"], drawn["truth_y_m"] - drawn["sensor_y_m"])
    assert (drawn["range_m"] - exact).std() == pytest.approx(5.0, rel=0.08)


@pytest.mark.parametrize("z_m", [None, 2.0])
def test_mirrors_move_and_turn(z_m: float | None) -> None:
    """The range by a mirror that moves along its normal changes by twice that; direct rows do not change."""
    if z_m is None:
        mirror = LineReflector(name="m", point=(50.0, 300.0), direction=(1.0, 0.0), offset_std_m=2.0)
    else:
        mirror = PlaneReflector(name="m", point=(50.0, 300.0, 0.0), normal=(0.0, 1.0, 0.0), offset_std_m=2.0)
    drawn = columns("ranges", scene(mirror, z_m=z_m), range_std_m=1e-6, target=(50.0, 0.0))
    direct = np.array([name is None for name in drawn["reflector"]])
    by_sensor = [drawn["range_m"][~direct & (drawn["sensor"] == f"s{n}")] for n in range(2)]
    assert drawn["range_m"][direct & (drawn["sensor"] == "s0")].std() < 1e-5
    assert by_sensor[0].std() == pytest.approx(4.0, rel=0.12)
    np.testing.assert_allclose(by_sensor[0], by_sensor[1], atol=1e-4)


def test_a_shorter_draw_is_the_beginning_of_a_longer_one() -> None:
    """Also with worlds of their own, walls that turn, and arrivals."""
    wall = SegmentReflector(name="w", start=(-50.0, 150.0), end=(150.0, 150.0), direction_std_deg=1.0)
    own = scene(wall, arrival_offset_std_m=1.0)
    few = nlosctl.simulate("arrivals", trials=3, seed=3, scene=own).to_pylist()
    assert nlosctl.simulate("arrivals", trials=20, seed=3, scene=own).to_pylist()[: len(few)] == few
