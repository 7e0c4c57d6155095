"""Bearings with ranges, compared with scipy's minimum of the same chi-square."""

from __future__ import annotations

import dataclasses
import math
from types import ModuleType

import numpy as np
import pytest
from batches import bearing_batch
from bearing_worlds import draw_world, estimate
from scipy.optimize import least_squares
from scipy.stats import norm

from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.fields import CircleField
from nlosctl.contract.statuses import Status
from nlosctl.methods import bearings_mixture_ml, bearings_ml, bearings_sequential, bearings_suppress
from nlosctl.models.bearings import sight_lines
from nlosctl.solvers.bearings.row_terms import DirectBearings

SHARE = 0.3
"""Relative standard deviations of ranges: large enough that the two error laws differ clearly."""


def ranged_batch(snapshots: int) -> tuple[BearingBatch, np.ndarray]:
    """Return direct bearings with ranges of four sensors, and the sources."""
    generator = np.random.default_rng(3)
    world = draw_world(snapshots, 4, (0.2, 0.4), noise=0.0)
    away = world.source_xy_m[:, None] - world.batch.sensor_xy_m
    std = world.batch.bearing_std_rad
    range_m = np.hypot(away[..., 0], away[..., 1]) * np.exp(generator.normal(0.0, SHARE, std.shape))
    bearing = np.arctan2(away[..., 1], away[..., 0]) + std * generator.normal(size=std.shape)
    batch = dataclasses.replace(
        bearing_batch(world.batch.sensor_xy_m, bearing, std),
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
def test_the_fix_minimizes_the_joint_chi_square(noise: str) -> None:
    """Fix and cost of ml agree with scipy, for Gaussian ranges and for lognormal ones by their log ratio."""
    batch, source = ranged_batch(20)
    found = estimate(bearings_ml.METHOD, batch, range_noise=noise)
    assert set(found.status) == {0}
    for row in range(20):
        best = least_squares(residuals, source[row], args=(batch, row, noise), xtol=1e-14, ftol=1e-14, gtol=1e-14)
        np.testing.assert_allclose(found.position_m[row], best.x, atol=1e-3)
        assert found.cost[row] == pytest.approx(best.cost, rel=1e-9)


@pytest.mark.parametrize("noise", ["gaussian", "lognormal"])
def test_the_cost_of_sequential_is_the_chi_square_at_its_fix(noise: str) -> None:
    """The cost is half the chi-square of all rows at the reported fix, never below the minimum."""
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
    """With an outlier probability of 1e-12 the best fix of the mixture is that of ml under the same law of ranges."""
    batch, _ = ranged_batch(20)
    mixture = estimate(bearings_mixture_ml.METHOD, batch, range_noise=noise, alpha=1e-12)
    best = mixture.position_m[mixture.alternative == 0]
    np.testing.assert_allclose(best, estimate(bearings_ml.METHOD, batch, range_noise=noise).position_m, atol=1e-3)


@pytest.mark.parametrize("noise", ["gaussian", "lognormal"])
@pytest.mark.parametrize("module", [bearings_mixture_ml, bearings_suppress], ids=lambda module: module.METHOD.name)
def test_the_cost_of_robust_methods_is_the_likelihood_at_the_fix(module: ModuleType, noise: str) -> None:
    """Equation (23): a row is direct, Gaussian in bearing and range, or uniform over search region and view."""
    batch, _ = ranged_batch(20)
    batch = dataclasses.replace(batch, field=CircleField(x_m=0.0, y_m=0.0, radius_m=3e3))
    found = estimate(module.METHOD, batch, range_noise=noise, alpha=0.1, field_of_view_deg=120.0)
    outlier = 1.0 / np.radians(120.0) / np.hypot(6e3, 6e3)
    assert np.isfinite(found.cost).sum() > 15
    for row, at, cost in zip(found.row, found.position_m, found.cost, strict=True):
        if np.isnan(cost):
            continue
        turned, off = residuals(at, batch, row, noise).reshape(2, 4)
        std = batch.bearing_std_rad[row]
        ahead = [math.erf(math.pi / 2.0 / math.sqrt(2.0) / spread) for spread in std]
        direct = norm.pdf(turned) / std / ahead * norm.pdf(off) / batch.range_std_m[row]
        direct[np.abs(turned) * std > math.pi / 2.0] = 0.0
        assert cost == pytest.approx(-np.log(0.9 * direct + 0.1 * outlier).sum(), rel=1e-9)


@pytest.mark.parametrize(("noise", "other"), [("gaussian", "lognormal"), ("lognormal", "gaussian")])
def test_updates_of_suppress_follow_the_law_of_ranges(noise: str, other: str) -> None:
    """Fixes are nearer to the maximum of the selected law of ranges than to that of the other."""
    batch, _ = ranged_batch(200)
    ours = estimate(bearings_suppress.METHOD, batch, range_noise=noise, alpha=0.01)
    first = ours.position_m[ours.alternative == 0]
    selected, wrong = (
        np.hypot(*(first - estimate(bearings_ml.METHOD, batch, range_noise=law).position_m).T) for law in (noise, other)
    )
    assert np.nanmedian(selected) < 0.5 * np.nanmedian(wrong)


@pytest.mark.parametrize("module", [bearings_ml, bearings_mixture_ml, bearings_sequential, bearings_suppress])
def test_residuals_are_measured_minus_predicted(module: ModuleType) -> None:
    """Residuals of bearings and ranges are those at the best fix, in the coordinates of the file."""
    batch, _ = ranged_batch(20)
    solution = module.METHOD.solve(batch, module.METHOD.options())
    first = solution.estimates.position_m[solution.estimates.alternative == 0]
    away = first[:, None] - batch.sensor_xy_m
    turned = np.angle(np.exp(1j * (batch.bearing_rad - np.arctan2(away[..., 1], away[..., 0]))))
    answered = np.isfinite(first[:, 0])
    assert answered.sum() > 10
    columns = solution.flags.columns
    np.testing.assert_allclose(columns["residual_rad"][answered], turned[answered], atol=1e-9)
    expected = batch.range_m - np.hypot(away[..., 0], away[..., 1])
    np.testing.assert_allclose(columns["residual_m"][answered], expected[answered], atol=1e-6)


@pytest.mark.parametrize("noise", ["gaussian", "lognormal"])
def test_suppress_rejects_a_row_whose_range_alone_is_wrong(noise: str) -> None:
    """A row with the right bearing and a range 30 % too long is an outlier; without ranges it is used."""
    sensors = np.array([(-50.0, -40.0), (60.0, -45.0), (55.0, 50.0), (-60.0, 45.0), (0.0, -70.0)])
    source = np.array([12.0, 7.0])
    away = source - sensors
    ranges = np.hypot(*away.T)
    ranges[2] *= 1.3
    batch = bearing_batch(
        [sensors],
        [np.arctan2(away[:, 1], away[:, 0])],
        0.02,
        range_m=np.asfortranarray(ranges[None]),
        range_std_m=np.asfortranarray(0.02 * ranges[None]),
        field=CircleField(x_m=0.0, y_m=0.0, radius_m=100.0),
    )
    method = bearings_suppress.METHOD
    both, alone = (
        method.solve(batch, method.options(range_noise=noise, use_ranges=use)).flags.used[0].tolist()
        for use in (True, False)
    )
    assert both == [True, True, False, True, True]
    assert alone == [True] * 5


ALL_METHODS = [bearings_ml, bearings_mixture_ml, bearings_sequential, bearings_suppress]


def lone_batch(range_m: list[float]) -> BearingBatch:
    """Return snapshots of one bearing of 30 degrees from (10, 20), with their ranges, NaN for none."""
    ranges = np.asfortranarray(np.array(range_m)[:, None])
    return bearing_batch(
        [(10.0, 20.0)],
        np.full(ranges.shape, np.radians(30.0)),
        np.radians(1.0),
        range_m=ranges,
        range_std_m=np.where(np.isnan(ranges), np.nan, 0.5),
    )


@pytest.mark.parametrize("module", ALL_METHODS, ids=lambda module: module.METHOD.name)
def test_one_sensor_with_a_range_is_a_fix(module: ModuleType) -> None:
    """One bearing with its range is the end of its ray, with the polar covariance; a bearing alone is too_few."""
    found = estimate(module.METHOD, lone_batch([100.0, np.nan]))
    assert [Status(int(status)).word for status in found.status] == ["ok", "too_few"]
    np.testing.assert_allclose(found.position_m[0], (96.6025, 70.0), atol=1e-4)
    np.testing.assert_allclose(found.covariance_m2[0], (0.94904, -1.21078, 2.34713), rtol=1e-4)
    alone = dataclasses.replace(lone_batch([100.0]), range_m=None, range_std_m=None)
    assert Status(int(estimate(module.METHOD, alone).status[0])) == Status.TOO_FEW


@pytest.mark.parametrize("module", ALL_METHODS, ids=lambda module: module.METHOD.name)
def test_the_default_search_region_holds_the_longest_range(module: ModuleType) -> None:
    """Sensors 2 m apart locate a source at 100 m by bearings and ranges, without a search region."""
    batch = bearing_batch(
        [(0.0, 0.0), (2.0, 0.0), (1.0, 1.5)],
        np.radians([[40.05, 40.6, 39.8]]),
        np.radians(1.0),
        range_m=np.asfortranarray([[101.0, 99.5, 99.2]]),
        range_std_m=np.full((1, 3), 0.5, order="F"),
    )
    found = estimate(module.METHOD, batch)
    assert [Status(int(status)).word for status in found.status] == ["ok"]
    np.testing.assert_allclose(found.position_m[0], (77.3560, 64.9144), atol=5e-3)
    np.testing.assert_allclose(found.covariance_m2[0], (0.4697, -0.4580, 0.6262), rtol=2e-3)


def test_parallel_bearings_with_ranges_are_a_fix_of_sequential() -> None:
    """Lines that never cross determine nothing by themselves; with ranges the rows do."""
    batch = bearing_batch(
        [(0.0, 0.0), (0.0, 1.0)],
        np.zeros((1, 2)),
        0.01,
        range_m=np.full((1, 2), 50.0, order="F"),
        range_std_m=np.full((1, 2), 0.5, order="F"),
    )
    found = estimate(bearings_sequential.METHOD, batch)
    assert [Status(int(status)).word for status in found.status] == ["ok"]
    np.testing.assert_allclose(found.position_m[0], estimate(bearings_ml.METHOD, batch).position_m[0], atol=0.02)


def coarse_batch(snapshots: int, bearing_std_deg: float, range_std_m: float) -> BearingBatch:
    """Return coarse bearings with fine ranges of three sensors in a field of 1 km."""
    generator = np.random.default_rng(4)
    sensor, source = generator.uniform(0.0, 1e3, (snapshots, 3, 2)), generator.uniform(0.0, 1e3, (snapshots, 1, 2))
    away, std = source - sensor, np.radians(bearing_std_deg)
    bearing = np.arctan2(away[..., 1], away[..., 0]) + std * generator.normal(size=(snapshots, 3))
    range_m = np.hypot(away[..., 0], away[..., 1]) + range_std_m * generator.normal(size=(snapshots, 3))
    return bearing_batch(
        sensor,
        np.angle(np.exp(1j * bearing)),
        std,
        range_m=np.asfortranarray(np.maximum(range_m, 1.0)),
        range_std_m=np.full((snapshots, 3), range_std_m, order="F"),
    )


@pytest.mark.parametrize(("bearing_std_deg", "range_std_m"), [(15.0, 1.0), (40.0, 0.1)])
def test_coarse_bearings_with_fine_ranges_have_their_global_optimum(bearing_std_deg: float, range_std_m: float) -> None:
    """No search by scipy from a grid ends below the cost of the fix; none of 400 has not converged."""
    batch = coarse_batch(400, bearing_std_deg, range_std_m)
    found = estimate(bearings_ml.METHOD, batch)
    assert Status.NOT_CONVERGED not in found.status
    best = np.flatnonzero(found.alternative == 0)
    nodes = np.linspace(0.0, 1e3, 4)
    for row in range(10):

        def scaled(at: np.ndarray, row: int = row) -> np.ndarray:
            dx, dy = (at - batch.sensor_xy_m[row]).T
            turned = np.angle(np.exp(1j * (batch.bearing_rad[row] - np.arctan2(dy, dx))))
            off = batch.range_m[row] - np.hypot(dx, dy)
            return np.concatenate([turned / batch.bearing_std_rad[row], off / range_std_m])

        reached = min(least_squares(scaled, (x, y), method="lm").cost for x in nodes for y in nodes)
        assert found.cost[best[row]] <= reached * (1.0 + 1e-6)


def test_a_far_crossing_of_circles_is_found() -> None:
    """Bearings of 15 degrees decide between two crossings of circles, though their own search ends at the other."""
    batch = bearing_batch(
        [(498.958, 574.676), (716.427, 455.851), (53.218, 670.419)],
        np.radians([[-10.521, -6.33, -12.243]]),
        np.radians(15.0),
        range_m=np.asfortranarray([[405.754, 162.469, 841.583]]),
        range_std_m=np.ones((1, 3), order="F"),
    )
    found = estimate(bearings_ml.METHOD, batch)
    np.testing.assert_allclose(found.position_m, [(825.9, 335.6), (876.9, 452.4)], atol=0.1)
    np.testing.assert_allclose(found.cost, (5.95, 93.19), atol=0.005)
    assert [Status(int(status)).word for status in found.status] == ["ok", "ok"]
    near = estimate(bearings_ml.METHOD, batch, ambiguous_within=90.0)
    assert [Status(int(status)).word for status in near.status] == ["ambiguous", "ambiguous"]


@pytest.mark.parametrize(("std_deg", "expected"), [(40.0, ["ambiguous", "ambiguous"]), (10.0, ["ok", "ok"])])
def test_two_crossings_are_ambiguous_with_ranges(std_deg: float, expected: list[str]) -> None:
    """Two crossings of circles are ambiguous if their costs differ by less than four nats; else the likelier is ok."""
    source, sensors = np.array([30.0, 20.0]), np.array([(0.0, 0.0), (60.0, 0.0)])
    batch = bearing_batch(
        [sensors],
        np.radians([[20.0, 160.0]]),
        np.radians(std_deg),
        range_m=np.asfortranarray(np.hypot(*(source - sensors).T)[None]),
        range_std_m=np.full((1, 2), 0.1, order="F"),
    )
    found = estimate(bearings_ml.METHOD, batch)
    assert [Status(int(status)).word for status in found.status] == expected
    np.testing.assert_allclose(found.position_m, [(30.0, 20.0), (30.0, -20.0)], atol=0.5)
    far, near = (np.degrees(np.arctan2(side * 20.0, 30.0)) - 20.0 for side in (-1.0, 1.0))
    assert found.cost[1] - found.cost[0] == pytest.approx((far**2 - near**2) / std_deg**2, rel=0.02)


@pytest.mark.parametrize("lognormal", [False, True])
def test_values_of_a_row_are_those_of_its_derivatives(lognormal: bool) -> None:
    """Half the chi-square of a row at many points is that which comes with its derivatives, at each of them."""
    batch, _ = ranged_batch(20)
    lines = sight_lines(batch)
    rows = DirectBearings.of(lines, np.full(20, 1e-9), batch.range_m, batch.range_std_m, lognormal=lognormal)
    x, y = np.random.default_rng(1).uniform(-500.0, 500.0, (2, 20, 7))
    for k in range(4):
        wide = rows.values(k, x, y)
        for point in range(7):
            expected = rows.terms(k, x[:, point], y[:, point]).half_chi_square
            np.testing.assert_allclose(wide[:, point], expected, rtol=1e-12)


@pytest.mark.extensive
@pytest.mark.parametrize(("sensors", "std_deg", "std_m"), [(1, 10.0, 1.0), (2, 5.0, 1.0), (3, 5.0, 1.0), (3, 2.0, 1.0)])
def test_covariances_near_a_sensor_are_calibrated(sensors: int, std_deg: float, std_m: float) -> None:
    """For sources within three standard deviations of a sensor the 95 % ellipse holds about 95 %; NEES is near 2."""
    generator, count = np.random.default_rng(7), 4000
    sensor_xy = np.broadcast_to(np.array([(0.0, 0.0), (100.0, 0.0), (30.0, 90.0)])[:sensors], (count, sensors, 2))
    angle, away = generator.uniform(-np.pi, np.pi, count), 3.0 * np.sqrt(generator.uniform(0.01, 1.0, count))
    source = np.stack([away * np.cos(angle), away * np.sin(angle)], axis=1)
    offset = source[:, None] - sensor_xy
    std = np.full((count, sensors), math.radians(std_deg))
    bearing = np.arctan2(offset[..., 1], offset[..., 0]) + std * generator.standard_normal(std.shape)
    range_m = np.abs(np.hypot(*np.moveaxis(offset, -1, 0)) + std_m * generator.standard_normal(std.shape)) + 1e-9
    batch = dataclasses.replace(
        bearing_batch(sensor_xy, bearing, std),
        range_m=np.asfortranarray(range_m),
        range_std_m=np.asfortranarray(np.full(std.shape, std_m)),
    )
    found = estimate(bearings_ml.METHOD, batch)
    best = (found.alternative == 0) & (found.status == Status.OK)
    assert np.count_nonzero(best) > 0.75 * count
    error = found.position_m[best] - source[found.row[best]]
    xx, xy, yy = found.covariance_m2[best].T
    nees = (yy * error[:, 0] ** 2 - 2.0 * xy * error[:, 0] * error[:, 1] + xx * error[:, 1] ** 2) / (xx * yy - xy * xy)
    assert 1.8 < nees.mean() < 2.15
    assert 0.935 < np.mean(nees < 5.991) < 0.96
    assert nees.max() < 100.0
