"""Calibration of the covariance: NEES and coverage on random mixed scenes."""

from __future__ import annotations

import numpy as np
import pytest
from bearing_worlds import draw_world, estimate, squared_mahalanobis

from nlosctl.contract.methods import MethodSpec
from nlosctl.methods import bearings_ls, bearings_ml, bearings_stansfield

CHI_SQUARE_95 = 5.991464547107979


@pytest.mark.parametrize("std_deg", [0.1, 0.5, 1.0, 2.0])
@pytest.mark.parametrize("measurements", [3, 8])
def test_nees_is_two_and_ellipses_cover(method: MethodSpec, std_deg: float, measurements: int) -> None:
    """NEES is 2 within its Monte Carlo error and 5 %, and the 95 % ellipse covers the source in 93 to 97.5 %."""
    std = float(np.radians(std_deg))
    world = draw_world(10_000, measurements, (std / 3.0, std))
    squared = squared_mahalanobis(estimate(method, world.batch), world.source_xy_m)
    fixes = squared[~np.isnan(squared)]
    assert fixes.size > 9_900
    assert abs(fixes.mean() - 2.0) < 0.1 + 4.0 * fixes.std() / np.sqrt(fixes.size)
    assert 0.93 < (fixes <= CHI_SQUARE_95).mean() < 0.975


def rms_error(method: MethodSpec, span: tuple[float, float]) -> float:
    """Return the RMS error in metres over snapshots of eight bearings with stds in a span."""
    world = draw_world(10_000, 8, span, seed=4)
    error = estimate(method, world.batch).position_m - world.source_xy_m
    return float(np.sqrt(np.nanmean((error**2).sum(axis=1))))


def test_unequal_stds_are_weighted() -> None:
    """With stds unequal by a factor of 30, Stansfield and ML have less than half the error of least squares."""
    span = (0.001, 0.03)
    plain, weighed, likely = (
        rms_error(module.METHOD, span) for module in (bearings_ls, bearings_stansfield, bearings_ml)
    )
    assert weighed < 0.5 * plain
    assert likely < 1.02 * weighed


def test_ml_reaches_the_cramer_rao_bound() -> None:
    """At half a degree the RMS error of ML is within 3 % of its inverse information."""
    world = draw_world(20_000, 6, (0.003, 0.01), seed=5)
    estimates = estimate(bearings_ml.METHOD, world.batch)
    mean_square = np.nanmean(((estimates.position_m - world.source_xy_m) ** 2).sum(axis=1))
    bound = np.nanmean(estimates.covariance_m2[:, 0] + estimates.covariance_m2[:, 2])
    assert np.sqrt(mean_square / bound) == pytest.approx(1.0, abs=0.03)


def test_the_covariance_of_ls_is_the_sandwich() -> None:
    """The LS covariance is A^+ diag(std^2 range^2) A^+^T at its own fix, computed by numpy per snapshot."""
    world = draw_world(40, 5, (0.002, 0.05))
    batch = world.batch
    direct = np.full(batch.reflector.shape, -1)
    bearing = np.arctan2(*np.moveaxis(world.source_xy_m[:, None] - batch.sensor_xy_m, -1, 0)[::-1])
    bearing = bearing + batch.bearing_std_rad * np.random.default_rng(2).normal(size=bearing.shape)
    batch = type(batch)(**{**vars(batch), "bearing_rad": bearing, "reflector": direct})
    estimates = estimate(bearings_ls.METHOD, batch)
    for row in range(40):
        normal = np.stack([-np.sin(bearing[row]), np.cos(bearing[row])], axis=1)
        distance = np.linalg.norm(estimates.position_m[row] - batch.sensor_xy_m[row], axis=1)
        pseudo_inverse = np.linalg.pinv(normal)
        spread = np.diag((batch.bearing_std_rad[row] * distance) ** 2)
        expected = pseudo_inverse @ spread @ pseudo_inverse.T
        xx, xy, yy = estimates.covariance_m2[row]
        np.testing.assert_allclose([[xx, xy], [xy, yy]], expected, rtol=1e-8, atol=1e-8 * np.trace(expected))
