"""The covariance of ranges in a curved valley, compared with the second moment of the likelihood on a fine grid."""

from __future__ import annotations

import numpy as np
import pytest
from batches import range_batch

from nlosctl.contract.batches import RangeBatch
from nlosctl.contract.statuses import Status
from nlosctl.evaluation.consistency import squared_mahalanobis
from nlosctl.methods import ranges_r_ls
from nlosctl.models.ranges.circles import range_circles


def touching(bend_m: float, height_m: float = 0.0) -> RangeBatch:
    """Return ranges of three sensors nearly in line, whose circles touch at (300, 0); the third tilts the line."""
    sensors = np.array([(0.0, 0.0), (100.0, 3.0), (160.0, bend_m)])
    exact = np.hypot(np.hypot(*(np.array([300.0, 0.0]) - sensors).T), height_m)
    return range_batch(sensors, (exact + np.array([0.0, 0.4, -0.4]))[None], [[0.1, 1.0, 1.0]], height=height_m)


def second_moment(batch: RangeBatch, x_m: float, y_m: float) -> np.ndarray:
    """Return xx, xy, yy of the likelihood about a point, by a sum over polar cells about the first sensor."""
    reach = np.sqrt(batch.range_m[0, 0] ** 2 - batch.sensor_height_m[0, 0] ** 2)
    radius = reach + np.linspace(-1.0, 1.0, 401)[:, None]
    angle = np.linspace(-0.8, 0.8, 4001)[None]
    x, y = radius * np.cos(angle), radius * np.sin(angle)
    half = np.zeros(x.shape)
    for k in range(3):
        sensor_x, sensor_y = batch.sensor_xy_m[0, k]
        away = np.sqrt((x - sensor_x) ** 2 + (y - sensor_y) ** 2 + batch.sensor_height_m[0, k] ** 2)
        half += 0.5 * ((away - batch.range_m[0, k]) / batch.range_std_m[0, k]) ** 2
    weight = radius * np.exp(half.min() - half)
    weight /= weight.sum()
    dx, dy = x - x_m, y - y_m
    return np.array([(weight * dx * dx).sum(), (weight * dx * dy).sum(), (weight * dy * dy).sum()])


@pytest.mark.parametrize(("bend_m", "height_m"), [(12.0, 0.0), (25.0, 0.0), (25.0, 40.0)])
def test_the_covariance_is_the_second_moment_where_circles_nearly_touch(bend_m: float, height_m: float) -> None:
    """It agrees with brute force to 5 % of the trace; the inverse information is off by more than a quarter."""
    batch = touching(bend_m, height_m)
    found = ranges_r_ls.METHOD.solve(batch, ranges_r_ls.METHOD.options()).estimates
    expected = second_moment(batch, *found.position_m[0])
    np.testing.assert_allclose(found.covariance_m2[0], expected, atol=0.05 * (expected[0] + expected[2]))
    circles = range_circles(batch)
    at = (found.position_m[:1] - np.stack([circles.center_x, circles.center_y], axis=1)).T
    information = circles.information(*at).inverse()
    assert abs(information.trace[0] / (expected[0] + expected[2]) - 1.0) > 0.25


def test_well_determined_fixes_keep_the_inverse_information() -> None:
    """Where circles cross at wide angles the covariance is the inverse information to the bit."""
    generator = np.random.default_rng(3)
    sensors = np.array([(0.0, 0.0), (100.0, 0.0), (50.0, 90.0), (40.0, 30.0)])
    source = generator.uniform(20.0, 80.0, (200, 1, 2))
    ranges = np.hypot(*np.moveaxis(sensors - source, -1, 0)) + 0.1 * generator.normal(size=(200, 4))
    batch = range_batch(np.broadcast_to(sensors, (200, 4, 2)), ranges, 0.1)
    found = ranges_r_ls.METHOD.solve(batch, ranges_r_ls.METHOD.options()).estimates
    best = np.flatnonzero((found.alternative == 0) & (found.status == Status.OK))
    circles = range_circles(batch)
    at = found.position_m[best].T - np.stack([circles.center_x[best], circles.center_y[best]])
    information = circles.take(best).information(*at).inverse()
    np.testing.assert_allclose(found.covariance_m2[best], information.stack(), rtol=1e-9)


def test_absurd_fixes_of_three_sensors_are_rare() -> None:
    """Of 20,000 snapshots with coarse ranges more than 94.4 % are in their ellipse, at most 6 have a NEES above 100."""
    generator = np.random.default_rng(5)
    shape = (20000, 3)
    sensors, source = generator.uniform(0.0, 20.0, (*shape, 2)), generator.uniform(0.0, 20.0, (20000, 1, 2))
    std = generator.uniform(0.05, 0.3, shape)
    ranges = np.hypot(*np.moveaxis(sensors - source, -1, 0)) + std * generator.normal(size=shape)
    batch = range_batch(sensors, np.maximum(ranges, 0.01), std)
    found = ranges_r_ls.METHOD.solve(batch, ranges_r_ls.METHOD.options()).estimates
    ok = np.flatnonzero((found.alternative == 0) & (found.status == Status.OK))
    nees = squared_mahalanobis(found.position_m[ok] - source[found.row[ok], 0], found.covariance_m2[ok])
    assert np.mean(nees < 5.991) > 0.944
    assert np.count_nonzero(nees > 100.0) <= 6
