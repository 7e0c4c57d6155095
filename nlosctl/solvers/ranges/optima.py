"""The optimum of ranges and its mirror image: which is the answer, and which status has it?"""

from __future__ import annotations

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, StatusArray, ignoring_invalid
from nlosctl.contract.batches import ArrivalBatch, RangeBatch
from nlosctl.contract.results import Flags, Solution
from nlosctl.contract.statuses import Status
from nlosctl.errors import UsageError
from nlosctl.geometry.blocks import max_measurements, rows_in_order, rows_of, sum_measurements
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.arrival_offsets import offset_columns
from nlosctl.models.arrivals import ArrivalRows
from nlosctl.models.ranges.circles import RangeCircles
from nlosctl.models.ranges.spheres import RangeRows, RangeSpheres
from nlosctl.solvers.arrivals.likelihood import ArrivalProblem
from nlosctl.solvers.optimization.two_optima import End, are_apart, are_images
from nlosctl.solvers.optimization.unknown_std import HEIGHT_FAULT, StdFactors, marginal_cost
from nlosctl.solvers.ranges.bent_search import find_bent_optima
from nlosctl.solvers.ranges.likelihood import RangeProblem, fit_squares
from nlosctl.solvers.ranges.paired_estimates import RangeOptimum, paired_estimates
from nlosctl.solvers.ranges.search import find_range_optima, surest_pole
from nlosctl.solvers.ranges.valley import valley_covariance

__all__ = ["estimate_factors", "finish_range_fix", "optimize_ranges", "with_covariances"]


_RELATIVE_MINIMUM_RANGE = 1e-6
_ROUNDING = 1e-10
"""Determinants of covariances below this share of xx yy are rounding: the information was singular."""

_RIVAL = 10.0
"""An optimum this many nats costlier than the best is no rival: its covariance is the inverse information."""


Rows = RangeRows | ArrivalRows


def optimize_ranges(rows: RangeRows, max_iterations: int, infeasible_nats: float) -> tuple[End, End]:
    """Return the two best optima (8) of `find_range_optima`, or with rows by circles of `find_bent_optima`."""
    if isinstance(rows, RangeSpheres):
        return _straight_optima(rows, max_iterations)
    bent = rows.bent_snapshots()
    straight, curved = np.flatnonzero(~bent), np.flatnonzero(bent)
    if not curved.size:
        best, other = _straight_optima(rows, max_iterations)
    else:
        best, other = (End.missing(bent.size) for _ in range(2))
        parts = [(curved, find_bent_optima(rows.take(curved), max_iterations, infeasible_nats))]
        parts += [(straight, _straight_optima(rows.take(straight), max_iterations))] if straight.size else []
        for some, (mine, my_other) in parts:
            best.put(some, mine)
            other.put(some, my_other)
    return best, other


def with_covariances(
    rows: Rows, best: End, other: End, factors: StdFactors | None = None
) -> tuple[RangeOptimum, RangeOptimum]:
    """Return optima (B,) of half the chi-square with their covariances.

    The inverse Fisher information at the optimum, or, in the plane without rows by a circle, `valley_covariance`. The
    std of the ``rows`` include the ``factors`` of unknown ones, the costs do not.
    """
    if not isinstance(rows, RangeCircles):
        return _with_inverse_information(rows, best), _with_inverse_information(rows, other)
    straight = np.flatnonzero(~rows.bent_snapshots())
    rival = _RIVAL if factors is None else _RIVAL * factors.squared[straight]
    with ignoring_invalid():
        rivals = straight[other.cost[straight] - best.cost[straight] <= rival]
    return _with_covariance(rows, best, straight), _with_covariance(rows, other, rivals)


def _with_inverse_information(rows: Rows, end: End) -> RangeOptimum:
    """Return optima (B,) with the inverse information there, NaN where there is no optimum."""
    covariance = SymmetricMatrix.full(end.cost.shape, np.nan, len(end.point))
    some = np.flatnonzero(np.isfinite(end.point[0]))
    there, point = rows_in_order((rows, end.point), some, end.cost.size)
    covariance.put(some, there.information(*point).inverse())
    return RangeOptimum(end.point, covariance, end.cost, end.converged)


