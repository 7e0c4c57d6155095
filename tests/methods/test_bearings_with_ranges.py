"""Maximum likelihood of bearings and ranges together, against scipy's minimum of the same chi-square."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from bearing_worlds import draw_world, estimate, make_batch
from scipy.optimize import least_squares

from nlosctl.methods import bearings_ml


@pytest.mark.parametrize("noise", ["gaussian", "lognormal"])
def test_the_fix_is_the_least_chi_square_of_both(noise: str) -> None:
    """Fix and cost are those of scipy: ranges by their own law, a lognormal one by the logarithm of its ratio."""
    generator = np.random.default_rng(3)
    world = draw_world(20, 4, (0.2, 0.4), noise=0.0)
    sensors = world.batch.sensor_xy_m
    away = world.source_xy_m[:, None] - sensors
    range_m = np.hypot(away[..., 0], away[..., 1]) * np.exp(generator.normal(0.0, 0.3, (20, 4)))
    bearing = np.arctan2(away[..., 1], away[..., 0]) + world.batch.bearing_std_rad * generator.normal(size=(20, 4))
    batch = dataclasses.replace(
        make_batch(sensors, bearing, world.batch.bearing_std_rad),
        range_m=np.asfortranarray(range_m),
        range_std_m=np.asfortranarray(0.3 * range_m),
    )
    found = estimate(bearings_ml.METHOD, batch, range_noise=noise)
    assert set(found.status) == {0}
    for row in range(20):

        def residuals(at: np.ndarray, row: int = row) -> np.ndarray:
            dx, dy = (at - sensors[row]).T
            turned = [math.remainder(angle, 2.0 * math.pi) for angle in bearing[row] - np.arctan2(dy, dx)]
            distance = np.hypot(dx, dy)
            off = np.log(range_m[row] / distance) / 0.3
            if noise == "gaussian":
                off = (range_m[row] - distance) / (0.3 * range_m[row])
            return np.concatenate([turned / world.batch.bearing_std_rad[row], off])

        best = least_squares(residuals, world.source_xy_m[row], xtol=1e-14, ftol=1e-14, gtol=1e-14)
        np.testing.assert_allclose(found.position_m[row], best.x, atol=1e-3)
        assert found.cost[row] == pytest.approx(best.cost, rel=1e-9)
