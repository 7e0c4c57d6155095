"""The modes of a mixture likelihood: score all candidates, follow the best few downhill, rank the results."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce
from typing import NamedTuple

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, Point, ignoring_overflow
from nlosctl.geometry.blocks import RowBlock, rows_of
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.solvers.bearings.ray_crossings import Candidates
from nlosctl.solvers.mixture.initial_estimates import Mode, Scores, Starts, choose_starts, leave_out_slope
from nlosctl.solvers.mixture.likelihood import Mixture
from nlosctl.solvers.mixture.outside import OutsideSearch
from nlosctl.solvers.optimization.levenberg_marquardt import Minimum, minimize
from nlosctl.solvers.optimization.problem import Evaluation

__all__ = ["Modes", "find_modes", "score_candidates"]

Allowed = Callable[..., BoolArray]

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

    ``point`` in metres about the local origin, D arrays; ``cost`` in nats, infinite where there is no such mode.
    ``hessian`` are the second derivatives of the cost. ``settled`` (B,) marks snapshots whose best mode is a smooth
    optimum, ``candidates`` (B,) those with any candidate, ``at_boundary`` (B,) those whose every descent left the
    search region, so that the points are the constrained ones on its edge.
    """

    point: Point
    cost: FloatArray
    hessian: SymmetricMatrix
    settled: BoolArray
    candidates: BoolArray
    at_boundary: BoolArray

    @property
    def best(self) -> Mode:
        """The best mode (B,) of each snapshot."""
        return Mode(tuple(part[:, 0] for part in self.point), self.cost[:, 0], self.hessian.at(slice(None), 0))


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

    ``candidates(rows)`` gives the candidates of some snapshots, about ``points`` each; ``allowed(rows, *point)``
    returns which points (b, P) are in the search region. Candidates costlier than the best by more than ``gap`` nats
    are not followed, nor those in the basin of a known mode. ``outside`` notes the candidates outside the region.
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
            cost = mixture.take(part).score(*scored_points.point)
            if outside is not None:
                outside.note_candidates(part, scored_points, cost)
            cost[~(scored_points.valid & allowed(part, *scored_points.point))] = np.inf
        scored.append((*scored_points.point, cost))
    *point, cost = (np.concatenate([array.T for array in arrays], axis=1).T for arrays in zip(*scored, strict=True))
    return Scores(tuple(point), cost)


