"""Noise-free bearings give the source."""

from __future__ import annotations

import math

import numpy as np
import pytest
from batches import bearing_batch
from bearing_worlds import draw_world, estimate, flags_of, words
from hypothesis import given, settings
from hypothesis import strategies as st

from nlosctl.contract.methods import MethodSpec
from nlosctl.contract.scene import LineReflector, Scene
from nlosctl.errors import UsageError
from nlosctl.methods import bearings_ls, bearings_ml, bearings_ml_grid, bearings_stansfield

METHODS = [bearings_ls.METHOD, bearings_stansfield.METHOD, bearings_ml.METHOD]


@pytest.mark.parametrize("measurements", [2, 3, 8, 40])
def test_noise_free_bearings_return_the_source(method: MethodSpec, measurements: int) -> None:
    """The error is at most 1e-9 of the scene's size, for direct and mirror rows, vertical mirrors included."""
    world = draw_world(500, measurements, (1e-4, 1e-3), noise=0.0)
    estimates = estimate(method, world.batch)
    fixed = np.array(words(estimates)) == "ok"
    # Two sensors may have the source right between them; three are not in a line.
    assert fixed.mean() > (0.98 if measurements == 2 else 0.9999)
    assert np.abs(estimates.position_m - world.source_xy_m)[fixed].max() < 1e-9 * 1e3
    assert estimates.cost[fixed].max() < 1e-12
    assert (estimates.n_used[fixed] == measurements).all()


@pytest.mark.extensive
@settings(max_examples=50, deadline=None, derandomize=True)
@given(st.floats(-3.0, 7.0), st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.integers(3, 12), st.integers(0, 10**6))
def test_exact_at_any_scale_and_offset(
    exponent: float, east: float, north: float, measurements: int, seed: int
) -> None:
    """From millimetres to 10,000 km, and at 1e8 m, the error is 1e-9 of the larger of size and offset."""
    scale = 10.0**exponent
    # Beyond a million sizes away float64 coordinates no longer distinguish the sensors.
    reach = min(1e8, 1e5 * scale)
    offset = (east * reach, north * reach)
    world = draw_world(5, measurements, (1e-4, 1e-3), scale_m=scale, offset_m=offset, noise=0.0, seed=seed)
    for method in METHODS:
        estimates = estimate(method, world.batch)
        assert set(words(estimates)) == {"ok"}
        assert np.abs(estimates.position_m - world.source_xy_m).max() < 1e-9 * max(scale, math.hypot(*offset))


def test_one_sensor_with_a_direct_and_a_mirrored_path_has_a_fix(method: MethodSpec) -> None:
    """From (0, 0), 45 degrees directly and atan2(2, 4) in the mirror x = 3 give the source (2, 2)."""
    scene = Scene(reflectors=(LineReflector(name="wall", point=(3.0, 0.0), direction=(0.0, 1.0)),))
    batch = bearing_batch((0.0, 0.0), [[np.pi / 4, math.atan2(2.0, 4.0)]], reflector=[[-1, 0]], scene=scene)
    np.testing.assert_allclose(estimate(method, batch).position_m, [[2.0, 2.0]], atol=1e-12)


def test_two_bearings_by_hand(method: MethodSpec) -> None:
    """From (0, 0) at 45 and from (10, 0) at 135 degrees the source is (5, 5); the covariance follows by hand.

    Both ranges are r = sqrt(50), both lines are square to each other: covariance (std r)^2 in every direction.
    """
    estimates = estimate(method, bearing_batch([[(0.0, 0.0), (10.0, 0.0)]], [[np.pi / 4, 3 * np.pi / 4]], std_rad=0.01))
    np.testing.assert_allclose(estimates.position_m, [[5.0, 5.0]], atol=1e-12)
    np.testing.assert_allclose(estimates.covariance_m2, [[50e-4, 0.0, 50e-4]], atol=1e-12)


def test_bearings_need_not_be_wrapped(any_method: MethodSpec) -> None:
    """A bearing plus a whole turn gives the same fix, cost and residual."""
    world = draw_world(50, 6)
    turned = bearing_batch(
        world.batch.sensor_xy_m,
        world.batch.bearing_rad + 2 * np.pi * np.array([1, -1, 0, 1, 0, -1]),
        world.batch.bearing_std_rad,
        world.batch.reflector,
        world.batch.scene,
    )
    one, other = estimate(any_method, world.batch), estimate(any_method, turned)
    np.testing.assert_allclose(one.position_m, other.position_m, rtol=0, atol=1e-6)
    np.testing.assert_allclose(one.cost, other.cost, rtol=1e-6)
    residuals = [flags_of(any_method, batch).columns["residual_rad"] for batch in (world.batch, turned)]
    np.testing.assert_allclose(*residuals, rtol=0, atol=1e-9)


def test_residuals_and_cost_agree(method: MethodSpec) -> None:
    """The cost is half the sum of the squared residuals over their variances."""
    world = draw_world(50, 6, (0.001, 0.05))
    residual = np.asarray(flags_of(method, world.batch).columns["residual_rad"], dtype=float)
    expected = 0.5 * ((residual / world.batch.bearing_std_rad) ** 2).sum(axis=1)
    np.testing.assert_allclose(estimate(method, world.batch).cost, expected, rtol=1e-6)


def test_a_grid_of_too_many_vertices_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """A grid has vertices at both ends of both sides; more than the limit is a usage error."""
    monkeypatch.setenv("NLOSCTL_MAX_GRID_VERTICES", "12")
    batch = bearing_batch([[(0.0, 0.0), (10.0, 0.0)]], [[np.pi / 4, 3 * np.pi / 4]])
    found = estimate(bearings_ml_grid.METHOD, batch, width_m=3.0, height_m=2.0, step_m=1.0)
    assert np.abs(found.position_m - 5.0).max() <= 0.5
    with pytest.raises(UsageError, match="make 16 vertices, more than 12"):
        estimate(bearings_ml_grid.METHOD, batch, width_m=3.0, height_m=3.0, step_m=1.0)
