"""Least squares on ranges: maximum likelihood for Gaussian errors."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from nlosctl.arrays import FloatArray, Point
from nlosctl.contract.batches import RangeBatch
from nlosctl.contract.methods import LEAST_HALF_CHI_SQUARE, MethodSpec
from nlosctl.contract.options import option
from nlosctl.contract.results import Solution
from nlosctl.contract.tables import OF_MOVING
from nlosctl.errors import UsageError
from nlosctl.geometry.blocks import sum_measurements
from nlosctl.models.ranges.spheres import range_rows
from nlosctl.solvers.optimization.point_costs import cost_at_points, spread_m
from nlosctl.solvers.ranges.optima import estimate_factors, finish_range_fix, optimize_ranges, with_covariances
from nlosctl.solvers.tracking.moving_fix import solve_moving_ranges
from nlosctl.solvers.tracking.path_rows import PathRows
from nlosctl.solvers.tracking.trusted_rows import trusted_ranges

__all__ = ["METHOD", "ML", "RangeLeastSquaresOptions", "solve"]


@dataclass(frozen=True, kw_only=True)
class RangeLeastSquaresOptions:
    """Parameters of ``r-ls``."""

    min_range_m: float = option(
        0.0, unit="m", minimum=0.0, meaning="a fix closer than this to a sensor that it uses is degenerate"
    )
    ambiguous_within: float = option(
        4.0, unit="nats", minimum=0.0, meaning="a second optimum whose cost is at most this much higher is as good"
    )
    max_iterations: int = option(100, minimum=1, meaning="steps after which a snapshot counts as not converged")
    motion: Literal["none", "velocity"] = option(
        "none", meaning="motion of the source within a snapshot; velocity: one velocity, by the times of rows"
    )


def solve(batch: RangeBatch, options: RangeLeastSquaresOptions) -> Solution:
    """Solve a batch by least squares on ranges weighted by 1 / std^2; equation (8) of Liang, Zeng, Li.

    Levenberg-Marquardt from the squared-range fit, from its image in the sensors' principal axis and from the crossings
    of circles, in polar coordinates about the sensor of the surest range; with a row by a circle, from the crossings of
    pairs of rows. In space from the fit and its image in the plane that fits the sensors best, and with a measured
    height, which is one more row, from the fits at that height. The covariance is the inverse Fisher information at the
    estimate; where circles nearly touch, the second moment of the likelihood about it. With ``motion`` the unknowns are
    position and velocity: `solve_moving_ranges`.
    """
    if options.motion == "velocity":
        return solve_moving_ranges(
            batch,
            min_range_m=options.min_range_m,
            ambiguous_within=options.ambiguous_within,
            max_iterations=options.max_iterations,
        )
    rows = range_rows(batch)
    ends = optimize_ranges(rows, options.max_iterations, options.ambiguous_within)
    factors = None
    if batch.std == "unknown":
        factors = estimate_factors(rows, *ends, options.ambiguous_within)
        rows = replace(rows, std_m=factors.scaled(rows.std_m))
    one, other = with_covariances(rows, *ends, factors)
    return finish_range_fix(
        batch,
        rows,
        one,
        other,
        min_range_m=options.min_range_m,
        ambiguous_within=options.ambiguous_within,
        factors=factors,
    )


def _cost_at(batch: RangeBatch, options: RangeLeastSquaresOptions, points: Point, cell_m: float) -> FloatArray:
    """Return half the chi-square (B, P) at points, or of cells, whose extent widens the standard deviations."""
    if options.motion != "none":
        raise UsageError("a posterior is of sources at rest; leave out motion=velocity")
    std_m = np.hypot(batch.range_std_m, spread_m(cell_m))
    rows = range_rows(replace(batch, range_std_m=std_m))
    cost = cost_at_points(rows, rows.center, points, lambda part, at: part.half_chi_squares(*at))
    return np.asarray(cost + sum_measurements(np.log(std_m / batch.range_std_m))[:, None])


def _path_rows(batch: RangeBatch, options: RangeLeastSquaresOptions) -> PathRows:
    """Return the rows of a path; raises UsageError for another motion."""
    if options.motion != "none":
        raise UsageError("motion=velocity is for localize; a track has its own motion: leave it out")
    return trusted_ranges(batch)


METHOD = MethodSpec(
    name="r-ls",
    kind="ranges",
    job="localize",
    summary="least squares on ranges: maximum likelihood for Gaussian errors, all rows trusted",
    reference="Liang, Zeng, Li, equation (8)",
    options=RangeLeastSquaresOptions,
    solve=solve,
    cost=LEAST_HALF_CHI_SQUARE,
    minimum_measurements=2,
    flags=("residual_m",),
    scales_std=True,
    dimensions=(2, 3),
    reads=frozenset({"reflector"}),
    path_rows=_path_rows,
    estimate_columns_with=lambda options: OF_MOVING if options.motion == "velocity" else (),
)

ML = replace(METHOD, name="ml", summary="another name of r-ls: the default of localize", cost_at=_cost_at)
