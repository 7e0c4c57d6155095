"""Least squares on squared range differences: the global minimum, without a start."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from nlosctl.arrays import ignoring_division, ignoring_invalid
from nlosctl.contract.batches import ArrivalBatch
from nlosctl.contract.methods import HALF_CHI_SQUARE, MethodSpec
from nlosctl.contract.options import option
from nlosctl.contract.results import Solution
from nlosctl.contract.tables.arrivals import OFFSET
from nlosctl.geometry.blocks import sum_measurements
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.arrivals import ArrivalRows, arrival_rows
from nlosctl.solvers.arrivals.closed_forms import initial_estimates
from nlosctl.solvers.arrivals.far_field import without_open_distance
from nlosctl.solvers.arrivals.likelihood import AT_INFINITY
from nlosctl.solvers.arrivals.squared_differences import DifferenceFit, squared_differences
from nlosctl.solvers.optimization.two_optima import End, find_best_two, nearer_first
from nlosctl.solvers.ranges.optima import estimate_factors, finish_range_fix
from nlosctl.solvers.ranges.paired_estimates import RangeOptimum

__all__ = ["METHOD", "SquaredDifferenceOptions", "solve"]

_MAX_ITERATIONS = 100

_MISSED = 1e-3
"""A stationary point is better than the best end if its cost is less by more than this share."""


@dataclass(frozen=True, kw_only=True)
class SquaredDifferenceOptions:
    """Parameters of ``srd-ls``."""

    min_range_m: float = option(
        0.0, unit="m", minimum=0.0, meaning="a fix closer than this to a sensor that it uses is degenerate"
    )
    ambiguous_within: float = option(
        2.0, unit="nats", minimum=0.0, meaning="a second optimum whose cost is at most this much higher is as good"
    )


def solve(batch: ArrivalBatch, options: SquaredDifferenceOptions) -> Solution:
    """Solve a batch by least squares on squared range differences; Beck, Stoica, Li 2008.

    The reference is the row of the smallest std. The rows weigh equally; a measured height is one more row. The answer
    is the global minimum, the best of descents from all stationary points and from the closed forms of
    `initial_estimates`, its alternative the best other one; where a stationary point is better, the minimum is too far
    away to be found. The covariance is the sandwich, which counts the error of the reference in all rows.
    """
    rows = arrival_rows(batch)
    fit = squared_differences(rows)
    points = [tuple(part[k] for part in fit.points) for k in range(fit.points[0].shape[0])]
    points += initial_estimates(rows)
    one, other = find_best_two(fit.problem, rows, points, _MAX_ITERATIONS, far_m=AT_INFINITY * rows.size_m())
    one, other = nearer_first(one, other)
    least = np.fmin.reduce([fit.problem.half_squares(*point) for point in points])
    with ignoring_invalid():
        missed = one.cost > least + _MISSED * (1.0 + least)
    one, other = (replace(end, converged=end.converged & ~missed) for end in (one, other))
    factors = None
    if batch.std == "unknown":
        factors = estimate_factors(rows, one, other, options.ambiguous_within, at_optimum=False)
        rows = replace(rows, std_m=factors.scaled(rows.std_m))
    return finish_range_fix(
        batch,
        rows,
        without_open_distance(rows, _with_covariance(rows, fit, one)),
        without_open_distance(rows, _with_covariance(rows, fit, other)),
        min_range_m=options.min_range_m,
        ambiguous_within=options.ambiguous_within,
        at_optimum=False,
        factors=factors,
    )


def _with_covariance(rows: ArrivalRows, fit: DifferenceFit, end: End) -> RangeOptimum:
    """Return the optimum with the covariance H^-1 (sum s_i^2 v_i v_i') H^-1, H = sum J_i J_i'.

    Row i of slope J_i changes by -2 |x - a_i| per metre of its own arrival, and by the opposite of the reference's: v_i
    is that times J_i, of the reference minus the sum of the others.
    """
    every, count = np.arange(rows.std_m.shape[0]), rows.std_m.shape[1]
    slopes = fit.problem.slopes(*end.point)
    change = -2.0 * rows.distance_m(*end.point) / fit.scale_m[:, None]
    pulls = []
    for slope in slopes:
        pull = slope[:, :count] * change
        pull[every, fit.reference] = 0.0
        pull[every, fit.reference] = -sum_measurements(pull)
        pulls.append(pull * rows.std_m)
    with ignoring_division():
        hessian = SymmetricMatrix.gram(*slopes)
        middle = SymmetricMatrix.gram(*pulls)
        if rows.level is not None:
            middle.diagonal[-1][:] += rows.level.inverse_std * rows.level.inverse_std
        return RangeOptimum(end.point, hessian.inverse().congruence(middle), end.cost, end.converged)


METHOD = MethodSpec(
    name="srd-ls",
    kind="arrivals",
    job="localize",
    summary="least squares on squared range differences: the exact global minimum, without an initial estimate",
    reference="Beck, Stoica, Li 2008, Section III",
    options=SquaredDifferenceOptions,
    solve=solve,
    cost=HALF_CHI_SQUARE,
    minimum_measurements=2,
    flags=("residual_m",),
    estimate_columns=tuple(column.name for column in OFFSET),
    scales_std=True,
    dimensions=(2, 3),
)
