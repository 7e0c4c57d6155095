"""Sums over the measurements of a block (B, K) whose bits do not depend on the number of snapshots in it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["max_measurements", "sum_measurements", "take_rows"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


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


def take_rows(array: FloatArray, rows: IntArray) -> FloatArray:
    """Return some rows of a block (B, K) in Fortran order; ``rows`` rise, so that B of them are the block itself."""
    if rows.shape[0] == array.shape[0]:
        return array
    taken = np.empty((rows.shape[0], array.shape[1]), order="F")
    for k in range(array.shape[1]):
        np.take(array[:, k], rows, out=taken[:, k])
    return taken
