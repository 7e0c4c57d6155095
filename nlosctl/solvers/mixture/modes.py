"""The modes of a mixture likelihood: score all candidates, follow the best few downhill, rank the results."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

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
    search = _Search(mixture, allowed, most, outside)
    if points > 0:
        section = max(1, _SECTION // points)
        for first in range(0, size, section):
            rows = np.arange(first, min(first + section, size))
            search.run(score_candidates(mixture, candidates, allowed, rows, points, outside), rows, gap)
        if outside is not None:
            outside.follow(mixture, search.least_cost)
    return search.finish()


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


class _Descents(NamedTuple):
    """Descents (N,) of some snapshots: where they began and ended; of infinite cost where the end is not valid.

    ``settled`` marks ends that are smooth minima.
    """

    snapshot: IntArray
    start_x: FloatArray
    start_y: FloatArray
    x: FloatArray
    y: FloatArray
    cost: FloatArray
    hessian: SymmetricMatrix
    settled: BoolArray

    @classmethod
    def join(cls, parts: list[_Descents]) -> _Descents:
        """Return the descents of several lists in one."""
        entries = zip(*(part.hessian for part in parts), strict=True)
        return cls(
            np.concatenate([part.snapshot for part in parts]),
            np.concatenate([part.start_x for part in parts]),
            np.concatenate([part.start_y for part in parts]),
            np.concatenate([part.x for part in parts]),
            np.concatenate([part.y for part in parts]),
            np.concatenate([part.cost for part in parts]),
            SymmetricMatrix(*(np.concatenate(entry) for entry in entries)),
            np.concatenate([part.settled for part in parts]),
        )


class _Search:
    """The descents of a block of mixtures so far, with the search region inside and outside.

    ``known`` (B,) are the modes of the first descents, NaN where they did not settle, and ``least_cost`` (B,) the cost
    of the best mode; ``candidates`` (B,) marks snapshots with any descent, ``at_boundary`` (B,) those constrained to
    the search region.
    """

    def __init__(self, mixture: Mixture, allowed: Allowed, most: int, outside: OutsideSearch | None) -> None:
        self.mixture, self.allowed, self.most, self.outside = mixture, allowed, most, outside
        size = mixture.obstructed.shape[0]
        x, y, cost = (np.full(size, np.nan) for _ in range(3))
        self.known = Mode(x, y, cost, SymmetricMatrix.full(size, np.nan))
        self.least_cost = np.full(size, np.inf)
        self.candidates, self.at_boundary = (np.zeros(size, dtype=bool) for _ in range(2))
        self._parts: list[_Descents] = []

    def run(self, scores: Scores, rows: IntArray, gap: float) -> None:
        """Follow the best candidate of each of the snapshots ``rows``, then others that don't lead to its mode."""
        index, best = scores.lowest()
        some = np.flatnonzero(np.isfinite(best))
        rows, scores, index, best = rows[some], scores.take(some), index[some], best[some]
        self._follow_best(rows, *scores.at(index))
        if self.most > 1:
            scores.leave_out(index)
            leave_out_slope(scores, self.known.take(rows))
            self._follow_others(choose_starts(self.mixture, rows, scores, best + gap, self.most - 1))

    def finish(self) -> Modes:
        """Repeat the descents, constrained to the search region, where every one left it; return all modes."""
        if not self._parts:
            nothing = np.zeros(0)
            self._follow_best(nothing.astype(np.int64), nothing, nothing)
        found = _Descents.join(self._parts)
        lost = self.candidates & ~np.isfinite(self.least_cost)
        again = np.flatnonzero(lost[found.snapshot])
        if again.size:
            self.at_boundary[lost] = True
            snapshot, x, y = found.snapshot[again], found.start_x[again], found.start_y[again]
            end = minimize(_Bounded(self.mixture.take(snapshot), snapshot, self.allowed), x, y)
            found = _Descents.join([found, self._ends(end, snapshot, x, y)])
        return _rank(found, self.candidates, self.at_boundary)

    def _follow_best(self, rows: IntArray, x: FloatArray, y: FloatArray) -> None:
        self.candidates[rows] = True
        ends = self._note(minimize(self.mixture.take_rows(rows), x, y), rows, x, y)
        settled = rows_of(ends, np.flatnonzero(ends.settled))
        for known, values in zip((self.known.x, self.known.y, self.known.cost), settled[3:6], strict=True):
            known[settled.snapshot] = values
        self.known.hessian.put(settled.snapshot, settled.hessian)

    def _follow_others(self, starts: Starts) -> None:
        """Follow initial points, each until it is clear that it leads to the known mode."""
        known = self.known.take(starts.snapshot)

        def leads_to_known(rows: IntArray, x: FloatArray, y: FloatArray) -> BoolArray:
            squared = known.hessian.take(rows).quadratic_form(x - known.x[rows], y - known.y[rows])
            return squared < _ATTRACTED * _ATTRACTED

        end = minimize(self.mixture.take(starts.snapshot), starts.x, starts.y, give_up=leads_to_known)
        new = np.flatnonzero(~leads_to_known(np.arange(starts.snapshot.shape[0]), end.x, end.y))
        self._note(rows_of(end, new), starts.snapshot[new], starts.x[new], starts.y[new])

    def _note(self, end: Minimum, snapshot: IntArray, x: FloatArray, y: FloatArray) -> _Descents:
        """Keep and return the descents (N,) from x, y; each of those that left the region is noted outside."""
        ends = self._ends(end, snapshot, x, y)
        np.minimum.at(self.least_cost, snapshot, ends.cost)
        self._parts.append(ends)
        return ends

    def _ends(self, end: Minimum, snapshot: IntArray, x: FloatArray, y: FloatArray) -> _Descents:
        inside = self.allowed(snapshot, end.x[:, None], end.y[:, None])[:, 0]
        least_cost = self.mixture.least_cost[snapshot]
        if self.outside is not None:
            self.outside.note_ends(end, least_cost, snapshot, inside)
        good = np.isfinite(end.cost) & inside
        cost = np.where(good, end.cost + least_cost, np.inf)
        return _Descents(snapshot, x, y, end.x, end.y, cost, end.hessian, good & end.converged)


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


