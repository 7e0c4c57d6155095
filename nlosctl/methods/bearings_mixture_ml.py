"""Maximum of the mixture likelihood: every row follows its path, or is an outlier."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.methods import MethodSpec
from nlosctl.contract.options import option
from nlosctl.contract.results import Solution
from nlosctl.contract.statuses import Status
from nlosctl.solvers.bearing_candidates import BearingCandidates
from nlosctl.solvers.modes import find_modes
from nlosctl.solvers.outlier_model import grouped_batch, has_several_paths, outlier_model
from nlosctl.solvers.parted_batches import solve_parts
from nlosctl.solvers.path_groups import restore_rows
from nlosctl.solvers.posterior_grid import posterior_covariance
from nlosctl.solvers.ranged_bearings import row_residuals
from nlosctl.solvers.ranked_fixes import (
    RankedFixes,
    rank_modes,
    ranked_estimates,
    ranked_flags,
    ranked_status,
)

__all__ = ["METHOD", "MixtureOptions", "solve"]


@dataclass(frozen=True, kw_only=True)
class MixtureOptions:
    """Parameters of ``mixture-ml``."""

    alpha: float = option(
        0.25,
        minimum=0.0,
        maximum=1.0,
        exclusive=True,
        meaning="fraction of rows (of sensors, if they have several paths) to expect as outliers",
    )
    field_of_view_deg: float = option(
        180.0, unit="deg", minimum=1.0, maximum=360.0, meaning="angle over which an outlier's bearing is uniform"
    )
    path_prior: Literal["uniform", "first", "falling"] = option(
        "uniform",
        meaning="which of a sensor's paths is direct: any, only the first arrival, or each half as likely as the last",
    )
    use_ranges: bool = option(True, meaning="whether ranges join the likelihood where rows have them")
    range_noise: Literal["gaussian", "lognormal"] = option("gaussian", meaning="distribution of the range error")
    min_range_m: float | None = option(
        None,
        unit="m",
        minimum=0.0,
        meaning="a row can't be direct from closer than this; none: 0.5 % of the larger side of the box of the sensors",
    )
    covariance: Literal["inliers", "posterior"] = option(
        "inliers",
        meaning="of the rows held to be direct (too small with outliers), or calibrated, from a posterior grid",
    )
    ambiguous_within: float = option(
        2.0, unit="nat", minimum=0.0, meaning="another mode this near makes a fix ambiguous"
    )
    ambiguous_rows: int = option(
        2,
        minimum=0,
        meaning="where sensors have several paths in no known order, another mode on which at most so many rows fewer "
        "agree (three or more) makes a fix ambiguous too: it may be the source, and this its mirror image",
    )
    max_modes: int = option(20, minimum=1, maximum=100, meaning="modes sought; each is an alternative")
    mode_gap: float = option(
        0.75,
        unit="nat per row",
        minimum=0.0,
        meaning="crossings less likely than the best by more than this times the number of rows are not followed",
    )
    max_pairs: int = option(5000, minimum=1, meaning="pairs of rows crossed; of more, so many are drawn at random")
    exclude_behind_walls: bool = option(
        False, meaning="leave out points that walls of the scene hide from every sensor"
    )


def solve(batch: BearingBatch, options: MixtureOptions) -> Solution:
    """Solve a batch by the maximum of (23) of Ananthasubramaniam and Madhow, by all crossings and Newton steps.

    Every crossing of two rays in the search field (and every ray's end at its range) is scored, the best few that
    are apart are followed to their modes. Of a sensor's paths at most one is direct, (5). The cost is the negative
    log-likelihood in nats. no_candidate: no crossing in the field; degenerate: parallel lines, or sensors all at one
    place without ranges.
    """
    return solve_parts(batch, has_several_paths(batch), lambda part: _solve(part, options))


def _solve(batch: BearingBatch, options: MixtureOptions) -> Solution:
    grouped, groups = grouped_batch(batch)
    model = outlier_model(
        grouped,
        groups,
        alpha=options.alpha,
        field_of_view_deg=options.field_of_view_deg,
        path_prior=options.path_prior,
        use_ranges=options.use_ranges,
        lognormal=options.range_noise == "lognormal",
        min_range_m=options.min_range_m,
    )
    candidates = BearingCandidates.of(
        grouped, model, max_pairs=options.max_pairs, exclude_behind_walls=options.exclude_behind_walls
    )
    modes = find_modes(
        model.mixture,
        candidates.points,
        candidates.count,
        candidates.allowed,
        most=options.max_modes,
        gap=options.mode_gap * batch.measurements,
    )
    fixes, probability = rank_modes(model.mixture, modes)
    status = ranked_status(
        fixes,
        modes.candidates,
        model.uninformative(),
        options.ambiguous_within,
        modes.held,
        unordered=groups.unordered(options.path_prior),
        ambiguous_rows=options.ambiguous_rows,
    )
    if candidates.count == 0:
        status[:] = Status.TOO_FEW
    if options.covariance == "posterior":
        covariance = posterior_covariance(model.mixture, modes, candidates.allowed)
        fixes = RankedFixes(fixes.x, fixes.y, fixes.cost, covariance, fixes.n_used)
    lines = model.lines
    estimates = ranked_estimates(fixes, status, lines.center_x, lines.center_y, options.covariance)
    if not batch.want_flags:
        return Solution(estimates=estimates)
    x, y = modes.x[:, 0], modes.y[:, 0]
    numbers = {"los_probability": probability, **row_residuals(grouped, model.lines, x, y)}
    flags = ranked_flags(
        status,
        restore_rows(probability > 0.5, groups),
        {name: restore_rows(values, groups) for name, values in numbers.items()},
    )
    return Solution(estimates=estimates, flags=flags)


METHOD = MethodSpec(
    name="mixture-ml",
    kind="bearings",
    job="localize",
    summary="maximum of the mixture likelihood of direct rows and outliers: the robust method to start with",
    reference="Ananthasubramaniam, Madhow, equations (4), (5), (23)",
    options=MixtureOptions,
    solve=solve,
    cost="negative log-likelihood of the mixture, in nats",
    minimum_measurements=1,
    flags=("los", "los_probability", "residual_rad", "residual_m"),
    flags_needing={"residual_m": "range_m"},
    searches=True,
    covariance_kinds=("inliers", "posterior"),
    randomized=True,
    reads=frozenset({"range_m", "range_std_m"}),
)
