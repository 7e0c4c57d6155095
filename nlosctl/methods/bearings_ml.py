"""Maximum likelihood on bearings with Gaussian errors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from nlosctl.arrays import FloatArray, Point
from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.methods import LEAST_HALF_CHI_SQUARE, MethodSpec
from nlosctl.contract.options import option
from nlosctl.contract.results import Solution
from nlosctl.contract.tables import OF_MOVING
from nlosctl.errors import UsageError
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.bearings import SightLines
from nlosctl.models.sight import Sight, bearing_lines
from nlosctl.models.space.lines import SpaceLines
from nlosctl.solvers.bearings.cell_rows import CellBearings
from nlosctl.solvers.bearings.constrained import constrain_to_scene
from nlosctl.solvers.bearings.fix_status import finish_bearings_fix
from nlosctl.solvers.bearings.joint_range_bearing import fit_ranged_bearings, range_columns, ranged_lines
from nlosctl.solvers.bearings.line_fits import LineFit, fit_focused, fit_least_squares, with_independent_errors
from nlosctl.solvers.bearings.multistart import find_optima
from nlosctl.solvers.bearings.ranked_optima import finish_alternatives
from nlosctl.solvers.bearings.row_terms import DirectBearings
from nlosctl.solvers.bearings.von_mises import fit_von_mises
from nlosctl.solvers.optimization.point_costs import cost_at_points, cost_point_by_point, spread_m
from nlosctl.solvers.tracking.moving_fix import solve_moving_bearings
from nlosctl.solvers.tracking.path_rows import PathRows
from nlosctl.solvers.tracking.trusted_rows import trusted_bearings

__all__ = ["METHOD", "MaximumLikelihoodOptions", "solve"]


_BEARINGS_ALONE, _WITH_RANGES = 2.0, 4.0
"""Default of ``ambiguous_within``: an optimum left out has at most 12 % of the probability, or with ranges 2 %."""


@dataclass(frozen=True, kw_only=True)
class MaximumLikelihoodOptions:
    """Parameters of ``ml``."""

    min_range_m: float = option(
        0.0, unit="m", minimum=0.0, meaning="a fix closer than this to a sensor that it uses is degenerate"
    )
    max_iterations: int = option(30, minimum=1, meaning="steps after which a snapshot counts as not converged")
    feasible: bool = option(
        False, meaning="constrain the estimate to what the scene allows (sides of mirrors, annulus, visibility)"
    )
    ambiguous_within: float | None = option(
        None,
        unit="nats",
        minimum=0.0,
        meaning="an estimate is ambiguous if another optimum is at most this much worse; default: 2, with ranges 4",
    )
    use_ranges: bool = option(True, meaning="whether ranges enter the likelihood, where present")
    range_noise: Literal["gaussian", "lognormal"] = option("gaussian", meaning="distribution of the range error")
    law: Literal["gaussian", "vonmises"] = option(
        "gaussian",
        meaning="distribution of bearing errors; vonmises: Lenth's estimate, with the concentration of the residuals",
    )
    motion: Literal["none", "velocity"] = option(
        "none", meaning="motion of the source within a snapshot; velocity: one velocity, by the times of rows"
    )


def solve(batch: BearingBatch, options: MaximumLikelihoodOptions) -> Solution:
    """Solve a batch by maximum likelihood; equations (6) and (35) of Song, Willett, Zhou 2013.

    Levenberg-Marquardt from Stansfield's fix (with the focus of circles in its weights), residuals wrapped. The
    covariance is the inverse Fisher information at the estimate, equations (27)-(29), with the closed-form gradient of
    reflected bearings on circles. On a circle without a blocker each row takes the path that fits best, the search
    starts from the crossings of all pairs of rays too, and up to 10 distinct optima are returned, best first. Ranges,
    where present, enter the likelihood, and the search starts from the crossings of their circles too; a mirrored row's
    range is the unfolded length. In space the search starts from the least-squares fix and from Stansfield's, with
    ranges from the rays' ends too. With ``motion`` the unknowns are position and velocity: `solve_moving_bearings`.
    """
    if options.motion == "velocity":
        return _solve_moving(batch, options)
    lines = bearing_lines(batch)
    first = fit_least_squares(lines)
    lines = with_independent_errors(lines, first)
    start = fit_focused(lines, first)
    ranges = range_columns(batch, options.use_ranges)
    if options.law == "vonmises":
        return _solve_von_mises(batch, lines, start, first.normal, options, with_ranges=ranges is not None)
    starts, normal = [first.point, start.point], first.normal
    within = _default_within(options, ranges)
    if ranges is not None and isinstance(lines, SpaceLines):
        lines, ends, normal = ranged_lines(lines, *ranges, lognormal=options.range_noise == "lognormal")
        starts += ends
    elif ranges is not None and not isinstance(lines, SightLines):
        raise UsageError("ranges beside azimuths of geodesics have no model: set `parameters` use_ranges=false")
    elif ranges is not None and isinstance(lines, SightLines):
        return fit_ranged_bearings(
            batch,
            lines,
            start.x,
            start.y,
            ranges,
            lognormal=options.range_noise == "lognormal",
            min_range_m=options.min_range_m,
            ambiguous_within=within,
            max_iterations=options.max_iterations,
        )
    optima = find_optima(lines, starts, options.max_iterations, relative_std=batch.std == "unknown")
    constrained_status = None
    if options.feasible:
        optima, constrained_status = constrain_to_scene(optima, options.max_iterations)
    if optima.snapshot is None:
        return finish_bearings_fix(
            batch,
            lines,
            optima.point,
            None,
            normal,
            min_range_m=options.min_range_m,
            converged=optima.converged,
            constrained_status=constrained_status,
            at_optimum=True,
        )
    return finish_alternatives(
        batch,
        optima,
        optima.snapshot,
        normal,
        min_range_m=options.min_range_m,
        ambiguous_within=within,
        constrained_status=constrained_status,
    )


def _solve_von_mises(
    batch: BearingBatch,
    lines: Sight,
    start: LineFit,
    normal: SymmetricMatrix,
    options: MaximumLikelihoodOptions,
    *,
    with_ranges: bool,
) -> Solution:
    """Solve a batch by `fit_von_mises`; raises UsageError for what that has no model of."""
    if with_ranges:
        raise UsageError("law=vonmises is for bearings alone, but rows have ranges: set `parameters` use_ranges=false")
    if not isinstance(lines, SightLines):
        raise UsageError("law=vonmises is for two dimensions; leave out law=vonmises")
    if lines.circles is not None:
        raise UsageError("law=vonmises is not for rows that a circle reflects; leave out law=vonmises")
    if options.feasible:
        raise UsageError("law=vonmises can't be combined with feasible=true; leave out one of them")
    return fit_von_mises(
        batch,
        lines,
        start,
        normal,
        min_range_m=options.min_range_m,
        ambiguous_within=_BEARINGS_ALONE if options.ambiguous_within is None else options.ambiguous_within,
        max_iterations=options.max_iterations,
    )


def _solve_moving(batch: BearingBatch, options: MaximumLikelihoodOptions) -> Solution:
    """Solve a batch of sources that move; raises UsageError for options that have no model of motion."""
    for name, is_set in (("law=vonmises", options.law == "vonmises"), ("feasible=true", options.feasible)):
        if is_set:
            raise UsageError(f"motion=velocity can't be combined with {name}; leave out one of them")
    return solve_moving_bearings(
        batch,
        use_ranges=options.use_ranges,
        lognormal=options.range_noise == "lognormal",
        min_range_m=options.min_range_m,
        ambiguous_within=_default_within(options, range_columns(batch, options.use_ranges)),
        max_iterations=options.max_iterations,
    )


def _default_within(options: MaximumLikelihoodOptions, ranges: Any) -> float:
    """Return the nats within which an optimum makes another ambiguous."""
    if options.ambiguous_within is not None:
        return options.ambiguous_within
    return _BEARINGS_ALONE if ranges is None else _WITH_RANGES


def _path_rows(batch: BearingBatch, options: MaximumLikelihoodOptions) -> PathRows:
    """Return the rows of a path; raises UsageError for another law of the errors, or another motion."""
    if options.motion != "none":
        raise UsageError("motion=velocity is for localize; a track has its own motion: leave it out")
    if options.law != "gaussian":
        raise UsageError(f"law={options.law} has no tracks; leave out law={options.law}")
    return trusted_bearings(batch, use_ranges=options.use_ranges, lognormal=options.range_noise == "lognormal")


def _cost_at(batch: BearingBatch, options: MaximumLikelihoodOptions, points: Point, cell_m: float) -> FloatArray:
    """Return half the chi-square (B, P) at points, or of cells; in space and by circles always at points."""
    if options.motion != "none":
        raise UsageError("a posterior is of sources at rest; leave out motion=velocity")
    if options.law == "vonmises":
        raise UsageError("a posterior under law=vonmises has no model; leave out law=vonmises")
    lines: Any = bearing_lines(batch)
    ranges = range_columns(batch, options.use_ranges)
    lognormal = options.range_noise == "lognormal"
    if isinstance(lines, SightLines) and lines.circles is None:
        smallest = np.full(batch.size, np.finfo(np.float64).tiny)
        rows = DirectBearings.of(lines, smallest, *(ranges or (None, None)), lognormal=lognormal)
        cells = CellBearings.of(rows, spread_m(cell_m), anywhere=True)
        cost = cost_at_points(cells, lines.center, points, lambda part, at: part.half_chi_squares(*at))
    else:
        if isinstance(lines, SpaceLines) and ranges is not None:
            lines = lines.with_ranges(*ranges, lognormal=lognormal)
        cost = cost_point_by_point(
            lines, lines.center, points, lambda part, at: 0.5 * part.ray_residuals(*at).chi_square
        )
    if options.feasible:
        hidden = cost_point_by_point(lines, lines.center, points, lambda part, at: part.outside_scene(*at))
        cost[hidden > 0.0] = np.inf
    return cost


def _further_columns(options: MaximumLikelihoodOptions) -> tuple[str, ...]:
    of_law = ("std_factor", "std_dof") if options.law == "vonmises" else ()
    return of_law + (OF_MOVING if options.motion == "velocity" else ())


def _std_fault(options: MaximumLikelihoodOptions, pool: str) -> str:
    """Return why the standard deviations of a ``pool`` can't be estimated, empty if they can."""
    if options.law == "vonmises" and pool != "snapshot":
        return "law=vonmises has a concentration for each snapshot: set `estimate_std` to snapshot"
    return ""


METHOD = MethodSpec(
    name="ml",
    kind="bearings",
    job="localize",
    summary="maximum likelihood for Gaussian bearing errors, all rows trusted",
    reference="Song, Willett, Zhou 2013, equation (6), information (20)-(29)",
    options=MaximumLikelihoodOptions,
    solve=solve,
    cost=LEAST_HALF_CHI_SQUARE,
    minimum_measurements=1,
    flags=("residual_rad", "residual_elevation_rad", "residual_m", "under_horizon"),
    flags_needing={"residual_m": "range_m", "residual_elevation_rad": "elevation_rad"},
    scales_std=True,
    dimensions=(2, 3),
    std_fault=_std_fault,
    cost_at=_cost_at,
    estimate_columns_with=_further_columns,
    reads=frozenset({"range_m", "range_std_m"}),
    path_rows=_path_rows,
)
