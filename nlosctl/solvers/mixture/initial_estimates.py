"""Which candidates are worth following to the mode of a mixture likelihood."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import FloatArray, IntArray, ignoring_invalid, ignoring_overflow
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.solvers.mixture.likelihood import Mixture

__all__ = ["Mode", "Scores", "Starts", "choose_starts", "leave_out_slope"]


_APART = 1.0
"""Starts are at least so many standard deviations apart."""

_SLACK = 0.05
"""A candidate whose cost above a mode's, in nats, is not less than what the second derivatives there make of its
distance, up to this slack, is on the slope of that mode."""


@dataclass(frozen=True)
class Mode:
    """A mode (B,) of each snapshot about the local origin, with the second derivatives of its cost; NaN where none."""

    x: FloatArray
    y: FloatArray
    cost: FloatArray
    hessian: SymmetricMatrix


@dataclass(frozen=True)
class Scores:
    """Candidates (B, P) and their cost in nats, infinite where there is none; the cost is written to."""

    x: FloatArray
    y: FloatArray
    cost: FloatArray

    def take(self, rows: IntArray) -> Scores:
        """Return the candidates of some snapshots, in rising order."""
        if rows.shape[0] == self.cost.shape[0]:
            return self
        return Scores(*(np.take(part.T, rows, axis=1).T for part in (self.x, self.y, self.cost)))

    def lowest(self) -> tuple[IntArray, FloatArray]:
        """Return place and cost (B,) of the cheapest candidates."""
        place: IntArray = np.argmin(self.cost, axis=1)
        return place, self.cost[np.arange(place.shape[0]), place]

    def at(self, place: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return x and y of one candidate (B,) each."""
        rows = np.arange(place.shape[0])
        return self.x[rows, place], self.y[rows, place]

    def leave_out(self, place: IntArray) -> None:
        """Leave out one candidate (B,) each."""
        self.cost[np.arange(place.shape[0]), place] = np.inf

    def squared_distance(self, x: FloatArray, y: FloatArray, matrix: SymmetricMatrix) -> FloatArray:
        """Return the squared distance (B, P) from points (B,) in the metric of matrices (B,)."""
        dx, dy = self.x - x[:, None], self.y - y[:, None]
        with ignoring_overflow():
            squared: FloatArray = matrix.xx[:, None] * dx
            squared += (2.0 * matrix.xy)[:, None] * dy
            squared *= dx
            dy *= dy
            dy *= matrix.yy[:, None]
            squared += dy
        return squared


def leave_out_slope(scores: Scores, mode: Mode) -> None:
    """Leave out candidates on the slope of a mode, to which they lead."""
    rise = scores.squared_distance(mode.x, mode.y, mode.hessian)
    rise *= 0.5
    rise += (mode.cost - _SLACK)[:, None]
    with ignoring_invalid():
        np.copyto(scores.cost, np.inf, where=scores.cost >= rise)


@dataclass(frozen=True)
class Starts:
    """Points (N,), the ``place``-th start of the block's ``snapshot``."""

    snapshot: IntArray
    place: IntArray
    x: FloatArray
    y: FloatArray


def choose_starts(mixture: Mixture, rows: IntArray, scores: Scores, limit: FloatArray, most: int) -> Starts:
    """Return up to ``most`` candidates of the snapshots ``rows`` (B,) that are apart, the cheapest first.

    None is costlier than ``limit`` (B,).
    """
    chosen = [Starts(rows[:0], rows[:0], limit[:0], limit[:0])]
    part: Mixture | None = None
    for number in range(most):
        place, lowest = scores.lowest()
        keep = np.flatnonzero(np.isfinite(lowest) & (lowest <= limit))
        if not keep.size:
            break
        rows, scores, limit, place = rows[keep], scores.take(keep), limit[keep], place[keep]
        x, y = scores.at(place)
        chosen.append(Starts(rows, np.full(rows.shape, number), x, y))
        if number < most - 1:
            part = mixture.take(rows) if part is None else part.take_rows(keep)
            scores.leave_out(place)
            _, information = part.responsibilities(x, y)
            near = scores.squared_distance(x, y, information) < _APART * _APART
            np.copyto(scores.cost, np.inf, where=near)
    fields = ("snapshot", "place", "x", "y")
    return Starts(*(np.concatenate([getattr(part, name) for part in chosen]) for name in fields))
