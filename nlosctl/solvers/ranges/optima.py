"""The optimum of ranges and its mirror image: which is the answer, and which status has it?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, StatusArray, ignoring_invalid
from nlosctl.contract.batches import RangeBatch
from nlosctl.contract.results import Estimates, Flags, Solution
from nlosctl.contract.statuses import Status
from nlosctl.geometry.blocks import max_measurements, sum_measurements
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.ranges.circles import RangeCircles
from nlosctl.solvers.optimization.unknown_std import StdFactors, marginal_cost
from nlosctl.solvers.ranges.bent_search import find_bent_optima
from nlosctl.solvers.ranges.likelihood import RangeProblem
from nlosctl.solvers.ranges.search import End, are_apart, find_range_optima, surest_pole
from nlosctl.solvers.ranges.squared_ranges import fit_squared_ranges
from nlosctl.solvers.ranges.valley import valley_covariance

__all__ = [
    "RangeOptimum",
    "estimate_factors",
    "finish_range_fix",
    "optimize_ranges",
    "paired_estimates",
    "with_covariances",
]


_RELATIVE_MINIMUM_RANGE = 1e-6
_ROUNDING = 1e-10
"""Determinants of covariances below this share of xx yy are rounding: the information was singular."""

_RIVAL = 10.0
"""An optimum this many nats costlier than the best is no rival: its covariance is the inverse information."""


@dataclass(frozen=True)
class RangeOptimum:
    """Points (B,) about the local origin, their covariance, what the search minimized there, and whether it settled."""

    point: tuple[FloatArray, ...]
    covariance: SymmetricMatrix
    cost: FloatArray
    converged: BoolArray


def optimize_ranges(circles: RangeCircles, max_iterations: int, infeasible_nats: float) -> tuple[End, End]:
    """Return the two best optima (8) of `find_range_optima`, or with rows by circles of `find_bent_optima`."""
    bent = circles.bent_snapshots()
    straight, rows = np.flatnonzero(~bent), np.flatnonzero(bent)
    if not rows.size:
        best, other = _straight_optima(circles, max_iterations)
    else:
        best, other = (End.missing(bent.size) for _ in range(2))
        parts = [(rows, find_bent_optima(circles.take(rows), max_iterations, infeasible_nats))]
        parts += [(straight, _straight_optima(circles.take(straight), max_iterations))] if straight.size else []
        for some, (mine, my_other) in parts:
            best.put(some, mine)
            other.put(some, my_other)
    return best, other


def with_covariances(
    circles: RangeCircles, best: End, other: End, factors: StdFactors | None = None
) -> tuple[RangeOptimum, RangeOptimum]:
    """Return optima (B,) of half the chi-square with their covariances.

    The inverse Fisher information at the optimum, or, without rows by a circle, `valley_covariance`. The std of the
    ``circles`` include the ``factors`` of unknown ones, the costs do not.
    """
    straight = np.flatnonzero(~circles.bent_snapshots())
    rival = _RIVAL if factors is None else _RIVAL * factors.squared[straight]
    with ignoring_invalid():
        rivals = straight[other.cost[straight] - best.cost[straight] <= rival]
    return _with_covariance(circles, best, straight), _with_covariance(circles, other, rivals)


def estimate_factors(
    circles: RangeCircles, one: End, other: End, infeasible_nats: float, *, at_optimum: bool = True
) -> StdFactors:
    """Return the factors of unknown std by the residuals of the better optimum; arguments of `finish_range_fix`."""
    degrees = circles.degrees_of_freedom
    swap = _second_is_better(circles, one, other, infeasible_nats, degrees)
    point = _where(swap, other.point, one.point)
    gain = 0.0 if at_optimum else _gauss_newton_gain(circles, point)
    return StdFactors.of(2.0 * _half_chi_square(circles, point, circles.residual_m(*point)) - gain, degrees)


def _straight_optima(circles: RangeCircles, max_iterations: int) -> tuple[End, End]:
    weight = 1.0 / (circles.std_m * circles.std_m)
    fit = fit_squared_ranges(circles.sensor, circles.squared_in_plane(), weight)
    return find_range_optima(RangeProblem.of_rows(circles), circles, fit, max_iterations)


def _with_covariance(circles: RangeCircles, end: End, rows: IntArray) -> RangeOptimum:
    """Return optima (B,) with their covariances, by `valley_covariance` in some ``rows``."""
    covariance = circles.information(end.x, end.y).inverse()
    part = circles.take(rows)
    wider = valley_covariance(part, surest_pole(part), end.x[rows], end.y[rows], covariance.take(rows))
    covariance.put(rows, wider)
    return RangeOptimum(end.point, covariance, end.cost, end.converged)


def finish_range_fix(
    batch: RangeBatch,
    circles: RangeCircles,
    one: RangeOptimum,
    other: RangeOptimum,
    *,
    min_range_m: float,
    ambiguous_within: float,
    at_optimum: bool = True,
    factors: StdFactors | None = None,
) -> Solution:
    """Return the solution of snapshots that have two optima each, which may coincide.

    The better is the answer; the other is its alternative where it is another point with an answer's status. Any other
    optimum makes the snapshot ambiguous where half its chi-square is within ``ambiguous_within`` nats. Sensors at a
    single point are too few. A point that the scene hides from a row is the answer, infeasible, only if it is better by
    more than ``ambiguous_within``, and makes no other ambiguous. The cost is half the chi-square of the range
    residuals. If the optima do not minimize it, ``at_optimum`` is false: the test of the fit is then that after a
    Gauss-Newton step. The std of the ``circles`` and the covariances include the ``factors`` of unknown ones, the
    costs do not; nats are then those of `marginal_cost`.
    """
    degrees = circles.degrees_of_freedom
    swap = _second_is_better(circles, one, other, ambiguous_within, None if factors is None else degrees)
    best, rest = _pick(swap, other, one), _pick(swap, one, other)
    status, other_status = (_judge(circles, optimum, min_range_m) for optimum in (best, rest))
    residual = circles.residual_m(*best.point)
    cost = _half_chi_square(circles, best.point, residual)
    other_cost = _half_chi_square(circles, rest.point, circles.residual_m(*rest.point))
    chi_squares, nats = (2.0 * cost, 2.0 * other_cost), (cost, other_cost)
    if factors is not None:
        cost, other_cost = cost * factors.squared, other_cost * factors.squared
        chi_squares = (np.full(batch.size, np.nan), np.full(batch.size, np.nan))
        nats = (marginal_cost(cost, degrees), marginal_cost(other_cost, degrees))
    elif not at_optimum:
        gains = (_gauss_newton_gain(circles, best.point), _gauss_newton_gain(circles, rest.point))
        chi_squares = (chi_squares[0] - gains[0], chi_squares[1] - gains[1])
    too_few = circles.single_origin()
    status[too_few] = other_status[too_few] = Status.TOO_FEW
    another = (status == Status.OK) & (other_status != Status.INFEASIBLE) & rest.converged
    another &= are_apart(best.point, rest.point, best.covariance)
    second = another & (other_status == Status.OK)
    with ignoring_invalid():
        ambiguous = another & (nats[1] - nats[0] <= ambiguous_within)
    status[ambiguous] = other_status[ambiguous] = Status.AMBIGUOUS
    if factors is not None:
        factors.mark(status)
        factors.mark(other_status)
    estimates = paired_estimates(
        np.flatnonzero(second),
        circles.center,
        (best, rest),
        (cost, other_cost),
        (status, other_status),
        chi_squares,
        batch.measurements,
        np.broadcast_to(np.asarray(degrees, dtype=np.int64), batch.size),
        factors,
    )
    flags = Flags.of_fixes(status, {"residual_m": residual}) if batch.want_flags else None
    return Solution(estimates=estimates, flags=flags)


def _second_is_better(
    circles: RangeCircles,
    one: End | RangeOptimum,
    other: End | RangeOptimum,
    infeasible_nats: float,
    degrees: IntArray | int | None,
) -> BoolArray:
    """Return where (B,) the second optimum is better; one that the scene hides from a row counts as that much worse.

    With the ``degrees`` of freedom of unknown std the costs are compared as `marginal_cost`.
    """
    cost, other_cost = one.cost, other.cost
    if degrees is not None:
        cost, other_cost = marginal_cost(cost, degrees), marginal_cost(other_cost, degrees)
    if circles.restricted:
        hidden, other_hidden = (circles.unseen(*part.point).any(axis=1) for part in (one, other))
        cost, other_cost = cost + infeasible_nats * hidden, other_cost + infeasible_nats * other_hidden
    with ignoring_invalid():
        swap: BoolArray = (other.converged == one.converged) & (other_cost < cost)
    return (other.converged & ~one.converged) | swap


def _pick(first: BoolArray, one: RangeOptimum, other: RangeOptimum) -> RangeOptimum:
    return RangeOptimum(
        _where(first, one.point, other.point),
        one.covariance.where(first, other.covariance),
        np.where(first, one.cost, other.cost),
        np.where(first, one.converged, other.converged),
    )


def _where(first: BoolArray, one: tuple[FloatArray, ...], other: tuple[FloatArray, ...]) -> tuple[FloatArray, ...]:
    return tuple(np.where(first, mine, theirs) for mine, theirs in zip(one, other, strict=True))


def _judge(circles: RangeCircles, optimum: RangeOptimum, min_range_m: float) -> StatusArray:
    """Return the status (B,): degenerate is a standard deviation beyond the farthest sensor, or a fix on a sensor.

    infeasible: the scene hides the fix from a row.
    """
    distance = circles.distance_m(*optimum.point)
    farthest, nearest = max_measurements(distance), -max_measurements(-distance)
    with ignoring_invalid():
        covariance = optimum.covariance
        proper = np.logical_and.reduce([variance > 0.0 for variance in covariance.diagonal])
        least = np.full(optimum.cost.shape, _ROUNDING)
        for variance in covariance.diagonal:
            least *= variance
        proper &= covariance.determinant > least
        uncertain = ~(proper & (covariance.trace <= farthest * farthest))
        on_sensor = nearest < np.maximum(min_range_m, _RELATIVE_MINIMUM_RANGE * farthest)
    status = np.full(optimum.cost.shape, Status.OK, dtype=np.uint8)
    if circles.restricted:
        status[circles.unseen(*optimum.point).any(axis=1)] = Status.INFEASIBLE
    status[~optimum.converged] = Status.NOT_CONVERGED
    status[uncertain | on_sensor] = Status.DEGENERATE
    return status


def _half_chi_square(circles: RangeCircles, point: tuple[FloatArray, ...], residual_m: FloatArray) -> FloatArray:
    scaled = residual_m / circles.std_m
    half = 0.5 * sum_measurements(scaled * scaled)
    return half if circles.level is None else half + 0.5 * circles.level.scaled_residual(point[-1]) ** 2


def _gauss_newton_gain(circles: RangeCircles, point: tuple[FloatArray, ...]) -> FloatArray:
    """Return by how much a Gauss-Newton step from points (B,) lowers the chi-square of the linearized residuals."""
    gradient = RangeProblem.of_rows(circles).evaluate(*point).gradient
    with ignoring_invalid():
        return circles.information(*point).inverse().quadratic_form(*gradient)


def paired_estimates(
    second: IntArray,
    center: tuple[FloatArray, ...],
    optima: tuple[RangeOptimum, RangeOptimum],
    costs: tuple[FloatArray, FloatArray],
    statuses: tuple[StatusArray, StatusArray],
    chi_squares: tuple[FloatArray, FloatArray],
    measurements: int,
    degrees_of_freedom: IntArray,
    factors: StdFactors | None = None,
) -> Estimates:
    """Return a row per snapshot (B,), and one more for each of the ``second`` snapshots, about local origins.

    ``factors`` are those of unknown standard deviations.
    """
    snapshots = np.arange(center[0].shape[0], dtype=np.int64)
    row = np.concatenate([snapshots, second])
    alternative = np.repeat([0, 1], [snapshots.shape[0], second.shape[0]])
    order = np.lexsort((alternative, row))
    row, alternative = row[order], alternative[order]

    def join(first: FloatArray, other: FloatArray) -> FloatArray:
        return np.concatenate([first, other[second]])[order]

    best, rest = optima
    status = np.concatenate([statuses[0], statuses[1][second]])[order]
    position = tuple(
        join(first, other) + origin[row] for first, other, origin in zip(best.point, rest.point, center, strict=True)
    )
    pairs = zip(best.covariance, rest.covariance, strict=True)
    return Estimates.of(
        status,
        position,
        SymmetricMatrix(*(join(first, other) for first, other in pairs)),
        join(*costs),
        measurements,
        row=row,
        alternative=alternative,
        chi_square=join(*chi_squares),
        degrees_of_freedom=degrees_of_freedom[row],
        columns={} if factors is None else factors.take(row).columns(status),
    )
