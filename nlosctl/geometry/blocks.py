"""Sums over the measurements of a block (B, K) whose bits do not depend on the number of snapshots in it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["max_measurements", "sum_measurements"]

FloatArray = npt.NDArray[np.float64]


def sum_measurements(values: FloatArray) -> FloatArray:
    """Return the sum (..., B) over the measurements of ``values`` (..., B, K), added one by one in order.

    ``np.sum`` would add in pairs when a block holds one snapshot and in order when it holds several.
    """
    total = np.zeros(values.shape[:-1])
    for k in range(values.shape[-1]):
        total += values[..., k]
    return total


def max_measurements(values: FloatArray) -> FloatArray:
    """Return the largest value (B,) over the measurements of ``values`` (B, K); NaN where any is NaN."""
    largest = np.full(values.shape[0], -np.inf)
    for k in range(values.shape[1]):
        np.maximum(largest, values[:, k], out=largest)
    return largest
