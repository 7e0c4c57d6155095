"""The covariance of a fix that is not sure how far it is from a sensor."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from nlosctl.arrays import FloatArray, IntArray, ignoring_overflow
from nlosctl.geometry.symmetric import SymmetricMatrix

__all__ = ["Widened", "widen_near_sensors"]

Widened = Callable[[IntArray, FloatArray], SymmetricMatrix]
"""Of some snapshots (N,), the covariance with all squared ranges increased by so much (N,), in square metres."""

_NEAR = 3.0
"""A fix is near a sensor when it is not more standard deviations away."""

_ROUNDS = 2


def widen_near_sensors(covariance: SymmetricMatrix, nearest_m: FloatArray, widened: Widened) -> SymmetricMatrix:
    """Return the covariances (B,) of fixes whose nearest origin is at ``nearest_m`` (B,), larger where that is near.

    A bearing says where a source is to std times its range; the range from a near sensor is itself as uncertain as the
    fix. There the expected squared range takes the place of the squared range at the fix: the square plus the larger
    eigenvalue of the covariance, twice over. Other rows keep their bits.
    """
    with ignoring_overflow():
        larger = covariance.eigenvalues()[1]
        near = np.flatnonzero((nearest_m * nearest_m < _NEAR * _NEAR * larger) & np.isfinite(larger))
        if not near.size:
            return covariance
        larger = larger[near]
        for _ in range(_ROUNDS):
            wider = widened(near, larger)
            larger = wider.eigenvalues()[1]
    result = covariance.map(np.copy)
    result.put(near, wider)
    return result
