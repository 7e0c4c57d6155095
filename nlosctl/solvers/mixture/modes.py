"""The modes of a mixture likelihood: score all candidates, follow the best few downhill, rank the results."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ignoring_overflow
from nlosctl.geometry.blocks import RowBlock, rows_of
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.solvers.bearings.ray_crossings import Candidates
from nlosctl.solvers.mixture.initial_estimates import Mode, Scores, Starts, choose_starts, leave_out_slope
from nlosctl.solvers.mixture.likelihood import Mixture
from nlosctl.solvers.mixture.outside import OutsideSearch
from nlosctl.solvers.optimization.levenberg_marquardt import Minimum, minimize
from nlosctl.solvers.optimization.problem import Evaluation

__all__ = ["Modes", "find_modes", "score_candidates"]

Allowed = Callable[[IntArray, FloatArray, FloatArray], BoolArray]

_POINTS = 8192
"""Number of points scored at once, so that temporaries stay in the cache."""

_SECTION = 1 << 18
"""Number of points kept at once: long blocks with many candidates are searched in sections."""

_TIE_DIGITS = 5
"""Costs in nats that agree to this many decimals are equal."""

_ATTRACTED = 0.1
"""A descent that comes within this many standard deviations of a known mode converges to it."""

_SAME = 0.05
"""Modes closer than this many standard deviations are the same."""


@dataclass(frozen=True)
class Modes:
    """Up to T modes (B, T) of each snapshot, the most likely first.

    x, y in metres about the local origin; ``cost`` in nats, infinite where there is no such mode. ``hessian`` are the
    second derivatives of the cost. ``settled`` (B,) marks snapshots whose best mode is a smooth optimum,
    ``candidates`` (B,) those with any candidate, ``at_boundary`` (B,) those whose every descent left the search region,
    so that the points are the constrained ones on its edge.
    """

    x: FloatArray
    y: FloatArray
    cost: FloatArray
    hessian: SymmetricMatrix
    settled: BoolArray
    candidates: BoolArray
    at_boundary: BoolArray


def find_modes(
    mixture: Mixture,
    candidates: Callable[[IntArray], Candidates],
    points: int,
    allowed: Allowed,
    *,
    most: int,
    gap: float,
    outside: OutsideSearch | None = None,
) -> Modes:
    """Return the modes of B mixtures, at most ``most`` each.

    ``candidates(rows)`` gives the candidates of some snapshots, about ``points`` each; ``allowed(rows, x, y)`` returns
    which points (b, P) are in the search region. Candidates costlier than the best by more than ``gap`` nats are not
    followed, nor those in the basin of a known mode. ``outside`` notes the candidates outside the search region.
    """
    size = mixture.obstructed.shape[0]
    search = _Search(mixture, allowed, _Descents.empty(size, most), outside)
    if points > 0:
        section = max(1, _SECTION // points)
        for first in range(0, size, section):
            rows = np.arange(first, min(first + section, size))
            search.run(score_candidates(mixture, candidates, allowed, rows, points, outside), rows, gap)
        if outside is not None:
            outside.follow(mixture, search.descents.cost.min(axis=1))
        search.repeat_within_region()
    return _rank(search.descents)


def score_candidates(
    mixture: Mixture,
    candidates: Callable[[IntArray], Candidates],
    allowed: Allowed,
    rows: IntArray,
    points: int,
    outside: OutsideSearch | None = None,
) -> Scores:
    """Return the candidates of some snapshots with their cost, infinite for invalid ones; as for `find_modes`."""
    scored = []
    block = max(1, _POINTS // points)
    for first in range(0, rows.shape[0], block):
        part = rows[first : first + block]
        scored_points = candidates(part)
        with ignoring_overflow():
            cost = mixture.take(part).score(scored_points.x, scored_points.y)
            if outside is not None:
                outside.note_candidates(part, scored_points, cost)
            cost[~(scored_points.valid & allowed(part, scored_points.x, scored_points.y))] = np.inf
        scored.append((scored_points.x, scored_points.y, cost))
    return Scores(*(np.concatenate([part[number].T for part in scored], axis=1).T for number in range(3)))


@dataclass(frozen=True)
class _Descents:
    """The descents (B, T): initial points, whether usable, and final points, of infinite cost if invalid.

    ``settled`` marks final points that are smooth minima, ``at_boundary`` (B,) snapshots constrained to the search
    region.
    """

    start_x: FloatArray
    start_y: FloatArray
    usable: BoolArray
    x: FloatArray
    y: FloatArray
    cost: FloatArray
    hessian: SymmetricMatrix
    settled: BoolArray
    at_boundary: BoolArray

    @classmethod
    def empty(cls, size: int, most: int) -> _Descents:
        start_x, start_y, x, y = (np.full((size, most), np.nan) for _ in range(4))
        usable, settled = (np.zeros((size, most), dtype=bool) for _ in range(2))
        cost, at_boundary = np.full((size, most), np.inf), np.zeros(size, dtype=bool)
        return cls(
            start_x, start_y, usable, x, y, cost, SymmetricMatrix.full((size, most), np.nan), settled, at_boundary
        )

    def begin(self, snapshot: IntArray, index: IntArray, x: FloatArray, y: FloatArray) -> None:
        """Record initial points (N,) of some snapshots."""
        self.start_x[snapshot, index], self.start_y[snapshot, index] = x, y
        self.usable[snapshot, index] = True

    def finish(
        self, end: Minimum, least_cost: FloatArray, snapshot: IntArray, index: IntArray, inside: BoolArray
    ) -> None:
        """Record final points (N,), if they are ``inside`` the search region."""
        good = np.isfinite(end.cost) & inside
        self.cost[snapshot, index] = np.where(good, end.cost + least_cost, np.inf)
        self.settled[snapshot, index] = good & end.converged
        self.x[snapshot, index], self.y[snapshot, index] = end.point
        self.hessian.put((snapshot, index), end.hessian)

    def first(self, snapshot: IntArray) -> Mode:
        """Return the modes of the first descents of some snapshots; NaN where they did not settle."""
        settled = self.settled[snapshot, 0]

        def settle(values: FloatArray) -> FloatArray:
            return np.where(settled, values[snapshot, 0], np.nan)

        return Mode(settle(self.x), settle(self.y), settle(self.cost), self.hessian.map(settle))


@dataclass(frozen=True)
class _Search:
    """The mixtures of a block, the search region inside and outside, and the descents so far."""

    mixture: Mixture
    allowed: Allowed
    descents: _Descents
    outside: OutsideSearch | None

    def run(self, scores: Scores, rows: IntArray, gap: float) -> None:
        """Follow the best candidate of each of the snapshots ``rows``, then others that don't lead to its mode."""
        index, best = scores.lowest()
        some = np.flatnonzero(np.isfinite(best))
        rows, scores, index, best = rows[some], scores.take(some), index[some], best[some]
        self._follow_best(rows, *scores.at(index))
        more = self.descents.cost.shape[1] - 1
        if more:
            scores.leave_out(index)
            leave_out_slope(scores, self.descents.first(rows))
            self._follow_others(choose_starts(self.mixture, rows, scores, best + gap, more))

    def repeat_within_region(self) -> None:
        """Repeat the descents, constrained to the search region, where every descent left it."""
        descents = self.descents
        lost: BoolArray = np.any(descents.usable, axis=1) & ~np.any(np.isfinite(descents.cost), axis=1)
        snapshot, index = np.nonzero(descents.usable & lost[:, None])
        if snapshot.size:
            descents.at_boundary[lost] = True
            problem = _Bounded(self.mixture.take(snapshot), snapshot, self.allowed)
            end = minimize(problem, descents.start_x[snapshot, index], descents.start_y[snapshot, index])
            self._finish(end, snapshot, index)

    def _follow_best(self, rows: IntArray, x: FloatArray, y: FloatArray) -> None:
        index = np.zeros_like(rows)
        self.descents.begin(rows, index, x, y)
        self._finish(minimize(self.mixture.take_rows(rows), x, y), rows, index)

    def _follow_others(self, starts: Starts) -> None:
        """Follow initial points, each until it is clear that it leads to the known mode."""
        snapshot, index = starts.snapshot, starts.index + 1
        self.descents.begin(snapshot, index, starts.x, starts.y)
        known = self.descents.first(snapshot)

        def leads_to_known(rows: IntArray, x: FloatArray, y: FloatArray) -> BoolArray:
            squared = known.hessian.take(rows).quadratic_form(x - known.x[rows], y - known.y[rows])
            return squared < _ATTRACTED * _ATTRACTED

        end = minimize(self.mixture.take(snapshot), starts.x, starts.y, give_up=leads_to_known)
        new = np.flatnonzero(~leads_to_known(np.arange(snapshot.shape[0]), end.x, end.y))
        self._finish(rows_of(end, new), snapshot[new], index[new])

    def _finish(self, end: Minimum, snapshot: IntArray, index: IntArray) -> None:
        inside = self.allowed(snapshot, end.x[:, None], end.y[:, None])[:, 0]
        least_cost = self.mixture.least_cost[snapshot]
        self.descents.finish(end, least_cost, snapshot, index, inside)
        if self.outside is not None:
            self.outside.note_ends(end, least_cost, snapshot, inside)


