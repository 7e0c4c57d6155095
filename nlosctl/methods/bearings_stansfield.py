"""Stansfield's estimator on bearings: one weighted linear fit, close to maximum likelihood; and focused on circles."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.methods import HALF_CHI_SQUARE, MethodSpec
from nlosctl.contract.options import option
from nlosctl.contract.results import Solution
from nlosctl.geometry.blocks import max_measurements
from nlosctl.models.sight import Sight, linear_lines
from nlosctl.solvers.bearings.fix_status import finish_bearings_fix
from nlosctl.solvers.bearings.line_fits import (
    LineFit,
    WeightedLines,
    fit_least_squares,
    fit_weighted,
    inflated_sandwich,
    sandwich_covariance,
    with_independent_errors,
)

__all__ = ["FOCUSED", "METHOD", "StansfieldOptions", "solve", "solve_focused"]


@dataclass(frozen=True, kw_only=True)
class StansfieldOptions:
    """Parameters of ``stansfield`` and ``stansfield-focused``."""

    min_range_m: float = option(
        0.0, unit="m", minimum=0.0, meaning="a fix closer than this to a sensor that it uses is degenerate"
    )


_LEAST_WIDTH = 1e-7
"""Least width of a line, in units of the largest."""


def solve(batch: BearingBatch, options: StansfieldOptions) -> Solution:
    """Solve a batch by Stansfield's estimator; equations (10)-(15) of Song, Willett, Zhou 2013.

    The distances in the weights are those of the least-squares fix: one pass, not iterated. The covariance is the
    sandwich of these weights and the errors of the lines at the fix, std times the spread of the ray tubes.
    """
    return _solve(batch, options, focused=False)


def solve_focused(batch: BearingBatch, options: StansfieldOptions) -> Solution:
    """Solve a batch by equations (10)-(15) of Song, Willett, Zhou 2013, with the true spread of the ray tubes.

    On a circle the error of a line is not std times distance, but std times the width of the ray tube per radian,
    l1 + l2 - 2 l1 l2 / (R cos i) along the measured ray. The widths are those at the least-squares fix, one pass. The
    covariance is the sandwich of these weights and the widths at the fix. Without circle rows it is ``stansfield``.
    """
    return _solve(batch, options, focused=True)


def _solve(batch: BearingBatch, options: StansfieldOptions, *, focused: bool) -> Solution:
    """Solve a batch by a weighted fit of the lines, whose errors grow with their widths at the least-squares fix."""
    lines, first, weighed_m = _weighted(batch, focused=focused)
    fit = fit_weighted(lines, weighed_m)
    return finish_bearings_fix(
        batch,
        lines,
        fit.point,
        sandwich_covariance(lines, fit, weighed_m),
        first.normal,
        inflated=inflated_sandwich(lines, fit, weighed_m),
        min_range_m=options.min_range_m,
        at_optimum=focused or not batch.scene.has_circles,
    )


def _weighted(batch: BearingBatch, *, focused: bool) -> tuple[Sight, LineFit, FloatArray]:
    """Return the lines, their least-squares fix, and their widths (B, M) there.

    A width that vanishes, as at a sensor, has a lower limit: its line's weight would make the equations singular.
    """
    lines = linear_lines(batch)
    first = fit_least_squares(lines)
    lines = with_independent_errors(lines, first)
    width_m = (lines.tube_width_m if focused else lines.stansfield_width_m)(*first.point)
    least_m = _LEAST_WIDTH * max_measurements(width_m)[:, None]
    return lines, first, np.where(np.abs(width_m) < least_m, least_m, width_m)


def _line_rows(batch: BearingBatch, options: StansfieldOptions) -> WeightedLines | None:
    return WeightedLines.of(*_weighted(batch, focused=False))


def _focused_line_rows(batch: BearingBatch, options: StansfieldOptions) -> WeightedLines | None:
    return WeightedLines.of(*_weighted(batch, focused=True))


METHOD = MethodSpec(
    name="stansfield",
    kind="bearings",
    job="localize",
    summary="Stansfield: lines weighted by std and distance, in closed form, close to maximum likelihood",
    reference="Song, Willett, Zhou 2013, equations (10)-(15); Stansfield 1947",
    options=StansfieldOptions,
    solve=solve,
    cost=HALF_CHI_SQUARE,
    minimum_measurements=1,
    flags=("residual_rad", "residual_elevation_rad", "residual_m", "under_horizon"),
    flags_needing={"residual_m": "range_m", "residual_elevation_rad": "elevation_rad"},
    scales_std=True,
    line_rows=_line_rows,
    dimensions=(2, 3),
)

FOCUSED = replace(
    METHOD,
    name="stansfield-focused",
    summary="Stansfield with the focusing of circular reflectors: lines weighted by std and ray-tube spread",
    reference="Song, Willett, Zhou 2013, equations (10)-(15), (41)-(45), with the spread of a concave mirror",
    solve=solve_focused,
    line_rows=_focused_line_rows,
    cost="half the chi-square of the bearing residuals",
    dimensions=(2,),
)
