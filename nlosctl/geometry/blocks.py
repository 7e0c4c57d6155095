"""Blocks (B, K): sums over the measurements whose bits do not depend on the number of snapshots, and rows of them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import FloatArray, IntArray, ScalarT

__all__ = ["gather_rows", "max_measurements", "sum_measurements", "take_rows"]


def gather_rows(array: npt.NDArray[ScalarT], rows: IntArray) -> npt.NDArray[ScalarT]:
    """Return rows of a block (B, K), in any order and as often as named, in Fortran order."""
    return np.take(array.T, rows, axis=1).T


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
    return array if rows.shape[0] == array.shape[0] else gather_rows(array, rows)
