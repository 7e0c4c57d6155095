"""Structured candidate sets: one crossing for every two sensors, sorted, made unique, cut at the elbow.

The second stage and the screening of the extended type-based clustering algorithm of Liang, Zeng, Li.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from typing import Literal

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray
from nlosctl.contract.options import option
from nlosctl.geometry.blocks import sum_measurements
from nlosctl.solvers.echoes.echoes import Echoes
from nlosctl.solvers.echoes.targets import IdentificationOptions
from nlosctl.solvers.echoes.type_sets import CrossingTable, Gate, Seeds, cross_all, find_seeds, gather_circles

__all__ = [
    "ClusteringOptions",
    "StructuredSets",
    "Uniqueness",
    "build_sets",
    "cluster_echoes",
    "cut_at_elbow",
    "echoes_of_sets",
    "unique_sets",
]

Uniqueness = Literal["points", "circles"]
"""What two sets must not share: a point, as in the paper, or a circle."""

_SWEEPS = 2


@dataclass(frozen=True)
class StructuredSets:
    """S sets by rising spread (S,) in metres, some possibly equal; ``circles`` (S, N) has one per sensor.

    There are T = N (N - 1) / 2 points in a set, one of each type; ``points`` (S, T) numbers them within their type.
    """

    spread_m: FloatArray
    circles: IntArray
    points: IntArray


def build_sets(table: CrossingTable, circles: IntArray, seeds: Seeds) -> StructuredSets:
    """Return the structured sets of tuples of circles (S, N) around seeds (S,).

    Of two roots the one nearest to the centre is taken: the seed at first, then twice the mean of the points. A
    tuple two of whose circles have no point is dropped.
    """
    crossings = _crossings_of(table, circles)
    there = np.isfinite(crossings.x[0]) | np.isfinite(crossings.x[1])
    complete = np.flatnonzero(there.all(axis=1))
    crossings, circles, seeds = crossings.take(complete), circles[complete], seeds.take(complete)
    second = crossings.nearest_root(seeds.x, seeds.y)
    for _ in range(_SWEEPS):
        x, y = crossings.points(second)
        second = crossings.nearest_root(_mean(x), _mean(y))
    x, y = crossings.points(second)
    dx, dy = x - _mean(x)[:, None], y - _mean(y)[:, None]
    # Equation (3): a root of a sum, so that it grows with the number of sensors.
    spread = np.sqrt(sum_measurements(dx * dx) + sum_measurements(dy * dy))
    order = np.argsort(spread, kind="stable")
    return StructuredSets(spread[order], circles[order], (2 * crossings.pair + second)[order])


def unique_sets(sets: StructuredSets, unique: Uniqueness) -> Iterator[int]:
    """Yield the indices of the sets that share nothing with a kept set of smaller spread; equation (5)."""
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


@dataclass(frozen=True)
class _Crossings:
    """The crossings of the circles of each tuple: ``x`` and ``y`` (2, S, T) by root, and the pair's number (S, T)."""

    x: FloatArray
    y: FloatArray
    pair: IntArray

    def take(self, rows: IntArray) -> _Crossings:
        """Return those of some tuples."""
        return _Crossings(self.x[:, rows], self.y[:, rows], self.pair[rows])

    def nearest_root(self, center_x: FloatArray, center_y: FloatArray) -> BoolArray:
        """Return where the second root (S, T) is nearer to the centre (S,) than the first."""
        dx, dy = self.x - center_x[:, None], self.y - center_y[:, None]
        squared = dx * dx + dy * dy
        nearer: BoolArray = squared[1] < squared[0]
        return nearer

    def points(self, second: BoolArray) -> tuple[FloatArray, FloatArray]:
        """Return x and y (S, T) of the chosen roots."""
        return np.where(second, self.x[1], self.x[0]), np.where(second, self.y[1], self.y[0])


def _crossings_of(table: CrossingTable, circles: IntArray) -> _Crossings:
    count = table.x.shape[1]
    one, other = np.triu_indices(table.sensors, 1)
    pair = circles[:, one] * count + circles[:, other]
    return _Crossings(table.x.reshape(2, -1)[:, pair], table.y.reshape(2, -1)[:, pair], pair)


def _mean(values: FloatArray) -> FloatArray:
    mean: FloatArray = sum_measurements(values) / values.shape[1]
    return mean


@dataclass(frozen=True, kw_only=True)
class ClusteringOptions(IdentificationOptions):
    """Parameters that the clustering methods share."""

    unique: Literal["points", "circles"] = option(
        "points",
        meaning="what two targets may not share: a crossing point (as the paper has it; the flags of a shared row are "
        "those of the nearest target), or a circle",
    )
    seeds: Literal["all", "first"] = option(
        "all", meaning="crossings from which sets are built: of all pairs of sensors, or of the first two sensors only"
    )


def cluster_echoes(echoes: Echoes, gate: Gate, options: ClusteringOptions) -> tuple[StructuredSets, Iterator[int]]:
    """Return the structured sets of a snapshot, and the indices of the unique ones by rising spread."""
    table = cross_all(echoes, options.gap_tolerance_m, gate)
    seeds = find_seeds(table)
    if options.seeds == "first":
        seeds = seeds.take(np.flatnonzero((seeds.parent_1 < table.most) & (seeds.parent_2 < 2 * table.most)))
    circles, seeds = gather_circles(table, seeds)
    sets = build_sets(table, circles, seeds)
    return sets, unique_sets(sets, options.unique)


def echoes_of_sets(echoes: Echoes, sets: StructuredSets, chosen: list[int]) -> IntArray:
    """Return the echo (T, N) that each chosen set takes of each sensor."""
    return sets.circles[np.array(chosen, dtype=np.int64)] - np.arange(echoes.sensors) * echoes.most
