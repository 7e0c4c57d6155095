"""Ranges of one source: exactness, statuses, ambiguity, heights, calibrated covariances."""

from __future__ import annotations

import numpy as np
import pytest
from batches import range_batch
from range_worlds import exact_ranges, solve, words
from scipy.optimize import minimize

from nlosctl.contract.methods import MethodSpec
from nlosctl.methods import ranges_r_ls, ranges_sr_ls
from nlosctl.testing.draws import draw_ranges

SQUARE = [(0.0, 0.0), (10.0, 0.0), (10.0, 8.0), (0.0, 8.0)]
LINE = [(0.0, 0.0), (10.0, 0.0), (25.0, 0.0)]


@pytest.fixture(params=[ranges_r_ls, ranges_sr_ls], ids=["r-ls", "sr-ls"])
def method(request: pytest.FixtureRequest) -> MethodSpec:
    """Each least-squares method for ranges in turn."""
    spec: MethodSpec = request.param.METHOD
    return spec


@pytest.mark.parametrize("height", [0.0, 3.0])
@pytest.mark.parametrize("offset", [0.0, 5e6])
def test_exact_ranges_give_the_source(method: MethodSpec, height: float, offset: float) -> None:
    """Noise-free ranges give the source, slant ranges included, for any origin of the frame."""
    sensors = np.array(SQUARE) + offset
    source = np.array([3.0, 14.0]) + offset
    estimates = solve(method, range_batch(sensors, exact_ranges(sensors, source, height), height=height)).estimates
    np.testing.assert_allclose(estimates.position_m[0], source, atol=1e-7)
    assert estimates.cost[0] == pytest.approx(0.0, abs=1e-6)


def test_ignored_heights_shift_the_fix(method: MethodSpec) -> None:
    """Slant ranges without heights give another position and a positive cost."""
    estimates = solve(method, range_batch(SQUARE, exact_ranges(SQUARE, (3.0, 5.0), 3.0))).estimates
    assert estimates.cost[0] > 10.0


def test_slant_ranges_below_the_height_are_solved(method: MethodSpec) -> None:
    """A source under a sensor whose noisy range is less than its height still has a fix near it."""
    ranges = exact_ranges(SQUARE, (0.2, 0.1), 3.0)
    ranges[0, 0] = 2.9
    estimates = solve(method, range_batch(SQUARE, ranges, height=3.0)).estimates
    np.testing.assert_allclose(estimates.position_m[0], (0.2, 0.1), atol=0.5)


def test_range_least_squares_is_the_global_minimum() -> None:
    """R-LS costs no more than the best of six searches from random starts; SR-LS alone may cost more."""
    batch = draw_ranges(np.random.default_rng(5), 20, 4, None).batch
    scale = float(np.abs(batch.sensor_xy_m).max())
    estimates = solve(ranges_r_ls.METHOD, batch).estimates
    best = estimates.alternative == 0
    for row, cost in zip(estimates.row[best], estimates.cost[best], strict=True):

        def half_chi_square(point: np.ndarray, row: int = int(row)) -> float:
            away = np.hypot(*(scale * point - batch.sensor_xy_m[row]).T)
            scaled = (batch.range_m[row] - np.hypot(away, batch.sensor_height_m[row])) / batch.range_std_m[row]
            return float(0.5 * (scaled**2).sum())

        starts = np.random.default_rng(int(row)).uniform(-1.5, 1.5, (6, 2))
        reached = min(minimize(half_chi_square, start, method="Nelder-Mead").fun for start in starts)
        assert cost <= reached + 1e-6 * (1.0 + reached)


def test_one_sensor_is_too_few(method: MethodSpec) -> None:
    """One range, and any number of ranges of one sensor, are too_few."""
    assert words(solve(method, range_batch((0.0, 0.0), [[5.0]]))) == ["too_few"]
    assert words(solve(method, range_batch((0.0, 0.0), [[5.0, 5.1, 4.9]]))) == ["too_few"]


def test_two_sensors_are_ambiguous(method: MethodSpec) -> None:
    """Two circles that cross give both crossings."""
    sensors = [(0.0, 0.0), (10.0, 0.0)]
    solution = solve(method, range_batch(sensors, exact_ranges(sensors, (3.0, 4.0))))
    assert words(solution) == ["ambiguous", "ambiguous"]
    assert solution.estimates.alternative.tolist() == [0, 1]
    found = solution.estimates.position_m[np.argsort(solution.estimates.position_m[:, 1])]
    np.testing.assert_allclose(found, [(3.0, -4.0), (3.0, 4.0)], atol=1e-6)


def test_circles_that_do_not_meet_are_degenerate(method: MethodSpec) -> None:
    """Two circles that do not meet have an infinite covariance across: degenerate."""
    assert words(solve(method, range_batch([(0.0, 0.0), (10.0, 0.0)], [[3.0, 3.0]]))) == ["degenerate"]


