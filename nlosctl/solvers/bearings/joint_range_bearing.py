"""Maximum likelihood of bearings and ranges together, all rows trusted."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from nlosctl.arrays import FloatArray, IntArray, StatusArray, ignoring_invalid, ignoring_overflow
from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.results import Solution, has_position
from nlosctl.contract.statuses import Status
from nlosctl.geometry.blocks import RowBlock
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.bearings import SightLines
from nlosctl.models.space.lines import SpaceLines
from nlosctl.solvers.bearings.fix_status import bearing_flags, judge_fixes, mark_crossings_behind
from nlosctl.solvers.bearings.line_fits import inflate_near_sensors
from nlosctl.solvers.bearings.ranged_search import THOROUGH_UP_TO, mean_end, starting_points, surest_sensor
from nlosctl.solvers.bearings.row_terms import DirectBearings
from nlosctl.solvers.optimization.problem import Evaluation
from nlosctl.solvers.optimization.two_optima import are_apart
from nlosctl.solvers.optimization.unknown_std import StdFactors, marginal_cost
from nlosctl.solvers.ranges.paired_estimates import RangeOptimum, paired_estimates
from nlosctl.solvers.ranges.search import find_two_optima

__all__ = ["RangedBearingProblem", "count_scalars", "fit_ranged_bearings", "range_columns", "ranged_lines"]

_UNKNOWNS = 2


def range_columns(batch: BearingBatch, use_ranges: bool) -> tuple[FloatArray, FloatArray] | None:
    """Return range and standard deviation (B, K) in metres, both NaN in rows without; None where no row has them."""
    if not use_ranges or batch.range_m is None or batch.range_std_m is None:
        return None
    known = np.isfinite(batch.range_m) & np.isfinite(batch.range_std_m)
    if not known.any():
        return None
    return np.where(known, batch.range_m, np.nan), np.where(known, batch.range_std_m, np.nan)


def count_scalars(batch: BearingBatch, range_m: FloatArray | None) -> IntArray:
    """Return the number of scalars (B,) that rows measure: a bearing each, and the ranges (B, K) that are not NaN."""
    bearings = np.full(batch.size, batch.measurements, dtype=np.int64)
    return bearings if range_m is None else bearings + np.count_nonzero(np.isfinite(range_m), axis=1)


def ranged_lines(
    lines: SpaceLines, range_m: FloatArray, std_m: FloatArray, *, lognormal: bool
) -> tuple[SpaceLines, list[tuple[FloatArray, ...]], SymmetricMatrix]:
    """Return rays in space with ranges (B, K), NaN in rows without one, as further scalars.

    With them initial estimates, the ends of the rays at their ranges (their mean where there are many), and a matrix
    (B,) in place of that of the lines' normals: ranges determine a point where lines are parallel.
    """
    ends = lines.ends(range_m)
    if range_m.shape[1] > THOROUGH_UP_TO:
        known = np.isfinite(ends[0])
        with ignoring_invalid():
            count = known.sum(axis=1, keepdims=True)
            x, y, z = (np.where(known, part, 0.0).sum(axis=1, keepdims=True) / count for part in ends)
            ends = x, y, z
    starts = [tuple(part[:, k] for part in ends)[: lines.unknowns] for k in range(ends[0].shape[1])]
    whole = SymmetricMatrix.full(range_m.shape[0], 0.0, lines.unknowns).add_to_diagonal(np.ones(range_m.shape[0]))
    return lines.with_ranges(range_m, std_m, lognormal=lognormal), starts, whole


@dataclass(frozen=True)
class RangedBearingProblem(RowBlock):
    """Half the chi-square of bearings and ranges, as a function of a point about the local origin."""

    rows: DirectBearings

    def evaluate(self, x: FloatArray, y: FloatArray) -> Evaluation:
        """Return cost, gradient and second derivatives, exact or, where not positive, Gauss-Newton's."""
        cost, gradient = np.zeros(x.shape), (np.zeros(x.shape), np.zeros(x.shape))
        exact, gauss = SymmetricMatrix.full(x.shape, 0.0), SymmetricMatrix.full(x.shape, 0.0)
        with ignoring_overflow():
            for k in range(self.rows.weight.shape[1]):
                row = self.rows.terms(k, x, y)
                cost += row.half_chi_square
                for total, slope in zip(gradient, row.gradient, strict=True):
                    total += slope
                exact += row.hessian
                gauss += row.gauss
        return Evaluation.of_newton(cost, gradient, exact, gauss)

    def half_chi_squares(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return half the chi-square (B, P) at points (B, P)."""
        total = np.zeros_like(x)
        with ignoring_overflow():
            for k in range(self.rows.weight.shape[1]):
                total += self.rows.values(k, x, y)
        return total

    def information(self, x: FloatArray, y: FloatArray, extra_m2: FloatArray | None = None) -> SymmetricMatrix:
        """Return the Fisher information (B,) of bearings and ranges together at points (B,).

        ``extra_m2`` (B,) is added to the squared range of each bearing, whose information is across its ray.
        """
        total, lines = SymmetricMatrix.full(x.shape, 0.0), self.rows.lines
        with ignoring_overflow():
            for k in range(self.rows.weight.shape[1]):
                row = self.rows.terms(k, x, y).gauss
                if extra_m2 is not None:
                    dx, dy = x - lines.origin_x[:, k], y - lines.origin_y[:, k]
                    squared = dx * dx + dy * dy
                    across = row.xx * dy * dy - 2.0 * row.xy * dx * dy + row.yy * dx * dx
                    lost = extra_m2 / (squared + extra_m2) * across / (squared * squared)
                    row += SymmetricMatrix.outer(-dy, dx, weight=-lost)
                total += row
        return total

    def covariance(self, x: FloatArray, y: FloatArray, *, stated: bool) -> SymmetricMatrix:
        """Return the covariance (B,) of fixes at points (B,): the inverse information, wider near a sensor of several.

        A single row's range is measured by itself: its covariance is calibrated as it is. Standard deviations that are
        not ``stated`` have the inverse information, see docs/unknown-std.md.
        """
        plain = self.information(x, y).inverse()
        if self.rows.weight.shape[1] == 1 or not stated:
            return plain

        def inflated(rows: IntArray, extra_m2: FloatArray) -> SymmetricMatrix:
            return self.take(rows).information(x[rows], y[rows], extra_m2).inverse()

        nearest_m = self.rows.lines.ray_residuals(x, y).nearest_m
        return inflate_near_sensors(plain, nearest_m, inflated)


def fit_ranged_bearings(
    batch: BearingBatch,
    lines: SightLines,
    start_x: FloatArray,
    start_y: FloatArray,
    ranges: tuple[FloatArray, FloatArray],
    *,
    lognormal: bool,
    min_range_m: float,
    ambiguous_within: float,
    max_iterations: int,
) -> Solution:
    """Return the maximum-likelihood solution of rows with bearings and, where not NaN, ranges (B, K).

    The better of the two best optima that `find_two_optima` reaches from ``start`` (B,) (of the bearings alone), the
    mean of the rays' ends, weighted by their spread, and `starting_points`; the other is the alternative. The
    covariance is the inverse of the joint information, the cost half the chi-square.
    """
    smallest = np.full(start_x.shape, np.finfo(np.float64).tiny)
    problem = RangedBearingProblem(DirectBearings.of(lines, smallest, *ranges, lognormal=lognormal))
    x, y = mean_end(lines, *ranges)
    x, y = np.where(np.isfinite(x), x, start_x), np.where(np.isfinite(y), y, start_y)
    pole = surest_sensor(lines, *ranges, x, y)
    points = tuple(
        np.concatenate([[start], part])
        for start, part in zip((start_x, start_y), starting_points(lines, *ranges), strict=True)
    )
    thorough = batch.measurements <= THOROUGH_UP_TO
    ends = find_two_optima(problem, problem, pole, (x, y), (points[0], points[1]), max_iterations, thorough=thorough)
    covariances = (problem.covariance(end.x, end.y, stated=batch.std == "stated") for end in ends)
    best, other = (
        RangeOptimum(end.point, covariance, end.cost, end.converged)
        for end, covariance in zip(ends, covariances, strict=True)
    )
    scalars = count_scalars(batch, ranges[0])
    costs, chi_squares, factors = (best.cost, other.cost), (2.0 * best.cost, 2.0 * other.cost), None
    if batch.std == "unknown":
        factors = StdFactors.of(2.0 * best.cost, scalars - _UNKNOWNS)
        best, other = (replace(part, covariance=part.covariance * factors.squared) for part in (best, other))
        lines = replace(lines, std_rad=factors.scaled(lines.std_rad))
        chi_squares = (np.full(batch.size, np.nan), np.full(batch.size, np.nan))
        costs = (marginal_cost(best.cost, scalars - _UNKNOWNS), marginal_cost(other.cost, scalars - _UNKNOWNS))
    status, other_status = (_judge(lines, optimum, scalars, min_range_m) for optimum in (best, other))
    another = (status == Status.OK) & other.converged & are_apart(best.point, other.point, best.covariance)
    second = another & (other_status == Status.OK)
    with ignoring_invalid():
        ambiguous = another & (costs[1] - costs[0] <= ambiguous_within)
    status[ambiguous] = other_status[ambiguous] = Status.AMBIGUOUS
    if factors is not None:
        factors.mark(status)
        factors.mark(other_status)
    estimates = paired_estimates(
        np.flatnonzero(second),
        lines,
        (best, other),
        (best.cost, other.cost),
        (status, other_status),
        chi_squares,
        batch.measurements,
        scalars - _UNKNOWNS,
        factors,
    )
    flags = bearing_flags(batch, lines, status, *best.point) if batch.want_flags else None
    return Solution(estimates=estimates, flags=flags)


def _judge(lines: SightLines, optimum: RangeOptimum, scalars: IntArray, min_range_m: float) -> StatusArray:
    x, y = optimum.point
    rays = lines.ray_residuals(x, y)
    status = judge_fixes(lines, (x, y), rays, optimum.covariance, min_range_m)
    status[~optimum.converged & has_position(status)] = Status.NOT_CONVERGED
    mark_crossings_behind(status, lines, rays.chi_square)
    status[scalars < _UNKNOWNS] = Status.TOO_FEW
    return status
