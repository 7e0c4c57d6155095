"""Simulated echoes: signal model (1), truth, order of rows."""

from __future__ import annotations

import numpy as np
import pytest
from scenario_draws import draw_columns
from scipy.stats import ks_2samp

from nlosctl.scenarios import echo_field, liang
from nlosctl.scenarios.spec import ScenarioSpec

SCENARIOS = [liang.SCENARIO, echo_field.SCENARIO]


@pytest.mark.parametrize("spec", SCENARIOS, ids=lambda spec: spec.name)
def test_direct_ranges_are_distances(spec: ScenarioSpec) -> None:
    """A direct echo reads the distance to its target plus a Gaussian error with the row's std."""
    columns = draw_columns(spec, 200, seed=3, range_std_m=0.5)
    los = columns["truth_los"]
    away = np.hypot(columns["truth_x_m"] - columns["sensor_x_m"], columns["truth_y_m"] - columns["sensor_y_m"])
    error = (columns["range_m"] - away)[los]
    assert error.mean() == pytest.approx(0.0, abs=0.05)
    assert error.std() == pytest.approx(0.5, rel=0.05)
    assert (columns["range_m"] - away)[~los].min() > -2.5


@pytest.mark.parametrize("spec", SCENARIOS, ids=lambda spec: spec.name)
def test_every_sensor_has_k_times_one_plus_l_echoes(spec: ScenarioSpec) -> None:
    """Without misses and false echoes each sensor has K direct ranges and K L others."""
    columns = draw_columns(spec, 20, seed=3, sensors=4, targets=3, scatterers=2)
    assert columns["range_m"].shape[0] == 20 * 4 * 3 * (1 + 2)
    assert columns["truth_los"].sum() == 20 * 4 * 3
    for target in range(3):
        assert ((columns["truth_target"] == target) & columns["truth_los"]).sum() == 20 * 4


@pytest.mark.parametrize("spec", SCENARIOS, ids=lambda spec: spec.name)
def test_scattered_ranges_add_up(spec: ScenarioSpec) -> None:
    """A scattered range is |p-a| + |p-s| + |s-a|; with ``half`` half of it, never less than the distance."""
    both = [draw_columns(spec, 50, seed=3, range_std_m=1e-9, nlos_range=word) for word in ("sum", "half")]
    los = both[0]["truth_los"]
    np.testing.assert_allclose(both[1]["range_m"][~los], 0.5 * both[0]["range_m"][~los], rtol=1e-7)
    np.testing.assert_allclose(both[1]["range_m"][los], both[0]["range_m"][los], rtol=1e-7)
    away = np.hypot(both[1]["truth_x_m"] - both[1]["sensor_x_m"], both[1]["truth_y_m"] - both[1]["sensor_y_m"])
    assert (both[1]["range_m"] >= away - 1e-6).all()


@pytest.mark.parametrize("spec", SCENARIOS, ids=lambda spec: spec.name)
def test_misses_and_false_echoes(spec: ScenarioSpec) -> None:
    """Some direct echoes are missed; a false echo has no target and no true position."""
    columns = draw_columns(spec, 200, seed=3, sensors=4, detection_probability=0.7, false_echoes=1.5)
    assert columns["truth_los"].sum() == pytest.approx(0.7 * 200 * 4 * 3, rel=0.05)
    false = np.isnan(columns["truth_target"])
    assert false.sum() == pytest.approx(1.5 * 200 * 4, rel=0.1)
    np.testing.assert_array_equal(np.isnan(columns["truth_x_m"]), false)
    assert not columns["truth_los"][false].any()


