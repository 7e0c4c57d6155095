"""Which candidates are worth following to the mode of a mixture likelihood."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nlosctl.geometry.symmetric import Symmetric2x2
from nlosctl.solvers.mixture import Mixture

__all__ = ["Scores", "Starts", "choose_starts"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

_APART = 1.0
"""Starts are at least so many standard deviations apart."""

_SHARE = 1.0
_SLACK = 0.05
"""A candidate is on the slope of a mode when its cost above the mode's, in nats, is at least this share of what the
second derivatives there make of its distance, less the slack: what curves up as at the mode leads down to it."""


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

    def leave_out_near(self, x: FloatArray, y: FloatArray, information: Symmetric2x2) -> None:
        """Leave out what is within a standard deviation of a point (B,) with that information."""
        near = self._squared_distance(x, y, information) < _APART * _APART
        np.copyto(self.cost, np.inf, where=near)

    def leave_out_slope(self, x: FloatArray, y: FloatArray, cost: FloatArray, hessian: Symmetric2x2) -> None:
        """Leave out what is on the slope of a mode (B,); of none where its cost is infinite."""
        least = self._squared_distance(x, y, hessian)
        least *= 0.5 * _SHARE
        least += (cost - _SLACK)[:, None]
        with np.errstate(invalid="ignore"):
            np.copyto(self.cost, np.inf, where=self.cost >= least)

    def _squared_distance(self, x: FloatArray, y: FloatArray, matrix: Symmetric2x2) -> FloatArray:
        dx, dy = self.x - x[:, None], self.y - y[:, None]
        with np.errstate(invalid="ignore", over="ignore"):
            squared: FloatArray = matrix.xx[:, None] * dx
            squared += (2.0 * matrix.xy)[:, None] * dy
            squared *= dx
            dy *= dy
            dy *= matrix.yy[:, None]
            squared += dy
        return squared


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
    chosen: list[Starts] = []
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
            scores.leave_out_near(x, y, part.responsibilities(x, y)[1])
    if not chosen:
        return Starts(rows[:0], rows[:0], limit[:0], limit[:0])
    return Starts(
        *(np.concatenate([getattr(part, name) for part in chosen]) for name in ("snapshot", "place", "x", "y"))
    )