class _Descents(NamedTuple):
    """Descents (N,) of some snapshots: where they began and ended; of infinite cost where the end is not valid.

    ``settled`` marks ends that are smooth minima.
    """

    snapshot: IntArray
    start: Point
    point: Point
    cost: FloatArray
    hessian: SymmetricMatrix
    settled: BoolArray

    @classmethod
    def join(cls, parts: list[_Descents]) -> _Descents:
        """Return the descents of several lists in one."""
        entries = zip(*(part.hessian for part in parts), strict=True)
        start, point = (
            tuple(map(np.concatenate, zip(*(getattr(part, name) for part in parts), strict=True)))
            for name in ("start", "point")
        )
        return cls(
            np.concatenate([part.snapshot for part in parts]),
            start,
            point,
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
        self.known = Mode.missing(size, mixture.dimension)
        self.least_cost = np.full(size, np.inf)
        self.candidates, self.at_boundary = (np.zeros(size, dtype=bool) for _ in range(2))
        self._parts: list[_Descents] = []

    def run(self, scores: Scores, rows: IntArray, gap: float) -> None:
        """Follow the best candidate of each of the snapshots ``rows``, then others that don't lead to its mode."""
        index, best = scores.lowest()
        some = np.flatnonzero(np.isfinite(best))
        rows, scores, index, best = rows[some], scores.take(some), index[some], best[some]
        self._follow_best(rows, scores.at(index))
        if self.most > 1:
            scores.leave_out(index)
            leave_out_slope(scores, self.known.take(rows))
            self._follow_others(choose_starts(self.mixture, rows, scores, best + gap, self.most - 1))

    def finish(self) -> Modes:
        """Repeat the descents, constrained to the search region, where every one left it; return all modes."""
        if not self._parts:
            nowhere = Mode.missing(0, self.mixture.dimension).point
            self._follow_best(np.zeros(0, dtype=np.int64), nowhere)
        found = _Descents.join(self._parts)
        lost = self.candidates & ~np.isfinite(self.least_cost)
        again = np.flatnonzero(lost[found.snapshot])
        if again.size:
            self.at_boundary[lost] = True
            snapshot, start = found.snapshot[again], rows_of(found.start, again)
            end = minimize(_Bounded(self.mixture.take(snapshot), snapshot, self.allowed), *start)
            found = _Descents.join([found, self._ends(end, snapshot, start)])
        return _rank(found, self.candidates, self.at_boundary)

    def _follow_best(self, rows: IntArray, start: Point) -> None:
        self.candidates[rows] = True
        ends = self._note(minimize(self.mixture.take_rows(rows), *start), rows, start)
        settled = rows_of(ends, np.flatnonzero(ends.settled))
        for known, values in zip((*self.known.point, self.known.cost), (*settled.point, settled.cost), strict=True):
            known[settled.snapshot] = values
        self.known.hessian.put(settled.snapshot, settled.hessian)

    def _follow_others(self, starts: Starts) -> None:
        """Follow initial points, each until it is clear that it leads to the known mode."""
        known = self.known.take(starts.snapshot)

        def leads_to_known(rows: IntArray, point: Point) -> BoolArray:
            away = [part - other[rows] for part, other in zip(point, known.point, strict=True)]
            return known.hessian.take(rows).quadratic_form(*away) < _ATTRACTED * _ATTRACTED

        end = minimize(
            self.mixture.take(starts.snapshot),
            *starts.point,
            give_up=lambda rows, at, *point: leads_to_known(rows, point),
        )
        new = np.flatnonzero(~leads_to_known(np.arange(starts.snapshot.shape[0]), end.point))
        self._note(rows_of(end, new), starts.snapshot[new], rows_of(starts.point, new))

    def _note(self, end: Minimum, snapshot: IntArray, start: Point) -> _Descents:
        """Keep and return the descents (N,) from ``start``; each of those that left the region is noted outside."""
        ends = self._ends(end, snapshot, start)
        np.minimum.at(self.least_cost, snapshot, ends.cost)
        self._parts.append(ends)
        return ends

    def _ends(self, end: Minimum, snapshot: IntArray, start: Point) -> _Descents:
        inside = self.allowed(snapshot, *(part[:, None] for part in end.point))[:, 0]
        least_cost = self.mixture.least_cost[snapshot]
        if self.outside is not None:
            self.outside.note_ends(end, least_cost, snapshot, inside)
        good = np.isfinite(end.cost) & inside
        cost = np.where(good, end.cost + least_cost, np.inf)
        return _Descents(snapshot, start, end.point, cost, end.hessian, good & end.converged)


@dataclass(frozen=True)
class _Bounded(RowBlock):
    """Mixtures (N,) of some snapshots whose cost is infinite outside the search region."""

    mixture: Mixture
    snapshot: IntArray
    allowed: Allowed

    def evaluate(self, *point: FloatArray) -> Evaluation:
        at = self.mixture.evaluate(*point)
        inside = self.allowed(self.snapshot, *(part[:, None] for part in point))[:, 0]
        return at._replace(cost=np.where(inside, at.cost, np.inf))


def _rank(found: _Descents, candidates: BoolArray, at_boundary: BoolArray) -> Modes:
    """Return the ends by rising cost, without repetitions.

    Ends that are equally likely up to rounding are ordered by distance: both crossings of two circles are equally
    likely if every other row is an outlier.
    """
    found = rows_of(found, np.flatnonzero(np.isfinite(found.cost)))
    distance = _squared_norm(found.point)
    found = rows_of(found, np.lexsort((distance, np.round(found.cost, _TIE_DIGITS), found.snapshot)))
    point, cost, hessian = _spread(found, candidates.shape[0])
    several = np.flatnonzero(np.isfinite(cost[:, 1:]).any(axis=1))
    repeated = np.zeros(cost.shape, dtype=bool)
    for t in range(cost.shape[1] - 1):
        at = several, slice(t + 1, None)
        away = [part[at] - part[several, t, None] for part in point]
        repeated[at] |= hessian.at(several, t, None).quadratic_form(*away) < _SAME * _SAME
    settled = np.zeros(candidates.shape, dtype=bool)
    is_best = np.logical_and.reduce(
        [mine == best[found.snapshot, 0] for mine, best in zip(found.point, point, strict=True)]
    )
    settled[found.snapshot[is_best & found.settled]] = True
    new = np.flatnonzero(~repeated[np.isfinite(cost)])
    return Modes(*_spread(rows_of(found, new), candidates.shape[0]), settled, candidates, at_boundary)


def _squared_norm(point: Point) -> FloatArray:
    return reduce(np.add, [part * part for part in point])


def _spread(found: _Descents, size: int) -> tuple[Point, FloatArray, SymmetricMatrix]:
    """Return points, cost and second derivatives (B, T) of descents that are sorted by snapshot."""
    number = np.bincount(found.snapshot, minlength=size)
    index = np.arange(found.snapshot.shape[0]) - np.repeat(np.cumsum(number) - number, number)
    shape = max(1, int(number.max(initial=0))), size
    point, cost = tuple(np.full(shape, np.nan).T for _ in found.point), np.full(shape, np.inf).T
    hessian = SymmetricMatrix(*(np.full(shape, np.nan).T for _ in found.hessian))
    at = found.snapshot, index
    for part, values in zip((*point, cost), (*found.point, found.cost), strict=True):
        part[at] = values
    hessian.put(at, found.hessian)
    return point, cost, hessian
