"""The best point outside the search region: is a source there more likely than the best mode inside?"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, Point
from nlosctl.geometry.blocks import rows_of
from nlosctl.solvers.bearings.ray_crossings import Candidates
from nlosctl.solvers.mixture.initial_estimates import Mode
from nlosctl.solvers.mixture.likelihood import Mixture
from nlosctl.solvers.optimization.levenberg_marquardt import Minimum, minimize

__all__ = ["OutsideSearch"]

_WORTH_FOLLOWING = 2.0
"""A crossing outside is followed if it is at most this many nats costlier than the best mode inside."""


class OutsideSearch:
    """The crossings outside the search region, the descents that left it, and the best mode among them.

    ``beyond(rows, *point)`` returns which points (b, P) of some snapshots are outside; ``mode`` has the result, whose
    cost is infinite in snapshots without any.
    """

    def __init__(self, size: int, dimension: int, beyond: Callable[..., BoolArray]) -> None:
        self.beyond = beyond
        self.mode, self._crossing = (
            replace(Mode.missing(size, dimension), cost=np.full(size, np.inf)) for _ in range(2)
        )

    def note_candidates(self, rows: IntArray, points: Candidates, cost: FloatArray) -> None:
        """Note the cheapest of the candidates (b, P) of some snapshots that are outside."""
        outside = self.beyond(rows, *points.point)
        outside &= points.valid
        cost = np.where(outside, cost, np.inf)
        index, here = np.argmin(cost, axis=1), np.arange(rows.shape[0])
        _improve(self._crossing, rows, tuple(part[here, index] for part in points.point), cost[here, index])

    def note_ends(self, end: Minimum, least_cost: FloatArray, snapshot: IntArray, inside: BoolArray) -> None:
        """Note where descents (N,) ended that are not ``inside`` the search region."""
        left = np.flatnonzero(~inside & end.converged)
        if not left.size:
            return
        left = left[np.argsort(end.cost[left], kind="stable")]
        first = left[np.unique(snapshot[left], return_index=True)[1]]
        self._note(end, least_cost, snapshot, first)

    def follow(self, mixture: Mixture, best_inside: FloatArray) -> None:
        """Follow the crossings that may be better than the best mode inside, whose cost is ``best_inside`` (B,)."""
        limit = np.minimum(best_inside + _WORTH_FOLLOWING, self.mode.cost)
        rows = np.flatnonzero(self._crossing.cost < limit)
        if rows.size:
            end = minimize(mixture.take_rows(rows), *rows_of(self._crossing.point, rows))
            self._note(end, mixture.least_cost[rows], rows, np.flatnonzero(end.converged))

    def _note(self, end: Minimum, least_cost: FloatArray, snapshot: IntArray, which: IntArray) -> None:
        rows, point = snapshot[which], rows_of(end.point, which)
        outside = self.beyond(rows, *(part[:, None] for part in point))[:, 0]
        better = _improve(self.mode, rows, point, np.where(outside, end.cost[which] + least_cost[which], np.inf))
        self.mode.hessian.put(rows[better], end.hessian.take(which[better]))


def _improve(best: Mode, rows: IntArray, point: Point, cost: FloatArray) -> IntArray:
    """Replace the points of some snapshots, each named once, by cheaper ones; return which were cheaper."""
    better = np.flatnonzero(cost < best.cost[rows])
    for mine, other in zip((*best.point, best.cost), (*point, cost), strict=True):
        mine[rows[better]] = other[better]
    return better
