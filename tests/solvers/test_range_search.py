"""The optima of ranges: every one that matters is found, compared with scipy from a grid of initial points."""

from __future__ import annotations

import numpy as np
import pytest
from batches import range_batch
from scipy.optimize import least_squares

from nlosctl.contract.batches import RangeBatch
from nlosctl.contract.methods import MethodSpec
from nlosctl.contract.statuses import Status
from nlosctl.methods import ranges_r_ls, ranges_sr_ls

MISSED = [(739.80646, 274.67049), (762.64946, 286.11316), (535.09882, 480.67422)]
"""Sensors whose two circles of coarse ranges cross twice along that of a fine one."""


def random_ranges(sensors: int, snapshots: int, height_m: float = 0.0) -> RangeBatch:
    """Return noisy ranges of sources in and around a field of 100 m, with standard deviations of .1 to 10 m."""
    generator = np.random.default_rng(sensors)
    shape = (snapshots, sensors)
    sensor, source = generator.uniform(0.0, 100.0, (*shape, 2)), generator.uniform(-50.0, 150.0, (snapshots, 1, 2))
    std = 10.0 ** generator.uniform(-1.0, 1.0, shape)
    heights = height_m * generator.uniform(0.5, 1.0, shape)
    exact = np.hypot(np.hypot(*np.moveaxis(sensor - source, -1, 0)), heights)
    return range_batch(sensor, np.maximum(exact + std * generator.normal(size=shape), 0.5), std, height=heights)


def brute_force(batch: RangeBatch, row: int) -> list[tuple[float, np.ndarray]]:
    """Return cost and position of the distinct optima that scipy reaches from a grid, best first."""
    sensor, height = batch.sensor_xy_m[row], batch.sensor_height_m[row]

    def residual(point: np.ndarray) -> np.ndarray:
        away = np.hypot(np.hypot(*(point - sensor).T), height)
        return (away - batch.range_m[row]) / batch.range_std_m[row]

    optima: list[tuple[float, np.ndarray]] = []
    nodes = np.linspace(-120.0, 220.0, 5)
    ends = [least_squares(residual, (x, y), method="lm", xtol=1e-12) for x in nodes for y in nodes]
    for end in sorted(ends, key=lambda end: end.cost):
        if end.optimality < 1e-4 and all(np.hypot(*(end.x - known)) > 0.5 for _, known in optima):
            optima.append((end.cost, end.x))
    return optima


@pytest.mark.parametrize(("sensors", "height_m"), [(3, 0.0), (3, 60.0), (4, 0.0)])
def test_the_two_best_optima_are_found(sensors: int, height_m: float) -> None:
    """The answer is scipy's best optimum, and `ambiguous` where a second one is within four nats, else `ok`."""
    batch = random_ranges(sensors, 10, height_m)
    found = ranges_r_ls.METHOD.solve(batch, ranges_r_ls.METHOD.options()).estimates
    best = np.flatnonzero(found.alternative == 0)
    seen = set()
    for row, index in enumerate(best):
        optima = brute_force(batch, row)
        assert found.cost[index] == pytest.approx(optima[0][0], abs=1e-6)
        np.testing.assert_allclose(found.position_m[index], optima[0][1], atol=0.05)
        status = Status(int(found.status[index])).word
        if status != "degenerate":
            close = len(optima) > 1 and optima[1][0] - optima[0][0] <= 4.0
            assert status == ("ambiguous" if close else "ok")
        seen.add(status)
    assert {"ok", "ambiguous"} <= seen or sensors == 4


@pytest.mark.parametrize(
    "method", [ranges_r_ls.METHOD, ranges_r_ls.ML, ranges_sr_ls.METHOD], ids=lambda spec: spec.name
)
def test_the_better_of_two_distant_optima_is_the_answer(method: MethodSpec) -> None:
    """A crossing far from the squared-range fit and from its mirror image may be the best optimum."""
    batch = range_batch(MISSED, [[682.26083, 686.84372, 416.36589]], [[0.12978, 6.13309, 8.62666]])
    found = method.solve(batch, method.options()).estimates
    assert [Status(int(status)).word for status in found.status] == ["ambiguous", "ambiguous"]
    expected = [(428.5, 881.8), (138.4, 596.8)]
    if method.name == "sr-ls":  # its minima are those of another cost: a few standard deviations away
        np.testing.assert_allclose(found.position_m[np.argsort(found.cost)], expected, atol=40.0)
        return
    assert found.cost == pytest.approx([0.211, 1.515], abs=1e-3)
    np.testing.assert_allclose(found.position_m, expected, atol=0.1)


@pytest.mark.parametrize("sensors", [3, 5, 9])
def test_the_order_of_the_rows_does_not_matter(sensors: int) -> None:
    """Rows in reverse order give the same optima, statuses and alternatives."""
    batch = random_ranges(sensors, 200)
    reverse = range_batch(
        batch.sensor_xy_m[:, ::-1], batch.range_m[:, ::-1], batch.range_std_m[:, ::-1], batch.sensor_height_m[:, ::-1]
    )
    one, other = (ranges_r_ls.METHOD.solve(each, ranges_r_ls.METHOD.options()).estimates for each in (batch, reverse))
    same = one.alternative == 0, other.alternative == 0
    np.testing.assert_array_equal(one.status[same[0]], other.status[same[1]])
    answered = np.isfinite(one.cost[same[0]])
    np.testing.assert_allclose(
        one.position_m[same[0]][answered], other.position_m[same[1]][answered], atol=1e-4, rtol=1e-6
    )
