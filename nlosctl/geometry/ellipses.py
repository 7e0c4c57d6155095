"""Ellipses: the nearest point, and the ellipse of a covariance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import FloatArray, IntArray, ignoring_division, ignoring_invalid, ignoring_overflow
from nlosctl.geometry.symmetric import SymmetricMatrix

__all__ = [
    "ErrorEllipse",
    "circular_error_probable",
    "ellipse_threshold",
    "ellipsoid_threshold",
    "error_ellipse",
    "nearest_on_ellipse",
    "spherical_error_probable",
]

_ITERATIONS = 60


def nearest_on_ellipse(
    x: FloatArray, y: FloatArray, semi_major_m: FloatArray, semi_minor_m: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the point of (x/a)^2 + (y/b)^2 = 1 nearest to each point x, y; shapes alike, a >= b > 0, metres.

    Newton's method on F(t) = (a x / (t + a^2))^2 + (b y / (t + b^2))^2 - 1 from the left of its only root with
    t > -b^2, where F falls and is convex, so that no step overshoots (Eberly, "Distance from a point to an ellipse").
    Of two nearest points (points of the major axis between the centres of curvature) the one above is returned, as it
    is of all points of a circle for its centre.
    NaN in, NaN out.
    """
    a2, b2 = semi_major_m * semi_major_m, semi_minor_m * semi_minor_m
    far_x, far_y = semi_major_m * np.abs(x), semi_minor_m * np.abs(y)
    with ignoring_invalid():
        t = np.maximum(far_x - a2, far_y - b2)
        for _ in range(_ITERATIONS):
            over_x, over_y = far_x / (t + a2), far_y / (t + b2)
            excess = over_x * over_x + over_y * over_y - 1.0
            slope = 2.0 * (over_x * over_x / (t + a2) + over_y * over_y / (t + b2))
            step = np.where(excess > 0.0, excess / slope, 0.0)
            moved = t + step
            if not (moved > t).any():
                break
            t = moved
        foot_x = np.where(t == -a2, 0.0, a2 * np.abs(x) / (t + a2))  # the centre of a circle, all points being nearest
        foot_y = b2 * np.abs(y) / (t + b2)
        # On the major axis inside the evolute the root is t = -b^2 itself, and the foot is above or below.
        inside = (y == 0.0) & (t <= -b2)
        beside = semi_minor_m * np.sqrt(np.maximum(1.0 - (foot_x / semi_major_m) ** 2, 0.0))
        foot_y = np.where(inside, beside, foot_y)
    return np.copysign(foot_x, x), np.where(y == 0.0, foot_y, np.copysign(foot_y, y))


_NODES = (np.arange(96) + 0.5) * (0.5 * np.pi / 96)
"""Midpoints of the quarter turn over which the probability of a circle is integrated."""

_LINE_CEP, _CIRCLE_CEP = 0.674489750196082, 1.177410022515475
"""Radii with half of the probability of a Gaussian: sqrt(2) erfinv(1/2) on a line, sqrt(2 ln 2) when round."""


@dataclass(frozen=True)
class ErrorEllipse:
    """One-sigma ellipses: semi-axes in metres, and the direction of the major axis in (-pi / 2, pi / 2]."""

    semi_major_m: FloatArray
    semi_minor_m: FloatArray
    orientation_rad: FloatArray


def error_ellipse(covariance: SymmetricMatrix) -> ErrorEllipse:
    """Return the one-sigma ellipses of covariances; NaN where a covariance is NaN or not positive."""
    smaller, larger = covariance.eigenvalues()
    valid = (smaller >= 0.0) & np.isfinite(larger)
    orientation = 0.5 * np.arctan2(2.0 * covariance.xy, covariance.xx - covariance.yy)
    return ErrorEllipse(
        np.sqrt(np.where(valid, larger, np.nan)),
        np.sqrt(np.where(valid, smaller, np.nan)),
        np.where(valid, orientation, np.nan),
    )


def circular_error_probable(semi_major_m: FloatArray, semi_minor_m: FloatArray) -> FloatArray:
    """Return CEP50 (N,): the radius of the circle about the mean that contains half of a Gaussian with these axes.

    Exact to rounding: Newton's method on the distribution of the radius. NaN where an axis is NaN, 0 where both are.
    """
    with ignoring_invalid():
        ratio = np.where(semi_major_m > 0.0, semi_minor_m / semi_major_m, 0.0)
    ratio = np.where(np.isnan(semi_minor_m + semi_major_m), np.nan, ratio)
    radius = _LINE_CEP + (_CIRCLE_CEP - _LINE_CEP) * ratio
    for _ in range(8):
        probability, density = _within_radius(radius, ratio)
        radius = radius - (probability - 0.5) / density
    return semi_major_m * radius


