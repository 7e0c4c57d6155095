"""The target that explains one path best, or all paths of a snapshot: fitted from several starts."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ignoring_invalid, ignoring_overflow
from nlosctl.geometry.blocks import rows_of
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.triplets import PathRows, SpaceFrame, SpacePaths
from nlosctl.solvers.optimization.levenberg_marquardt import Minimum, minimize
from nlosctl.solvers.triplets.elliptic_coordinates import minimize_paths
from nlosctl.solvers.triplets.initial_estimates import plane_crossings, plane_starts, plane_suprema
from nlosctl.solvers.triplets.initial_space_estimates import space_crossings, space_starts, space_suprema
from nlosctl.solvers.triplets.likelihood import HeldTriplets, TripletProblem, with_height
from nlosctl.solvers.triplets.spheroidal_coordinates import minimize_space_paths

__all__ = ["TargetFits", "fit_paths", "fit_snapshots"]


_SAME_BASIN = 0.05
"""An initial point whose cost matches the quadratic model of a known minimum this well converges to it."""
_SNAPSHOT_STARTS = 5
"""So many of the targets that single paths propose are tried for all paths together."""
_COSTS_AT_ONCE = 256


@dataclass
class TargetFits:
    """The best target of every problem (N,) about its local origin, metres, and what it leaves over.

    ``cost`` is half the chi-square, ``hessian`` its second derivatives. ``runner_up`` is the cost of the best other
    minimum, infinite without one.
    """

    point: tuple[FloatArray, ...]
    cost: FloatArray
    hessian: SymmetricMatrix
    converged: BoolArray
    runner_up: FloatArray

    @property
    def x(self) -> FloatArray:
        """The first coordinate."""
        return self.point[0]

    @property
    def y(self) -> FloatArray:
        """The second coordinate."""
        return self.point[1]

    @classmethod
    def none(cls, count: int, dimension: int) -> TargetFits:
        """Return as many problems that no start has been tried on."""

        def fill(value: float) -> FloatArray:
            return np.full(count, value)

        return cls(
            point=tuple(fill(np.nan) for _ in range(dimension)),
            cost=fill(np.inf),
            hessian=SymmetricMatrix.full(count, np.nan, dimension),
            converged=np.zeros(count, dtype=bool),
            runner_up=fill(np.inf),
        )


def fit_paths(rows: PathRows | SpacePaths, *, max_iterations: int = 100) -> TargetFits:
    """Fit every path by itself from the three intersections and between them, in its baseline frame.

    The chi-square of a direct path has as many degrees of freedom as it has spare scalars: one in the plane. One start
    is not enough: the likelihood of an indirect path has several minima. Points in the basin of a known minimum are
    skipped.
    """
    problem = TripletProblem.of_paths(rows)
    starts, crossing = _initial_estimates(rows, problem)
    held = problem.held
    if held is not None:
        starts, crossing = ((*start[:2], held.z_m) for start in starts), (*crossing[:2], held.z_m)
    descend = _descend_paths(rows, problem, max_iterations)
    best = _best_of(problem, starts, descend)
    # Where the lines cross is worth a start only if it is better than what the ellipse has led to.
    with ignoring_invalid():
        promising = problem.evaluate(*crossing).cost < best.cost
    open_rows = np.flatnonzero(promising & ~_leads_back(problem, best, crossing))
    if open_rows.size:
        _improve(best, open_rows, descend(open_rows, *rows_of(crossing, open_rows)))
    open_rows = np.flatnonzero(~best.converged)
    if open_rows.size:
        _improve(best, open_rows, _descend(problem, max_iterations)(open_rows, *rows_of(best.point, open_rows)))
    if held is None:
        _consider_suprema(best, rows, problem)
    return best


def _initial_estimates(
    rows: PathRows | SpacePaths, problem: TripletProblem
) -> tuple[Iterable[tuple[FloatArray, ...]], tuple[FloatArray, ...]]:
    """Return the initial estimates of paths, and where their lines cross."""
    if isinstance(rows, SpacePaths):
        return space_starts(rows, problem), space_crossings(rows, problem)
    return plane_starts(rows), plane_crossings(rows)


def _consider_suprema(best: TargetFits, rows: PathRows | SpacePaths, problem: TripletProblem) -> None:
    """Put targets on a node, or straight above one, where no other point costs less."""
    suprema: Iterable[tuple[IntArray, tuple[FloatArray, ...], FloatArray]] = (
        space_suprema(rows, problem, best.cost) if isinstance(rows, SpacePaths) else plane_suprema(rows)
    )
    for some, point, cost in suprema:
        better = cost <= best.cost[some]
        chosen = some[better]
        for mine, part in zip(best.point, point, strict=True):
            mine[chosen] = part[better]
        best.cost[chosen], best.converged[chosen] = cost[better], True


def _descend_paths(rows: PathRows | SpacePaths, problem: TripletProblem, max_iterations: int) -> Callable[..., Minimum]:
    """Return the descent of single paths, in coordinates in which their valleys are straight."""
    if problem.held is not None:
        return _descend(problem, max_iterations)

    def descend(open_rows: IntArray, *start: FloatArray) -> Minimum:
        some, frame = problem.take(open_rows), rows.frame
        if isinstance(frame, SpaceFrame):
            return minimize_space_paths(some, *rows_of((frame.length_m, frame.axes), open_rows), start, max_iterations)
        return minimize_paths(some, frame.length_m[open_rows], start, max_iterations)

    return descend


def _descend(problem: TripletProblem, max_iterations: int) -> Callable[..., Minimum]:
    """Return the descent in the coordinates of the targets; those whose height is held stay at it."""

    def descend(rows: IntArray, *start: FloatArray) -> Minimum:
        some = problem.take(rows)
        if some.held is None:
            return minimize(some, *start, max_iterations=max_iterations, patience=max_iterations)
        level = HeldTriplets(some, some.held.z_m)
        found = minimize(level, *start[:2], max_iterations=max_iterations, patience=max_iterations)
        return found._replace(point=(*found.point, some.held.z_m), hessian=with_height(found.hessian))

    return descend


def fit_snapshots(problem: TripletProblem, *proposed: FloatArray, max_iterations: int = 100) -> TargetFits:
    """Fit one target to all paths (B, K) of each snapshot, from the likeliest of the proposed targets (B, K)."""
    costs = _costs(problem, *proposed)
    order = np.argsort(np.where(np.isnan(costs), np.inf, costs), axis=1, kind="stable")[:, :_SNAPSHOT_STARTS]
    start = [np.take_along_axis(values, order, axis=1) for values in proposed]
    starts = (tuple(part[:, number] for part in start) for number in range(order.shape[1]))
    if problem.held is not None:
        level = problem.held.z_m
        starts = ((*start[:2], level) for start in starts)
    return _best_of(problem, starts, _descend(problem, max_iterations))


def _costs(problem: TripletProblem, *point: FloatArray) -> FloatArray:
    """Return the costs (B, K) of K points of each problem (B,), several points at a time where problems are few."""
    count, points = point[0].shape
    at_once = max(1, _COSTS_AT_ONCE // max(count, 1))
    costs = np.empty(point[0].shape)
    for first in range(0, points, at_once):
        some = slice(first, first + at_once)
        repeated = np.repeat(np.arange(count), costs[:, some].shape[1])
        there = problem.take(repeated).evaluate(*(part[:, some].ravel() for part in point))
        costs[:, some] = there.cost.reshape(count, -1)
    return costs


def _best_of(
    problem: TripletProblem, starts: Iterable[tuple[FloatArray, ...]], descend: Callable[..., Minimum]
) -> TargetFits:
    best: TargetFits | None = None
    for start in starts:
        best = best or TargetFits.none(start[0].shape[0], len(start))
        finite = np.logical_and.reduce([np.isfinite(part) for part in start])
        rows = np.flatnonzero(finite & ~_leads_back(problem, best, start))
        if rows.size:
            _improve(best, rows, descend(rows, *rows_of(start, rows)))
    return best or TargetFits.none(0, problem.dimension)


def _leads_back(problem: TripletProblem, best: TargetFits, start: tuple[FloatArray, ...]) -> BoolArray:
    known = best.converged
    if not known.any():
        return known
    with ignoring_overflow():
        apart = (part - own for part, own in zip(start, best.point, strict=True))
        rise = 0.5 * best.hessian.quadratic_form(*apart)
        there = problem.evaluate(*start).cost
        predicted = np.abs(there - best.cost - rise) <= _SAME_BASIN * rise
    return known & predicted


def _improve(best: TargetFits, rows: IntArray, found: Minimum) -> None:
    with ignoring_overflow():
        apart = found.hessian.quadratic_form(
            *(part - own[rows] for part, own in zip(found.point, best.point, strict=True))
        )
        other = found.converged & best.converged[rows] & (apart > 1e-6)
        # A point that has not settled counts only while no other has.
        better = (found.cost < best.cost[rows]) & (found.converged | ~best.converged[rows])
        better |= found.converged & ~best.converged[rows]
    loser = np.where(better, best.cost[rows], found.cost)
    best.runner_up[rows] = np.where(other, np.minimum(best.runner_up[rows], loser), best.runner_up[rows])
    chosen = rows[better]
    for mine, part in zip(best.point, found.point, strict=True):
        mine[chosen] = part[better]
    best.cost[chosen], best.converged[chosen] = found.cost[better], found.converged[better]
    best.hessian.put(chosen, found.hessian.at(better))
