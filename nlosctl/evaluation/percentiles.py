"""Percentiles of errors, where a row without a fix is infinitely wrong."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from nlosctl.arrays import FloatArray

__all__ = ["error_percentiles"]


def error_percentiles(error: FloatArray, percents: Sequence[float]) -> tuple[float, ...]:
    """Return the percentiles of errors (N,), which may be infinite; NaN where there are none.

    Interpolated linearly between neighbours, as ``numpy.percentile`` does with finite values; infinite as soon as
    an infinite neighbour has any weight (numpy says NaN).
    """
    if error.size == 0:
        return tuple(math.nan for _ in percents)
    places = [percent / 100.0 * (error.size - 1) for percent in percents]
    below = [math.floor(place) for place in places]
    above = [math.ceil(place) for place in places]
    ordered = np.partition(error, sorted({*below, *above}))
    return tuple(
        _interpolate(float(ordered[low]), float(ordered[high]), place - low)
        for low, high, place in zip(below, above, places, strict=True)
    )


def _interpolate(low: float, high: float, fraction: float) -> float:
    if fraction == 0.0 or low == high:
        return low
    return low + (high - low) * fraction if math.isfinite(high) else high
