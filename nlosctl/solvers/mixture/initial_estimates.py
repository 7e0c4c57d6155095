"""Which candidates are worth following to the mode of a mixture likelihood."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import FloatArray, IntArray, Point, ignoring_invalid, ignoring_overflow
from nlosctl.geometry.blocks import RowBlock, rows_of
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.solvers.mixture.likelihood import Mixture

__all__ = ["Mode", "Scores", "Starts", "choose_starts", "leave_out_slope"]


_APART = 1.0
"""Initial estimates are at least this many standard deviations apart."""

_SLACK = 0.05
"""A candidate is in the basin of a mode if its excess cost is at least half its squared Mahalanobis distance from the
mode, up to this slack (nats)."""


@dataclass(frozen=True)
class Mode(RowBlock):
    """A mode (B,) of each snapshot about the local origin, with the second derivatives of its cost; NaN where none."""

    point: Point
    cost: FloatArray
    hessian: SymmetricMatrix

    @classmethod
    def missing(cls, size: int, dimension: int) -> Mode:
        """Return no mode of each of ``size`` snapshots: NaN."""
        point = tuple(np.full(size, np.nan) for _ in range(dimension))
        return cls(point, np.full(size, np.nan), SymmetricMatrix.full(size, np.nan, dimension))


@dataclass(frozen=True)
class Scores:
    """Candidates (B, P) and their cost in nats, infinite for invalid ones; the cost is modified in place."""

    point: Point
    cost: FloatArray

    def take(self, rows: IntArray) -> Scores:
        """Return the candidates of some snapshots, in rising order."""
        if rows.shape[0] == self.cost.shape[0]:
            return self
        return Scores(rows_of(self.point, rows), rows_of(self.cost, rows))

    def lowest(self) -> tuple[IntArray, FloatArray]:
        """Return index and cost (B,) of the cheapest candidates."""
        index: IntArray = np.argmin(self.cost, axis=1)
        return index, self.cost[np.arange(index.shape[0]), index]

    def at(self, index: IntArray) -> Point:
        """Return the point of one candidate (B,) each."""
        rows = np.arange(index.shape[0])
        return tuple(part[rows, index] for part in self.point)

    def leave_out(self, index: IntArray) -> None:
        """Leave out one candidate (B,) each."""
        self.cost[np.arange(index.shape[0]), index] = np.inf

    def squared_distance(self, matrix: SymmetricMatrix, *point: FloatArray) -> FloatArray:
        """Return the squared distance (B, P) from points (B,) in the metric of matrices (B,)."""
        away = [mine - other[:, None] for mine, other in zip(self.point, point, strict=True)]
        with ignoring_overflow():
            squared: FloatArray | None = None
            for i, part in enumerate(away[:-1]):
                slope: FloatArray = matrix.entry(i, i)[:, None] * part
                for j in range(i + 1, len(away)):
                    slope += (2.0 * matrix.entry(i, j))[:, None] * away[j]
                slope *= part
                squared = slope if squared is None else squared + slope
            last = away[-1]
            last *= last
            last *= matrix.diagonal[-1][:, None]
            return last if squared is None else np.add(squared, last, out=squared)


def leave_out_slope(scores: Scores, mode: Mode) -> None:
    """Leave out candidates in the basin of a mode, to which they would converge."""
    rise = scores.squared_distance(mode.hessian, *mode.point)
    rise *= 0.5
    rise += (mode.cost - _SLACK)[:, None]
    with ignoring_invalid():
        np.copyto(scores.cost, np.inf, where=scores.cost >= rise)


@dataclass(frozen=True)
class Starts:
    """Points (N,), the ``index``-th start of the block's ``snapshot``."""

    snapshot: IntArray
    index: IntArray
    point: Point


def choose_starts(mixture: Mixture, rows: IntArray, scores: Scores, limit: FloatArray, most: int) -> Starts:
    """Return up to ``most`` candidates of the snapshots ``rows`` (B,) that are apart, the cheapest first.

    None is costlier than ``limit`` (B,).
    """
    chosen = [Starts(rows[:0], rows[:0], tuple(limit[:0] for _ in scores.point))]
    part: Mixture | None = None
    for number in range(most):
        index, lowest = scores.lowest()
        keep = np.flatnonzero(np.isfinite(lowest) & (lowest <= limit))
        if not keep.size:
            break
        rows, scores, limit, index = rows[keep], scores.take(keep), limit[keep], index[keep]
        point = scores.at(index)
        chosen.append(Starts(rows, np.full(rows.shape, number), point))
        if number < most - 1:
            part = mixture.take(rows) if part is None else part.take_rows(keep)
            scores.leave_out(index)
            _, information = part.responsibilities(*point)
            near = scores.squared_distance(information, *point) < _APART * _APART
            np.copyto(scores.cost, np.inf, where=near)
    point = tuple(map(np.concatenate, zip(*(part.point for part in chosen), strict=True)))
    snapshot, index = (np.concatenate([getattr(part, name) for part in chosen]) for name in ("snapshot", "index"))
    return Starts(snapshot, index, point)
