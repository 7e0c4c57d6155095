"""Figures of a sample: ratios, percentiles of errors, and standard errors of an RMSE and of a share."""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterator, Sequence

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray

__all__ = ["error_percentiles", "ratio", "rmse_std_error", "rows_by_group", "share_std_error"]


def ratio(part: float, whole: float) -> float:
    """Return ``part`` over ``whole``; NaN if ``whole`` is zero."""
    return float(part) / whole if whole else math.nan


def rows_by_group(group: IntArray, keys: Sequence[Hashable]) -> Iterator[tuple[Hashable, BoolArray]]:
    """Yield each key that has rows, with a mask (N,) of its rows, in order of first appearance.

    ``group`` (N,) holds the index of each row's key in ``keys``.
    """
    numbers, first = np.unique(group, return_index=True)
    for number in numbers[np.argsort(first)]:
        yield keys[number], group == number


def error_percentiles(error: FloatArray, percents: Sequence[float]) -> tuple[float, ...]:
    """Return the percentiles of errors (N,), where a row without a fix is infinite; NaN without rows.

    Interpolated linearly between neighbours, as ``numpy.percentile`` does with finite values; infinite as soon as an
    infinite neighbour has any weight (where NumPy returns NaN).
    """
    if error.size == 0:
        return tuple(math.nan for _ in percents)
    positions = [percent / 100.0 * (error.size - 1) for percent in percents]
    below = [math.floor(position) for position in positions]
    above = [math.ceil(position) for position in positions]
    ordered = np.partition(error, sorted({*below, *above}))
    return tuple(
        _interpolate(float(ordered[low]), float(ordered[high]), position - low)
        for low, high, position in zip(below, above, positions, strict=True)
    )


def _interpolate(low: float, high: float, fraction: float) -> float:
    return low + (high - low) * fraction if math.isfinite(high) else high


def rmse_std_error(count: int, mean_square: float, mean_fourth: float) -> float:
    """Return the standard error of the root mean square of ``count`` independent values.

    ``mean_square`` and ``mean_fourth`` are the means of their squares and fourth powers. By the delta method: standard
    deviation of the squares / sqrt(count) / (2 RMS). NaN for fewer than two values.
    """
    if count < 2 or math.isnan(mean_square):
        return math.nan
    if mean_square == 0.0:
        return 0.0
    variance = max(mean_fourth - mean_square * mean_square, 0.0) / (count - 1)
    return 0.5 * math.sqrt(variance / mean_square)


def share_std_error(share: float, count: float) -> float:
    """Return the binomial standard error of a share of ``count`` independent rows; NaN without rows."""
    return math.sqrt(share * (1.0 - share) / count) if count > 0 else math.nan
