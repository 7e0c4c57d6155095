"""Least squares on squared ranges: the global minimum, without a start."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import reduce

import numpy as np

from nlosctl.contract.batches import RangeBatch
from nlosctl.contract.methods import HALF_CHI_SQUARE, MethodSpec
from nlosctl.contract.options import option
from nlosctl.contract.results import Solution
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.ranges.spheres import RangeRows, range_rows
from nlosctl.solvers.optimization.two_optima import End
from nlosctl.solvers.ranges.likelihood import SquaredRangeProblem, fit_squares, mean_range_m
from nlosctl.solvers.ranges.optima import estimate_factors, finish_range_fix
from nlosctl.solvers.ranges.paired_estimates import RangeOptimum
from nlosctl.solvers.ranges.search import find_range_optima

__all__ = ["METHOD", "SquaredRangeOptions", "solve"]


_MAX_ITERATIONS = 100


@dataclass(frozen=True, kw_only=True)
class SquaredRangeOptions:
    """Parameters of ``sr-ls``."""

    min_range_m: float = option(
        0.0, unit="m", minimum=0.0, meaning="a fix closer than this to a sensor that it uses is degenerate"
    )
    ambiguous_within: float = option(
        4.0, unit="nats", minimum=0.0, meaning="a second optimum whose cost is at most this much higher is as good"
    )


def solve(batch: RangeBatch, options: SquaredRangeOptions) -> Solution:
    """Solve a batch by least squares on squared ranges weighted by 1 / std^2; equation (9) of Liang, Zeng, Li.

    The answer is the global minimum; its alternative is the best other minimum that descents from its image in the
    sensors' principal axis (in space, plane) and from crossings of circles reach. A measured height in space is one
    more row, in units of squared ranges. The covariance is the sandwich: long ranges weigh more in the fit than they
    are worth.
    """
    rows = range_rows(batch)
    one, other = find_range_optima(SquaredRangeProblem.of_rows(rows), rows, fit_squares(rows), _MAX_ITERATIONS)
    factors = None
    if batch.std == "unknown":
        factors = estimate_factors(rows, one, other, options.ambiguous_within, at_optimum=False)
        rows = replace(rows, std_m=factors.scaled(rows.std_m))
    return finish_range_fix(
        batch,
        rows,
        _with_covariance(rows, one),
        _with_covariance(rows, other),
        min_range_m=options.min_range_m,
        ambiguous_within=options.ambiguous_within,
        at_optimum=False,
        factors=factors,
    )


def _with_covariance(rows: RangeRows, end: End) -> RangeOptimum:
    """Return the optimum with the covariance H^-1 (sum w^2 r^2 std^2 d d') H^-1, H = sum w d d', d = p - a."""
    away = [part[:, None] - own for part, own in zip(end.point, rows.sensor, strict=True)]
    range_m = reduce(np.hypot, away)
    if rows.height is not None:
        range_m = np.hypot(range_m, rows.height)
    hessian = SymmetricMatrix.gram(*(part / rows.std_m for part in away))
    middle = SymmetricMatrix.gram(*(part * range_m / rows.std_m for part in away))
    if rows.level is not None:  # its row is (z - Z) / S times the mean range, of that std
        mean = mean_range_m(rows)
        weight = mean * rows.level.inverse_std
        hessian.diagonal[-1][:] += weight * weight
        middle.diagonal[-1][:] += weight * weight * mean * mean
    return RangeOptimum(end.point, hessian.inverse().congruence(middle), end.cost, end.converged)


METHOD = MethodSpec(
    name="sr-ls",
    kind="ranges",
    job="localize",
    summary="least squares on squared ranges: the exact global minimum, without an initial estimate",
    reference="Liang, Zeng, Li, equation (9); Beck, Stoica, Li 2008",
    options=SquaredRangeOptions,
    solve=solve,
    cost=HALF_CHI_SQUARE,
    minimum_measurements=2,
    flags=("residual_m",),
    scales_std=True,
    dimensions=(2, 3),
)
