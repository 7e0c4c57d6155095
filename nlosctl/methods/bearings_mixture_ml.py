"""Maximum of the mixture likelihood: every row follows its path, or is an outlier."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from nlosctl.arrays import FloatArray, Point
from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.learning import Learning
from nlosctl.contract.methods import MethodSpec
from nlosctl.contract.options import option
from nlosctl.contract.results import Solution
from nlosctl.solvers.bearings.cell_rows import CellBearings
from nlosctl.solvers.bearings.row_terms import DirectBearings
from nlosctl.solvers.mixture.bearing_candidates import BearingCandidates
from nlosctl.solvers.mixture.judgement import FixesToJudge, judge_robust_fixes
from nlosctl.solvers.mixture.modes import Modes, find_modes
from nlosctl.solvers.mixture.outlier_counts import expected_counts, next_alpha
from nlosctl.solvers.mixture.outlier_model import OutlierModel, grouped_batch, has_several_paths, outlier_model
from nlosctl.solvers.mixture.outlier_options import BearingOutlierOptions, MixtureModeOptions
from nlosctl.solvers.mixture.outside import OutsideSearch
from nlosctl.solvers.mixture.path_groups import restore_rows
from nlosctl.solvers.mixture.posterior import direct_probability, posterior_covariance
from nlosctl.solvers.mixture.ranked_estimates import direct_at, rank_modes, ranked_estimates, ranked_flags
from nlosctl.solvers.optimization.point_costs import cost_at_points, spread_m
from nlosctl.solvers.optimization.split_batches import solve_parts, split_batch
from nlosctl.solvers.tracking.path_rows import PathRows

__all__ = ["METHOD", "MixtureOptions", "solve"]


@dataclass(frozen=True, kw_only=True)
class MixtureOptions(BearingOutlierOptions, MixtureModeOptions):
    """Parameters of ``mixture-ml``."""

    mode_gap: float = option(
        0.75,
        unit="nat per row",
        minimum=0.0,
        meaning="crossings less likely than the best by more than this times the number of rows are not followed",
    )


def solve(batch: BearingBatch, options: MixtureOptions) -> Solution:
    """Solve a batch by the maximum of (23) of Ananthasubramaniam and Madhow, by all crossings and Newton steps.

    Every crossing of two rays in the search region (and every ray's end at its range) is scored, and the best few that
    are apart are followed to their modes. Of a sensor's paths at most one is direct, (5). The cost is the negative
    log-likelihood in nats. no_candidate: no crossing in the field; degenerate: parallel lines, or all sensors at
    one point without ranges.
    """
    return solve_parts(batch, has_several_paths(batch), lambda part: _solve(part, options))


def _solve(batch: BearingBatch, options: MixtureOptions) -> Solution:
    grouped, groups = grouped_batch(batch)
    model = outlier_model(grouped, groups, options)
    candidates = _candidates(grouped, model, options)
    outside = OutsideSearch(batch.size, model.mixture.dimension, candidates.beyond) if options.search_outside else None
    modes = _modes(model, candidates, options, outside)
    fixes, probability = rank_modes(model.mixture, modes)
    found = FixesToJudge(
        fixes, probability, probability > 0.5, modes.best, modes.settled, modes.at_boundary, modes.candidates
    )
    judged = judge_robust_fixes(model, groups, options, found, outside, too_few=model.too_few(), distinct=True)
    fixes, status = judged.fixes, judged.status
    if options.covariance == "posterior":
        covariance = posterior_covariance(model.mixture, modes, model.region, candidates, fixes.covariance, status)
        fixes = replace(fixes, covariance=covariance)
    lines = model.lines
    estimates = ranked_estimates(fixes, status, lines, options.covariance)
    if not batch.want_flags:
        return Solution(estimates=estimates)
    probability = direct_probability(model.mixture, modes, model.region, candidates, judged.probability, status)
    numbers = lines.residuals(grouped, *fixes.best_point)
    return Solution(estimates=estimates, flags=ranked_flags(status, groups, judged.used, probability, numbers))


def _candidates(grouped: BearingBatch, model: OutlierModel, options: MixtureOptions) -> BearingCandidates:
    return BearingCandidates.of(
        grouped, model, max_pairs=options.max_pairs, exclude_behind_walls=options.exclude_behind_walls
    )


def _modes(
    model: OutlierModel, candidates: BearingCandidates, options: MixtureOptions, outside: OutsideSearch | None
) -> Modes:
    return find_modes(
        model.mixture,
        candidates.points,
        candidates.count,
        candidates.allowed,
        most=options.max_modes,
        gap=options.mode_gap * model.mixture.count,
        outside=outside,
    )


def _cost_at(batch: BearingBatch, options: MixtureOptions, points: Point, cell_m: float) -> FloatArray:
    """Return the negative log-likelihood (B, P) of the mixture at points, or of cells; in space always at points."""
    total = np.empty(points[0].shape)
    for rows, part in split_batch(batch, has_several_paths(batch)):
        model = outlier_model(*grouped_batch(part), options)
        mixture = model.mixture
        if isinstance(mixture.rows, DirectBearings):
            cells: Any = CellBearings.of(mixture.rows, spread_m(cell_m), anywhere=False)
            mixture = replace(mixture, rows=cells)
        some = tuple(each[rows] for each in points)
        total[rows] = cost_at_points(mixture, model.lines.center, some, lambda part, at: part.score(*at))
    return total


def _with_proper_density(options: MixtureOptions) -> MixtureOptions:
    """Return options with outliers uniform over the full circle, or over a field of view below 180 degrees.

    Their density integrates to one then, as a share or a standard deviation that is estimated requires.
    """
    return replace(options, field_of_view_deg=360.0) if options.field_of_view_deg >= 180.0 else options


def _direct_rows(
    batch: BearingBatch, options: MixtureOptions, known_m: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return the likeliest position (B, D) and the probability (B, K) of each row to be direct there, else NaN.

    With known positions (B, D) those are the positions.
    """
    options = _with_proper_density(options)
    position = np.full((batch.size, batch.dimension), np.nan) if known_m is None else known_m
    probability = np.full(batch.bearing_rad.shape, np.nan, order="F")
    for rows, part in split_batch(batch, has_several_paths(batch)):
        grouped, groups = grouped_batch(part)
        model = outlier_model(grouped, groups, options)
        if known_m is None:
            modes = _modes(model, _candidates(grouped, model, options), options, None)
            fixes, direct = rank_modes(model.mixture, modes)
            for axis, values in enumerate(model.lines.absolute(*fixes.best_point)):
                position[rows, axis] = values
        else:
            direct = direct_at(model.mixture, model.lines.center, known_m[rows])
        probability[rows] = restore_rows(direct, groups)
    return position, probability


def _path_rows(batch: BearingBatch, options: MixtureOptions) -> PathRows:
    """Return the rows of a path."""
    grouped, groups = grouped_batch(batch)
    model = outlier_model(grouped, groups, options)
    lines = model.lines
    return PathRows.mixed(model.mixture, lines.center, groups, lambda *point: lines.residuals(grouped, *point))


def _count_outliers(batch: BearingBatch, options: MixtureOptions) -> FloatArray:
    """Return the expected numbers (B, 2) of sensors without a direct row and of sensors."""
    options = _with_proper_density(options)
    counts = np.empty((batch.size, 2))
    for rows, part in split_batch(batch, has_several_paths(batch)):
        grouped, groups = grouped_batch(part)
        model = outlier_model(grouped, groups, options)
        candidates = _candidates(grouped, model, options)
        counts[rows] = expected_counts(
            model.mixture, _modes(model, candidates, options, None), model.region, candidates
        )
    return counts


def _next_options(sums: Sequence[float], options: MixtureOptions) -> dict[str, float | None]:
    return {"alpha": next_alpha(*sums)}


METHOD = MethodSpec(
    name="mixture-ml",
    kind="bearings",
    job="localize",
    summary="maximum of the mixture likelihood of direct rows and outliers: the recommended robust method",
    reference="Ananthasubramaniam, Madhow, equations (4), (5), (23)",
    options=MixtureOptions,
    solve=solve,
    cost="negative log-likelihood of the mixture, in nats",
    minimum_measurements=1,
    flags=("los", "los_probability", "residual_rad", "residual_elevation_rad", "residual_m"),
    flags_needing={"residual_m": "range_m", "residual_elevation_rad": "elevation_rad"},
    searches=True,
    covariance_kinds=("inliers", "posterior"),
    randomized=True,
    reads=frozenset({"range_m", "range_std_m", "path"}),
    direct_rows=_direct_rows,
    path_rows=_path_rows,
    cost_at=_cost_at,
    dimensions=(2, 3),
    learning=Learning(options=("alpha",), statistics=_count_outliers, update=_next_options),
)
