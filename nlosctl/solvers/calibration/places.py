"""How many different places positions are at: what a calibration without known positions needs many of.

A position is a cell of a grid whose spacing is a power of two: at least a twentieth of the size of the array, and the
standard deviation of the position. Cells, unlike positions, can be collected from any part of a file, in any order.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from nlosctl.arrays import FloatArray, IntArray

__all__ = ["MOST_CELLS", "cells_of", "count_places"]

MOST_CELLS = 2000
"""So many cells are compared; more are counted only as far as these."""

_SHARE = 0.05
_STDS = 1.0
_APART = 1.5
"""Places whose middles are at most this many spacings apart, along each axis, may be one."""


def cells_of(position_m: FloatArray, size_m: FloatArray, std_m: FloatArray) -> IntArray:
    """Return the cells (B, 1 + D) of positions (B, D): the exponent of the spacing, then the indices of the cell.

    ``size_m`` (B,) is the size of the array, ``std_m`` (B,) the standard deviation of the position. All are finite.
    """
    spacing = np.maximum(_SHARE * size_m, _STDS * std_m)
    level = np.ceil(np.log2(np.maximum(spacing, np.finfo(np.float64).tiny))).astype(np.int64)
    return np.column_stack([level, np.floor(np.ldexp(position_m, -level[:, None])).astype(np.int64)])


def count_places(cells: Iterable[tuple[int, ...]]) -> int:
    """Return how many of the cells are at different places, the smallest cells first.

    Of more than `MOST_CELLS` cells only as many are compared, those that come first when sorted.
    """
    chosen = sorted(set(cells))[:MOST_CELLS]
    middles: list[FloatArray] = []
    for level, *index in chosen:
        middle = np.ldexp(np.array(index, dtype=np.float64) + 0.5, level)
        if not middles or (np.abs(np.array(middles) - middle).max(axis=1) > _APART * 2.0**level).all():
            middles.append(middle)
    return len(middles)
