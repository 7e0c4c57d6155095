"""Error ellipses compared with numpy's eigenvectors, CEP50 with integration by scipy."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import i0e

from nlosctl.geometry.ellipses import circular_error_probable, error_ellipse
from nlosctl.geometry.symmetric import Symmetric2x2


def test_axes_agree_with_the_eigenvectors():
    """Semi-axes are square roots of eigenvalues; the orientation is that of the major eigenvector."""
    generator = np.random.default_rng(1)
    factors = generator.normal(size=(300, 2, 2))
    matrices = factors @ factors.transpose(0, 2, 1)
    ellipse = error_ellipse(Symmetric2x2(matrices[:, 0, 0], matrices[:, 0, 1], matrices[:, 1, 1]))
    values, vectors = np.linalg.eigh(matrices)
    np.testing.assert_allclose(ellipse.semi_major_m, np.sqrt(values[:, 1]), rtol=1e-12)
    np.testing.assert_allclose(ellipse.semi_minor_m, np.sqrt(values[:, 0]), rtol=1e-6)
    direction = vectors[:, 0, 1] + 1j * vectors[:, 1, 1]
    # An axis has no sign: compare twice the angle.
    twice = np.exp(2j * ellipse.orientation_rad) / (direction / np.abs(direction)) ** 2
    assert np.abs(np.angle(twice)).max() < 1e-6
    assert (np.abs(ellipse.orientation_rad) <= np.pi / 2).all()


def test_invalid_covariances_have_no_ellipse():
    """NaN and matrices that are not positive semidefinite have NaN axes."""
    ellipse = error_ellipse(Symmetric2x2(np.array([np.nan, 1.0]), np.array([0.0, 2.0]), np.array([1.0, 1.0])))
    assert np.isnan(ellipse.semi_major_m).all()
    assert np.isnan(ellipse.orientation_rad).all()


def test_singular_covariances_have_a_zero_minor_axis():
    """Singular covariances have a minor axis of 0 along the line; the zero matrix has both axes 0."""
    ellipse = error_ellipse(
        Symmetric2x2(np.array([4.0, 0.0, 2.0, 0.0]), np.array([0.0, 0.0, -2.0, 0.0]), np.array([0.0, 9.0, 2.0, 0.0]))
    )
    np.testing.assert_allclose(ellipse.semi_major_m, [2.0, 3.0, 2.0, 0.0])
    np.testing.assert_allclose(ellipse.semi_minor_m, 0.0)
    np.testing.assert_allclose(ellipse.orientation_rad[:3], [0.0, np.pi / 2, -np.pi / 4])


def share_within(radius: float, minor: float) -> float:
    """Return P(radius) for axes 1 and ``minor``: the Hoyt distribution, integrated by scipy."""
    a, b = (1.0 + minor**2) / (4.0 * minor**2), (1.0 - minor**2) / (4.0 * minor**2)
    density = lambda r: r / minor * math.exp(-(a - b) * r * r) * i0e(b * r * r)  # noqa: E731
    return quad(density, 0.0, radius, epsabs=1e-13, limit=200)[0]


@pytest.mark.parametrize("minor", [1.0, 0.7, 0.3, 0.05])
def test_half_of_the_errors_are_within_cep50(minor):
    """The probability within CEP50 is one half by an independent formula."""
    radius = circular_error_probable(np.array([1.0]), np.array([minor]))[0]
    assert share_within(radius, minor) == pytest.approx(0.5, abs=1e-10)


def test_limits_of_cep50():
    """Equal axes give 1.1774 sigma, a line 0.6745 sigma, a point 0; NaN stays NaN."""
    found = circular_error_probable(np.array([2.0, 2.0, 0.0, np.nan, 0.0]), np.array([2.0, 0.0, 0.0, 1.0, np.nan]))
    np.testing.assert_allclose(found[:3], [2.0 * math.sqrt(2.0 * math.log(2.0)), 2.0 * 0.6744897501960817, 0.0])
    assert np.isnan(found[3:]).all()
