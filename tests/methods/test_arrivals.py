"""Arrival times: public examples, statuses, global minima, calibrated covariances of position and offset."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from arrival_batches import arrival_batch
from range_worlds import words
from scipy.optimize import least_squares

from nlosctl.contract.batches import ArrivalBatch
from nlosctl.contract.methods import MethodSpec
from nlosctl.contract.result_checks import contract_violation
from nlosctl.contract.results import Solution
from nlosctl.methods import arrivals_ml, arrivals_srd_ls
from nlosctl.models.arrivals import arrival_rows
from nlosctl.solvers.arrivals.squared_differences import squared_differences

Array = np.ndarray
LIGHT_M_S = 299792458.0

GATEWAYS = np.array([(0, 0), (6200, 400), (5100, 5600), (-900, 4800)], dtype=float)
GATEWAY_ARRIVALS_NS = np.array([12510210.5, 12513627.2, 12515278.5, 12514654.1])
RECEIVERS = np.array(
    [(0, 0, 120), (62000, 8000, 340), (41000, 57000, 90), (-15000, 48000, 210), (20000, 25000, 60)], dtype=float
)
RECEIVER_ARRIVALS_US = np.array([143.466, 140.944, 102.837, 157.907, 47.886])
AIRCRAFT = (28000.0, 31000.0, 10360.0)


@pytest.fixture(params=[arrivals_ml, arrivals_srd_ls], ids=["ml", "srd-ls"])
def method(request: pytest.FixtureRequest) -> MethodSpec:
    """Each method for arrivals in turn."""
    spec: MethodSpec = request.param.METHOD
    return spec


def solve(method: MethodSpec, batch: ArrivalBatch) -> Solution:
    """Return the solution of a method with its default options."""
    return method.solve(batch, method.options())


def exact(sensors: Array, point: Any, offset: float = 7.0) -> Array:
    """Return the arrivals (1, K) of a source without noise."""
    return np.asarray(np.linalg.norm(sensors - np.asarray(point, dtype=float), axis=1)[None] + offset)


def test_gateways_give_the_published_position_and_time(method: MethodSpec) -> None:
    """Four gateways with arrivals in ns: (2400, 1900) m, sent at 12.5 ms."""
    arrivals = (GATEWAY_ARRIVALS_NS - GATEWAY_ARRIVALS_NS[0]) * 1e-9 * LIGHT_M_S
    origin = GATEWAY_ARRIVALS_NS[0] * 1e-9 * LIGHT_M_S
    solution = solve(method, arrival_batch(GATEWAYS, arrivals[None], 3.0, origin_m=origin))
    assert contract_violation(solution, (1, 4), 2) == ""
    np.testing.assert_allclose(solution.estimates.position_m[0], (2400.0, 1900.0), atol=0.02)
    assert solution.estimates.columns["offset_m"][0] / LIGHT_M_S * 1e3 == pytest.approx(12.5, abs=1e-7)


def test_microphones_give_the_published_position(method: MethodSpec) -> None:
    """Four microphones around a meadow: (14, 23) m to 2 mm; two of them are too few."""
    sensors = np.array([(0, 0), (40, 0), (40, 40), (0, 40)], dtype=float)
    arrivals = np.array([[3.2785, 3.3012, 3.29057, 3.26421]]) * 343.0
    np.testing.assert_allclose(
        solve(method, arrival_batch(sensors, arrivals)).estimates.position_m[0], (14.0, 23.0), atol=2e-3
    )
    assert words(solve(method, arrival_batch(sensors[:2], arrivals[:, :2]))) == ["too_few"]


def test_an_aircraft_with_and_without_altitude(method: MethodSpec) -> None:
    """Five receivers give z to 24 m; four have a second solution of equal cost, which an altitude removes."""
    arrivals = RECEIVER_ARRIVALS_US[None] * 1e-6 * LIGHT_M_S
    five = solve(method, arrival_batch(RECEIVERS, arrivals, 10.0)).estimates
    np.testing.assert_allclose(five.position_m[0], AIRCRAFT, atol=1.0)
    assert 20.0 < np.sqrt(five.covariance_m2[0, 5]) < 30.0
    four, index = RECEIVERS[[0, 1, 2, 4]], [0, 1, 2, 4]
    two = solve(method, arrival_batch(four, arrivals[:, index], 10.0))
    assert words(two) == ["ambiguous", "ambiguous"]
    found = two.estimates.position_m[np.argsort(two.estimates.position_m[:, 2])]
    np.testing.assert_allclose(found, [(28082.0, 30941.0, -10278.0), AIRCRAFT], atol=1.0)
    known = solve(method, arrival_batch(four, arrivals[:, index], 10.0, 10360.0, 50.0))
    assert words(known)[0] == "ok"
    np.testing.assert_allclose(known.estimates.position_m[0], AIRCRAFT, atol=1.0)
    held = solve(method, arrival_batch(four[:3], arrivals[:, index[:3]], 10.0, 10360.0, 0.0))
    assert contract_violation(held, (1, 3), 3) == ""
    nearest = np.linalg.norm(held.estimates.position_m - AIRCRAFT, axis=1).min()
    assert nearest < 2.0
    assert (held.estimates.covariance_m2[:, 3:] == 0.0).all()


SQUARE = np.array([(0, 0, 0), (10, 0, 0), (10, 10, 0), (0, 10, 0)], dtype=float)
LINE = np.array([(0, 0), (3, 0), (7, 0), (12, 0)], dtype=float)


@pytest.mark.parametrize(
    ("sensors", "point", "status"),
    [
        (SQUARE, (5.0, 5.0, 7.0), "degenerate"),
        (np.vstack([SQUARE, (5.0, 5.0, 0.0)]), (5.0, 5.0, 7.0), "ambiguous"),
        (np.vstack([SQUARE, (4.0, 7.0, 0.0)]), (3.0, 8.0, 0.0), "degenerate"),
        (LINE, (4.0, 5.0), "ambiguous"),
        (LINE, (5.0, 0.0), "degenerate"),
        (LINE, (20.0, 0.0), "degenerate"),
        (np.outer([0.0, 1.0, 3.0, 7.0, 9.0], [1.0, 2.0, 0.5]), (4.0, 5.0, 3.0), "degenerate"),
        (np.array([(0, 0), (0, 0), (10, 3)], dtype=float), (2.0, 3.0), "degenerate"),
        (SQUARE[:3], (3.0, 4.0, 5.0), "too_few"),
    ],
    ids=["axis", "middle", "in-plane", "aside", "between", "beyond", "line-in-space", "one-place", "three"],
)
def test_statuses_of_arrays(method: MethodSpec, sensors: Array, point: Any, status: str) -> None:
    """Arrays that leave a coordinate unobservable are degenerate, mirror images ambiguous with both answers."""
    solution = solve(method, arrival_batch(sensors, exact(sensors, point)))
    assert words(solution)[0] == status
    if status == "ambiguous":
        away = np.linalg.norm(solution.estimates.position_m - np.asarray(point), axis=1)
        assert sorted(away)[0] < 1e-6
        mirrored = np.array([*point[:-1], -point[-1]])
        assert np.linalg.norm(solution.estimates.position_m - mirrored, axis=1).min() < 1e-6


def test_differences_longer_than_their_baseline_are_degenerate(method: MethodSpec) -> None:
    """A difference of 15 m between sensors 10 m apart, of std 1 cm, fits no point."""
    sensors = np.array([(0, 0), (10, 0), (0, 10), (10, 10)], dtype=float)
    assert words(solve(method, arrival_batch(sensors, [[0.0, 15.0, 3.0, 4.0]], 0.01)))[0] == "degenerate"


@pytest.mark.parametrize("distance", [3e3, 1e6, 1e9, 1e15])
def test_far_sources_are_never_ok(distance: float) -> None:
    """A source thousands of array sizes away has saturated differences: degenerate, without a position."""
    generator = np.random.default_rng(4)
    sensors = generator.uniform(-1.0, 1.0, (6, 2))
    wave = -sensors @ np.array([0.6, 0.8]) if distance > 1e12 else exact(sensors, distance * np.array([0.6, 0.8]))[0]
    noise = 1e-3 * generator.normal(size=6)
    batch = arrival_batch(sensors, (wave - wave[0] + noise)[None], 1e-3)
    assert words(solve(arrivals_ml.METHOD, batch)) == ["degenerate"]


def test_ml_does_not_depend_on_the_origin_or_an_offset(method: MethodSpec) -> None:
    """Adding 1e7 m to all arrivals and 6e6 m to all coordinates moves the fix by less than 1e-3 standard deviations."""
    generator = np.random.default_rng(5)
    sensors = generator.uniform(0.0, 500.0, (6, 3))
    arrivals = exact(sensors, (200.0, 300.0, 90.0)) + generator.normal(size=(1, 6))
    one = solve(method, arrival_batch(sensors, arrivals, 1.0)).estimates
    two = solve(method, arrival_batch(sensors + 6e6, arrivals + 1e7, 1.0)).estimates
    np.testing.assert_allclose(two.position_m - 6e6, one.position_m, atol=1e-4)
    np.testing.assert_allclose(two.columns["offset_m"] - 1e7, one.columns["offset_m"], atol=1e-4)
    np.testing.assert_allclose(two.covariance_m2, one.covariance_m2, rtol=1e-5)


def test_the_likelihood_is_that_of_all_differences() -> None:
    """Cost and information equal those of the differences to any reference with their full covariance."""
    generator = np.random.default_rng(6)
    sensors, std = generator.uniform(0.0, 500.0, (5, 2)), generator.uniform(0.5, 2.0, 5)
    point = np.array([120.0, 330.0])
    arrivals = exact(sensors, point) + std * generator.normal(size=(1, 5))
    rows = arrival_rows(arrival_batch(sensors, arrivals, std))
    local = [np.array([[value - float(middle[0])]]) for value, middle in zip(point, rows.center, strict=True)]
    cost = rows.half_chi_squares(*local)[0, 0]
    information = rows.information(*(part[:, 0] for part in local)).dense()[0]
    away = point - sensors
    unit = away / np.linalg.norm(away, axis=1)[:, None]
    for reference in range(5):
        others = np.delete(np.arange(5), reference)
        covariance = np.diag(std[others] ** 2) + std[reference] ** 2
        excess = arrivals[0] - np.linalg.norm(away, axis=1)
        difference = excess[others] - excess[reference]
        slopes = unit[others] - unit[reference]
        assert cost == pytest.approx(0.5 * difference @ np.linalg.solve(covariance, difference), rel=1e-9)
        np.testing.assert_allclose(information, slopes.T @ np.linalg.solve(covariance, slopes), rtol=1e-9)


def _draw(seed: int) -> tuple[Array, Array, Array, Array]:
    generator = np.random.default_rng(seed)
    dimension = 2 + seed % 2
    count = dimension + 1 + seed // 2 % 5
    sensors = generator.uniform(-1.0, 1.0, (count, dimension))
    if seed % 3 == 0 and count > dimension + 1:
        sensors[:, -1] *= 0.1
    point = generator.uniform(-1.0, 1.0, dimension) * generator.choice([0.7, 1.5])
    std = generator.uniform(0.5, 2.0, count) * generator.choice([1e-4, 3e-3, 1e-2])
    return sensors, point, std, exact(sensors, point)[0] + std * generator.normal(size=count)


@pytest.mark.parametrize(
    "snapshots", [pytest.param(16, id="few"), pytest.param(200, marks=[pytest.mark.slow, pytest.mark.extensive])]
)
def test_ml_is_the_global_minimum(snapshots: int) -> None:
    """ML costs no more than the best of 25 scipy searches within 1e3 array sizes, in the plane and in space."""
    worse = 0
    for seed in range(snapshots):
        sensors, point, std, arrivals = _draw(seed)
        weight = 1.0 / std**2

        def residuals(at: Array, s: Array = sensors, t: Array = arrivals, w: Array = weight) -> Array:
            excess = t - np.linalg.norm(at - s, axis=1)
            return np.sqrt(w) * (excess - (w * excess).sum() / w.sum())

        starts = np.vstack([point, np.random.default_rng(seed).uniform(-3.0, 3.0, (25, point.size))])
        searches = [least_squares(residuals, start, x_scale="jac") for start in starts]
        least = min(search.cost for search in searches if np.abs(search.x).max() < 1e3)
        cost = solve(arrivals_ml.METHOD, arrival_batch(sensors, arrivals[None], std)).estimates.cost[0]
        worse += bool(np.isfinite(cost)) and cost > least + 1e-6 * (1.0 + least)
    assert worse <= snapshots // 100


@pytest.mark.parametrize(("dimension", "share"), [(2, 0.41), (3, 0.54)])
def test_both_exact_solutions_are_found(method: MethodSpec, dimension: int, share: float) -> None:
    """With as many equal rows as unknowns the source is among the fixes, and as often as published there are two."""
    generator = np.random.default_rng(dimension)
    sensors = generator.uniform(-1.0, 1.0, (400, dimension + 1, dimension))
    points = generator.uniform(-1.0, 1.0, (400, 1, dimension))
    arrivals = np.linalg.norm(sensors - points, axis=2) + 7.0
    estimates = solve(method, arrival_batch(sensors, arrivals, 1e-6)).estimates
    away = np.linalg.norm(estimates.position_m - points[estimates.row, 0], axis=1)
    assert np.unique(estimates.row[away < 1e-4]).size > 390
    assert np.mean(np.bincount(estimates.row) == 2) == pytest.approx(share, abs=0.08)


def test_srd_ls_is_the_global_minimum() -> None:
    """The squared differences cost no more at the fix than after 25 searches by scipy, of every size of noise."""
    for seed in range(24):
        sensors, point, std, arrivals = _draw(seed)
        std = std * 30.0 if seed % 4 == 0 else std
        noisy = arrivals + std * np.random.default_rng(seed + 99).normal(size=std.size)
        batch = arrival_batch(sensors, noisy[None], std)
        reference = int(np.argmin(std))
        away, difference = sensors - sensors[reference], noisy - noisy[reference]

        def residuals(at: Array, a: Array = away, d: Array = difference) -> Array:
            return np.asarray(-2.0 * a @ at - 2.0 * d * np.linalg.norm(at) - d * d + (a * a).sum(axis=1))

        starts = np.vstack(
            [point - sensors[reference], np.random.default_rng(seed).uniform(-3.0, 3.0, (25, point.size))]
        )
        least = min(least_squares(residuals, start).cost for start in starts)
        estimates = solve(arrivals_srd_ls.METHOD, batch).estimates
        if np.isfinite(estimates.cost[0]):
            ours = 0.5 * (residuals(estimates.position_m[0] - sensors[reference]) ** 2).sum()
            assert ours <= least + 1e-4 * least + 1e-12
        fit = squared_differences(arrival_rows(batch))
        costs = [fit.problem.half_squares(*(part[k] for part in fit.points))[0] for k in range(fit.points[0].shape[0])]
        if sensors.shape[0] > sensors.shape[1] + 1:
            assert np.nanmin(costs) * fit.scale_m[0] ** 2 <= least * (1.0 + 1e-4) + 1e-9


@pytest.mark.parametrize(
    ("sensors", "size", "std", "z_std", "mean"),
    [
        (500.0 * np.column_stack([np.cos(np.arange(8) * np.pi / 4), np.sin(np.arange(8) * np.pi / 4)]), 300, 3.0, 0, 2),
        (np.random.default_rng(7).uniform(0.0, 1.0, (8, 3)) * [1000, 1000, 300], 400, 3.0, 0, 3),
        (np.random.default_rng(8).uniform(-1.0, 1.0, (6, 3)) * [3e4, 3e4, 300], 9000, 5.0, 50.0, 3),
    ],
    ids=["ring", "box", "aircraft"],
)
def test_errors_are_as_large_as_stated(
    method: MethodSpec, sensors: Array, size: float, std: float, z_std: float, mean: int
) -> None:
    """600 runs: NEES of position and offset, RMSE over the stated and the 95 % region are calibrated."""
    generator = np.random.default_rng(12)
    sources = generator.uniform(-0.8, 0.8, (600, sensors.shape[1])) * size + sensors.mean(axis=0)
    if z_std:
        sources[:, 2] = generator.uniform(9e3, 11e3, 600)
    stds = std * generator.uniform(0.5, 2.0, sensors.shape[0])
    offset = generator.uniform(-1e3, 1e3, 600)
    away = np.linalg.norm(sources[:, None] - sensors, axis=2)
    arrivals = away + offset[:, None] + stds * generator.normal(size=away.shape)
    heights = {"z_m": sources[:, 2] + z_std * generator.normal(size=600), "z_std_m": z_std} if z_std else {}
    estimates = solve(method, arrival_batch(sensors, arrivals, stds, **heights)).estimates
    best = (estimates.alternative == 0) & (estimates.status == 0)
    row = estimates.row[best]
    assert row.size > 590
    error, parts = estimates.position_m[best] - sources[row], estimates.covariance_m2[best]
    columns = {name: values[best] for name, values in estimates.columns.items()}
    cross = np.stack([columns[f"cov_{axis}_offset_m2"] for axis in "xyz"[:mean]], axis=1)
    index = [[0, 1], [1, 2]] if mean == 2 else [[0, 1, 3], [1, 2, 4], [3, 4, 5]]
    whole = np.empty((row.size, mean + 1, mean + 1))
    whole[:, :mean, :mean] = parts[:, index]
    whole[:, :mean, mean] = whole[:, mean, :mean] = cross
    whole[:, mean, mean] = columns["offset_std_m"] ** 2
    both = np.column_stack([error, columns["offset_m"] - offset[row]])
    nees = np.einsum("bi,bij,bj->b", error, np.linalg.inv(whole[:, :mean, :mean]), error)
    joint = np.einsum("bi,bij,bj->b", both, np.linalg.inv(whole), both)
    spread = 3.3 * np.sqrt(2.0 * mean / 600.0)
    assert abs(nees.mean() - mean) < spread
    assert abs(joint.mean() - mean - 1) < 3.3 * np.sqrt(2.0 * (mean + 1) / 600.0)
    assert 0.82 < (both[:, -1] ** 2 / whole[:, mean, mean]).mean() < 1.20
    assert 0.93 < (nees < {2: 5.991, 3: 7.815}[mean]).mean() < 0.975
    if mean == 2 or z_std:
        rms = np.sqrt((error**2).sum() / np.trace(whole[:, :mean, :mean], axis1=1, axis2=2).sum())
        assert 0.93 < rms < 1.07