def _rank(found: _Descents, candidates: BoolArray, at_boundary: BoolArray) -> Modes:
    """Return the ends by rising cost, without repetitions.

    Ends that are equally likely up to rounding are ordered by distance: both crossings of two circles are equally
    likely if every other row is an outlier.
    """
    found = rows_of(found, np.flatnonzero(np.isfinite(found.cost)))
    distance = found.x * found.x + found.y * found.y
    found = rows_of(found, np.lexsort((distance, np.round(found.cost, _TIE_DIGITS), found.snapshot)))
    x, y, cost, hessian = _spread(found, candidates.shape[0])
    several = np.flatnonzero(np.isfinite(cost[:, 1:]).any(axis=1))
    repeated = np.zeros(cost.shape, dtype=bool)
    for t in range(cost.shape[1] - 1):
        at = several, slice(t + 1, None)
        dx, dy = x[at] - x[several, t, None], y[at] - y[several, t, None]
        repeated[at] |= hessian.at(several, t, None).quadratic_form(dx, dy) < _SAME * _SAME
    settled = np.zeros(candidates.shape, dtype=bool)
    is_best = (found.x == x[found.snapshot, 0]) & (found.y == y[found.snapshot, 0])
    settled[found.snapshot[is_best & found.settled]] = True
    new = np.flatnonzero(~repeated[np.isfinite(cost)])
    x, y, cost, hessian = _spread(rows_of(found, new), candidates.shape[0])
    return Modes(x, y, cost, hessian, settled, candidates, at_boundary)


def _spread(found: _Descents, size: int) -> tuple[FloatArray, FloatArray, FloatArray, SymmetricMatrix]:
    """Return x, y, cost and second derivatives (B, T) of descents that are sorted by snapshot."""
    number = np.bincount(found.snapshot, minlength=size)
    index = np.arange(found.snapshot.shape[0]) - np.repeat(np.cumsum(number) - number, number)
    shape = max(1, int(number.max(initial=0))), size
    x, y, cost = (np.full(shape, value).T for value in (np.nan, np.nan, np.inf))
    hessian = SymmetricMatrix(*(np.full(shape, np.nan).T for _ in found.hessian))
    at = found.snapshot, index
    x[at], y[at], cost[at] = found.x, found.y, found.cost
    hessian.put(at, found.hessian)
    return x, y, cost, hessian
