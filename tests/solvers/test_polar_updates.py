"""Bootstrap and updates of the sequential algorithm, compared with the information form."""

from __future__ import annotations

import numpy as np
import pytest
from outlier_worlds import ring_batch

from nlosctl.models.bearings import sight_lines
from nlosctl.solvers.sequential.orders import RangedLines, run_all_orders
from nlosctl.solvers.sequential.polar_updates import bootstrap_state, select_rays, update_bearings, update_ranges


def _information(dx: float, dy: float, std_rad: float) -> np.ndarray:
    """Return the information of one bearing at an offset from its receiver: a term of (18)."""
    gradient = np.array([-dy, dx]) / (dx * dx + dy * dy)
    return np.outer(gradient, gradient) / std_rad**2


def test_bootstrap_covariance_is_the_inverse_information_of_the_pair() -> None:
    """(15) and (16) are right as printed: crossing and covariance agree with the information of both bearings."""
    _, batch, _ = ring_batch(1, 20, sources="disc")
    lines = sight_lines(batch)
    first, second = (np.full((20, 1), k) for k in (0, 3))
    state = bootstrap_state(select_rays(lines, first), select_rays(lines, second))
    for b in np.flatnonzero(state.alive[:, 0]):
        point = np.array([state.x[b, 0] + lines.center_x[b], state.y[b, 0] + lines.center_y[b]])
        total = np.zeros((2, 2))
        for k in (0, 3):
            dx, dy = point - batch.sensor_xy_m[b, k]
            assert np.isclose(np.sin(np.arctan2(dy, dx) - batch.bearing_rad[b, k]), 0.0, atol=1e-9)
            total += _information(dx, dy, batch.bearing_std_rad[b, k])
        covariance = np.linalg.inv(total)
        got = [state.covariance.xx[b, 0], state.covariance.xy[b, 0], state.covariance.yy[b, 0]]
        np.testing.assert_allclose(got, covariance[[0, 0, 1], [0, 1, 1]], rtol=1e-9)


def test_update_adds_the_information_of_the_bearing() -> None:
    """For a small step the updated covariance is the inverse of (22): prior information plus the bearing's."""
    truth, batch, _ = ring_batch(2, 20, bearing_std_deg=1e-4)
    lines = sight_lines(batch)
    places = [np.full((20, 1), k) for k in (0, 2, 5)]
    rows = [select_rays(lines, place) for place in places]
    prior = bootstrap_state(rows[0], rows[1])
    state = update_bearings(prior, rows[2])
    for b in range(20):
        before = np.array(
            [
                [prior.covariance.xx[b, 0], prior.covariance.xy[b, 0]],
                [prior.covariance.xy[b, 0], prior.covariance.yy[b, 0]],
            ]
        )
        dx, dy = truth[b] - batch.sensor_xy_m[b, 5]
        expected = np.linalg.inv(np.linalg.inv(before) + _information(dx, dy, batch.bearing_std_rad[b, 5]))
        got = [state.covariance.xx[b, 0], state.covariance.xy[b, 0], state.covariance.yy[b, 0]]
        np.testing.assert_allclose(got, expected[[0, 0, 1], [0, 1, 1]], rtol=1e-4)


@pytest.mark.parametrize("lognormal", [False, True])
def test_sequential_equals_one_linear_solve_when_errors_are_small(lognormal: bool) -> None:
    """With small errors, bearings and ranges in any order give the weighted least-squares point and covariance."""
    truth, batch, _ = ring_batch(3, 20, bearing_std_deg=1e-4, range_std_share=1e-6, sources="disc")
    assert batch.range_m is not None
    assert batch.range_std_m is not None
    lines = sight_lines(batch)
    ranged = RangedLines(lines, batch.range_m, batch.range_std_m, lognormal)
    first, second = np.zeros((20, 1), dtype=np.int64), np.full((20, 1), 2)
    last = run_all_orders(ranged, batch.seed, first, second).states[-1]
    for b in range(20):
        offset = truth[b] - batch.sensor_xy_m[b]
        distance = np.hypot(*offset.T)
        along, across = (
            offset / distance[:, None],
            np.stack([-offset[:, 1], offset[:, 0]], axis=1) / distance[:, None] ** 2,
        )
        residual = np.concatenate(
            [
                (batch.bearing_rad[b] - np.arctan2(offset[:, 1], offset[:, 0]) + np.pi) % (2.0 * np.pi) - np.pi,
                batch.range_m[b] - distance,
            ]
        )
        std = np.concatenate([batch.bearing_std_rad[b], batch.range_std_m[b]])
        design = np.concatenate([across, along]) / std[:, None]
        information = design.T @ design
        expected = truth[b] + np.linalg.solve(information, design.T @ (residual / std))
        got = np.array([last.x[b, 0] + lines.center_x[b], last.y[b, 0] + lines.center_y[b]])
        assert np.hypot(*(got - expected)) < 1e-3 * np.sqrt(np.trace(np.linalg.inv(information)))


def test_missing_ranges_update_nothing() -> None:
    """A NaN range leaves the state unchanged to the bit."""
    _, batch, _ = ring_batch(4, 10, range_std_share=0.02)
    assert batch.range_m is not None
    lines = sight_lines(batch)
    nothing = np.full_like(batch.range_m, np.nan)
    rows = [select_rays(lines, np.full((10, 1), k), nothing, nothing) for k in (0, 3)]
    state = bootstrap_state(*rows)
    updated = update_ranges(state, rows[1], lognormal=False)
    assert np.array_equal(updated.x, state.x)
    assert np.array_equal(updated.covariance.yy, state.covariance.yy)
