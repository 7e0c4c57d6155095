"""Squared-range least squares: the global minimum."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares

from nlosctl.solvers.ranges.squared_ranges import HeightPenalty, fit_squared_ranges

FloatArray = np.ndarray


def draw_ranges(seed: int, snapshots: int, measurements: int, layout: str) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Draw sensors (B, K, 2), squared ranges with errors of 0 to 50 m, and weights."""
    generator = np.random.default_rng(seed)
    shape = (snapshots, measurements)
    sensors = generator.uniform(-100.0, 100.0, (*shape, 2))
    if layout == "line":
        sensors[..., 1] = 0.3 * sensors[..., 0]
    if layout == "nearly a line":
        sensors[..., 1] = 0.3 * sensors[..., 0] + 1e-6 * generator.normal(size=shape)
    point = generator.uniform(-200.0, 200.0, (snapshots, 1, 2))
    error = generator.choice([0.0, 0.1, 10.0, 50.0], (snapshots, 1)) * generator.normal(size=shape)
    ranges = np.hypot(*np.moveaxis(sensors - point, -1, 0)) + error
    return sensors, ranges * ranges, 1.0 / generator.uniform(0.1, 2.0, shape) ** 2


def cost(sensors: FloatArray, squared: FloatArray, weight: FloatArray, x: FloatArray, y: FloatArray) -> FloatArray:
    """Return the cost (9) of points (B,), relative to the fourth power of the ranges."""
    distance = (sensors[..., 0] - x[:, None]) ** 2 + (sensors[..., 1] - y[:, None]) ** 2
    return (weight * (squared - distance) ** 2).sum(axis=1) / (weight * squared**2).sum(axis=1)


@pytest.mark.extensive
@pytest.mark.parametrize("layout", ["plane", "line", "nearly a line"])
@pytest.mark.parametrize("measurements", [2, 3, 6])
def test_no_random_start_finds_a_lower_cost(layout: str, measurements: int) -> None:
    """The fit costs no more than the best of eight least-squares searches from random starts."""
    sensors, squared, weight = draw_ranges(measurements, 15, measurements, layout)
    fit = fit_squared_ranges(tuple(np.moveaxis(sensors, -1, 0)), squared, weight)
    ours = cost(sensors, squared, weight, *fit.point)
    generator = np.random.default_rng(0)
    for row in range(sensors.shape[0]):
        root = np.sqrt(weight[row] / (weight[row] * squared[row] ** 2).sum())

        def residual(point: FloatArray, row: int = row, root: FloatArray = root) -> FloatArray:
            return root * (squared[row] - ((point - sensors[row]) ** 2).sum(axis=1))

        searches = [least_squares(residual, generator.uniform(-300.0, 300.0, 2)) for _ in range(8)]
        assert ours[row] <= min(2.0 * search.cost for search in searches) + 1e-12


def test_collinear_sensors_have_two_equal_minima() -> None:
    """For collinear sensors the mirror image of the fit is another minimum of equal cost."""
    sensors, squared, weight = draw_ranges(7, 200, 4, "line")
    fit = fit_squared_ranges(tuple(np.moveaxis(sensors, -1, 0)), squared, weight)
    one = cost(sensors, squared, weight, *fit.point)
    other = cost(sensors, squared, weight, *fit.mirror)
    np.testing.assert_allclose(one, other, atol=1e-12)
    across = np.array([-0.3, 1.0])
    assert (
        (fit.point[0] * across[0] + fit.point[1] * across[1]) * (fit.mirror[0] * across[0] + fit.mirror[1] * across[1])
        <= 1e-6
    ).all()


def test_fits_do_not_depend_on_the_block() -> None:
    """Fitting a block gives the bits of fitting each snapshot alone."""
    sensors, squared, weight = draw_ranges(11, 50, 5, "plane")
    whole = fit_squared_ranges(tuple(np.moveaxis(sensors, -1, 0)), squared, weight)
    for row in range(50):
        part = slice(row, row + 1)
        alone = fit_squared_ranges((sensors[part, :, 0], sensors[part, :, 1]), squared[part], weight[part])
        assert [part[0] for part in alone.point] == [part[row] for part in whole.point]


def test_coincident_sensors_have_no_fit() -> None:
    """Coincident sensors give NaN, and the row beside them is unaffected."""
    sensors, squared, weight = draw_ranges(13, 2, 4, "plane")
    alone = fit_squared_ranges((sensors[1:, :, 0], sensors[1:, :, 1]), squared[1:], weight[1:])
    sensors[0] = sensors[0, 0]
    fit = fit_squared_ranges(tuple(np.moveaxis(sensors, -1, 0)), squared, weight)
    assert np.isnan(fit.point[0][0])
    assert fit.point[0][1] == alone.point[0][0]


def _space_cost(sensors: FloatArray, squared: FloatArray, weight: FloatArray, point: FloatArray) -> FloatArray:
    return (weight * (squared - ((point[:, None] - sensors) ** 2).sum(axis=2)) ** 2).sum(axis=1)


@pytest.mark.parametrize("layout", ["space", "plane", "nearly a plane"])
@pytest.mark.parametrize("height", [False, True])
def test_in_space_no_random_start_finds_a_lower_cost(layout: str, height: bool) -> None:
    """In space the fit, with a penalty on its height or without, costs no more than eight searches by scipy."""
    generator = np.random.default_rng(17)
    shape = (12, 5)
    sensors = generator.uniform(-100.0, 100.0, (*shape, 3))
    if layout != "space":
        sensors[..., 2] = 0.3 * sensors[..., 0] + (1e-6 * generator.normal(size=shape) if layout != "plane" else 0.0)
    source = generator.uniform(-150.0, 150.0, (12, 1, 3))
    error = generator.choice([0.0, 0.1, 10.0], (12, 1)) * generator.normal(size=shape)
    squared = (np.linalg.norm(sensors - source, axis=2) + error) ** 2
    weight = 1.0 / generator.uniform(0.1, 2.0, shape) ** 2
    level = source[:, 0, 2] + 5.0
    penalty = HeightPenalty(level, np.full(12, 3e3)) if height else None
    fit = fit_squared_ranges(tuple(np.moveaxis(sensors, -1, 0)), squared, weight, penalty)

    def whole(point: FloatArray) -> FloatArray:
        return _space_cost(sensors, squared, weight, point) + (3e3 * (point[:, 2] - level) ** 2 if height else 0.0)

    ours, scale = whole(np.stack(fit.point, axis=1)), (weight * squared**2).sum(axis=1)
    if layout == "plane" and not height:
        np.testing.assert_allclose(whole(np.stack(fit.mirror, axis=1)) / scale, ours / scale, atol=1e-12)
    for row in range(shape[0]):

        def residual(point: FloatArray, row: int = row) -> FloatArray:
            rows = np.sqrt(weight[row]) * (squared[row] - ((point - sensors[row]) ** 2).sum(axis=1))
            rows = np.append(rows, np.sqrt(3e3) * (point[2] - level[row]) if height else 0.0)
            return rows / np.sqrt(scale[row])

        searches = [least_squares(residual, generator.uniform(-200.0, 200.0, 3)) for _ in range(8)]
        assert ours[row] / scale[row] <= min(2.0 * search.cost for search in searches) + 1e-12
