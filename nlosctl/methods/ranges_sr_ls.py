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
from nlosctl.models.ranges.circles import RangeCircles, range_circles
from nlosctl.solvers.ranges.likelihood import SquaredRangeProblem
from nlosctl.solvers.ranges.optima import RangeOptimum, estimate_factors, finish_range_fix
from nlosctl.solvers.ranges.search import End, find_range_optima
from nlosctl.solvers.ranges.squared_ranges import fit_squared_ranges

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
    sensors' principal axis and from crossings of circles reach. The covariance is the sandwich: long ranges weigh more
    in the fit than they are worth.
    """
    circles = range_circles(batch)
    fit = fit_squared_ranges(circles.sensor, circles.squared_in_plane(), 1.0 / (circles.std_m * circles.std_m))
    one, other = find_range_optima(SquaredRangeProblem.of_rows(circles), circles, fit, _MAX_ITERATIONS)
    factors = None
    if batch.std == "unknown":
        factors = estimate_factors(circles, one, other, options.ambiguous_within, at_optimum=False)
        circles = replace(circles, std_m=factors.scaled(circles.std_m))
    return finish_range_fix(
        batch,
        circles,
        _with_covariance(circles, one),
        _with_covariance(circles, other),
        min_range_m=options.min_range_m,
        ambiguous_within=options.ambiguous_within,
        at_optimum=False,
        factors=factors,
    )


def _with_covariance(circles: RangeCircles, end: End) -> RangeOptimum:
    """Return the optimum with the covariance H^-1 (sum w^2 r^2 std^2 d d') H^-1, H = sum w d d', d = p - a."""
    away = [part[:, None] - own for part, own in zip(end.point, circles.sensor, strict=True)]
    range_m = reduce(np.hypot, away)
    if circles.height is not None:
        range_m = np.hypot(range_m, circles.height)
    hessian = SymmetricMatrix.gram(*(part / circles.std_m for part in away))
    middle = SymmetricMatrix.gram(*(part * range_m / circles.std_m for part in away))
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
)
