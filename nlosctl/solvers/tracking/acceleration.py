"""The density of the acceleration: the maximum of the marginal likelihood of all tracks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import exp, log, sqrt

import numpy as np

from nlosctl.arrays import FloatArray, IntArray

__all__ = ["DensityEstimate", "close_times", "likeliest_density"]

_LEAST, _MOST = 1e-12, 1e12
_FLAT_NATS = 0.05
"""A decade over which the logarithm of the likelihood rises by less is flat."""

_TOLERANCE = 2e-3
_GOLDEN = 0.5 * (sqrt(5.0) - 1.0)

_STIFFEST = 1e10
"""Steps are so long that the variance of a fix is at most this many times q h^3: beyond, digits are lost."""


@dataclass(frozen=True)
class DensityEstimate:
    """The density q in m2/s3, and whether the likelihood has a maximum there: not where it is flat towards 0."""

    density: float
    is_maximum: bool


def likeliest_density(log_evidence: Callable[[float], float], first: float) -> DensityEstimate:
    """Return the density at the maximum of a function of it: decades uphill from ``first``, then golden sections."""
    middle, value = log(first), log_evidence(first)
    decade = log(10.0)
    below, above = log_evidence(exp(middle - decade)), log_evidence(exp(middle + decade))
    while above > value and middle < log(_MOST):
        middle, below, value, above = middle + decade, value, above, log_evidence(exp(middle + 2.0 * decade))
    while below > value and middle > log(_LEAST):
        if below - value < _FLAT_NATS:
            return DensityEstimate(exp(middle), False)
        middle, above, value, below = middle - decade, value, below, log_evidence(exp(middle - 2.0 * decade))
    low, high = middle - decade, middle + decade
    left, right = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
    at_left, at_right = log_evidence(exp(left)), log_evidence(exp(right))
    while high - low > _TOLERANCE:
        if at_left > at_right:
            high, right, at_right = right, left, at_left
            left = high - _GOLDEN * (high - low)
            at_left = log_evidence(exp(left))
        else:
            low, left, at_left = left, right, at_right
            right = low + _GOLDEN * (high - low)
            at_right = log_evidence(exp(right))
    return DensityEstimate(exp(0.5 * (low + high)), True)


def close_times(key: IntArray, variance_m2: FloatArray, density: float) -> FloatArray:
    """Return the times (S,) within which snapshots are one state: too short for the motion to matter in any digit.

    ``variance_m2`` (S,) are those of the positions, NaN where they are not known; the median of each track ``key``
    (S,) counts.
    """
    median = np.zeros(int(key.max(initial=-1)) + 1)
    known = np.flatnonzero(np.isfinite(variance_m2) & (variance_m2 > 0.0))
    order = known[np.lexsort((variance_m2[known], key[known]))]
    keys, first, count = np.unique(key[order], return_index=True, return_counts=True)
    median[keys] = variance_m2[order[first + count // 2]]
    return np.asarray(np.cbrt(median / (_STIFFEST * density))[key])
