"""Initial estimates for independent differences of pairs of sensors: closed forms, or the lowest of many points."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray
from nlosctl.models.arrivals import ArrivalRows
from nlosctl.solvers.arrivals.closed_forms import initial_estimates
from nlosctl.solvers.arrivals.pair_graph import arrivals_of_pairs, number_places

__all__ = ["pair_estimates"]

_DIRECTIONS = 128
_RADII = (0.15, 0.3, 0.5, 0.75, 1.0, 1.5, 2.0, 4.0, 8.0)
"""Distances of the points from the local origin in array sizes."""

_KEPT = 16
_NEAR = 0.6
"""Two points are near each other at less than this share of the larger distance from the local origin."""

_MOST_PLACES = 1000
_LARGEST = 1 << 20
"""Entries of the arrays of a few snapshots."""

Points = list[tuple[FloatArray, ...]]


def pair_estimates(rows: ArrivalRows) -> Points:
    """Return points, each as D arrays (B,) about the local origins, NaN where a point does not exist.

    If a chain of pairs links all sensors of a snapshot, the closed forms of `initial_estimates` have the least-squares
    arrivals at them. Otherwise those are not arrivals with one offset, and the likeliest points of a pattern follow;
    so too if the sensors are at thousands of places.
    """
    place = number_places(rows)
    count = place.max(axis=1, initial=-1) + 1
    shape, closed = (len(rows.center), count.size), list[tuple[IntArray, Points]]()
    lowest, pattern = np.full((_KEPT, *shape), np.nan), _pattern(shape[0])
    most = max(1, _LARGEST // pattern[0].size)
    for some in _alike(count):
        part, connected = rows.take(some), np.zeros(some.size, dtype=bool)
        if count[some[0]] <= _MOST_PLACES:
            arrivals, connected = arrivals_of_pairs(part, place[some])
            closed.append((some, initial_estimates(arrivals)))
        apart = np.flatnonzero(~connected)
        for start in range(0, apart.size, most):
            others = apart[start : start + most]
            lowest[:, :, some[others]] = _lowest(part.take(others), pattern)
    found = np.full((max((len(points) for _, points in closed), default=0), *shape), np.nan)
    for some, points in closed:
        found[:, :, some] = points
    return [tuple(point) for point in (*found, *lowest)]


def _alike(count: IntArray) -> Iterator[IntArray]:
    """Yield indices of snapshots with equal counts (B,) of places, of a few at a time."""
    for size in np.unique(count).tolist():
        every, most = np.flatnonzero(count == size), max(1, _LARGEST // (size * size))
        for start in range(0, every.size, most):
            yield every[start : start + most]


def _lowest(rows: ArrivalRows, pattern: tuple[FloatArray, BoolArray]) -> FloatArray:
    """Return the likeliest points (N, D, B) of a pattern, one after the other, each not near an earlier one."""
    unit, near = pattern
    size = rows.size_m()
    cost = rows.half_chi_squares(*(size[:, None] * part for part in unit))
    points = np.full((_KEPT, len(unit), size.size), np.nan)
    for number in range(_KEPT):
        best: IntArray = np.argmin(cost, axis=1)
        exists = np.isfinite(cost[np.arange(size.size), best])
        points[number] = np.where(exists, size * unit[:, best], np.nan)
        cost[near[best]] = np.inf
    return points


@cache
def _pattern(dimension: int) -> tuple[FloatArray, BoolArray]:
    """Return points (D, P) in array sizes, evenly distributed directions at each radius, and which are near (P, P)."""
    number = np.arange(_DIRECTIONS) + 0.5
    if dimension == 2:
        angle = 2.0 * np.pi * number / _DIRECTIONS
        unit = np.stack([np.cos(angle), np.sin(angle)])
    else:
        z = 1.0 - 2.0 * number / _DIRECTIONS
        angle = np.pi * (1.0 + np.sqrt(5.0)) * number
        unit = np.stack([np.sqrt(1.0 - z * z) * np.cos(angle), np.sqrt(1.0 - z * z) * np.sin(angle), z])
    radius = np.repeat(_RADII, _DIRECTIONS)
    points = radius * np.tile(unit, len(_RADII))
    away = np.linalg.norm(points[:, :, None] - points[:, None, :], axis=0)
    return points, away < _NEAR * np.maximum(radius[:, None], radius)
