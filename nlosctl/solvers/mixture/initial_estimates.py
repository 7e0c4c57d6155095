"""Which candidates are worth following to the mode of a mixture likelihood."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import FloatArray, IntArray, ignoring_invalid, ignoring_overflow
from nlosctl.geometry.blocks import RowBlock
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

    x: FloatArray
    y: FloatArray
    cost: FloatArray
    hessian: SymmetricMatrix


@dataclass(frozen=True)
class Scores:
    """Candidates (B, P) and their cost in nats, infinite for invalid ones; the cost is modified in place."""

    x: FloatArray
    y: FloatArray
    cost: FloatArray

    def take(self, rows: IntArray) -> Scores:
        """Return the candidates of some snapshots, in rising order."""
        if rows.shape[0] == self.cost.shape[0]:
            return self
        return Scores(*(np.take(part.T, rows, axis=1).T for part in (self.x, self.y, self.cost)))

    def lowest(self) -> tuple[IntArray, FloatArray]:
        """Return index and cost (B,) of the cheapest candidates."""
        index: IntArray = np.argmin(self.cost, axis=1)
        return index, self.cost[np.arange(index.shape[0]), index]

    def at(self, index: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return x and y of one candidate (B,) each."""
        rows = np.arange(index.shape[0])
        return self.x[rows, index], self.y[rows, index]

    def leave_out(self, index: IntArray) -> None:
        """Leave out one candidate (B,) each."""
        self.cost[np.arange(index.shape[0]), index] = np.inf

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
    """Leave out candidates in the basin of a mode, to which they would converge."""
    rise = scores.squared_distance(mode.x, mode.y, mode.hessian)
    rise *= 0.5
    rise += (mode.cost - _SLACK)[:, None]
    with ignoring_invalid():
        np.copyto(scores.cost, np.inf, where=scores.cost >= rise)


@dataclass(frozen=True)
class Starts:
    """Points (N,), the ``index``-th start of the block's ``snapshot``."""

    snapshot: IntArray
    index: IntArray
    x: FloatArray
    y: FloatArray


def choose_starts(mixture: Mixture, rows: IntArray, scores: Scores, limit: FloatArray, most: int) -> Starts:
    """Return up to ``most`` candidates of the snapshots ``rows`` (B,) that are apart, the cheapest first.

    None is costlier than ``limit`` (B,).
    """
    chosen = [Starts(rows[:0], rows[:0], limit[:0], limit[:0])]
    part: Mixture | None = None
    for number in range(most):
        index, lowest = scores.lowest()
        keep = np.flatnonzero(np.isfinite(lowest) & (lowest <= limit))
        if not keep.size:
            break
        rows, scores, limit, index = rows[keep], scores.take(keep), limit[keep], index[keep]
        x, y = scores.at(index)
        chosen.append(Starts(rows, np.full(rows.shape, number), x, y))
        if number < most - 1:
            part = mixture.take(rows) if part is None else part.take_rows(keep)
            scores.leave_out(index)
            _, information = part.responsibilities(x, y)
            near = scores.squared_distance(x, y, information) < _APART * _APART
            np.copyto(scores.cost, np.inf, where=near)
    fields = ("snapshot", "index", "x", "y")
    return Starts(*(np.concatenate([getattr(part, name) for part in chosen]) for name in fields))
