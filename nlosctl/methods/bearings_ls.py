"""Least squares on bearings: the point nearest to all lines, in closed form."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.methods import HALF_CHI_SQUARE, MethodSpec
from nlosctl.contract.options import option
from nlosctl.contract.results import Solution
from nlosctl.geometry.blocks import sum_measurements
from nlosctl.geometry.symmetric import Symmetric2x2
from nlosctl.models.bearings import SightLines, sight_lines
from nlosctl.solvers.fixes import finish_bearings_fix
from nlosctl.solvers.line_fits import LineFit, fit_least_squares

__all__ = ["METHOD", "LeastSquaresOptions", "solve"]


@dataclass(frozen=True, kw_only=True)
class LeastSquaresOptions:
    """Parameters of ``ls``."""

    min_range_m: float = option(
        0.0, unit="m", minimum=0.0, meaning="a fix closer than this to a sensor that it uses is degenerate"
    )


def solve(batch: BearingBatch, options: LeastSquaresOptions) -> Solution:
    """Solve a batch by least squares; equations (18), (19) of Song, Willett, Zhou 2013.

    The covariance is the sandwich (U^T U)^-1 U^T S U (U^T U)^-1 with S = diag(std^2 range^2), since the
    distances to the lines are not equally sure.
    """
    lines = sight_lines(batch)
    fit = fit_least_squares(lines)
    return finish_bearings_fix(
        batch, lines, fit.x, fit.y, _sandwich(lines, fit), fit.normal, min_range_m=options.min_range_m
    )


def _sandwich(lines: SightLines, fit: LineFit) -> Symmetric2x2:
    spread = lines.std_rad * lines.range_m(fit.x, fit.y)
    with np.errstate(invalid="ignore", over="ignore"):
        normal_x, normal_y = spread * lines.sine, -spread * lines.cosine
        middle = Symmetric2x2(
            sum_measurements(normal_x * normal_x),
            sum_measurements(normal_x * normal_y),
            sum_measurements(normal_y * normal_y),
        )
    return fit.normal.inverse().congruence(middle)


METHOD = MethodSpec(
    name="ls",
    kind="bearings",
    job="localize",
    summary="least squares: the point nearest to all lines, whatever their distance and std",
    reference="Song, Willett, Zhou 2013, equations (18)-(19)",
    options=LeastSquaresOptions,
    solve=solve,
    cost=HALF_CHI_SQUARE,
    minimum_measurements=2,
    flags=("residual_rad",),
)
