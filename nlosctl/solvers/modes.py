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

__all__ = ["Modes", "find_modes"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]
Allowed = Callable[[IntArray, FloatArray, FloatArray], BoolArray]

_POINTS = 8192
"""So many points are scored at once, that temporaries stay in the cache."""

_APART = 1.0
"""Starts are at least so many standard deviations apart."""

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
    followed.
    """
    size = mixture.obstructed.shape[0]
    if size == 0 or points == 0:
        return _no_modes(size, most)
    block = max(1, _POINTS // max(points, 1))
    starts = [
        _starts(mixture, candidates, allowed, np.arange(first, min(first + block, size)), most, gap)
        for first in range(0, size, block)
    ]
    x, y, usable = (np.concatenate([part[number] for part in starts]) for number in range(3))
    return _polish(mixture, x, y, usable, allowed)


def _no_modes(size: int, most: int) -> Modes:
    nothing = [np.full((size, most), np.nan) for _ in range(5)]
    none = np.zeros(size, dtype=bool)
    return Modes(nothing[0], nothing[1], np.full((size, most), np.inf), Symmetric2x2(*nothing[2:]), none, none.copy())


def _starts(
    mixture: Mixture,
    candidates: Callable[[IntArray], Candidates],
    allowed: Allowed,
    rows: IntArray,
    most: int,
    gap: float,
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return up to ``most`` starts (b, T) of some snapshots: x, y, and whether there is one."""
    part = mixture if rows.shape[0] == mixture.obstructed.shape[0] else mixture.take(rows)
    found = candidates(rows)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore", under="ignore"):
        cost = part.score(found.x, found.y)
        cost[~(found.valid & allowed(rows, found.x, found.y))] = np.inf
    shape = (rows.shape[0], most)
    x, y = np.full(shape, np.nan), np.full(shape, np.nan)
    usable = np.zeros(shape, dtype=bool)
    best = np.full(rows.shape[0], np.nan)
    active = np.arange(rows.shape[0])
    points_x, points_y = found.x, found.y
    for t in range(most):
        place = np.argmin(cost, axis=1)
        within = np.arange(place.shape[0])
        lowest = cost[within, place]
        if t == 0:
            best = lowest
        open_rows = np.isfinite(lowest) & ~(lowest > best + gap)
        if not open_rows.all():
            keep = np.flatnonzero(open_rows)
            if not keep.size:
                break
            active, best, place, within = active[keep], best[keep], place[keep], np.arange(keep.size)
            cost, points_x, points_y = _keep(cost, keep), _keep(points_x, keep), _keep(points_y, keep)
            part = part.take(keep)
        start_x, start_y = points_x[within, place], points_y[within, place]
        x[active, t], y[active, t], usable[active, t] = start_x, start_y, True
        cost[within, place] = np.inf
        if t < most - 1:
            _, information = part.responsibilities(start_x, start_y)
            near = _squared_distance(information, points_x - start_x[:, None], points_y - start_y[:, None])
            np.copyto(cost, np.inf, where=near < _APART * _APART)
    return x, y, usable


def _keep(array: FloatArray, rows: IntArray) -> FloatArray:
    return np.take(array.T, rows, axis=1).T if array.flags.f_contiguous else array[rows]


def _squared_distance(information: Symmetric2x2, dx: FloatArray, dy: FloatArray) -> FloatArray:
    xx, xy, yy = information.xx[:, None], information.xy[:, None], information.yy[:, None]
    with np.errstate(invalid="ignore", over="ignore"):
        return xx * dx * dx + 2.0 * xy * dx * dy + yy * dy * dy


def _polish(mixture: Mixture, x: FloatArray, y: FloatArray, usable: BoolArray, allowed: Allowed) -> Modes:
    """Follow every start (B, T) downhill; rank what comes to rest in the field, without repetitions.

    Where nothing does, the starts are followed again and held back at the field's edge.
    """
    cost = np.full(x.shape, np.inf)
    parts = [np.full(x.shape, np.nan) for _ in range(5)]
    held = np.zeros(x.shape[0], dtype=bool)
    for edge in (False, True):
        lost = usable.any(axis=1) & ~np.isfinite(cost).any(axis=1)
        snapshot, place = np.nonzero(usable & lost[:, None])
        if not snapshot.size:
            break
        followed = mixture.take(snapshot)
        start_x, start_y = x[snapshot, place], y[snapshot, place]
        if edge:
            held |= lost
            minimum = minimize(_Bounded(followed, snapshot, allowed), start_x, start_y)
        else:
            minimum = minimize(followed, start_x, start_y)
        good = np.isfinite(minimum.cost) & allowed(snapshot, minimum.x[:, None], minimum.y[:, None])[:, 0]
        cost[snapshot[good], place[good]] = (minimum.cost + mixture.least_cost[snapshot])[good]
        values = (minimum.x, minimum.y, minimum.hessian.xx, minimum.hessian.xy, minimum.hessian.yy)
        for part, value in zip(parts, values, strict=True):
            part[snapshot, place] = value
    order = _order(cost, x=parts[0], y=parts[1])
    parts = [np.take_along_axis(part, order, axis=1) for part in parts]
    return _without_repetitions(parts, np.take_along_axis(cost, order, axis=1), np.asarray(usable.any(axis=1)), held)


def _order(cost: FloatArray, x: FloatArray, y: FloatArray) -> IntArray:
    """Return the order (B, T) of rising cost; modes that are equally likely but for rounding, by their distance.

    Where two circles cross, both crossings are equally likely when every other row is an outlier.
    """
    order: IntArray = np.lexsort((x * x + y * y, np.round(cost, _TIE_DIGITS)), axis=1)
    return order


@dataclass(frozen=True)
class _Bounded:
    """Mixtures (N,) of some snapshots whose cost is infinite outside the search field."""

    mixture: Mixture
    snapshot: IntArray
    allowed: Allowed

    def evaluate(self, x: FloatArray, y: FloatArray) -> Evaluation:
        at = self.mixture.evaluate(x, y)
        inside = self.allowed(self.snapshot, x[:, None], y[:, None])[:, 0]
        return Evaluation(np.where(inside, at.cost, np.inf), at.gradient_x, at.gradient_y, at.hessian)

    def take(self, rows: IntArray) -> _Bounded:
        return _Bounded(self.mixture.take(rows), self.snapshot[rows], self.allowed)


def _without_repetitions(parts: list[FloatArray], cost: FloatArray, candidates: BoolArray, held: BoolArray) -> Modes:
    x, y, xx, xy, yy = parts
    repeated = np.zeros(cost.shape, dtype=bool)
    with np.errstate(invalid="ignore"):
        for t in range(cost.shape[1] - 1):
            hessian = Symmetric2x2(xx[:, t], xy[:, t], yy[:, t])
            near = _squared_distance(hessian, x[:, t + 1 :] - x[:, t, None], y[:, t + 1 :] - y[:, t, None])
            repeated[:, t + 1 :] |= near < _SAME * _SAME
    cost[repeated] = np.inf
    order = _order(cost, x, y)
    x, y, xx, xy, yy, cost = (np.take_along_axis(part, order, axis=1) for part in (x, y, xx, xy, yy, cost))
    return Modes(x, y, cost, Symmetric2x2(xx, xy, yy), candidates, held)
