"""Bearings and ranges together, against scipy's minimum of the same chi-square, written out again."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from bearing_worlds import draw_world, estimate, make_batch
from scipy.optimize import least_squares

from nlosctl.contract.batches import BearingBatch
from nlosctl.methods import bearings_mixture_ml, bearings_ml, bearings_sequential

SHARE = 0.3
"""Standard deviations of ranges, of what was measured: so coarse that the two laws of errors are far apart."""


def ranged_batch(snapshots: int) -> tuple[BearingBatch, np.ndarray]:
    """Return direct bearings with ranges of four sensors, and the sources."""
    generator = np.random.default_rng(3)
    world = draw_world(snapshots, 4, (0.2, 0.4), noise=0.0)
    away = world.source_xy_m[:, None] - world.batch.sensor_xy_m
    std = world.batch.bearing_std_rad
    range_m = np.hypot(away[..., 0], away[..., 1]) * np.exp(generator.normal(0.0, SHARE, std.shape))
    bearing = np.arctan2(away[..., 1], away[..., 0]) + std * generator.normal(size=std.shape)
    batch = dataclasses.replace(
        make_batch(world.batch.sensor_xy_m, bearing, std),
        range_m=np.asfortranarray(range_m),
        range_std_m=np.asfortranarray(SHARE * range_m),
    )
    return batch, world.source_xy_m


def residuals(at: np.ndarray, batch: BearingBatch, row: int, noise: str) -> np.ndarray:
    """Return the residuals of a snapshot's bearings and ranges in standard deviations."""
    dx, dy = (at - batch.sensor_xy_m[row]).T
    turned = [math.remainder(angle, 2.0 * math.pi) for angle in batch.bearing_rad[row] - np.arctan2(dy, dx)]
    distance, range_m = np.hypot(dx, dy), batch.range_m[row]
    off = (range_m - distance) / range_m if noise == "gaussian" else np.log(range_m / distance)
    return np.concatenate([turned / batch.bearing_std_rad[row], off / SHARE])


@pytest.mark.parametrize("noise", ["gaussian", "lognormal"])
def test_the_fix_is_the_least_chi_square_of_both(noise: str) -> None:
    """Fix and cost of ml are those of scipy: ranges by their own law, a lognormal one by the logarithm of its ratio."""
    batch, source = ranged_batch(20)
    found = estimate(bearings_ml.METHOD, batch, range_noise=noise)
    assert set(found.status) == {0}
    for row in range(20):
        best = least_squares(residuals, source[row], args=(batch, row, noise), xtol=1e-14, ftol=1e-14, gtol=1e-14)
        np.testing.assert_allclose(found.position_m[row], best.x, atol=1e-3)
        assert found.cost[row] == pytest.approx(best.cost, rel=1e-9)


@pytest.mark.parametrize("noise", ["gaussian", "lognormal"])
def test_the_cost_of_sequential_is_the_chi_square_at_its_fix(noise: str) -> None:
    """Half the sum of squares of all rows at the fix that is told, never below the least there is."""
    batch, _ = ranged_batch(20)
    found, least = (estimate(module.METHOD, batch, range_noise=noise) for module in (bearings_sequential, bearings_ml))
    answered = np.flatnonzero(found.status == 0)
    assert answered.size > 10
    for row in answered:
        expected = 0.5 * (residuals(found.position_m[row], batch, row, noise) ** 2).sum()
        assert found.cost[row] == pytest.approx(expected, rel=1e-9)
        assert found.cost[row] >= least.cost[row] * (1.0 - 1e-9)


@pytest.mark.parametrize("noise", ["gaussian", "lognormal"])
def test_a_mixture_that_expects_no_outlier_is_maximum_likelihood(noise: str) -> None:
    """With one outlier in 10^12 rows expected, the mixture's best fix is that of ml under the same law of ranges."""
    batch, _ = ranged_batch(20)
    mixture = estimate(bearings_mixture_ml.METHOD, batch, range_noise=noise, alpha=1e-12)
    best = mixture.position_m[mixture.alternative == 0]
    np.testing.assert_allclose(best, estimate(bearings_ml.METHOD, batch, range_noise=noise).position_m, atol=1e-3)
