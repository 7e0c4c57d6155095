"""Spots of a posterior, its modes and further crossings of rows, and the masses of what a posterior consists of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from math import sqrt
from typing import Any, NamedTuple, Protocol

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, Point, ignoring_overflow
from nlosctl.geometry.eigensystems import eigensystem
from nlosctl.geometry.regions import Ball
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.solvers.bearings.ray_crossings import Candidates
from nlosctl.solvers.mixture.initial_estimates import Mode, Scores, choose_starts, leave_out_slope
from nlosctl.solvers.mixture.likelihood import Mixture
from nlosctl.solvers.mixture.modes import Modes

__all__ = ["HalfAxes", "RowCandidates", "Spots", "component_masses", "further_spots", "mode_spots", "total_mass"]


_LARGEST_SPOT = 0.5
"""Largest standard deviation of a spot, in units of the ball's radius."""

_PLANE = 2

_FURTHER = 8
_FURTHER_NATS = 14.0
_TIE_DIGITS = 5
"""So many crossings that are not modes, costlier than the best mode by at most so many nats, have a spot. Of costs that
agree to so many decimals (all pairs of rows that agree with no other row) the nearest to the best mode come first."""


class RowCandidates(Protocol):
    """The crossings of the rows of B snapshots, and the search region."""

    @property
    def count(self) -> int:
        """The number of crossings of each snapshot."""
        ...

    def points(self, rows: IntArray) -> Candidates:
        """Return the crossings of some snapshots."""
        ...

    def allowed(self, rows: IntArray, *point: FloatArray) -> BoolArray:
        """Return which points (b, P) of some snapshots are in the search region."""
        ...


class HalfAxes(NamedTuple):
    """Half-axes of spots: D lengths (B, S) in metres, the shortest first, and their D directions of D arrays (B, S)."""

    lengths: Point
    directions: tuple[Point, ...]

    def at(self, *index: Any) -> HalfAxes:
        """Return the half-axes at an index, as in ``length[index]``."""
        return HalfAxes(
            tuple(part[index] for part in self.lengths),
            tuple(tuple(part[index] for part in direction) for direction in self.directions),
        )

    def points(self, center: Sequence[FloatArray], *number: FloatArray) -> Point:
        """Return points by their coordinates about centers along the half-axes, in units of these."""
        along = [length * part for length, part in zip(self.lengths, number, strict=True)]
        return tuple(
            reduce(np.add, [cosine * part for cosine, part in zip(cosines, along, strict=True)], middle)
            for middle, cosines in zip(center, zip(*self.directions, strict=True), strict=True)
        )

    def squared_distance(self, *offset: FloatArray) -> FloatArray:
        """Return the squared distances of points at offsets (B, P) from the spots (B, 1), in units of the half-axes."""
        squared: FloatArray | None = None
        for length, direction in zip(self.lengths, self.directions, strict=True):
            along = (direction[0] / length) * offset[0]
            for cosine, part in zip(direction[1:], offset[1:], strict=True):
                along += (cosine / length) * part
            along *= along
            squared = along if squared is None else np.add(squared, along, out=squared)
        return np.zeros_like(offset[0]) if squared is None else squared


@dataclass(frozen=True)
class Spots:
    """Points (B, S) with their cost, infinite where missing, and its second derivatives."""

    point: Point
    cost: FloatArray
    hessian: SymmetricMatrix

    def join(self, other: Spots) -> Spots:
        """Return these spots and others beside them."""
        pairs = zip(self.hessian, other.hessian, strict=True)
        hessian = SymmetricMatrix(*(np.concatenate(pair, axis=1) for pair in pairs))
        parts = zip((*self.point, self.cost), (*other.point, other.cost), strict=True)
        *point, cost = (np.concatenate(pair, axis=1) for pair in parts)
        return Spots(tuple(point), cost, hessian)

    def half_axes(self, ball: Ball) -> HalfAxes:
        """Return the half-axes of one standard deviation; they point to the side of the ball's centre.

        In the plane only the short one does, and the long one is a quarter turn further.
        """
        tiny, largest = np.finfo(np.float64).tiny, _LARGEST_SPOT * ball.radius[:, None]
        with ignoring_overflow():
            values, directions = eigensystem(self.hessian)
            lengths = tuple(np.minimum(1.0 / np.sqrt(np.maximum(value, tiny)), largest) for value in values)
            toward = [middle[:, None] - part for middle, part in zip(ball.center, self.point, strict=True)]
            signs = [np.where(_dot(direction, toward) < 0.0, -1.0, 1.0) for direction in directions]
        if len(signs) == _PLANE:
            signs[1] = signs[0]
        directions = tuple(
            tuple(part * sign for part in direction) for direction, sign in zip(directions, signs, strict=True)
        )
        return HalfAxes(lengths, directions)


