"""The radius of the sphere with half of a Gaussian, and the thresholds of ellipsoids."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from nlosctl.geometry.ellipses import circular_error_probable, ellipsoid_threshold, spherical_error_probable
from nlosctl.geometry.symmetric import SymmetricMatrix


def sep50(*variances: float) -> float:
    """Return the radius for a diagonal covariance."""
    xx, yy, zz = (np.array([value]) for value in variances)
    zero = np.zeros(1)
    return float(spherical_error_probable(SymmetricMatrix(xx, zero, yy, zero, zero, zz))[0])


def test_a_round_gaussian_has_the_chi_square_radius() -> None:
    """In one, two and three dimensions half of a round Gaussian is within the root of the chi-square median."""
    for variances, degrees in (((4.0, 4.0, 4.0), 3), ((4.0, 4.0, 0.0), 2), ((4.0, 0.0, 0.0), 1)):
        assert sep50(*variances) == pytest.approx(2.0 * np.sqrt(chi2.ppf(0.5, degrees)), rel=1e-6)


def test_a_flat_gaussian_has_its_circular_error() -> None:
    """Without a third dimension the sphere is the circle of CEP50."""
    assert sep50(1.0, 0.25, 0.0) == pytest.approx(float(circular_error_probable(np.ones(1), np.array([0.5]))[0]))


@pytest.mark.parametrize("variances", [(1.0, 0.5, 0.2), (1.0, 0.01, 0.001), (1.0, 1.0, 0.01), (4.0, 3.0, 2.0)])
def test_half_of_the_draws_are_within_the_sphere(variances: tuple[float, float, float]) -> None:
    """Half of 200,000 draws are within the radius, up to their error."""
    draws = np.random.default_rng(0).normal(size=(200_000, 3)) * np.sqrt(variances)
    inside = np.mean(np.linalg.norm(draws, axis=1) <= sep50(*variances))
    assert abs(inside - 0.5) < 4.0 * 0.00112


def test_no_covariance_has_no_radius() -> None:
    """NaN gives NaN."""
    assert np.isnan(sep50(np.nan, 1.0, 1.0))


def test_thresholds_are_those_of_chi_square() -> None:
    """Of two and three dimensions row by row, as scipy has them."""
    found = ellipsoid_threshold(0.95, np.array([2, 3]))
    np.testing.assert_allclose(found, chi2.ppf(0.95, [2, 3]), rtol=1e-12)
