"""Shares of outliers and mean biases from a file: maxima of the marginal likelihood, integrated on a grid."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from batches import bearing_batch, range_batch
from scipy.optimize import minimize_scalar
from scipy.stats import exponnorm, norm

from nlosctl.contract.fields import parse_field
from nlosctl.methods import bearings_mixture_ml, ranges_mixture_ml
from nlosctl.solvers.mixture.outlier_counts import next_bias_mean_m

SIDE = 100.0
FIELD = parse_field("-50,150,-50,150")
GRID = np.stack(np.meshgrid(*[np.arange(-49.5, 150.0)] * 2), axis=-1).reshape(-1, 1, 2)


def fixed_point(method: Any, batch: Any, options: Any, names: tuple[str, ...], steps: int) -> list[float]:
    """Return the values of some options after so many steps of the plain iteration."""
    for _ in range(steps):
        values = method.learning.update(method.learning.statistics(batch, options).sum(axis=0).tolist(), options)
        options = dataclasses.replace(options, **{name: values[name] for name in names})
    return [getattr(options, name) for name in names]


def log_prior(alpha: float) -> float:
    """Return the logarithm of the weight of four further rows at the default share."""
    return float(np.log(alpha) + 3.0 * np.log1p(-alpha))


def world(seed: int, size: int, sensors: int) -> tuple[npt.NDArray[Any], npt.NDArray[Any], np.random.Generator]:
    """Return positions of sensors (B, K, 2) and offsets from them to sources (B, K, 2) in the square."""
    generator = np.random.default_rng(seed)
    xy = generator.uniform(0.0, SIDE, (size, sensors, 2))
    return xy, generator.uniform(0.0, SIDE, (size, 1, 2)) - xy, generator


@pytest.mark.parametrize(("sensors", "share"), [(3, 0.4), (4, 0.1), (6, 0.3)])
def test_the_share_of_bearings_maximizes_the_marginal_likelihood(sensors: int, share: float) -> None:
    """Outliers are uniform over the circle; snapshots whose rays do not cross in the region count too."""
    std = np.radians(6.0)
    xy, away, generator = world(sensors, 40, sensors)
    bearing = np.arctan2(away[..., 1], away[..., 0]) + std * generator.normal(size=away.shape[:2])
    outlier = generator.random(bearing.shape) < share
    bearing = np.where(
        outlier, generator.uniform(-np.pi, np.pi, bearing.shape), (bearing + np.pi) % (2 * np.pi) - np.pi
    )
    ratios = []
    for sensor, angle in zip(xy, bearing, strict=True):
        offset = GRID - sensor
        error = (angle - np.arctan2(offset[..., 1], offset[..., 0]) + np.pi) % (2.0 * np.pi) - np.pi
        near = np.hypot(offset[..., 0], offset[..., 1]) < 0.005 * np.ptp(sensor, axis=0).max()
        ratios.append(np.where((np.abs(error) < np.pi / 2) & ~near, norm.pdf(error / std) / std * 2.0 * np.pi, 0.0))

    def cost(alpha: float) -> float:
        return -log_prior(alpha) - sum(np.log((alpha + (1.0 - alpha) * r).prod(axis=1).mean()) for r in ratios)

    best = minimize_scalar(cost, bounds=(1e-4, 0.99), method="bounded").x
    batch = bearing_batch(xy, bearing, std, field=FIELD)
    method = bearings_mixture_ml.METHOD
    (found,) = fixed_point(method, batch, bearings_mixture_ml.MixtureOptions(), ("alpha",), 15)
    assert found == pytest.approx(best, abs=0.006)


@pytest.mark.parametrize("mean", [6.0, 24.0])
def test_share_and_bias_of_ranges_maximize_the_marginal_likelihood(mean: float) -> None:
    """Most outliers are late by an exponential bias, a twentieth anything: no neighbour of both values is likelier."""
    std, grid = 3.0, GRID[::2]
    xy, away, generator = world(1, 12, 6)
    distance = np.hypot(away[..., 0], away[..., 1])
    late = np.where(generator.random(distance.shape) < 0.3, generator.exponential(mean, distance.shape), 0.0)
    ranges = np.abs(distance + late + std * generator.normal(size=distance.shape))
    excess = np.stack([r - np.hypot(*np.moveaxis(grid - s, -1, 0)) for s, r in zip(xy, ranges, strict=True)])
    direct, stray = norm.pdf(excess / std) / std, 0.05 / (2.0 * SIDE * np.sqrt(2.0))

    def cost(alpha: float, mean_m: float) -> float:
        outlier = stray + 0.95 * exponnorm(mean_m / std, scale=std).pdf(excess)
        likelihood = (alpha * outlier + (1.0 - alpha) * direct).prod(axis=2).mean(axis=1)
        return -log_prior(alpha) - float(np.log(likelihood).sum())

    batch = dataclasses.replace(range_batch(xy, ranges, std), field=FIELD)
    options = ranges_mixture_ml.RangeMixtureOptions(bias="positive")
    alpha, mean_m = fixed_point(ranges_mixture_ml.METHOD, batch, options, ("alpha", "bias_mean_m"), 30)
    least = cost(alpha, mean_m)
    assert least < min(cost(alpha * factor, mean_m) for factor in (0.9, 1.1))
    assert least < min(cost(alpha, mean_m * factor) for factor in (0.9, 1.1))


def test_too_few_late_rows_leave_the_mean_unknown() -> None:
    """Three snapshots have fewer than ten late rows."""
    xy, away, _ = world(2, 3, 6)
    batch = range_batch(xy, np.hypot(away[..., 0], away[..., 1]), 1.0)
    options = ranges_mixture_ml.RangeMixtureOptions(bias="positive")
    assert fixed_point(ranges_mixture_ml.METHOD, batch, options, ("bias_mean_m",), 1) == [None]


def test_statistics_do_not_depend_on_the_company() -> None:
    """A snapshot has the same bits alone and in a block, also beside one whose sensors have several paths."""
    generator = np.random.default_rng(5)
    xy = generator.uniform(0.0, SIDE, (9, 6, 2))
    xy[::2, 1] = xy[::2, 0]
    sensor = np.tile(np.arange(6), (9, 1))
    sensor[::2, 1] = 0
    fields: dict[str, Any] = {
        "sensor": np.asfortranarray(sensor),
        "path": np.asfortranarray(np.tile([0, 1, 0, 0, 0, 0], (9, 1))),
    }
    bearing = generator.uniform(-3.0, 3.0, (9, 6))
    statistics = bearings_mixture_ml.METHOD.learning.statistics
    options = bearings_mixture_ml.MixtureOptions()
    whole = statistics(bearing_batch(xy, bearing, 0.1, **fields), options)
    assert whole[:, 1].tolist() == [5.0, 6.0] * 4 + [5.0]
    for n in range(9):
        alone = {name: value[n : n + 1] for name, value in fields.items()}
        one = statistics(bearing_batch(xy[n : n + 1], bearing[n : n + 1], 0.1, **alone), options)
        assert one.tobytes() == np.ascontiguousarray(whole[n : n + 1]).tobytes()


def test_the_next_mean_of_the_bias_by_hand() -> None:
    """Ten late rows have a mean, fewer none; it is at least a tenth of their mean standard deviation."""
    assert next_bias_mean_m(10.0, 50.0, 20.0) == pytest.approx(5.0)
    assert next_bias_mean_m(9.99, 50.0, 20.0) is None
    assert next_bias_mean_m(20.0, 0.5, 40.0) == pytest.approx(0.2)
