"""The two best of the optima that descents from several points reach."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from typing import Protocol, Self

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ignoring_invalid
from nlosctl.geometry.blocks import RowBlock
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.solvers.optimization.levenberg_marquardt import minimize
from nlosctl.solvers.optimization.problem import Evaluation, Problem

__all__ = ["End", "Landscape", "TwoBest", "are_apart", "are_images", "find_best_two", "nearer_first"]

_DISTINCT_STANDARD_DEVIATIONS = 1e-3
"""Optima nearer to each other than this are the same."""

_PATIENCE = 20
"""Refused steps after which a descent is given up."""

_BLOCKS_AT_ONCE = 4
"""So many further descents for each snapshot are made at a time: a few long ones take as many steps as all."""

_NO_RIVAL = 1e3
"""A point this many nats worse than a good fit is the start of no other good one."""

_BASIN = 3.0
_BOWL = 0.1
"""A descent within so many standard deviations of the first optimum ends there if cost and slope are those of the
parabola about that optimum, up to this share. The cost alone may agree beyond a mirror image of a broad optimum."""

_EQUAL = 1e-9
"""Costs that differ by a smaller share are equal."""

_BARRIER = 0.5
"""Mirror images are one broad optimum unless the point half way between them costs so many nats more."""

_IMAGES = 1e-6
"""Optima are mirror images of each other if their costs are equal up to this share."""


class Landscape(Protocol):
    """Measurements of B snapshots that points, given as D arrays, are compared with."""

    @property
    def half_chi_squares(self) -> Callable[..., FloatArray]:
        """Return half the chi-square (B, P) at points (B, P)."""
        ...

    @property
    def information(self) -> Callable[..., SymmetricMatrix]:
        """Return the Fisher information (B,) at points (B,)."""
        ...

    def take(self, rows: IntArray) -> Self:
        """Return the measurements of some snapshots."""
        ...


@dataclass(frozen=True)
class End(RowBlock):
    """Where one descent of each snapshot ended (B,), about the local origin; NaN and not converged where none did."""

    point: tuple[FloatArray, ...]
    cost: FloatArray
    converged: BoolArray

    @classmethod
    def missing(cls, snapshots: int, dimension: int = 2) -> End:
        """Return the ends where no descent has been."""
        cost, *point = np.full((dimension + 1, snapshots), np.nan)
        return cls(tuple(point), cost, np.zeros(snapshots, dtype=bool))

    @property
    def x(self) -> FloatArray:
        """The first coordinate."""
        return self.point[0]

    @property
    def y(self) -> FloatArray:
        """The second coordinate."""
        return self.point[1]

    def put(self, rows: IntArray, other: End) -> None:
        """Replace the ends of some snapshots."""
        for mine, theirs in zip(self.point, other.point, strict=True):
            mine[rows] = theirs
        self.cost[rows], self.converged[rows] = other.cost, other.converged

    def improves(self, known: End) -> BoolArray:
        """Return where this end is better: converged while the other is not, or cheaper."""
        with ignoring_invalid():
            cheaper: BoolArray = (self.converged == known.converged) & (self.cost < known.cost)
        return cheaper | (self.converged & ~known.converged)


def are_apart(one: tuple[FloatArray, ...], other: tuple[FloatArray, ...], covariance: SymmetricMatrix) -> BoolArray:
    """Return which points (B,), given as D arrays, are two, by the covariance of one."""
    with ignoring_invalid():
        away = reduce(np.hypot, [mine - theirs for mine, theirs in zip(one, other, strict=True)])
        apart: BoolArray = away > _DISTINCT_STANDARD_DEVIATIONS * np.sqrt(covariance.trace)
    return apart


class TwoBest:
    """The cheapest optimum of each snapshot so far, and the cheapest apart from it."""

    def __init__(self, first: End) -> None:
        self.best = first
        self.other = End.missing(first.cost.size, len(first.point))

    def note(self, rows: IntArray, end: End, information: SymmetricMatrix) -> None:
        """Take the ends of further descents of some snapshots into account, whose information is that at the end."""
        best, other = self.best.take(rows), self.other.take(rows)
        apart = are_apart(end.point, best.point, information.inverse())
        better = end.improves(best)
        runner_up = np.flatnonzero(better & apart & best.converged)
        self.other.put(rows[runner_up], best.take(runner_up))
        second = np.flatnonzero(end.improves(other) & ~better & apart & end.converged)
        self.other.put(rows[second], end.take(second))
        first = np.flatnonzero(better)
        self.best.put(rows[first], end.take(first))


def find_best_two(
    problem: Problem,
    landscape: Landscape,
    points: Sequence[tuple[FloatArray, ...]],
    max_iterations: int,
    plausible: FloatArray | None = None,
    far_m: FloatArray | None = None,
) -> tuple[End, End]:
    """Return the two best optima of ``problem``, a cost of the ``landscape``, the second NaN where there is only one.

    Descents start from all of ``points``, each D arrays (B,), the likeliest first. None is left out as near another:
    the mirror images of a broad optimum are near each other. If ``problem`` is half the chi-square, and the first end
    costs at most ``plausible`` (B,), points that are a thousand nats worse than that are no rivals. Descents that
    end farther than ``far_m`` (B,) from the local origin count as settled: their optimum is at infinity.
    """
    coordinates = [np.stack(parts) for parts in zip(*points, strict=True)]
    cost = landscape.half_chi_squares(*(part.T for part in coordinates)).T
    order, every = np.argsort(np.where(np.isnan(cost), np.inf, cost), axis=0, kind="stable"), np.arange(cost.shape[1])
    cost, coordinates = cost[order, every], [part[order, every] for part in coordinates]
    first, hessian = _descend(problem, [part[0] for part in coordinates], max_iterations, far_m)
    open_points = np.isfinite(cost)
    open_points[0] = False
    if plausible is not None:
        with ignoring_invalid():
            open_points &= ~(first.converged & (first.cost <= plausible) & (cost > first.cost + _NO_RIVAL))
    optima = TwoBest(first)
    rank, snapshot = np.nonzero(open_points)
    step = _BLOCKS_AT_ONCE * max(1, every.size)
    for begin in range(0, rank.size, step):
        numbers, rows = rank[begin : begin + step], snapshot[begin : begin + step]
        start = [part[numbers, rows] for part in coordinates]
        far = None if far_m is None else far_m[rows]
        bowl = _Bowl(first.take(rows), hessian.take(rows))
        end, _ = _descend(problem.take(rows), start, max_iterations, far, bowl.leads_to_first)
        ended = np.flatnonzero(end.converged | ~first.converged[rows])
        numbers, rows, end = numbers[ended], rows[ended], end.take(ended)
        information = landscape.take(rows).information(*end.point)
        for number in range(1, cost.shape[0]):
            some = np.flatnonzero(numbers == number)
            optima.note(rows[some], end.take(some), information.take(some))
    return optima.best, optima.other


@dataclass(frozen=True)
class _Bowl:
    """The first optimum of each further descent (N,), with the second derivatives there."""

    first: End
    hessian: SymmetricMatrix

    def leads_to_first(self, rows: IntArray, at: Evaluation, *point: FloatArray) -> BoolArray:
        """Return which descents of ``rows``, evaluated ``at`` their points, lead to the optimum."""
        first = self.first.take(rows)
        with ignoring_invalid():
            away = [part - own for part, own in zip(point, first.point, strict=True)]
            rise = 0.5 * self.hessian.take(rows).quadratic_form(*away)
            slope = reduce(np.add, [part * own for part, own in zip(at.gradient, away, strict=True)])
            known: BoolArray = first.converged & (rise <= 0.5 * _BASIN**2)
            known &= np.abs(at.cost - first.cost - rise) <= _BOWL * rise
            known &= np.abs(slope - 2.0 * rise) <= 2.0 * _BOWL * rise
        return known


def _descend(
    problem: Problem,
    start: list[FloatArray],
    max_iterations: int,
    far_m: FloatArray | None,
    give_up: Callable[..., BoolArray] | None = None,
) -> tuple[End, SymmetricMatrix]:
    """Return where descents end, and the second derivatives there."""
    minimum = minimize(problem, *start, max_iterations=max_iterations, patience=_PATIENCE, give_up=give_up)
    converged = minimum.converged
    if far_m is not None:
        with ignoring_invalid():
            converged = converged | (reduce(np.hypot, minimum.point) > far_m)
    return End(minimum.point, minimum.cost, converged & np.isfinite(minimum.cost)), minimum.hessian


def nearer_first(one: End, other: End) -> tuple[End, End]:
    """Return two optima (B,), that nearer to the local origin first where their costs are equal up to rounding.

    As many measurements as unknowns have two exact solutions: rounding must not choose.
    """
    with ignoring_invalid():
        equal = np.abs(one.cost - other.cost) <= _EQUAL * (1.0 + one.cost)
        farther = reduce(np.hypot, one.point) > reduce(np.hypot, other.point)
    rows = np.flatnonzero(equal & farther & one.converged & other.converged)
    first, second = one.take(rows), other.take(rows)
    one.put(rows, replace(second, cost=first.cost))
    other.put(rows, replace(first, cost=second.cost))
    return one, other


def are_images(landscape: Landscape, one: tuple[FloatArray, ...], other: tuple[FloatArray, ...]) -> BoolArray:
    """Return where (B,) two optima are images of each other, and the likelihood half way between them is about theirs.

    So it is for sensors in a plane and a source in it, whose distance from the plane they don't determine.
    """
    points = (one, other, tuple(0.5 * (mine + theirs) for mine, theirs in zip(one, other, strict=True)))
    costs = [landscape.half_chi_squares(*(part[:, None] for part in point))[:, 0] for point in points]
    with ignoring_invalid():
        merged: BoolArray = costs[2] - np.minimum(costs[0], costs[1]) < _BARRIER
        merged &= np.abs(costs[0] - costs[1]) <= _IMAGES * (1.0 + costs[0])
    return merged
