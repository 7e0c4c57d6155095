"""Names of array types, and contexts in which NumPy does not warn."""

from __future__ import annotations

from functools import partial
from typing import TypeVar

import numpy as np
import numpy.typing as npt

__all__ = [
    "BoolArray",
    "FloatArray",
    "IntArray",
    "Point",
    "ScalarT",
    "SeedArray",
    "StatusArray",
    "ThreeValuedArray",
    "ignoring_division",
    "ignoring_invalid",
    "ignoring_overflow",
]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]
Point = tuple[FloatArray, ...]
"""Coordinates of points, as D arrays: x and y in the plane, x, y and z in space."""
StatusArray = npt.NDArray[np.uint8]
"""Statuses of estimates, by number (`nlosctl.contract.statuses.Status`)."""
ThreeValuedArray = npt.NDArray[np.int8]
"""True (1), false (0) or unknown (-1)."""
SeedArray = npt.NDArray[np.uint64]
ScalarT = TypeVar("ScalarT", bound=np.generic)

# Each call makes a new context: NumPy enters one errstate object only once.
ignoring_invalid = partial(np.errstate, invalid="ignore")
"""A context for comparisons and arithmetic with NaN."""
ignoring_division = partial(np.errstate, divide="ignore", invalid="ignore")
"""A context for divisions by zero, logarithms of zero, and what follows from them."""
ignoring_overflow = partial(np.errstate, divide="ignore", invalid="ignore", over="ignore", under="ignore")
"""A context for numbers that float64 does not hold, and what follows from them."""
