"""Structured candidate sets: one crossing for every two sensors, sorted, made unique, cut at the elbow.

The second stage and the screening of the extended type-based clustering algorithm of Liang, Zeng, Li.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations, islice
from typing import Literal

import numpy as np
import numpy.typing as npt

from nlosctl.geometry.blocks import sum_measurements
from nlosctl.solvers.type_sets import CrossingTable, Seeds

__all__ = ["StructuredSets", "Uniqueness", "build_sets", "cut_at_elbow", "unique_sets"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

Uniqueness = Literal["points", "circles"]
"""What two sets may not share: a point, as the paper has it, or a circle."""

_SWEEPS = 2


@dataclass(frozen=True)
class StructuredSets:
    """S sets by rising spread (S,) in metres, of which some may be equal; ``circles`` (S, N) has one per sensor.

    There are T = N (N - 1) / 2 points in a set, one of each type; ``points`` (S, T) numbers them within their type.
    """

    spread_m: FloatArray
    circles: IntArray
    points: IntArray


def build_sets(table: CrossingTable, circles: IntArray, seeds: Seeds) -> StructuredSets:
    """Return the structured sets of tuples of circles (S, N) found around seeds (S,).

    Of two roots the one nearest to the centre is taken: the seed at first, then twice the mean of the points. A
    tuple two of whose circles have no point is dropped.
    """
    roots, x, y = _choose_roots(table, circles, seeds.x, seeds.y)
    complete = np.flatnonzero(np.isfinite(x).all(axis=1))
    circles, x, y = circles[complete], x[complete], y[complete]
    for _ in range(_SWEEPS):
        roots, x, y = _choose_roots(table, circles, _mean(x), _mean(y))
    dx, dy = x - _mean(x)[:, None], y - _mean(y)[:, None]
    # Equation (3): a root of a sum, so that it grows with the number of sensors.
    spread = np.sqrt(sum_measurements(dx * dx) + sum_measurements(dy * dy))
    order = np.argsort(spread, kind="stable")
    return StructuredSets(spread[order], circles[order], _number_points(table, circles[order], roots[order]))


def unique_sets(sets: StructuredSets, unique: Uniqueness) -> Iterator[int]:
    """Yield the places of the sets that share nothing with one of smaller spread that was kept; equation (5)."""
    keys = sets.points if unique == "points" else sets.circles
    left = np.arange(keys.shape[0])
    while left.size:
        kept = left[0]
        yield int(kept)
        left = left[(keys[left] != keys[kept]).all(axis=1)]


def cut_at_elbow(sets: StructuredSets, kept: Iterator[int], elbow_m: float) -> list[int]:
    """Return the kept sets before the first whose spread exceeds the mean of those before by ``elbow_m``; (7).

    Without an elbow all of them.
    """
    chosen = list(islice(kept, 1))
    for candidate in kept:
        if sets.spread_m[candidate] - float(np.mean(sets.spread_m[chosen])) > elbow_m:
            break
        chosen.append(candidate)
    return chosen


def _choose_roots(
    table: CrossingTable, circles: IntArray, center_x: FloatArray, center_y: FloatArray
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return the root nearest to the centre for every type, and the points' x and y; shapes (S, T)."""
    types = list(combinations(range(table.sensors), 2))
    shape = (circles.shape[0], len(types))
    roots = np.empty(shape, dtype=np.int64, order="F")
    x, y = np.empty(shape, order="F"), np.empty(shape, order="F")
    for t, (one, other) in enumerate(types):
        place = circles[:, one] * table.x.shape[1] + circles[:, other]
        (x0, x1), (y0, y1) = (
            [np.take(root.reshape(-1), place) for root in coordinate] for coordinate in (table.x, table.y)
        )
        with np.errstate(invalid="ignore"):
            second = (x1 - center_x) ** 2 + (y1 - center_y) ** 2 < (x0 - center_x) ** 2 + (y0 - center_y) ** 2
        roots[:, t] = second
        x[:, t], y[:, t] = np.where(second, x1, x0), np.where(second, y1, y0)
    return roots, x, y


def _number_points(table: CrossingTable, circles: IntArray, roots: IntArray) -> IntArray:
    points = np.empty(roots.shape, dtype=np.int64, order="F")
    for t, (one, other) in enumerate(combinations(range(table.sensors), 2)):
        points[:, t] = (circles[:, one] * table.x.shape[1] + circles[:, other]) * 2 + roots[:, t]
    return points


def _mean(values: FloatArray) -> FloatArray:
    mean: FloatArray = sum_measurements(values) / values.shape[1]
    return mean