@pytest.mark.parametrize("nlos_range", ["sum", "half"])
@pytest.mark.parametrize("spec", SCENARIOS, ids=lambda spec: spec.name)
def test_without_targets_false_echoes_have_the_distribution_of_real_ones(spec: ScenarioSpec, nlos_range: str) -> None:
    """Ranges of pure clutter and of all echoes of targets have the same distribution; no row has a truth."""
    fixed = {"layout": "fixed"} if spec.name == "echo-field" else {}
    real = draw_columns(spec, 1500, seed=3, targets=1, scatterers=3, nlos_range=nlos_range, **fixed)
    clutter = draw_columns(spec, 300, seed=4, targets=0, scatterers=3, false_echoes=5.0, nlos_range=nlos_range, **fixed)
    assert clutter["range_m"].shape[0] == pytest.approx(300 * 5 * np.unique(real["sensor"]).size, rel=0.05)
    assert not clutter["truth_los"].any()
    assert np.isnan(clutter["truth_target"]).all()
    assert np.isnan(clutter["truth_x_m"]).all()
    for sensor in np.unique(real["sensor"]):
        ranges = [columns["range_m"][columns["sensor"] == sensor] for columns in (real, clutter)]
        assert ks_2samp(*ranges).pvalue > 1e-3


def test_false_echoes_have_no_common_origin() -> None:
    """Without targets the ranges of two sensors in the same snapshot are not correlated."""
    columns = draw_columns(liang.SCENARIO, 4000, seed=5, targets=0, scatterers=0, sensors=2, false_echoes=1.0)
    rows = [
        {snapshot: value for snapshot, value, sensor in zip(*columns, strict=True) if sensor == name}
        for columns in [[columns[key] for key in ("snapshot", "range_m", "sensor")]]
        for name in ("s1", "s2")
    ]
    both = sorted(set(rows[0]) & set(rows[1]))
    assert len(both) > 1000
    assert abs(np.corrcoef([[side[snapshot] for snapshot in both] for side in rows])[0, 1]) < 0.1


@pytest.mark.parametrize("spec", SCENARIOS, ids=lambda spec: spec.name)
def test_the_order_of_rows_is_uninformative(spec: ScenarioSpec) -> None:
    """Direct echoes are as frequent in the first half of a snapshot's rows as in the second."""
    columns = draw_columns(spec, 400, seed=3)
    rows = columns["range_m"].shape[0] // 400
    los = columns["truth_los"].reshape(400, rows)
    first, second = los[:, : rows // 2].sum(), los[:, rows // 2 :].sum()
    assert abs(int(first) - int(second)) < 4.0 * np.sqrt(first + second)


def test_the_scene_of_the_paper() -> None:
    """Sensors on a circle of 160 m, targets in the square of 400 m, scatterers fixed on its edge."""
    options = liang.LiangOptions(sensors=5)
    positions = np.array([sensor.position for sensor in liang.scene(options).sensors])
    np.testing.assert_allclose(np.hypot(*positions.T), 160.0)
    columns = draw_columns(liang.SCENARIO, 200, seed=3, sensors=5, targets=1, scatterers=1, range_std_m=1e-9)
    assert np.abs(columns["truth_x_m"]).max() <= 200.0
    # equation (1): what is left of a scattered range after the target's legs is the same for one sensor and scatterer
    away = np.hypot(columns["truth_x_m"] - columns["sensor_x_m"], columns["truth_y_m"] - columns["sensor_y_m"])
    scattered = ~columns["truth_los"]
    generator = np.random.default_rng(0)
    scatterer = liang._edge_points(generator, 1, 200.0)[0]
    assert np.abs(scatterer).max() == pytest.approx(200.0)
    legs = np.hypot(columns["truth_x_m"] - scatterer[0], columns["truth_y_m"] - scatterer[1])
    legs += np.hypot(columns["sensor_x_m"] - scatterer[0], columns["sensor_y_m"] - scatterer[1])
    np.testing.assert_allclose(columns["range_m"][scattered], (away + legs)[scattered], rtol=1e-6)


def test_fixed_and_random_layouts() -> None:
    """With a fixed layout sensors are those of the scene in every snapshot; otherwise they vary."""
    spec = echo_field.SCENARIO
    fixed = draw_columns(spec, 30, seed=3, layout="fixed", layout_seed=4)
    assert len(set(zip(fixed["sensor"], fixed["sensor_x_m"], strict=True))) == 5
    fresh = draw_columns(spec, 30, seed=3)
    assert len(set(zip(fresh["sensor"], fresh["sensor_x_m"], strict=True))) == 150
