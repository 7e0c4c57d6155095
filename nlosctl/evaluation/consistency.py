"""Consistency of covariances with errors: normalized estimation error squared (NEES) and confidence ellipses."""

from __future__ import annotations

import math

import numpy as np

from nlosctl.arrays import FloatArray, ignoring_overflow

__all__ = ["nees_interval", "squared_mahalanobis"]


def squared_mahalanobis(error_m: FloatArray, covariance_m2: FloatArray) -> FloatArray:
    """Return e^T C^-1 e (N,) of errors (N, 2) in metres and covariances (N, 3): xx, xy, yy in square metres.

    NaN where a covariance is not positive definite or anything is not finite. This is the NEES of a row (Bar-Shalom,
    Li, Kirubarajan 2001, Section 5.4.2), chi-square with two degrees of freedom if the covariance is correct.
    """
    xx, xy, yy = covariance_m2[:, 0], covariance_m2[:, 1], covariance_m2[:, 2]
    x, y = error_m[:, 0], error_m[:, 1]
    with ignoring_overflow():
        remaining = yy - xy * (xy / xx)
        across = y - x * (xy / xx)
        squared = x * (x / xx) + across * (across / remaining)
        proper = (xx > 0.0) & (remaining > 0.0) & np.isfinite(covariance_m2).all(axis=1) & np.isfinite(squared)
    return np.where(proper, squared, np.nan)


def nees_interval(count: int, probability: float = 0.95) -> tuple[float, float]:
    """Return the two-sided acceptance interval of the mean NEES of ``count`` independent rows.

    It contains the mean with ``probability`` if all covariances are correct: the sum over rows is then chi-square
    with 2 ``count`` degrees of freedom (Bar-Shalom et al. 2001, (5.4.2-11)). NaN without rows.
    """
    if count == 0:
        return math.nan, math.nan
    from scipy.special import gammaincinv

    tail = 0.5 * (1.0 - probability)
    low, high = (2.0 * float(gammaincinv(count, p)) / count for p in (tail, 1.0 - tail))
    return low, high
