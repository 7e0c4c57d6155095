"""Stansfield's estimator with the focus of circular reflectors in its weights."""

from __future__ import annotations

from dataclasses import dataclass

from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.methods import MethodSpec
from nlosctl.contract.options import option
from nlosctl.contract.results import Solution
from nlosctl.models.bearings import sight_lines
from nlosctl.solvers.bearings.fix_status import finish_bearings_fix
from nlosctl.solvers.bearings.line_fits import fit_focused, fit_least_squares, inflated_sandwich, sandwich_covariance

__all__ = ["METHOD", "FocusedStansfieldOptions", "solve"]


@dataclass(frozen=True, kw_only=True)
class FocusedStansfieldOptions:
    """Parameters of ``stansfield-focused``."""

    min_range_m: float = option(
        0.0, unit="m", minimum=0.0, meaning="a fix closer than this to a sensor that it uses is degenerate"
    )


def solve(batch: BearingBatch, options: FocusedStansfieldOptions) -> Solution:
    """Solve a batch by equations (10)-(15) of Song, Willett, Zhou 2013, with the true spread of the ray tubes.

    On a circle the error of a line is not std times distance, but std times the width of the ray tube per radian,
    l1 + l2 - 2 l1 l2 / (R cos i) along the measured ray. The widths are those at the least-squares fix, one pass. The
    covariance is the sandwich of these weights and the widths at the fix. Without circle rows it is ``stansfield``.
    """
    lines = sight_lines(batch)
    first = fit_least_squares(lines)
    fit = fit_focused(lines, first)
    weighed_m = lines.tube_width_m(first.x, first.y)
    return finish_bearings_fix(
        batch,
        lines,
        fit.x,
        fit.y,
        sandwich_covariance(lines, fit, weighed_m),
        first.normal,
        inflated=inflated_sandwich(lines, fit, weighed_m),
        min_range_m=options.min_range_m,
    )


METHOD = MethodSpec(
    name="stansfield-focused",
    kind="bearings",
    job="localize",
    summary="Stansfield with the focusing of circular reflectors: lines weighted by std and ray-tube spread",
    reference="Song, Willett, Zhou 2013, equations (10)-(15), (41)-(45), with the spread of a concave mirror",
    options=FocusedStansfieldOptions,
    solve=solve,
    cost="half the chi-square of the bearing residuals",
    minimum_measurements=2,
    flags=("residual_rad", "residual_m", "under_horizon"),
    flags_needing={"residual_m": "range_m"},
)
