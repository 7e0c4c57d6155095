"""The modes of a mixture likelihood: score all candidates, follow the best few downhill, rank what is found."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nlosctl.geometry.symmetric import Symmetric2x2
from nlosctl.solvers.crossings import Candidates
from nlosctl.solvers.levenberg_marquardt import Evaluation, minimize
from nlosctl.solvers.mixture import Mixture
from nlosctl.solvers.starts import Scores, choose_starts

__all__ = ["Modes", "find_modes"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]
Allowed = Callable[[IntArray, FloatArray, FloatArray], BoolArray]

_POINTS = 8192
"""So many points are scored at once, that temporaries stay in the cache."""

_SECTION = 1 << 18
"""So many points are kept at once: long blocks with many candidates are searched in sections."""

_TIE_DIGITS = 5
"""Costs that agree to so many digits after the point, in nats, are equal."""

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
    hessian: Symmetric2x2
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
    found = _Found.nothing(size, most)
    if points > 0:
        section = max(1, _SECTION // points)
        for first in range(0, size, section):
            rows = np.arange(first, min(first + section, size))
            _search(mixture, _score(mixture, candidates, allowed, rows, points), rows, allowed, gap, found)
        found.hold_back(mixture, allowed)
    return _rank(found)


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
        with np.errstate(divide="ignore", invalid="ignore", over="ignore", under="ignore"):
            cost = mixture.take(part).score(found.x, found.y)
            cost[~(found.valid & allowed(part, found.x, found.y))] = np.inf
        scored.append((found.x, found.y, cost))
    return Scores(*(np.concatenate([part[number].T for part in scored], axis=1).T for number in range(3)))


@dataclass(frozen=True)
class _Found:
    """What was followed (B, T): where from, whether at all, and the ends, of infinite cost where there is none."""

    start_x: FloatArray
    start_y: FloatArray
    usable: BoolArray
    x: FloatArray
    y: FloatArray
    cost: FloatArray
    hessian: Symmetric2x2
    held: BoolArray

    @classmethod
    def nothing(cls, size: int, most: int) -> _Found:
        start_x, start_y, x, y, xx, xy, yy = (np.full((size, most), np.nan) for _ in range(7))
        usable, held = np.zeros((size, most), dtype=bool), np.zeros(size, dtype=bool)
        return cls(start_x, start_y, usable, x, y, np.full((size, most), np.inf), Symmetric2x2(xx, xy, yy), held)

    def follow(
        self, mixture: Mixture, snapshot: IntArray, place: IntArray, x: FloatArray, y: FloatArray, allowed: Allowed
    ) -> None:
        """Follow starts (N,) of some snapshots downhill, and keep where they come to rest in the field."""
        self.start_x[snapshot, place], self.start_y[snapshot, place] = x, y
        self.usable[snapshot, place] = True
        self._minimize(mixture, mixture.take_rows(snapshot), snapshot, place, allowed)

    def hold_back(self, mixture: Mixture, allowed: Allowed) -> None:
        """Follow the starts again where every way downhill left the field, held back at its edge."""
        lost = self.usable.any(axis=1) & ~np.isfinite(self.cost).any(axis=1)
        snapshot, place = np.nonzero(self.usable & lost[:, None])
        if snapshot.size:
            self.held[lost] = True
            self._minimize(mixture, _Bounded(mixture.take(snapshot), snapshot, allowed), snapshot, place, allowed)

    def _minimize(
        self, mixture: Mixture, problem: Mixture | _Bounded, snapshot: IntArray, place: IntArray, allowed: Allowed
    ) -> None:
        end = minimize(problem, self.start_x[snapshot, place], self.start_y[snapshot, place])
        good = np.isfinite(end.cost) & allowed(snapshot, end.x[:, None], end.y[:, None])[:, 0]
        self.cost[snapshot, place] = np.where(good, end.cost + mixture.least_cost[snapshot], np.inf)
        own = (self.x, self.y, self.hessian.xx, self.hessian.xy, self.hessian.yy)
        for part, value in zip(own, (end.x, end.y, end.hessian.xx, end.hessian.xy, end.hessian.yy), strict=True):
            part[snapshot, place] = value


def _search(mixture: Mixture, scores: Scores, rows: IntArray, allowed: Allowed, gap: float, found: _Found) -> None:
    """Follow the best candidate of each of some snapshots, then the others that are not on the slope of its mode."""
    place, best = scores.lowest()
    some = np.flatnonzero(np.isfinite(best))
    rows, scores, place, best = rows[some], scores.take(some), place[some], best[some]
    first = np.zeros_like(rows)
    found.follow(mixture, rows, first, *scores.at(place), allowed)
    if found.cost.shape[1] == 1:
        return
    scores.leave_out(place)
    scores.leave_out_slope(
        found.x[rows, 0],
        found.y[rows, 0],
        found.cost[rows, 0],
        Symmetric2x2(*(part[rows, 0] for part in (found.hessian.xx, found.hessian.xy, found.hessian.yy))),
    )
    starts = choose_starts(mixture, rows, scores, best + gap, found.cost.shape[1] - 1)
    found.follow(mixture, starts.snapshot, starts.place + 1, starts.x, starts.y, allowed)


@dataclass(frozen=True)
class _Bounded:
    """Mixtures (N,) of some snapshots whose cost is infinite outside the search field."""

    mixture: Mixture
    snapshot: IntArray
    allowed: Allowed

    def evaluate(self, x: FloatArray, y: FloatArray) -> Evaluation:
        at = self.mixture.evaluate(x, y)
        inside = self.allowed(self.snapshot, x[:, None], y[:, None])[:, 0]
        return Evaluation(np.where(inside, at.cost, np.inf), at.gradient_x, at.gradient_y, at.hessian, at.exact)

    def take(self, rows: IntArray) -> _Bounded:
        return _Bounded(self.mixture.take(rows), self.snapshot[rows], self.allowed)


def _rank(found: _Found) -> Modes:
    """Return what was found by rising cost, without repetitions."""
    hessian = found.hessian
    parts = [found.x, found.y, hessian.xx, hessian.xy, hessian.yy]
    parts, cost = _sort(parts, found.cost)
    x, y, xx, xy, yy = parts
    repeated = np.zeros(cost.shape, dtype=bool)
    for t in range(cost.shape[1] - 1):
        if not np.isfinite(cost[:, t + 1]).any():
            break
        dx, dy = x[:, t + 1 :] - x[:, t, None], y[:, t + 1 :] - y[:, t, None]
        with np.errstate(invalid="ignore", over="ignore"):
            squared = xx[:, t, None] * dx * dx + 2.0 * xy[:, t, None] * dx * dy + yy[:, t, None] * dy * dy
            repeated[:, t + 1 :] |= squared < _SAME * _SAME
    cost[repeated] = np.inf
    (x, y, xx, xy, yy), cost = _sort(parts, cost)
    return Modes(x, y, cost, Symmetric2x2(xx, xy, yy), np.asarray(found.usable.any(axis=1)), found.held)


def _sort(parts: list[FloatArray], cost: FloatArray) -> tuple[list[FloatArray], FloatArray]:
    """Return arrays (B, T), of which the first two are x and y, by rising cost.

    Modes that are equally likely but for rounding come by their distance: where two circles cross, both crossings are
    equally likely when every other row is an outlier.
    """
    x, y = parts[:2]
    order = np.lexsort((x * x + y * y, np.round(cost, _TIE_DIGITS)), axis=1)
    return [np.take_along_axis(part, order, axis=1) for part in parts], np.take_along_axis(cost, order, axis=1)
