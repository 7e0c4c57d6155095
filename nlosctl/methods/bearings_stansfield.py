"""Stansfield's estimator on bearings: one weighted linear fit, close to maximum likelihood."""

from __future__ import annotations

from dataclasses import dataclass

from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.methods import HALF_CHI_SQUARE, MethodSpec
from nlosctl.contract.options import option
from nlosctl.contract.results import Solution
from nlosctl.models.bearings import sight_lines
from nlosctl.solvers.bearings.fix_status import finish_bearings_fix
from nlosctl.solvers.bearings.line_fits import fit_least_squares, fit_stansfield, inflated_sandwich, sandwich_covariance

__all__ = ["METHOD", "StansfieldOptions", "solve"]


@dataclass(frozen=True, kw_only=True)
class StansfieldOptions:
    """Parameters of ``stansfield``."""

    min_range_m: float = option(
        0.0, unit="m", minimum=0.0, meaning="a fix closer than this to a sensor that it uses is degenerate"
    )


def solve(batch: BearingBatch, options: StansfieldOptions) -> Solution:
    """Solve a batch by Stansfield's estimator; equations (10)-(15) of Song, Willett, Zhou 2013.

    The distances in the weights are those of the least-squares fix: one pass, not iterated. The covariance is the
    sandwich of these weights and the errors of the lines at the fix, std times the spread of the ray tubes.
    """
    lines = sight_lines(batch)
    first = fit_least_squares(lines)
    fit = fit_stansfield(lines, first)
    weighed_m = lines.range_m(first.x, first.y)
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
    name="stansfield",
    kind="bearings",
    job="localize",
    summary="Stansfield: lines weighted by std and distance, in closed form, close to maximum likelihood",
    reference="Song, Willett, Zhou 2013, equations (10)-(15); Stansfield 1947",
    options=StansfieldOptions,
    solve=solve,
    cost=HALF_CHI_SQUARE,
    minimum_measurements=2,
    flags=("residual_rad", "residual_m", "under_horizon"),
    flags_needing={"residual_m": "range_m"},
)
