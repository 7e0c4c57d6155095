"""The modes of a mixture likelihood: score all candidates, follow the best few downhill, rank what is found."""

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
from nlosctl.solvers.optimization.levenberg_marquardt import Minimum, minimize
from nlosctl.solvers.optimization.problem import Evaluation

__all__ = ["Modes", "find_modes"]

Allowed = Callable[[IntArray, FloatArray, FloatArray], BoolArray]

_POINTS = 8192
"""So many points are scored at once, that temporaries stay in the cache."""

_SECTION = 1 << 18
"""So many points are kept at once: long blocks with many candidates are searched in sections."""

_TIE_DIGITS = 5
"""Costs that agree to so many digits after the point, in nats, are equal."""

_DRAWN = 0.1
"""A start that has come to within so many standard deviations of a known mode leads there."""

_SAME = 0.05
"""Modes closer than so many standard deviations are one."""


@dataclass(frozen=True)
class Modes:
    """Up to T modes (B, T) of each snapshot, the most likely first.

    x, y in metres about the local origin; ``cost`` in nats, infinite where there is no such mode. ``hessian`` holds
    the second derivatives of the cost. ``candidates`` (B,) tells whether there was any candidate, ``held`` (B,) that
    every way downhill left the search field and the points are where it was held back at the edge.
    """

    x: FloatArray
    y: FloatArray
    cost: FloatArray
    hessian: SymmetricMatrix
    candidates: BoolArray
    held: BoolArray