def estimate_factors(
    rows: Rows, one: End, other: End, infeasible_nats: float, *, at_optimum: bool = True
) -> StdFactors:
    """Return the factors of unknown std by the residuals of the better optimum; arguments of `finish_range_fix`.

    UsageError with a measured height or an uncertain speed, whose standard deviation is stated.
    """
    if isinstance(rows, ArrivalRows) and rows.speed is not None:
        raise UsageError(
            "`speed_std_m_s` needs stated standard deviations of the arrivals; state them, or leave it out for an "
            "exact speed."
        )
    if rows.level is not None:
        raise UsageError(HEIGHT_FAULT)
    degrees = rows.degrees_of_freedom
    swap = _second_is_better(rows, one, other, infeasible_nats, degrees)
    point = _where(swap, other.point, one.point)
    gain = 0.0 if at_optimum else _gauss_newton_gain(rows, point)
    return StdFactors.of(2.0 * _half_chi_square(rows, point, rows.residual_m(*point)) - gain, degrees)


def _straight_optima(rows: RangeRows, max_iterations: int) -> tuple[End, End]:
    return find_range_optima(RangeProblem.of_rows(rows), rows, fit_squares(rows), max_iterations)


def _with_covariance(circles: RangeCircles, end: End, rows: IntArray) -> RangeOptimum:
    """Return optima (B,) with their covariances, by `valley_covariance` in some ``rows``."""
    covariance = circles.information(end.x, end.y).inverse()
    part = circles.take(rows)
    wider = valley_covariance(part, surest_pole(part), end.x[rows], end.y[rows], covariance.take(rows))
    covariance.put(rows, wider)
    return RangeOptimum(end.point, covariance, end.cost, end.converged)


def finish_range_fix(
    batch: RangeBatch | ArrivalBatch,
    rows: Rows,
    one: RangeOptimum,
    other: RangeOptimum,
    *,
    min_range_m: float,
    ambiguous_within: float,
    at_optimum: bool = True,
    factors: StdFactors | None = None,
) -> Solution:
    """Return the solution of snapshots of ranges or arrivals that have two optima each, which may coincide.

    The better is the answer; the other is its alternative where it is another point with an answer's status. Any other
    optimum makes the snapshot ambiguous where half its chi-square is within ``ambiguous_within`` nats. Sensors at a
    single point are too few, as are fewer scalars than unknowns. In space, and with arrivals, images of each other that
    are one broad optimum are degenerate. A point that the scene hides from a row is the answer, infeasible, only if it
    is better by more than ``ambiguous_within``, and makes no other ambiguous. The cost is half the chi-square of the
    residuals. If the optima do not minimize it, ``at_optimum`` is false: the test of the fit is then that after a
    Gauss-Newton step. The std of the ``rows`` and the covariances include the ``factors`` of unknown ones, the
    costs do not; nats are then those of `marginal_cost`.
    """
    degrees = rows.degrees_of_freedom
    swap = _second_is_better(rows, one, other, ambiguous_within, None if factors is None else degrees)
    best, rest = _pick(swap, other, one), _pick(swap, one, other)
    status, other_status = (_judge(rows, optimum, min_range_m) for optimum in (best, rest))
    residual = rows.residual_m(*best.point)
    cost, other_cost = _half_chi_square(rows, best.point, residual), np.full(batch.size, np.nan)
    exists = np.flatnonzero(np.isfinite(rest.point[0]))
    there, point = rows_in_order((rows, rest.point), exists, batch.size)
    other_cost[exists] = _half_chi_square(there, point, there.residual_m(*point))
    chi_squares, nats = (2.0 * cost, 2.0 * other_cost), (cost, other_cost)
    if isinstance(rows, ArrivalRows):
        contradictory = rows.contradictory(cost)
        status[contradictory] = other_status[contradictory] = Status.DEGENERATE
    if factors is not None:
        cost, other_cost = cost * factors.squared, other_cost * factors.squared
        chi_squares = (np.full(batch.size, np.nan), np.full(batch.size, np.nan))
        nats = (marginal_cost(cost, degrees), marginal_cost(other_cost, degrees))
    elif not at_optimum:
        gains = (_gauss_newton_gain(rows, best.point), _gauss_newton_gain(rows, rest.point))
        chi_squares = (chi_squares[0] - gains[0], chi_squares[1] - gains[1])
    too_few = rows.single_origin() | (degrees < 0)
    status[too_few] = other_status[too_few] = Status.TOO_FEW
    another = (status == Status.OK) & (other_status != Status.INFEASIBLE) & rest.converged
    another &= are_apart(best.point, rest.point, best.covariance)
    second = another & (other_status == Status.OK)
    with ignoring_invalid():
        ambiguous = another & (nats[1] - nats[0] <= ambiguous_within)
    status[ambiguous] = other_status[ambiguous] = Status.AMBIGUOUS
    if not isinstance(rows, RangeCircles):
        pairs = np.flatnonzero(ambiguous)
        merged = pairs[are_images(rows.take(pairs), rows_of(best.point, pairs), rows_of(rest.point, pairs))]
        status[merged], second[merged] = Status.DEGENERATE, False
    if factors is not None:
        factors.mark(status)
        factors.mark(other_status)
    others = np.flatnonzero(second)
    columns: tuple[dict[str, FloatArray], dict[str, FloatArray]] = ({}, {})
    if isinstance(rows, ArrivalRows):
        apart, covariance = rows_of(rest.point, others), rest.covariance.take(others)
        columns = (
            offset_columns(rows, best.point, best.covariance),
            offset_columns(rows.take(others), apart, covariance),
        )
    estimates = paired_estimates(
        others,
        rows,
        (best, rest),
        (cost, other_cost),
        (status, other_status),
        chi_squares,
        batch.measurements,
        np.broadcast_to(np.asarray(degrees, dtype=np.int64), batch.size),
        factors,
        columns,
    )
    flags = Flags.of_fixes(status, {"residual_m": residual}) if batch.want_flags else None
    return Solution(estimates=estimates, flags=flags)


