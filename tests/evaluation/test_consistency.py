"""NEES and confidence ellipses, compared with linear algebra and scipy's chi-square."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import chi2

from nlosctl.evaluation.consistency import nees_interval, squared_mahalanobis
from nlosctl.evaluation.error_statistics import error_percentiles
from nlosctl.geometry.ellipses import ellipse_threshold


def test_squared_mahalanobis_is_the_quadratic_form():
    """e^T C^-1 e by a matrix solve, row by row, for random covariances and an elongated one."""
    generator = np.random.default_rng(1)
    roots = generator.normal(size=(200, 2, 2))
    roots[0] = [[1e4, 0.0], [9.9e3, 1e-1]]
    covariance = roots @ roots.transpose(0, 2, 1)
    error = generator.normal(size=(200, 2))
    packed = np.stack([covariance[:, 0, 0], covariance[:, 0, 1], covariance[:, 1, 1]], axis=1)
    expected = [(np.linalg.solve(root, e) ** 2).sum() for root, e in zip(roots, error, strict=True)]
    np.testing.assert_allclose(squared_mahalanobis(error, packed)[1:], expected[1:], rtol=1e-9)
    assert squared_mahalanobis(error, packed)[0] == pytest.approx(expected[0], rel=1e-3)


@pytest.mark.parametrize(
    "covariance", [(0, 0, 0), (1, 1, 1), (1, 2, 1), (-1, 0, 1), (1, 0, -1), (math.nan, 0, 1), (math.inf, 0, 1)]
)
def test_invalid_covariances_give_nan(covariance):
    """Singular, indefinite, negative or missing covariances give NaN and leave the other rows unchanged."""
    result = squared_mahalanobis(np.ones((2, 2)), np.array([covariance, (1, 0, 1)], dtype=float))
    assert math.isnan(result[0])
    assert result[1] == 2.0


@pytest.mark.parametrize("probability", [0.5, 0.9, 0.95, 0.99])
def test_ellipse_threshold_is_the_quantile_of_chi_square(probability):
    """The threshold is the chi-square quantile with two degrees of freedom."""
    assert ellipse_threshold(probability) == pytest.approx(chi2.ppf(probability, 2), rel=1e-12)


@pytest.mark.parametrize("count", [1, 7, 1000, 10_000_000])
def test_nees_interval_is_that_of_the_chi_square_mean(count):
    """The mean of n NEES is chi-square with 2 n degrees of freedom over n."""
    expected = chi2.ppf([0.025, 0.975], 2 * count) / count
    np.testing.assert_allclose(nees_interval(count), expected, rtol=1e-9)


def test_nees_interval_without_rows():
    """Without rows there is no interval."""
    assert all(math.isnan(bound) for bound in nees_interval(0))


@pytest.mark.parametrize("count", [1, 2, 5, 100, 101])
def test_percentiles_agree_with_numpy(count):
    """Linear interpolation, as in numpy.percentile."""
    errors = np.random.default_rng(count).exponential(size=count)
    percents = (0, 50, 90, 95, 99, 100)
    np.testing.assert_allclose(error_percentiles(errors, percents), np.percentile(errors, percents), rtol=1e-12)


def test_percentiles_that_touch_a_missing_fix_are_infinite():
    """Ranks 0 to 4 are 1, 2, 3 and two infinities: 50 % is exactly rank 2, above it the result is infinite."""
    errors = np.array([np.inf, 3.0, 1.0, np.inf, 2.0])
    assert error_percentiles(errors, (25, 50, 50.1, 75, 100)) == (2.0, 3.0, math.inf, math.inf, math.inf)


def test_percentiles_without_rows():
    """Without errors there is no percentile."""
    assert all(math.isnan(value) for value in error_percentiles(np.zeros(0), (50, 90)))
