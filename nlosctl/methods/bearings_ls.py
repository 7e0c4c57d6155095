"""Least squares on bearings: the point nearest to all lines, in closed form."""

from __future__ import annotations

from dataclasses import dataclass

from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.methods import HALF_CHI_SQUARE, MethodSpec
from nlosctl.contract.options import option
from nlosctl.contract.results import Solution
from nlosctl.models.sight import linear_lines
from nlosctl.solvers.bearings.fix_status import finish_bearings_fix
from nlosctl.solvers.bearings.line_fits import (
    fit_least_squares,
    inflated_sandwich,
    sandwich_covariance,
    with_independent_errors,
)

__all__ = ["METHOD", "LeastSquaresOptions", "solve"]


@dataclass(frozen=True, kw_only=True)
class LeastSquaresOptions:
    """Parameters of ``ls``."""

    min_range_m: float = option(
        0.0, unit="m", minimum=0.0, meaning="a fix closer than this to a sensor that it uses is degenerate"
    )


def solve(batch: BearingBatch, options: LeastSquaresOptions) -> Solution:
    """Solve a batch by least squares; equations (18), (19) of Song, Willett, Zhou 2013.

    The covariance is the sandwich (U^T U)^-1 U^T S U (U^T U)^-1 with S = diag(std^2 spread^2), since the
    distances to the lines are not equally precise. On a circle the lines are those of (41)-(45).
    """
    lines = linear_lines(batch)
    fit = fit_least_squares(lines)
    lines = with_independent_errors(lines, fit)
    return finish_bearings_fix(
        batch,
        lines,
        fit.point,
        sandwich_covariance(lines, fit),
        fit.normal,
        inflated=inflated_sandwich(lines, fit),
        min_range_m=options.min_range_m,
    )


METHOD = MethodSpec(
    name="ls",
    kind="bearings",
    job="localize",
    summary="least squares: the point nearest to all lines, regardless of their distance and std",
    reference="Song, Willett, Zhou 2013, equations (18)-(19)",
    options=LeastSquaresOptions,
    solve=solve,
    cost=HALF_CHI_SQUARE,
    minimum_measurements=1,
    flags=("residual_rad", "residual_elevation_rad", "residual_m", "under_horizon"),
    flags_needing={"residual_m": "range_m", "residual_elevation_rad": "elevation_rad"},
    scales_std=True,
    dimensions=(2, 3),
)