def mode_spots(modes: Modes, rows: IntArray) -> Spots:
    """Return the modes of some snapshots."""
    most = max(1, int(np.isfinite(modes.cost[rows]).sum(axis=1).max(initial=0)))
    at = rows, slice(0, most)
    return Spots(tuple(part[at] for part in modes.point), modes.cost[at], modes.hessian.at(*at))


def further_spots(
    mixture: Mixture, modes: Spots, rows: IntArray, candidates: RowCandidates, reach: FloatArray
) -> Spots:
    """Return crossings outside the basins of the modes (B, T), with the information of their direct rows."""
    points = candidates.points(rows)
    with ignoring_overflow():
        cost = mixture.score(*points.point)
        cost[~(points.valid & candidates.allowed(rows, *points.point))] = np.inf
        pairs = zip(points.point, modes.point, strict=True)
        away = reduce(np.hypot, [mine - other[:, :1] for mine, other in pairs])
        cost = np.round(cost, _TIE_DIGITS) + 10.0**-_TIE_DIGITS * away / (away + reach[:, None])
    scores = Scores(points.point, cost)
    for t in range(modes.cost.shape[1]):
        known = np.isfinite(modes.cost[:, t])
        *point, cost = (np.where(known, part[:, t], np.nan) for part in (*modes.point, modes.cost))
        leave_out_slope(scores, Mode(tuple(point), cost, modes.hessian.at(slice(None), t)))
    starts = choose_starts(mixture, np.arange(rows.shape[0]), scores, modes.cost[:, 0] + _FURTHER_NATS, _FURTHER)
    shape = rows.shape[0], _FURTHER
    somewhere = tuple(np.zeros(shape) for _ in starts.point)
    spots = Spots(somewhere, np.full(shape, np.inf), SymmetricMatrix.full(shape, 1.0, mixture.dimension))
    at = starts.snapshot, starts.index
    chosen = mixture.take(starts.snapshot)
    for part, values in zip(spots.point, starts.point, strict=True):
        part[at] = values
    spots.cost[at] = chosen.score(*(part[:, None] for part in starts.point))[:, 0]
    spots.hessian.put(at, chosen.responsibilities(*starts.point)[1])
    return spots


def component_masses(mixture: Mixture, ball: Ball, spots: Spots, axes: HalfAxes) -> FloatArray:
    """Return the posterior masses (B, 1 + K + S) where no row is direct, each row alone, and of each spot.

    They are in units of the likelihood at the first spot. The first two are of the whole ball; those of rows that have
    no ridge are 0.
    """
    ridge = mixture.rows.ridges(ball)
    with ignoring_overflow():
        outliers = np.exp(spots.cost[:, 0] + mixture.log_nlos + mixture.groups * np.log(mixture.obstructed))[:, None]
        on_ridges = outliers * np.exp(mixture.log_direct) / mixture.obstructed[:, None] / ridge
        in_spots = np.exp(np.minimum(spots.cost[:, :1] - spots.cost, 0.0)) * (2.0 * np.pi) ** (0.5 * mixture.dimension)
        for length in axes.lengths:
            in_spots *= length
        if mixture.height is not None:  # away from spots it weighs the points of a layer
            layer = sqrt(0.5 * np.pi) / (mixture.height.inverse_std * ball.radius)
            outliers, on_ridges = (part * np.minimum(layer, 1.0)[:, None] for part in (outliers, on_ridges))
        return np.concatenate(
            [
                outliers * ball.volume[:, None],
                np.where(ridge > 0.0, on_ridges, 0.0),
                np.where(np.isfinite(spots.cost), in_spots, 0.0),
            ],
            axis=1,
        )


def _dot(one: Point, other: Sequence[FloatArray]) -> FloatArray:
    return reduce(np.add, [mine * theirs for mine, theirs in zip(one, other, strict=True)])


def total_mass(mass: FloatArray) -> FloatArray:
    """Return the sums (B, 1) over the components, one after the other."""
    return np.cumsum(mass, axis=1)[:, -1:]