@dataclass(frozen=True)
class _Bounded(RowBlock):
    """Mixtures (N,) of some snapshots whose cost is infinite outside the search region."""

    mixture: Mixture
    snapshot: IntArray
    allowed: Allowed

    def evaluate(self, x: FloatArray, y: FloatArray) -> Evaluation:
        at = self.mixture.evaluate(x, y)
        inside = self.allowed(self.snapshot, x[:, None], y[:, None])[:, 0]
        return at._replace(cost=np.where(inside, at.cost, np.inf))


def _rank(descents: _Descents) -> Modes:
    """Return the modes by rising cost, without repetitions."""
    x, y, hessian, cost = _sort(descents.x, descents.y, descents.hessian, descents.cost)
    repeated = np.zeros(cost.shape, dtype=bool)
    for t in range(cost.shape[1] - 1):
        if not np.isfinite(cost[:, t + 1]).any():
            break
        dx, dy = x[:, t + 1 :] - x[:, t, None], y[:, t + 1 :] - y[:, t, None]
        repeated[:, t + 1 :] |= hessian.at(slice(None), t, None).quadratic_form(dx, dy) < _SAME * _SAME
    cost[repeated] = np.inf
    x, y, hessian, cost = _sort(x, y, hessian, cost)
    best = (descents.x == x[:, :1]) & (descents.y == y[:, :1])
    settled: BoolArray = (best & descents.settled).any(axis=1)
    return Modes(x, y, cost, hessian, settled, np.asarray(descents.usable.any(axis=1)), descents.at_boundary)


def _sort(
    x: FloatArray, y: FloatArray, hessian: SymmetricMatrix, cost: FloatArray
) -> tuple[FloatArray, FloatArray, SymmetricMatrix, FloatArray]:
    """Return modes (B, T) by rising cost.

    Modes that are equally likely up to rounding are ordered by distance: both crossings of two circles are equally
    likely if every other row is an outlier.
    """
    order = np.lexsort((x * x + y * y, np.round(cost, _TIE_DIGITS)), axis=1)

    def sort(values: FloatArray) -> FloatArray:
        return np.take_along_axis(values, order, axis=1)

    return sort(x), sort(y), hessian.map(sort), sort(cost)
