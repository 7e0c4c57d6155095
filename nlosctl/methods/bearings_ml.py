"""Maximum likelihood on bearings with Gaussian errors."""

from __future__ import annotations

from dataclasses import dataclass

from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.methods import LEAST_HALF_CHI_SQUARE, MethodSpec
from nlosctl.contract.options import option
from nlosctl.contract.results import Solution
from nlosctl.models.bearings import sight_lines
from nlosctl.solvers.bearing_problem import BearingProblem
from nlosctl.solvers.fixes import finish_bearings_fix
from nlosctl.solvers.levenberg_marquardt import minimize
from nlosctl.solvers.line_fits import fit_least_squares, fit_stansfield

__all__ = ["METHOD", "MaximumLikelihoodOptions", "solve"]


@dataclass(frozen=True, kw_only=True)
class MaximumLikelihoodOptions:
    """Parameters of ``ml``."""

    min_range_m: float = option(
        0.0, unit="m", minimum=0.0, meaning="a fix closer than this to a sensor that it uses is degenerate"
    )
    max_iterations: int = option(30, minimum=1, meaning="steps after which a snapshot counts as not converged")


def solve(batch: BearingBatch, options: MaximumLikelihoodOptions) -> Solution:
    """Solve a batch by maximum likelihood; equation (6) of Song, Willett, Zhou 2013.

    Levenberg-Marquardt from Stansfield's fix, residuals wrapped. The covariance is the inverse Fisher
    information at the estimate, equations (27)-(29).
    """
    lines = sight_lines(batch)
    first = fit_least_squares(lines)
    start = fit_stansfield(lines, first)
    minimum = minimize(BearingProblem.of_lines(lines), start.x, start.y, max_iterations=options.max_iterations)
    return finish_bearings_fix(
        batch,
        lines,
        minimum.x,
        minimum.y,
        lines.information(minimum.x, minimum.y).inverse(),
        first.normal,
        min_range_m=options.min_range_m,
        converged=minimum.converged,
    )


METHOD = MethodSpec(
    name="ml",
    kind="bearings",
    job="localize",
    summary="maximum likelihood for Gaussian bearing errors, all rows trusted",
    reference="Song, Willett, Zhou 2013, equation (6), information (20)-(29)",
    options=MaximumLikelihoodOptions,
    solve=solve,
    cost=LEAST_HALF_CHI_SQUARE,
    minimum_measurements=2,
    flags=("residual_rad",),
)
