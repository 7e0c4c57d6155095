"""Numbers of the page: rounded to what the eye and the standard deviations need, so that the page stays small."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import FloatArray

__all__ = ["decimals_of", "places_for", "rounded", "significant"]

_MOST_DECIMALS = 9


def decimals_of(size: float, digits: int) -> int:
    """Return the decimals with which numbers of this ``size`` have so many digits, from 0 to 9."""
    if not math.isfinite(size) or size <= 0.0:
        return 3
    return min(max(digits - 1 - math.floor(math.log10(size)), 0), _MOST_DECIMALS)


def places_for(std: FloatArray, span: float) -> int:
    """Return the decimals of positions with standard deviations (N,): a hundredth of the median, or 1e-6 of the span.

    The finer of the two is taken, so that neither the errors nor the picture are coarser for the rounding.
    """
    known = std[np.isfinite(std) & (std > 0.0)]
    by_std = decimals_of(float(np.median(known)), 3) if known.size else 0
    return max(by_std, min(decimals_of(span, 6), 4))


def rounded(values: npt.NDArray[Any] | FloatArray, decimals: int) -> list[float | int | None]:
    """Return numbers (N,) with these decimals, whole ones as integers, and None for those that are not finite."""
    parts = np.round(np.asarray(values, dtype=np.float64), decimals).tolist()
    return [None if not math.isfinite(part) else int(part) if part == int(part) else part for part in parts]


def significant(value: float, digits: int = 4) -> float | int | None:
    """Return a number with so many significant digits; None if it is not finite."""
    if not math.isfinite(value):
        return None
    short = float(f"{value:.{digits}g}")
    return int(short) if short == int(short) else short
