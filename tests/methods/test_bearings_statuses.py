"""Statuses, per snapshot."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from batches import bearing_batch
from bearing_worlds import draw_world, estimate, flags_of, words

from nlosctl.contract.methods import MethodSpec
from nlosctl.contract.scene import LineReflector, Scene
from nlosctl.methods import bearings_ml, bearings_ml_grid, bearings_stansfield
from nlosctl.testing.draws import draw_bearings

WALL = Scene(reflectors=(LineReflector(name="wall", point=(3.0, 0.0), direction=(0.0, 1.0)),))
NO_ANSWER = {"degenerate", "behind", "not_converged"}


def towards(sensors: list[tuple[float, float]], point: tuple[float, float], turn: float = 0.0) -> np.ndarray:
    """Return the bearings (1, K) of a point, rotated."""
    away = np.array(point) - np.array(sensors)
    return (np.arctan2(away[:, 1], away[:, 0]) + turn)[None]


def test_one_bearing_is_too_few(any_method: MethodSpec) -> None:
    """A single bearing gives too_few."""
    assert words(estimate(any_method, bearing_batch((0.0, 0.0), [[0.3], [1.0]]))) == ["too_few", "too_few"]


@pytest.mark.parametrize("turn", [0.0, np.pi])
def test_parallel_lines_are_degenerate(any_method: MethodSpec, turn: float) -> None:
    """Parallel lines, exactly or to 1e-7 rad, in any direction of their rays, are degenerate."""
    sensors = [(0.0, 0.0), (0.0, 10.0), (5.0, -10.0)]
    bearings = [[0.4, 0.4, 0.4 + turn], [0.4, 0.4 + 1e-8, 0.4 - 1e-8 + turn]]
    assert words(estimate(any_method, bearing_batch([sensors, sensors], bearings))) == ["degenerate"] * 2


def test_fixes_more_uncertain_than_distant_are_degenerate(method: MethodSpec) -> None:
    """Lines that cross at an angle of half their std are degenerate."""
    sensors = [(0.0, 0.0), (0.0, 10.0)]
    assert words(estimate(method, bearing_batch([sensors], [[0.01, 0.0]], std_rad=0.02))) == ["degenerate"]
    assert words(estimate(method, bearing_batch([sensors], [[0.01, 0.0]], std_rad=0.0002))) == ["ok"]


@pytest.mark.parametrize("measurements", [2, 3, 8])
@pytest.mark.parametrize("fault", ["parallel", "one point", "on a sensor"])
def test_lines_that_cross_nowhere_but_on_a_sensor_are_degenerate(
    method: MethodSpec, fault: str, measurements: int
) -> None:
    """Parallel lines, coincident sensors, and a source on a sensor are degenerate.

    ML may also not converge, or converge close to the sensor at the source; sequential may be behind a sensor that the
    source is on.
    """
    for seed in range(5):
        trial = draw_bearings(np.random.default_rng(seed), 200, measurements, fault)
        estimates = estimate(method, trial.batch)
        if method.name == "sequential" and fault == "on a sensor":
            assert set(words(estimates)) <= NO_ANSWER | {"ok"}
            assert (np.array(words(estimates)) == "ok").mean() < 0.02
            continue
        if method.name != "ml":
            assert set(words(estimates)) == {"degenerate"}
            continue
        beside = np.linalg.norm(estimates.position_m - trial.batch.sensor_xy_m[:, 0], axis=1) < 1e-5 * trial.size_m
        settled = np.array(words(estimates)) == "ok"
        assert set(words(estimates)) <= NO_ANSWER | {"ok"}
        assert not (settled & ~beside).any()
        assert settled.mean() < (0.02 if fault == "on a sensor" else 1e-9)


@pytest.mark.parametrize("place", [(0.0, 0.0), (3e6, -2e6)])
def test_two_bearings_from_one_place_are_degenerate(any_method: MethodSpec, place: tuple[float, float]) -> None:
    """Two bearings of one sensor cross on the sensor itself: degenerate."""
    assert words(estimate(any_method, bearing_batch(place, [[0.2, 1.4]]))) == ["degenerate"]


def test_min_range_makes_near_fixes_degenerate(method: MethodSpec) -> None:
    """A fix closer to a sensor than ``min_range_m`` is degenerate."""
    sensors = [(0.0, 0.0), (10.0, 0.0), (0.0, 10.0)]
    batch = bearing_batch([sensors], towards(sensors, (1.0, 1.0)))
    assert words(estimate(method, batch)) == ["ok"]
    assert words(estimate(method, batch, min_range_m=1.5)) == ["degenerate"]


def test_lines_that_cross_behind_the_sensors_are_behind(method: MethodSpec) -> None:
    """Rays that all point away from the crossing of their lines have no fix: every method reports behind."""
    sensors = [(0.0, 0.0), (10.0, 0.0), (0.0, 10.0)]
    estimates = estimate(method, bearing_batch([sensors], towards(sensors, (4.0, 5.0), turn=np.pi)))
    assert set(words(estimates)) == {"behind"}
    assert np.isnan(estimates.position_m).all()


@pytest.mark.parametrize("measurements", [2, 4, 8])
@pytest.mark.parametrize("std_deg", [1.0, 5.0])
def test_reversed_bearings_are_behind(method: MethodSpec, measurements: int, std_deg: float) -> None:
    """Bearings of the opposite sense are behind where those of the right sense have a fix: in 99 %, two rows in 95 %.

    Two rays that meet far away, compared with their distance, may as well be nearly parallel.
    """
    batch = draw_world(400, measurements, np.radians([std_deg, std_deg])).batch
    turned = dataclasses.replace(batch, bearing_rad=(batch.bearing_rad + 2.0 * np.pi) % (2.0 * np.pi) - np.pi)
    fixed = np.array(words(estimate(method, batch))) == "ok"
    behind = np.array(words(estimate(method, turned))) == "behind"
    assert fixed.sum() > 200
    assert behind[fixed].mean() > (0.95 if measurements == 2 else 0.99)


def test_fixes_that_ml_finds_near_a_sensor_are_not_behind() -> None:
    """A source two standard deviations in front of a sensor: where ML has no fix it is degenerate, not behind."""
    sensors = [(0.0, 0.0), (1000.0, 0.0), (0.0, 1000.0)]
    generator = np.random.default_rng(0)
    bearings = towards(sensors, (14.0, 14.0)) + 0.01 * generator.standard_normal((300, 3))
    found = np.array(words(estimate(bearings_ml.METHOD, bearing_batch([sensors] * 300, bearings))))
    linear = np.array(words(estimate(bearings_stansfield.METHOD, bearing_batch([sensors] * 300, bearings))))
    assert (linear == "behind").sum() > 3
    assert (found == "behind").sum() == 0


@pytest.mark.parametrize("spec", [bearings_ml.METHOD, bearings_ml_grid.METHOD], ids=lambda spec: spec.name)
def test_two_lines_that_cross_behind_are_behind_for_searches(spec: MethodSpec) -> None:
    """Where two rays diverge, a search ends at a sensor or far away: behind, not degenerate."""
    batch = bearing_batch([[(0.0, 0.0), (0.0, 1000.0)]], [[-2.641593, 2.641593]], std_rad=0.01)
    assert words(estimate(spec, batch)) == ["behind"]


def test_ml_recovers_some_fixes_behind_rays() -> None:
    """Of the snapshots whose linear fix is behind a ray, ML moves some in front of all rays."""
    batch = draw_world(3000, 4, (0.05, 0.6)).batch
    behind = np.array(words(estimate(bearings_stansfield.METHOD, batch))) == "behind"
    likely = np.array(words(estimate(bearings_ml.METHOD, batch)))
    assert behind.sum() > 50
    assert (likely[behind] == "ok").sum() > 10


def test_the_wrong_side_of_a_mirror_is_infeasible(method: MethodSpec) -> None:
    """A fix beyond the mirror of one of its rows is infeasible, and keeps position and covariance."""
    sensors = [(0.0, 0.0), (1.0, -5.0), (1.0, 5.0)]
    beyond = (5.0, 1.0)  # the mirrored row points at the image (1, 1), which no wave reaches by the mirror x = 3
    bearing = np.array([[np.arctan2(1.0, 1.0), *towards(sensors[1:], beyond)[0]]])
    estimates = estimate(method, bearing_batch([sensors], bearing, reflector=[[0, -1, -1]], scene=WALL))
    assert words(estimates) == ["infeasible"]
    np.testing.assert_allclose(estimates.position_m, [beyond], atol=1e-9)
    assert np.isfinite(estimates.covariance_m2).all()


def test_feasible_moves_a_fix_to_the_mirror() -> None:
    """With ``feasible`` a fix beyond its mirror moves to the mirror: boundary, without a covariance."""
    sensors = [(0.0, 0.0), (1.0, -5.0), (1.0, 5.0)]
    bearing = np.array([[np.arctan2(1.0, 1.0), *towards(sensors[1:], (5.0, 1.0))[0]]])
    batch = bearing_batch([sensors], bearing, reflector=[[0, -1, -1]], scene=WALL)
    estimates = estimate(bearings_ml.METHOD, batch, feasible=True)
    assert words(estimates) == ["boundary"]
    assert estimates.position_m[0, 0] == pytest.approx(3.0, abs=1e-3)
    assert np.isnan(estimates.covariance_m2).all()


def test_unused_mirrors_constrain_nothing(any_method: MethodSpec) -> None:
    """A mirror of the scene that no row uses makes no fix infeasible."""
    sensors = [(0.0, 0.0), (1.0, -5.0), (1.0, 5.0)]
    assert words(estimate(any_method, bearing_batch([sensors], towards(sensors, (5.0, 1.0)), scene=WALL))) == ["ok"]


def test_too_few_iterations_are_not_converged() -> None:
    """Noisy bearings at ``max_iterations=1`` are not_converged and have no answer."""
    estimates = estimate(bearings_ml.METHOD, draw_world(50, 4, (0.03, 0.1)).batch, max_iterations=1)
    assert set(words(estimates)) <= NO_ANSWER
    assert words(estimates).count("not_converged") > 40
    assert np.isnan(estimates.position_m).all()


@pytest.mark.parametrize("std", [1e-6, 1e-4, 1e-3, 1e-2])
def test_ordinary_bearings_converge(std: float) -> None:
    """Of 3,000 well-posed snapshots of any precision none is not_converged under ML."""
    estimates = estimate(bearings_ml.METHOD, draw_world(3000, 6, (std / 10.0, std)).batch)
    assert set(words(estimates)) == {"ok"}


def test_snapshots_without_an_answer_use_no_row(any_method: MethodSpec) -> None:
    """``used`` is false and ``residual_rad`` NaN for all rows of snapshots without an answer, and only there."""
    sensors = [(0.0, 0.0), (10.0, 0.0), (0.0, 10.0)]
    bearings = np.concatenate([towards(sensors, (4.0, 5.0)), np.full((1, 3), 0.7)])
    flags = flags_of(any_method, bearing_batch([sensors, sensors], bearings))
    assert flags.used.tolist() == [[True] * 3, [False] * 3]
    assert np.isnan(flags.columns["residual_rad"].astype(float)).tolist() == [[False] * 3, [True] * 3]
