"""Bearing methods on rows by circles: exactness, infeasible and ambiguous cases."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from batches import bearing_batch
from bearing_worlds import estimate, flags_of, words

from nlosctl.contract.methods import MethodSpec
from nlosctl.contract.scene import CircleReflector, LineReflector, Scene
from nlosctl.geometry.circular_reflection import all_reflections
from nlosctl.methods import bearings_mixture_ml, bearings_ml, bearings_ml_grid, bearings_stansfield
from nlosctl.models.bearing_predictions import predict_bearings

FloatArray = npt.NDArray[np.float64]

EARTH_M, IONOSPHERE_M = 6371e3, 6671e3
IONOSPHERE = Scene(
    reflectors=(
        CircleReflector(name="ionosphere", center=(0.0, 0.0), radius=IONOSPHERE_M, blocker_radius=EARTH_M),
        LineReflector(name="wall", point=(7000e3, 0.0), direction=(0.0, 1.0)),
    )
)
RING = Scene(reflectors=(CircleReflector(name="ring", center=(20.0, -10.0), radius=100.0),))


def on_ground(*angles: float) -> FloatArray:
    """Return sensors (1, K, 2) at angles from +x, times pi."""
    turn = np.pi * np.array(angles)
    return EARTH_M * np.stack([np.cos(turn), np.sin(turn)], axis=-1)[None]


def bearings_of(sensor_xy: FloatArray, source: tuple[float, float], reflector: Any = 0) -> FloatArray:
    """Return the bearings (1, K) of a source without error."""
    placed = np.broadcast_to(reflector, sensor_xy.shape[:2])
    return predict_bearings(sensor_xy, placed, IONOSPHERE, np.broadcast_to(source, sensor_xy.shape))


SENSORS = on_ground(0.1, 0.08, -0.09, -0.06)
SOURCE = (6421e3, 30e3)


def test_noise_free_rows_meet_in_the_source(any_method: MethodSpec) -> None:
    """Noise-free direct rows, mirror rows and ionospheric rows together give the source."""
    sensor_xy = np.concatenate([SENSORS, on_ground(0.02, -0.03, 0.01)], axis=1)
    reflector = np.array([[0, 0, 0, 0, -1, -1, 1]])
    bearing = bearings_of(sensor_xy, SOURCE, reflector)
    found = estimate(any_method, bearing_batch(sensor_xy, bearing, 0.01, reflector, IONOSPHERE))
    assert words(found) == ["ok"]
    np.testing.assert_allclose(found.position_m[0], SOURCE, atol=1e-3)
    assert found.cost[0] < 1e-9


def test_stansfield_focused_without_circles_is_stansfield() -> None:
    """Without circle rows both methods agree to the bit."""
    sensor_xy = on_ground(0.02, -0.03, 0.01)
    bearing = bearings_of(sensor_xy, SOURCE, -1) + 0.01 * np.array([[1.0, -1.0, 0.5]])
    batch = bearing_batch(sensor_xy, bearing, 0.01, -1, IONOSPHERE)
    first, second = (estimate(spec, batch) for spec in (bearings_stansfield.METHOD, bearings_stansfield.FOCUSED))
    np.testing.assert_array_equal(first.position_m, second.position_m)
    np.testing.assert_array_equal(first.covariance_m2, second.covariance_m2)


@pytest.mark.parametrize("source", [(6300e3, 0.0), (5703e3, -2906e3)], ids=["under ground", "in A1"])
def test_estimates_outside_the_scene_are_infeasible(method: MethodSpec, source: tuple[float, float]) -> None:
    """A free estimate under the ground or out of reach is kept, with status infeasible."""
    sensor_xy = on_ground(0.03, 0.06, -0.02, -0.06)
    bearing = bearings_of(sensor_xy, source)
    found = estimate(method, bearing_batch(sensor_xy, bearing, 0.002, 0, IONOSPHERE))
    assert words(found) == ["infeasible"]
    assert np.isfinite(found.covariance_m2).all()


def test_misplaced_sensors_are_degenerate(any_method: MethodSpec) -> None:
    """A sensor outside the circle or under the ground makes its snapshot degenerate; others are unaffected."""
    sensor_xy = np.concatenate([SENSORS, SENSORS, SENSORS])
    bearing = np.repeat(bearings_of(SENSORS, SOURCE), 3, axis=0)
    sensor_xy[1, 2] *= 1.1
    sensor_xy[2, 0] *= 0.99
    found = estimate(any_method, bearing_batch(sensor_xy, bearing, 0.01, 0, IONOSPHERE))
    assert words(found) == ["ok", "degenerate", "degenerate"]
    assert np.isnan(found.position_m[1:]).all()


def test_rows_under_the_horizon_are_flagged(method: MethodSpec) -> None:
    """A row that points below its horizon is flagged; the fix is kept while another row points above."""
    bearing = bearings_of(SENSORS, SOURCE)
    straight_down = np.arctan2(-SENSORS[0, 0, 1], -SENSORS[0, 0, 0])
    bearing[0, 0] = straight_down + 1.4
    batch = bearing_batch(SENSORS, bearing, 0.1, 0, IONOSPHERE)
    columns = flags_of(method, batch).columns
    assert method.name == "sequential" or columns["under_horizon"].tolist() == [[True, False, False, False]]


def test_a_snapshot_under_the_horizon_is_not_ok(method: MethodSpec) -> None:
    """If every bearing points into the ground, the status is not ok."""
    level = np.arctan2(SENSORS[..., 1], SENSORS[..., 0])
    below = level + np.sign(-SENSORS[..., 1]) * np.radians(92.0)
    found = estimate(method, bearing_batch(SENSORS, below, 0.05, 0, IONOSPHERE))
    assert words(found) != ["ok"]
    columns = flags_of(method, bearing_batch(SENSORS, below, 0.05, 0, IONOSPHERE)).columns
    assert method.name == "sequential" or columns["under_horizon"].all()


def test_one_circle_row_is_too_few(any_method: MethodSpec) -> None:
    """One bearing gives too_few."""
    batch = bearing_batch(SENSORS[:, :1], bearings_of(SENSORS, SOURCE)[:, :1], 0.01, 0, IONOSPHERE)
    assert words(estimate(any_method, batch)) == ["too_few"]


def test_least_elevation_makes_low_paths_infeasible() -> None:
    """A source whose paths leave below the least elevation is infeasible."""
    bearing = bearings_of(SENSORS, SOURCE)
    for least, expected in ((0.0, "ok"), (60.0, "infeasible")):
        layer = CircleReflector(
            name="i", center=(0.0, 0.0), radius=IONOSPHERE_M, blocker_radius=EARTH_M, min_elevation_deg=least
        )
        batch = bearing_batch(SENSORS, bearing, 0.01, 0, Scene(reflectors=(layer,)))
        assert words(estimate(bearings_ml.METHOD, batch)) == [expected]


def test_a_direct_row_beyond_the_horizon_is_infeasible() -> None:
    """In a scene with an opaque circle a direct row needs a clear line of sight to the estimate."""
    sensor_xy = on_ground(0.1, 0.08, -0.09, 0.2)
    reflector = np.array([[0, 0, 0, -1]])
    bearing = bearings_of(sensor_xy, SOURCE, reflector)
    assert words(estimate(bearings_ml.METHOD, bearing_batch(sensor_xy, bearing, 0.01, reflector, IONOSPHERE))) == [
        "infeasible"
    ]


def test_feasible_moves_an_estimate_to_the_edge() -> None:
    """With ``feasible`` an estimate under the ground moves to its surface: boundary, no covariance, higher cost."""
    bearing = bearings_of(SENSORS, (6365e3, 0.0))
    batch = bearing_batch(SENSORS, bearing, 0.02, 0, IONOSPHERE)
    free, held = estimate(bearings_ml.METHOD, batch), estimate(bearings_ml.METHOD, batch, feasible=True)
    assert (words(free), words(held)) == (["infeasible"], ["boundary"])
    assert np.hypot(*held.position_m[0]) == pytest.approx(EARTH_M, abs=1.0)
    assert np.isnan(held.covariance_m2).all()
    assert held.cost[0] > free.cost[0]


def ring_world(seed: int, std: float) -> tuple[Any, FloatArray]:
    """Return a batch of 150 snapshots of four sensors in an open circle, each row along any of its paths."""
    generator = np.random.default_rng(seed)
    center = np.array([20.0, -10.0])
    sensor_xy = generator.uniform(-60.0, 60.0, (150, 4, 2))
    source = generator.uniform(-60.0, 60.0, (150, 1, 2))
    ends = [part.ravel() for end in (sensor_xy, source + 0.0 * sensor_xy) for part in (end[..., 0], end[..., 1])]
    paths = all_reflections(*ends, np.full(600, 100.0)).bearing_rad
    chosen = np.argmax(np.where(np.isnan(paths), -1.0, generator.random(paths.shape)), axis=0)
    bearing = paths[chosen, np.arange(600)].reshape(150, 4)
    noisy = bearing + std * generator.normal(size=bearing.shape)
    batch = bearing_batch(center + sensor_xy, noisy, max(std, 0.01), np.zeros((150, 4), dtype=int), RING)
    return batch, center + source[:, 0]


@pytest.mark.extensive
def test_feasible_constrains_fixes_in_an_open_circle() -> None:
    """Fixes behind a wall that reflected a row are infeasible; with ``feasible`` they are in front of it or on it."""
    batch, source = ring_world(2, 0.0)
    wall = LineReflector(name="wall", point=(30.0, 0.0), direction=(0.0, 1.0))
    scene = Scene(reflectors=(*RING.reflectors, wall))
    sensor_xy = np.concatenate([batch.sensor_xy_m, np.full((150, 1, 2), -10.0)], axis=1)
    image = np.arctan2(source[:, 1] + 10.0, 60.0 - source[:, 0] + 10.0)
    bearing = np.concatenate([batch.bearing_rad, image[:, None]], axis=1)
    both = bearing_batch(sensor_xy, bearing, 0.01, np.array([[0, 0, 0, 0, 1]]), scene)
    free, held = (estimate(bearings_ml.METHOD, both, feasible=feasible) for feasible in (False, True))
    beyond = source[:, 0] > 31.0
    first = np.array(words(free))[free.alternative == 0][beyond]
    assert (first == "infeasible").mean() > 0.9
    kept = np.array(words(held))
    assert "boundary" in kept
    answered = np.isin(kept, ["ok", "ambiguous", "boundary"])
    assert held.position_m[answered, 0].max() < 30.1
    assert (kept == "infeasible").mean() < 0.05


def test_noise_free_bearings_in_an_open_circle_give_the_source() -> None:
    """Without a blocker the paths are ambiguous, yet noise-free bearings give their source."""
    batch, source = ring_world(1, 0.0)
    found = estimate(bearings_ml.METHOD, batch)
    best = found.alternative == 0
    solved = best & (found.status <= 1)
    assert solved.sum() > 140
    np.testing.assert_allclose(found.position_m[solved], source[found.row[solved]], atol=1e-4)


def test_alternatives_are_ranked_and_ambiguity_is_reported() -> None:
    """Costs rise from 0; the status is ambiguous exactly if the next is within the given nats."""
    batch, _ = ring_world(2, 0.2)
    found = estimate(bearings_ml.METHOD, batch)
    several = 0
    for row in range(150):
        mine = np.flatnonzero(found.row == row)
        assert found.alternative[mine].tolist() == list(range(mine.size))
        if mine.size > 1:
            several += 1
            assert (np.diff(found.cost[mine]) >= 0.0).all()
            if found.cost[mine[1]] - found.cost[mine[0]] <= 2.0:
                assert words(found)[mine[0]] in ("ambiguous", "not_converged")
    assert several >= 4
    strict = estimate(bearings_ml.METHOD, batch, ambiguous_within=0.0)
    wide = estimate(bearings_ml.METHOD, batch, ambiguous_within=1e6)
    ambiguous = [words(e).count("ambiguous") for e in (strict, found, wide)]
    assert ambiguous[0] <= ambiguous[1] < ambiguous[2]


def test_a_field_without_allowed_vertices_has_no_candidate() -> None:
    """ml-grid does not fall back on least squares if the scene forbids the whole search region."""
    sensor_xy = on_ground(0.03, 0.06, 0.045)
    bearing = bearings_of(sensor_xy, (6300e3, 500e3))
    batch = bearing_batch(sensor_xy, bearing, 0.002, 0, IONOSPHERE)
    found = estimate(bearings_ml_grid.METHOD, batch, width_m=10e3, height_m=10e3, step_m=5e3)
    assert words(found) == ["no_candidate"]
    assert np.isnan(found.position_m).all()


def test_the_best_vertex_on_the_edge_is_boundary() -> None:
    """If the likelihood still rises at the edge of the search region the status is boundary."""
    sensor_xy = np.array([[[0.0, 0.0], [100.0, 0.0], [50.0, 80.0]]])
    bearing = np.array([[0.6, 2.8, -1.2]])
    batch = bearing_batch(sensor_xy, bearing, [0.001, 0.5, 0.001])
    found = estimate(bearings_ml_grid.METHOD, batch, width_m=4.0, height_m=4.0, step_m=1.0)
    wide = estimate(bearings_ml_grid.METHOD, batch, width_m=80.0, height_m=80.0, step_m=1.0)
    assert (words(found), words(wide)) == (["boundary"], ["ok"])
    exact = estimate(bearings_ml.METHOD, batch)
    assert np.hypot(*(wide.position_m - exact.position_m)[0]) < 1.0


def test_flags_without_circles_have_no_horizon_column(method: MethodSpec) -> None:
    """A scene without circles has no column under_horizon."""
    batch = bearing_batch([[[0.0, 0.0], [10.0, 0.0]]], [[0.8, 2.3]])
    assert set(flags_of(method, batch).columns) == {"residual_rad"}


def nees_of(estimates: Any, truth: FloatArray) -> FloatArray:
    """Return the normalized squared error of each best fix."""
    best = estimates.alternative == 0
    x, y = (estimates.position_m[best] - truth[estimates.row[best]]).T
    xx, xy, yy = estimates.covariance_m2[best].T
    nees: FloatArray = (yy * x * x - 2.0 * xy * x * y + xx * y * y) / (xx * yy - xy * xy)
    return nees


def test_the_mixture_weighs_circle_rows_by_their_width() -> None:
    """On ionospheric rows alone mixture-ml agrees with ml and is calibrated; one outlier is rejected."""
    generator = np.random.default_rng(8)
    sensor_xy = np.broadcast_to(on_ground(0.1, 0.08, 0.06, -0.05, -0.07, -0.09), (400, 6, 2))
    turn, height = generator.uniform(-0.01, 0.01, 400), generator.uniform(20e3, 60e3, 400)
    source_xy = (EARTH_M + height)[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    placed = np.zeros((400, 6), dtype=np.int64)
    exact = predict_bearings(sensor_xy, placed, IONOSPHERE, np.broadcast_to(source_xy[:, None], sensor_xy.shape))
    bearing = exact + 1e-4 * generator.normal(size=exact.shape)
    plain = estimate(bearings_ml.METHOD, bearing_batch(sensor_xy, bearing, 1e-4, 0, IONOSPHERE))
    robust = estimate(bearings_mixture_ml.METHOD, bearing_batch(sensor_xy, bearing, 1e-4, 0, IONOSPHERE))
    best = robust.alternative == 0
    apart = np.hypot(*(plain.position_m - robust.position_m[best]).T)
    std = np.sqrt(plain.covariance_m2[:, 0] + plain.covariance_m2[:, 2])
    assert np.quantile(apart / std, 0.9) < 0.2
    nees = nees_of(robust, source_xy)
    assert abs(nees.mean() - 2.0) < 4.0 * 2.0 / np.sqrt(400)
    assert 0.93 <= np.mean(nees < 5.991) <= 0.975
    lying = bearing.copy()
    lying[:, 2] += 0.02
    solution = bearings_mixture_ml.METHOD.solve(
        bearing_batch(sensor_xy, lying, 1e-4, 0, IONOSPHERE), bearings_mixture_ml.METHOD.options()
    )
    assert solution.flags is not None
    assert solution.flags.columns["los"].mean(axis=0)[2] < 0.01
    assert np.median(nees_of(solution.estimates, source_xy)) < 2.0
