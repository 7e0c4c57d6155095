"""Maximum likelihood of bearings and ranges together, all rows trusted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ignoring_division, ignoring_invalid, ignoring_overflow
from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.results import Estimates, Solution, has_position
from nlosctl.contract.statuses import Status
from nlosctl.geometry.blocks import RowBlock, sum_measurements
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.bearings import SightLines
from nlosctl.solvers.bearings.fix_status import bearing_flags, judge_fixes, mark_crossings_behind
from nlosctl.solvers.bearings.ray_crossings import end_rays
from nlosctl.solvers.bearings.row_terms import DirectBearings
from nlosctl.solvers.optimization.levenberg_marquardt import Minimum, minimize
from nlosctl.solvers.optimization.problem import Evaluation

__all__ = ["RangedBearingProblem", "count_scalars", "fit_ranged_bearings", "range_columns"]

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

    def information(self, x: FloatArray, y: FloatArray) -> SymmetricMatrix:
        """Return the Fisher information (B,) of bearings and ranges together at points (B,)."""
        total = SymmetricMatrix.full(x.shape, 0.0)
        with ignoring_overflow():
            for k in range(self.rows.weight.shape[1]):
                total += self.rows.terms(k, x, y).gauss
        return total


def fit_ranged_bearings(
    batch: BearingBatch,
    lines: SightLines,
    start_x: FloatArray,
    start_y: FloatArray,
    ranges: tuple[FloatArray, FloatArray],
    *,
    lognormal: bool,
    min_range_m: float,
    max_iterations: int,
) -> Solution:
    """Return the maximum-likelihood solution of rows with bearings and, where not NaN, ranges (B, K).

    The better end of two searches: from ``start`` (B,) (of the bearings alone), and from the mean of the rays' ends,
    weighted by their spread. The covariance is the inverse of the joint information, the cost half the chi-square.
    """
    smallest = np.full(start_x.shape, np.finfo(np.float64).tiny)
    problem = RangedBearingProblem(DirectBearings.of(lines, smallest, *ranges, lognormal=lognormal))
    first = minimize(problem, start_x, start_y, max_iterations=max_iterations)
    second = minimize(problem, *_mean_end(lines, *ranges), max_iterations=max_iterations)
    best = _better(first, second)
    x, y = np.where(best, second.x, first.x), np.where(best, second.y, first.y)
    converged = np.where(best, second.converged, first.converged)
    covariance = problem.information(x, y).inverse()
    rays = lines.ray_residuals(x, y)
    status = judge_fixes(lines, x, y, rays, covariance, min_range_m)
    status[~converged & has_position(status)] = Status.NOT_CONVERGED
    mark_crossings_behind(status, lines, rays.chi_square)
    scalars = count_scalars(batch, ranges[0])
    status[scalars < _UNKNOWNS] = Status.TOO_FEW
    position = (x + lines.center_x, y + lines.center_y)
    cost = np.where(best, second.cost, first.cost)
    estimates = Estimates.of(
        status,
        position,
        covariance,
        cost,
        batch.measurements,
        chi_square=2.0 * cost,
        degrees_of_freedom=scalars - _UNKNOWNS,
    )
    if not batch.want_flags:
        return Solution(estimates=estimates)
    return Solution(estimates=estimates, flags=bearing_flags(batch, lines, status, x, y))


def _mean_end(lines: SightLines, range_m: FloatArray, std_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    ends = end_rays(lines, range_m)
    spread = lines.std_rad * range_m
    weight = np.where(ends.valid, 1.0 / (spread * spread + std_m * std_m), 0.0)
    with ignoring_division():
        total = sum_measurements(weight)
        x = sum_measurements(np.where(ends.valid, weight * ends.x, 0.0)) / total
        y = sum_measurements(np.where(ends.valid, weight * ends.y, 0.0)) / total
    return x, y


def _better(first: Minimum, second: Minimum) -> BoolArray:
    """Return where the second end is better: it settled and the other did not, or its cost is less."""
    with ignoring_invalid():
        cheaper: BoolArray = (second.converged == first.converged) & (second.cost < first.cost)
    return (second.converged & ~first.converged) | cheaper