def _second_is_better(
    rows: Rows,
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
    if rows.restricted:
        hidden, other_hidden = (rows.unseen(*part.point).any(axis=1) for part in (one, other))
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


def _judge(rows: Rows, optimum: RangeOptimum, min_range_m: float) -> StatusArray:
    """Return the status (B,): degenerate is a standard deviation beyond the farthest sensor, or a fix on a sensor.

    infeasible: the scene hides the fix from a row.
    """
    status = np.full(optimum.cost.shape, Status.DEGENERATE, dtype=np.uint8)
    exists = np.flatnonzero(np.isfinite(optimum.point[0]))
    rows, optimum = rows_in_order((rows, optimum), exists, status.size)
    distance = rows.distance_m(*optimum.point)
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
    there = np.full(exists.shape, Status.OK, dtype=np.uint8)
    if rows.restricted:
        there[rows.unseen(*optimum.point).any(axis=1)] = Status.INFEASIBLE
    there[~optimum.converged] = Status.NOT_CONVERGED
    there[uncertain | on_sensor] = Status.DEGENERATE
    status[exists] = there
    return status


def _half_chi_square(rows: Rows, point: tuple[FloatArray, ...], residual_m: FloatArray) -> FloatArray:
    scaled = residual_m / rows.std_m
    half = 0.5 * sum_measurements(scaled * scaled)
    if isinstance(rows, ArrivalRows) and rows.speed is not None:
        half = half + 0.5 * rows.speed.scaled_error(scaled) ** 2
    return half if rows.level is None else half + 0.5 * rows.level.scaled_residual(point[-1]) ** 2


def _gauss_newton_gain(rows: Rows, point: tuple[FloatArray, ...]) -> FloatArray:
    """Return by how much a Gauss-Newton step from points (B,) lowers the chi-square of the linearized residuals."""
    problem = ArrivalProblem.of_rows(rows) if isinstance(rows, ArrivalRows) else RangeProblem.of_rows(rows)
    gradient = problem.evaluate(*point).gradient
    with ignoring_invalid():
        return rows.information(*point).inverse().quadratic_form(*gradient)