def _within_radius(radius: FloatArray, ratio: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return P(|(g, ratio h)| <= radius) and its derivative, for independent standard Gaussians g and h.

    P = (2 / pi) int_0^(pi/2) 1 - exp(-radius^2 / (2 m(v))) dv with m = cos^2 v + ratio^2 sin^2 v: the Gaussian in
    polar coordinates, the angle scaled by the axes. Periodic and smooth, so that midpoints converge fast.
    """
    probability, density = np.zeros_like(radius), np.zeros_like(radius)
    for node in _NODES:
        mean_square = np.cos(node) ** 2 + (ratio * np.sin(node)) ** 2
        tail = np.exp(-0.5 * radius * radius / mean_square)
        probability += (1.0 - tail) / _NODES.size
        density += radius / mean_square * tail / _NODES.size
    return probability, density


def _within_sphere(radius: FloatArray, middle: FloatArray, least: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return P(|(g, middle h, least k)| <= radius) and its derivative, for independent standard Gaussians g, h and k.

    P = int P_plane(sqrt(radius^2 - least^2 k^2)) phi(k) dk with `_within_radius`, k = min(radius / least, 9) sin(v): by
    Gauss-Legendre nodes over a quarter turn.
    """
    probability, density = np.zeros_like(radius), np.zeros_like(radius)
    with ignoring_division():
        reach = np.where(least > 0.0, radius / least, np.inf)
    limit = np.minimum(reach, 9.0)
    for node, weight in zip(*np.polynomial.legendre.leggauss(16), strict=True):
        turn = 0.25 * np.pi * (node + 1.0)
        height = limit * np.sin(turn)
        share = (
            2.0 * weight * 0.25 * np.pi * limit * np.cos(turn) * np.exp(-0.5 * height * height) / np.sqrt(2.0 * np.pi)
        )
        beside = np.sqrt(np.maximum(radius * radius - (least * height) ** 2, 1e-300))
        within, slope = _within_radius(beside, middle)
        probability += share * within
        density += share * slope * radius / beside
    return probability, density


def ellipsoid_threshold(probability: float, dimension: IntArray, degrees: FloatArray | None = None) -> FloatArray:
    """Return the squared Mahalanobis distance (N,) that holds ``probability`` of errors in ``dimension`` (N,) 1 to 3.

    The quantile of chi-square. With the ``degrees`` of freedom (N,) of a standard deviation that is estimated, that of
    the F distribution times the dimension; where they are NaN, that of chi-square.
    """
    from scipy.special import fdtri, gammaincinv

    certain = np.float64(2.0) * gammaincinv(0.5 * dimension, probability)
    certain = np.where(dimension == 2, ellipse_threshold(probability), certain)
    if degrees is None:
        return certain
    with ignoring_invalid():
        estimated = np.where(dimension == 2, ellipse_threshold(probability, degrees), 0.0)
        estimated = np.where(dimension == 2, estimated, dimension * fdtri(dimension, degrees, probability))
    return np.where(np.isnan(degrees), certain, estimated)


def spherical_error_probable(covariance: SymmetricMatrix) -> FloatArray:
    """Return SEP50 (N,): the radius of the sphere about the mean that contains half of a Gaussian in space.

    To 1e-6 of itself: Newton's method on the distribution of the radius (`_within_sphere`). NaN where a covariance is
    NaN or not positive; a Gaussian without a third dimension, as at a height that is held, has its CEP50.
    """
    dense = covariance.dense()
    finite = np.asarray(np.isfinite(dense).all(axis=(-2, -1)))
    variances = np.linalg.eigvalsh(np.where(finite[:, None, None], dense, np.eye(3)))
    valid = finite & (variances[:, 2] > 0.0) & (variances[:, 0] >= -1e-9 * variances[:, 2])
    largest = np.sqrt(np.where(valid, variances[:, 2], 1.0))
    middle, least = (np.sqrt(np.maximum(np.where(valid, variances[:, k], 1.0), 0.0)) / largest for k in (1, 0))
    radius = circular_error_probable(np.ones(largest.shape), middle) + 0.35 * least
    for _ in range(7):
        probability, density = _within_sphere(radius, middle, least)
        radius = np.maximum(radius - (probability - 0.5) / density, 0.3 * radius)
    return np.where(valid, largest * radius, np.nan)


def ellipse_threshold(probability: float, degrees: FloatArray | None = None) -> FloatArray:
    """Return the squared Mahalanobis distance (N,) of ellipses that contain ``probability`` of the errors in the plane.

    The quantile of chi-square with two degrees of freedom: -2 ln(1 - p). With the ``degrees`` of freedom (N,) of a
    standard deviation that is estimated, twice that of the F distribution of 2 and ``degrees``:
    ``degrees`` ((1 - p)^(-2 / degrees) - 1); where they are NaN, that of chi-square.
    """
    certain = np.float64(-2.0 * np.log1p(-probability))
    if degrees is None:
        return np.asarray(certain)
    with ignoring_overflow():
        return np.where(np.isnan(degrees), certain, degrees * np.expm1(certain / degrees))
