"""The cost of every snapshot at many points, computed in tiles whose temporaries stay in the near caches."""

from __future__ import annotations

from collections.abc import Callable
from math import sqrt
from typing import Any

import numpy as np

from nlosctl.arrays import FloatArray, Point, ignoring_overflow

__all__ = ["cost_at_points", "cost_point_by_point", "spread_m"]


_AT_ONCE = 1 << 15
"""So many costs are computed at once."""


def spread_m(cell_m: float) -> float:
    """Return the standard deviation by each coordinate of a point that is uniform in a square cell."""
    return cell_m / sqrt(12.0)


def cost_at_points(problem: Any, center: Point, points: Point, cost: Callable[[Any, Point], FloatArray]) -> FloatArray:
    """Return ``cost(problem, local)`` (B, P) of a block of snapshots at points (D arrays (B, P)).

    ``local`` are the points about the local origins ``center``, at least D arrays (B,). NaN becomes infinite.
    """
    size, count = points[0].shape
    total = np.empty((size, count))
    snapshots = max(1, _AT_ONCE // max(1, count))
    for first in range(0, size, snapshots):
        rows = np.arange(first, min(first + snapshots, size))
        part = problem.take(rows)
        for start in range(0, count, _AT_ONCE):
            at = slice(start, start + _AT_ONCE)
            local = tuple(
                each[first : first + snapshots, at] - middle[rows, None]
                for each, middle in zip(points, center, strict=False)
            )
            with ignoring_overflow():
                total[first : first + snapshots, at] = cost(part, local)
    total[np.isnan(total)] = np.inf
    return total


def cost_point_by_point(
    problem: Any, center: Point, points: Point, cost: Callable[[Any, Point], FloatArray]
) -> FloatArray:
    """Return the same of a ``cost`` (N,) of N snapshots, each at a point of its own (N,)."""

    def repeated(part: Any, local: Point) -> FloatArray:
        size, count = local[0].shape
        flat = tuple(each.ravel() for each in local)
        return cost(part.take(np.repeat(np.arange(size), count)), flat).reshape(size, count)

    return cost_at_points(problem, center, points, repeated)
