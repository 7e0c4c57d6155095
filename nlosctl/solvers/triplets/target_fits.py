"""The target that explains one path best, or all paths of a snapshot: fitted from several starts."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ignoring_invalid, ignoring_overflow
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

    x: FloatArray
    y: FloatArray
    cost: FloatArray
    hessian: SymmetricMatrix
    converged: BoolArray
    runner_up: FloatArray

    @classmethod
    def none(cls, count: int) -> TargetFits:
        """Return as many problems that no start has been tried on."""

        def fill(value: float) -> FloatArray:
            return np.full(count, value)

        return cls(
            x=fill(np.nan),
            y=fill(np.nan),
            cost=fill(np.inf),
            hessian=SymmetricMatrix.full(count, np.nan),
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

    def descend(open_rows: IntArray, start_x: FloatArray, start_y: FloatArray) -> Minimum:
        return minimize_paths(problem.take(open_rows), baseline_m[open_rows], start_x, start_y, max_iterations)

    best = _best_of(problem, _starts(rows), descend)
    # Where the lines cross is worth a start only if it is better than what the ellipse has led to.
    x, y = _crossings(rows)
    with ignoring_invalid():
        promising = problem.evaluate(x, y).cost < best.cost
    open_rows = np.flatnonzero(promising & ~_leads_back(problem, best, x, y))
    if open_rows.size:
        _improve(best, open_rows, descend(open_rows, x[open_rows], y[open_rows]))
    open_rows = np.flatnonzero(~best.converged)
    if open_rows.size:
        start_x, start_y = best.x[open_rows], best.y[open_rows]
        _improve(best, open_rows, _descend_in_plane(problem, open_rows, start_x, start_y, max_iterations))
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


def _descend_in_plane(
    problem: TripletProblem, rows: IntArray, x: FloatArray, y: FloatArray, max_iterations: int
) -> Minimum:
    return minimize(problem.take(rows), x, y, max_iterations=max_iterations, patience=max_iterations)


def fit_snapshots(
    problem: TripletProblem, proposed_x: FloatArray, proposed_y: FloatArray, *, max_iterations: int = 100
) -> TargetFits:
    """Fit one target to all paths (B, K) of each snapshot, from the likeliest of the proposed targets (B, K)."""
    costs = _costs(problem, proposed_x, proposed_y)
    order = np.argsort(np.where(np.isnan(costs), np.inf, costs), axis=1, kind="stable")[:, :_SNAPSHOT_STARTS]
    start_x, start_y = (np.take_along_axis(values, order, axis=1) for values in (proposed_x, proposed_y))

    def descend(open_rows: IntArray, x: FloatArray, y: FloatArray) -> Minimum:
        return _descend_in_plane(problem, open_rows, x, y, max_iterations)

    starts = ((start_x[:, start], start_y[:, start]) for start in range(order.shape[1]))
    return _best_of(problem, starts, descend)


def _costs(problem: TripletProblem, x: FloatArray, y: FloatArray) -> FloatArray:
    """Return the costs (B, K) of K points of each problem (B,), several points at a time where problems are few."""
    count, points = x.shape
    at_once = max(1, _COSTS_AT_ONCE // max(count, 1))
    costs = np.empty(x.shape)
    for start in range(0, points, at_once):
        part = slice(start, start + at_once)
        repeated = np.repeat(np.arange(count), x[:, part].shape[1])
        costs[:, part] = problem.take(repeated).evaluate(x[:, part].ravel(), y[:, part].ravel()).cost.reshape(count, -1)
    return costs


def _best_of(
    problem: TripletProblem,
    starts: Iterable[tuple[FloatArray, FloatArray]],
    descend: Callable[[IntArray, FloatArray, FloatArray], Minimum],
) -> TargetFits:
    best: TargetFits | None = None
    for start_x, start_y in starts:
        best = best or TargetFits.none(start_x.shape[0])
        rows = np.flatnonzero(np.isfinite(start_x + start_y) & ~_leads_back(problem, best, start_x, start_y))
        if rows.size:
            _improve(best, rows, descend(rows, start_x[rows], start_y[rows]))
    return best or TargetFits.none(0)


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


def _leads_back(problem: TripletProblem, best: TargetFits, start_x: FloatArray, start_y: FloatArray) -> BoolArray:
    known = best.converged
    if not known.any():
        return known
    with ignoring_overflow():
        dx, dy = start_x - best.x, start_y - best.y
        rise = 0.5 * best.hessian.quadratic_form(dx, dy)
        there = problem.evaluate(start_x, start_y).cost
        predicted = np.abs(there - best.cost - rise) <= _SAME_BASIN * rise
    return known & predicted


def _improve(best: TargetFits, rows: IntArray, found: Minimum) -> None:
    with ignoring_overflow():
        dx, dy = found.x - best.x[rows], found.y - best.y[rows]
        apart = found.hessian.quadratic_form(dx, dy)
        other = found.converged & best.converged[rows] & (apart > 1e-6)
        # A point that has not settled counts only while no other has.
        better = (found.cost < best.cost[rows]) & (found.converged | ~best.converged[rows])
        better |= found.converged & ~best.converged[rows]
    loser = np.where(better, best.cost[rows], found.cost)
    best.runner_up[rows] = np.where(other, np.minimum(best.runner_up[rows], loser), best.runner_up[rows])
    chosen = rows[better]
    for name in ("x", "y", "cost", "converged"):
        getattr(best, name)[chosen] = getattr(found, name)[better]
    best.hessian.put(chosen, found.hessian.at(better))
