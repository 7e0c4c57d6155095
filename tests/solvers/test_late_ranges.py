"""Late ranges: the density of an outlier, and its derivatives in the mixture."""

from __future__ import annotations

import numpy as np
import pytest
from batches import range_batch
from scipy.integrate import quad
from scipy.stats import exponnorm, norm

from nlosctl.models.ranges.circles import range_circles
from nlosctl.solvers.mixture.late_ranges import LateRanges
from nlosctl.solvers.mixture.likelihood import Mixture
from nlosctl.solvers.mixture.range_rows import BiasLaw, grouped_ranges, range_outlier_model

STD = 0.3


STRAY, SHARE = 0.02, 0.05
"""The density of a stray per metre, and the share of strays among the outliers."""


def density(excess: float, mean_m: float | None) -> float:
    """Return the density of an outlier whose range exceeds the distance by ``excess``."""
    circles = range_circles(range_batch([(0.0, 0.0)], [[excess + 50.0]], STD))
    rows = LateRanges.of(circles, mean_m, np.log([STRAY]))
    _, cost = rows.scores(np.array([[50.0]]), np.array([[0.0]]))
    return float(np.exp(-cost)[0, 0] * SHARE * STRAY)


def late_density(excess: float, mean_m: float | None) -> float:
    """Return that of a late row."""
    return (density(excess, mean_m) - SHARE * STRAY) / (1.0 - SHARE)


@pytest.mark.parametrize("mean_m", [0.1, 0.3, 6.0])
@pytest.mark.parametrize("excess", [-2.0, -0.3, 0.0, 0.5, 9.0])
def test_a_known_mean_gives_the_exponentially_modified_gaussian(mean_m: float, excess: float) -> None:
    """The density is SciPy's, to ten digits."""
    expected = 0.95 * exponnorm(mean_m / STD, scale=STD).pdf(excess) + SHARE * STRAY
    assert density(excess, mean_m) == pytest.approx(expected, rel=1e-10)


def test_the_density_of_an_unknown_bias() -> None:
    """It is within a quarter of the convolution of the Gaussian with 1 / (b + c), and falls in proportion to 1 / b."""

    def convolved(excess: float) -> float:
        bias = np.linspace(0.0, 25.0, 5001) * STD
        weight = 1.0 / (bias / STD + 0.5)
        return float((weight * norm.pdf(excess - bias, scale=STD)).sum() / weight.sum())

    for excess in (-1.0, -0.3, 0.0, 0.3, 0.9, 3.0):
        assert late_density(excess, None) == pytest.approx(convolved(excess), rel=0.25)
    assert late_density(30.0, None) / late_density(60.0, None) == pytest.approx(2.0, rel=1e-2)
    assert density(-9.0, None) == pytest.approx(SHARE * STRAY, rel=1e-9)
    parts = [quad(late_density, *ends, args=(None,), epsabs=1e-6)[0] for ends in ((-3.0, 0.0), (0.0, 1.0), (1.0, 7.5))]
    assert sum(parts) == pytest.approx(1.0, abs=0.1)


def mixture(mean_m: float | None, paths: bool) -> Mixture:
    """Return the mixtures of 60 snapshots of five ranges, in groups of paths or each by itself."""
    generator = np.random.default_rng(1)
    sensors, ranges = generator.uniform(0.0, 30.0, (60, 5, 2)), generator.uniform(1.0, 40.0, (60, 5))
    std = generator.uniform(0.5, 3.0, (60, 5))
    if paths:
        sensors[:, 1], sensors[:, 4] = sensors[:, 0], sensors[:, 3]
    batch = range_batch(sensors, ranges, std, height=2.0, sensor=np.array([[0, 0, 1, 2, 2]]) if paths else None)
    if paths:
        number = np.asfortranarray(np.tile([0, 1, 0, 0, 1], (60, 1)))
        batch = type(batch)(**{**vars(batch), "path": number})
    grouped, groups = grouped_ranges(batch)
    law = BiasLaw("positive", mean_m, None)
    return range_outlier_model(grouped, groups, alpha=0.3, law=law, path_prior="uniform").mixture


@pytest.mark.parametrize("paths", [False, True])
@pytest.mark.parametrize("mean_m", [None, 0.7, 20.0])
def test_derivatives_are_those_of_the_score(mean_m: float | None, paths: bool) -> None:
    """Gradient and exact second derivatives agree with central differences of the score."""
    mixtures = mixture(mean_m, paths)
    x, y = np.random.default_rng(2).uniform(-20.0, 20.0, (2, 60))
    at, h = mixtures.evaluate(x, y), 1e-4

    def cost(dx: float, dy: float) -> np.ndarray:
        return mixtures.score(x[:, None] + dx, y[:, None] + dy)[:, 0]

    np.testing.assert_allclose(at.cost + mixtures.least_cost, cost(0.0, 0.0), atol=1e-10)
    np.testing.assert_allclose(at.gradient[0], (cost(h, 0.0) - cost(-h, 0.0)) / (2.0 * h), atol=1e-6)
    np.testing.assert_allclose(at.gradient[1], (cost(0.0, h) - cost(0.0, -h)) / (2.0 * h), atol=1e-6)
    exact = at.exact
    assert exact is not None
    assert exact.sum() >= 10
    xx = (cost(h, 0.0) - 2.0 * cost(0.0, 0.0) + cost(-h, 0.0)) / (h * h)
    xy = (cost(h, h) - cost(h, -h) - cost(-h, h) + cost(-h, -h)) / (4.0 * h * h)
    np.testing.assert_allclose(at.hessian.xx[exact], xx[exact], atol=1e-3)
    np.testing.assert_allclose(at.hessian.xy[exact], xy[exact], atol=1e-3)
    assert (at.hessian.determinant > 0.0).all()


def test_ranges_far_too_short_stay_finite() -> None:
    """A range a hundred million standard deviations too short has a finite cost and finite derivatives."""
    circles = range_circles(range_batch([(0.0, 0.0)], [[1.0]], 1e-3))
    for mean_m in (None, 0.5):
        row = LateRanges.of(circles, mean_m, np.log([STRAY])).derivatives(0, np.array([1e5]), np.array([0.0]))
        assert row.outlier is not None
        for part in (row, row.outlier):
            assert np.isfinite([part.half_chi_square, *part.gradient, *part.gauss, *part.hessian]).all()