def find_modes(
    mixture: Mixture,
    candidates: Callable[[IntArray], Candidates],
    points: int,
    allowed: Allowed,
    *,
    most: int,
    gap: float,
) -> Modes:
    """Return the modes of B mixtures, at most ``most`` each.

    ``candidates(rows)`` gives the candidates of some snapshots, about ``points`` each; ``allowed(rows, x, y)`` tells
    which points (b, P) are in the search field. Candidates costlier than the best by more than ``gap`` nats are not
    followed, nor those on the slope of a mode that is known.
    """
    size = mixture.obstructed.shape[0]
    search = _Search(mixture, allowed, _Found.nothing(size, most))
    if points > 0:
        section = max(1, _SECTION // points)
        for first in range(0, size, section):
            rows = np.arange(first, min(first + section, size))
            search.run(_score(mixture, candidates, allowed, rows, points), rows, gap)
        search.hold_back()
    return _rank(search.found)


def _score(
    mixture: Mixture,
    candidates: Callable[[IntArray], Candidates],
    allowed: Allowed,
    rows: IntArray,
    points: int,
) -> Scores:
    """Return the candidates of some snapshots with their cost, infinite where there is none."""
    scored = []
    block = max(1, _POINTS // points)
    for first in range(0, rows.shape[0], block):
        part = rows[first : first + block]
        found = candidates(part)
        with ignoring_overflow():
            cost = mixture.take(part).score(found.x, found.y)
            cost[~(found.valid & allowed(part, found.x, found.y))] = np.inf
        scored.append((found.x, found.y, cost))
    return Scores(*(np.concatenate([part[number].T for part in scored], axis=1).T for number in range(3)))


@dataclass(frozen=True)
class _Found:
    """What was followed (B, T): where from, whether at all, and the ends, of infinite cost where there is none.

    ``settled`` tells which ends are smooth minima, ``held`` (B,) where the starts were held back at the field's edge.
    """

    start_x: FloatArray
    start_y: FloatArray
    usable: BoolArray
    x: FloatArray
    y: FloatArray
    cost: FloatArray
    hessian: SymmetricMatrix
    settled: BoolArray
    held: BoolArray

    @classmethod
    def nothing(cls, size: int, most: int) -> _Found:
        start_x, start_y, x, y = (np.full((size, most), np.nan) for _ in range(4))
        usable, settled = (np.zeros((size, most), dtype=bool) for _ in range(2))
        cost, held = np.full((size, most), np.inf), np.zeros(size, dtype=bool)
        return cls(start_x, start_y, usable, x, y, cost, SymmetricMatrix.full((size, most), np.nan), settled, held)

    def begin(self, snapshot: IntArray, place: IntArray, x: FloatArray, y: FloatArray) -> None:
        """Keep starts (N,) of some snapshots."""
        self.start_x[snapshot, place], self.start_y[snapshot, place] = x, y
        self.usable[snapshot, place] = True

    def finish(
        self, end: Minimum, least_cost: FloatArray, snapshot: IntArray, place: IntArray, inside: BoolArray
    ) -> None:
        """Keep where starts (N,) came to rest, if that is ``inside`` the field."""
        good = np.isfinite(end.cost) & inside
        self.cost[snapshot, place] = np.where(good, end.cost + least_cost, np.inf)
        self.settled[snapshot, place] = good & end.converged
        self.x[snapshot, place], self.y[snapshot, place] = end.point
        self.hessian.put((snapshot, place), end.hessian)

    def first(self, snapshot: IntArray) -> Mode:
        """Return the modes to which the first starts of some snapshots led; NaN where they did not settle."""
        settled = self.settled[snapshot, 0]

        def settle(values: FloatArray) -> FloatArray:
            return np.where(settled, values[snapshot, 0], np.nan)

        return Mode(settle(self.x), settle(self.y), settle(self.cost), self.hessian.map(settle))


@dataclass(frozen=True)
class _Search:
    """The mixtures of a block, which points are in the field, and what has been found."""

    mixture: Mixture
    allowed: Allowed
    found: _Found

    def run(self, scores: Scores, rows: IntArray, gap: float) -> None:
        """Follow the best candidate of each of the snapshots ``rows``, then others that don't lead to its mode."""
        place, best = scores.lowest()
        some = np.flatnonzero(np.isfinite(best))
        rows, scores, place, best = rows[some], scores.take(some), place[some], best[some]
        self._follow_best(rows, *scores.at(place))
        more = self.found.cost.shape[1] - 1
        if more:
            scores.leave_out(place)
            leave_out_slope(scores, self.found.first(rows))
            self._follow_others(choose_starts(self.mixture, rows, scores, best + gap, more))

    def hold_back(self) -> None:
        """Follow the starts again where every way downhill left the field, held back at its edge."""
        found = self.found
        lost: BoolArray = np.any(found.usable, axis=1) & ~np.any(np.isfinite(found.cost), axis=1)
        snapshot, place = np.nonzero(found.usable & lost[:, None])
        if snapshot.size:
            found.held[lost] = True
            problem = _Bounded(self.mixture.take(snapshot), snapshot, self.allowed)
            end = minimize(problem, found.start_x[snapshot, place], found.start_y[snapshot, place])
            self._finish(end, snapshot, place)

    def _follow_best(self, rows: IntArray, x: FloatArray, y: FloatArray) -> None:
        place = np.zeros_like(rows)
        self.found.begin(rows, place, x, y)
        self._finish(minimize(self.mixture.take_rows(rows), x, y), rows, place)

    def _follow_others(self, starts: Starts) -> None:
        """Follow starts, each until it is seen to lead to the mode that is known."""
        snapshot, place = starts.snapshot, starts.place + 1
        self.found.begin(snapshot, place, starts.x, starts.y)
        known = self.found.first(snapshot)

        def drawn(rows: IntArray, x: FloatArray, y: FloatArray) -> BoolArray:
            squared = known.hessian.take(rows).quadratic_form(x - known.x[rows], y - known.y[rows])
            return squared < _DRAWN * _DRAWN

        end = minimize(self.mixture.take(snapshot), starts.x, starts.y, give_up=drawn)
        new = np.flatnonzero(~drawn(np.arange(snapshot.shape[0]), end.x, end.y))
        self._finish(rows_of(end, new), snapshot[new], place[new])

    def _finish(self, end: Minimum, snapshot: IntArray, place: IntArray) -> None:
        inside = self.allowed(snapshot, end.x[:, None], end.y[:, None])[:, 0]
        self.found.finish(end, self.mixture.least_cost[snapshot], snapshot, place, inside)


@dataclass(frozen=True)
class _Bounded(RowBlock):
    """Mixtures (N,) of some snapshots whose cost is infinite outside the search field."""

    mixture: Mixture
    snapshot: IntArray
    allowed: Allowed

    def evaluate(self, x: FloatArray, y: FloatArray) -> Evaluation:
        at = self.mixture.evaluate(x, y)
        inside = self.allowed(self.snapshot, x[:, None], y[:, None])[:, 0]
        return at._replace(cost=np.where(inside, at.cost, np.inf))


def _rank(found: _Found) -> Modes:
    """Return what was found by rising cost, without repetitions."""
    x, y, hessian, cost = _sort(found.x, found.y, found.hessian, found.cost)
    repeated = np.zeros(cost.shape, dtype=bool)
    for t in range(cost.shape[1] - 1):
        if not np.isfinite(cost[:, t + 1]).any():
            break
        dx, dy = x[:, t + 1 :] - x[:, t, None], y[:, t + 1 :] - y[:, t, None]
        repeated[:, t + 1 :] |= hessian.at(slice(None), t, None).quadratic_form(dx, dy) < _SAME * _SAME
    cost[repeated] = np.inf
    x, y, hessian, cost = _sort(x, y, hessian, cost)
    return Modes(x, y, cost, hessian, np.asarray(found.usable.any(axis=1)), found.held)


def _sort(
    x: FloatArray, y: FloatArray, hessian: SymmetricMatrix, cost: FloatArray
) -> tuple[FloatArray, FloatArray, SymmetricMatrix, FloatArray]:
    """Return modes (B, T) by rising cost.

    Modes that are equally likely but for rounding come by their distance: where two circles cross, both crossings are
    equally likely when every other row is an outlier.
    """
    order = np.lexsort((x * x + y * y, np.round(cost, _TIE_DIGITS)), axis=1)

    def sort(values: FloatArray) -> FloatArray:
        return np.take_along_axis(values, order, axis=1)

    return sort(x), sort(y), hessian.map(sort), sort(cost)