def test_collinear_sensors_are_ambiguous(method: MethodSpec) -> None:
    """Collinear sensors, or noisy ranges of nearly collinear ones, give the source and its mirror image."""
    solution = solve(method, range_batch(LINE, exact_ranges(LINE, (6.0, 9.0))))
    assert words(solution) == ["ambiguous", "ambiguous"]
    found = solution.estimates.position_m[np.argsort(solution.estimates.position_m[:, 1])]
    np.testing.assert_allclose(found, [(6.0, -9.0), (6.0, 9.0)], atol=1e-6)
    bent = [(0.0, 0.0), (10.0, 0.01), (25.0, 0.0)]
    solution = solve(method, range_batch(bent, exact_ranges(bent, (6.0, 9.0))))
    assert words(solution) == ["ambiguous", "ambiguous"]
    np.testing.assert_allclose(solution.estimates.position_m[0], (6.0, 9.0), atol=1e-3)


def test_the_ambiguity_gap_can_be_set(method: MethodSpec) -> None:
    """Far from a line the mirror image costs far more: an alternative, but not ambiguous."""
    batch = range_batch([(0.0, 0.0), (10.0, 0.5), (25.0, 0.0)], [[10.6, 9.3, 21.0]], 0.1)
    solution = solve(method, batch)
    assert solution.estimates.cost[1] > solution.estimates.cost[0] + 2.0
    assert words(solution) == ["ok", "ok"]
    assert words(solve(method, batch, ambiguous_within=1e4)) == ["ambiguous", "ambiguous"]


def test_min_range_makes_near_fixes_degenerate(method: MethodSpec) -> None:
    """A fix closer to a sensor than ``min_range_m`` is degenerate, and one on a sensor always is."""
    batch = range_batch(SQUARE, exact_ranges(SQUARE, (1.0, 1.0)))
    assert words(solve(method, batch))[0] == "ok"
    assert words(solve(method, batch, min_range_m=2.0)) == ["degenerate"]
    batch = range_batch(SQUARE, np.maximum(exact_ranges(SQUARE, (0.0, 0.0)), 1e-300), 1e-3)
    assert words(solve(method, batch))[0] in {"degenerate", "not_converged"}


@pytest.mark.parametrize("height", [0.0, 6.0])
def test_the_covariance_propagates_range_errors(method: MethodSpec, height: float) -> None:
    """At exact ranges it is J diag(std^2) J' with J by central differences, heights included."""
    source, std = np.array([3.0, 5.5]), np.array([[0.1, 0.2, 0.15, 0.3]])
    exact, step = exact_ranges(SQUARE, source, height), 1e-3

    def fix(ranges: np.ndarray) -> np.ndarray:
        return solve(method, range_batch(SQUARE, ranges, std, height)).estimates.position_m[0]

    slopes = [(fix(exact + step * row) - fix(exact - step * row)) / (2.0 * step) for row in np.eye(4)[:, None]]
    jacobian = np.array(slopes).T * std
    expected = jacobian @ jacobian.T
    found = solve(method, range_batch(SQUARE, exact, std, height)).estimates.covariance_m2[0]
    np.testing.assert_allclose(found, [expected[0, 0], expected[0, 1], expected[1, 1]], rtol=1e-3, atol=1e-6)


@pytest.mark.parametrize(("name", "low", "high"), [("r-ls", 0.93, 0.97), ("sr-ls", 0.93, 0.97)])
def test_covariances_are_calibrated(name: str, low: float, high: float) -> None:
    """With small errors 95 % of the fixes are within the 95 % ellipse; SR-LS by its sandwich covariance."""
    generator = np.random.default_rng(9)
    shape = (4000, 5)
    angle = generator.uniform(-0.3, 0.3, shape) + 2.0 * np.pi * np.arange(5) / 5.0
    sensors = 100.0 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    source = generator.uniform(-60.0, 60.0, (4000, 1, 2))
    std = 10.0 ** generator.uniform(-2.0, 0.0, shape)
    ranges = np.hypot(*np.moveaxis(sensors - source, -1, 0)) + std * generator.normal(size=shape)
    method = {"r-ls": ranges_r_ls, "sr-ls": ranges_sr_ls}[name].METHOD
    estimates = solve(method, range_batch(sensors, ranges, std)).estimates
    best = estimates.alternative == 0
    xx, xy, yy = estimates.covariance_m2[best].T
    dx, dy = (estimates.position_m[best] - source[:, 0]).T
    nees = (yy * dx * dx - 2.0 * xy * dx * dy + xx * dy * dy) / (xx * yy - xy * xy)
    assert low < (nees < 5.991).mean() < high
    assert np.nanmean(nees) == pytest.approx(2.0, abs=0.15)


def test_residuals_are_measured_minus_predicted(method: MethodSpec) -> None:
    """The flag residual_m is the range minus the distance from the fix."""
    batch = range_batch(SQUARE, exact_ranges(SQUARE, (3.0, 5.0)) + np.array([[0.1, -0.1, 0.05, 0.0]]))
    solution = solve(method, batch)
    assert solution.flags is not None
    away = np.hypot(*(np.array(SQUARE) - solution.estimates.position_m[0]).T)
    np.testing.assert_allclose(solution.flags.columns["residual_m"][0], batch.range_m[0] - away, atol=1e-12)
    assert solution.flags.used.all()
