"""Consistency of covariances with errors: normalized estimation error squared (NEES) and confidence ellipses."""

from __future__ import annotations

import math

import numpy as np

from nlosctl.arrays import FloatArray, IntArray, ignoring_overflow
from nlosctl.geometry.symmetric import SymmetricMatrix, dot

__all__ = ["nees_interval", "squared_mahalanobis", "uncertain_coordinates"]


def uncertain_coordinates(covariance_m2: FloatArray) -> IntArray:
    """Return how many coordinates (N,) covariances (N, D (D + 1) / 2) leave uncertain: D, or 2 where z is exact."""
    rows, entries = covariance_m2.shape
    if entries == 3:
        return np.full(rows, 2)
    return np.where(covariance_m2[:, 5] == 0.0, 2, 3)


def squared_mahalanobis(error_m: FloatArray, covariance_m2: FloatArray) -> FloatArray:
    """Return e^T C^-1 e (N,) of errors (N, D) and covariances (N, D (D + 1) / 2): xx, xy, yy, and xz, yz, zz; metres.

    NaN where a covariance is not positive definite or anything is not finite. This is the NEES of a row (Bar-Shalom,
    Li, Kirubarajan 2001, Section 5.4.2), chi-square with D degrees of freedom if the covariance is correct. Where a
    height is held exactly (zz is 0) it is that of x and y.
    """
    if error_m.shape[1] == 3:
        covariance = SymmetricMatrix(*covariance_m2.T)
        with ignoring_overflow():
            squared = dot(tuple(error_m.T), covariance.solve(*error_m.T))
        squared = np.where(np.isfinite(squared), squared, np.nan)
        held = uncertain_coordinates(covariance_m2) == 2
        return np.where(held, squared_mahalanobis(error_m[:, :2], covariance_m2[:, :3]), squared)
    xx, xy, yy = covariance_m2[:, 0], covariance_m2[:, 1], covariance_m2[:, 2]
    x, y = error_m[:, 0], error_m[:, 1]
    with ignoring_overflow():
        remaining = yy - xy * (xy / xx)
        across = y - x * (xy / xx)
        squared = x * (x / xx) + across * (across / remaining)
        proper = (xx > 0.0) & (remaining > 0.0) & np.isfinite(covariance_m2).all(axis=1) & np.isfinite(squared)
    return np.where(proper, squared, np.nan)


def nees_interval(count: int, probability: float = 0.95, degrees: int | None = None) -> tuple[float, float]:
    """Return the two-sided acceptance interval of the mean NEES of ``count`` independent rows.

    It contains the mean with ``probability`` if all covariances are correct: the sum over rows is then chi-square
    with ``degrees`` of freedom, by default 2 ``count`` (Bar-Shalom et al. 2001, (5.4.2-11)). NaN without rows.
    """
    if count == 0:
        return math.nan, math.nan
    from scipy.special import gammaincinv

    tail = 0.5 * (1.0 - probability)
    half = count if degrees is None else 0.5 * degrees
    low, high = (2.0 * float(gammaincinv(half, p)) / count for p in (tail, 1.0 - tail))
    return low, high
