"""The target that explains one path best, or all paths of a snapshot: fitted from several starts."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ignoring_invalid, ignoring_overflow
from nlosctl.geometry.blocks import rows_of
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.triplets import PathRows
from nlosctl.solvers.optimization.levenberg_marquardt import Minimum, minimize
from nlosctl.solvers.triplets.elliptic_coordinates import minimize_paths
from nlosctl.solvers.triplets.likelihood import TripletProblem

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


def fit_paths(rows: PathRows, *, max_iterations: int = 100) -> TargetFits:
    """Fit every path by itself from the three intersections and between them, in its baseline frame.

    The chi-square of a direct path has one degree of freedom. One start is not enough: the likelihood of an indirect
    path has several minima. Points in the basin of a known minimum are skipped.
    """
    problem = TripletProblem.of_paths(rows)
    baseline_m = rows.rays.baseline_m

    def descend(open_rows: IntArray, *start: FloatArray) -> Minimum:
        return minimize_paths(problem.take(open_rows), baseline_m[open_rows], start, max_iterations)

    best = _best_of(problem, _starts(rows), descend)
    # Where the lines cross is worth a start only if it is better than what the ellipse has led to.
    crossing = _crossings(rows)
    with ignoring_invalid():
        promising = problem.evaluate(*crossing).cost < best.cost
    open_rows = np.flatnonzero(promising & ~_leads_back(problem, best, crossing))
    if open_rows.size:
        _improve(best, open_rows, descend(open_rows, *rows_of(crossing, open_rows)))
    open_rows = np.flatnonzero(~best.converged)
    if open_rows.size:
        _improve(best, open_rows, _descend(problem, max_iterations)(open_rows, *rows_of(best.point, open_rows)))
    _consider_nodes(best, rows)
    return best


def _consider_nodes(best: TargetFits, rows: PathRows) -> None:
    """Put targets on a transmitter or receiver where no other point costs less, as for paths shorter than baselines.

    The likelihood has its supremum there without reaching it: the angle at that node is then any.
    """
    rays, half = rows.rays, 0.5 * rows.rays.baseline_m
    length = (rays.path_length_m - rays.baseline_m) / rows.path_length_std_m
    at_tx = np.arctan2(rays.doa_sine, -rays.doa_cosine) / rows.doa_std_rad
    at_rx = np.arctan2(rays.dod_sine, rays.dod_cosine) / rows.dod_std_rad
    for angle, x in ((at_tx, -half), (at_rx, half)):
        cost = 0.5 * (length * length + angle * angle)
        better = (cost <= best.cost) & (half > 0.0)
        best.x[better], best.y[better], best.cost[better] = x[better], 0.0, cost[better]
        best.converged[better] = True


def _descend(problem: TripletProblem, max_iterations: int) -> Callable[..., Minimum]:
    def descend(rows: IntArray, *start: FloatArray) -> Minimum:
        return minimize(problem.take(rows), *start, max_iterations=max_iterations, patience=max_iterations)

    return descend


def fit_snapshots(problem: TripletProblem, *proposed: FloatArray, max_iterations: int = 100) -> TargetFits:
    """Fit one target to all paths (B, K) of each snapshot, from the likeliest of the proposed targets (B, K)."""
    costs = _costs(problem, *proposed)
    order = np.argsort(np.where(np.isnan(costs), np.inf, costs), axis=1, kind="stable")[:, :_SNAPSHOT_STARTS]
    start = [np.take_along_axis(values, order, axis=1) for values in proposed]
    starts = (tuple(part[:, number] for part in start) for number in range(order.shape[1]))
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


def _starts(rows: PathRows) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield initial estimates (N,): the midpoint of points 2 and 3, and both.

    Where there is no ellipse they are on a longer one.
    """
    rays = rows.rays
    longer = replace(rays, path_length_m=np.maximum(rays.path_length_m, rays.baseline_m + rows.path_length_std_m))
    x2, y2, x3, y3 = (longer.coordinate(point, axis).value_m for point in (2, 3) for axis in ("x", "y"))
    yield 0.5 * (x2 + x3), 0.5 * (y2 + y3)
    yield x2, y2
    yield x3, y3


def _crossings(rows: PathRows) -> tuple[FloatArray, FloatArray]:
    """Return point 1 (N,); NaN where the lines are nearly parallel or meet behind, where it is uninformative."""
    rays = rows.rays
    x, y = rays.coordinate(1, "x").value_m, rays.coordinate(1, "y").value_m
    with ignoring_overflow():
        usable = ~rays.meets_behind & (x * x + y * y < 100.0 * rays.path_length_m**2)
    return np.where(usable, x, np.nan), np.where(usable, y, np.nan)


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
