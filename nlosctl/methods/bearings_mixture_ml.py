"""Maximum of the mixture likelihood: every row follows its path, or is an outlier."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import radians

from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.methods import MethodSpec
from nlosctl.contract.options import option
from nlosctl.contract.results import Solution
from nlosctl.contract.statuses import Status
from nlosctl.solvers.mixture.bearing_candidates import BearingCandidates
from nlosctl.solvers.mixture.consensus import find_rival, log_evidence, outlier_gain
from nlosctl.solvers.mixture.modes import find_modes
from nlosctl.solvers.mixture.outlier_model import grouped_batch, has_several_paths, outlier_model
from nlosctl.solvers.mixture.outlier_options import BearingOutlierOptions, MixtureModeOptions
from nlosctl.solvers.mixture.outside import OutsideSearch
from nlosctl.solvers.mixture.posterior_grid import posterior_covariance
from nlosctl.solvers.mixture.ranked_estimates import rank_modes, ranked_estimates, ranked_flags, ranked_status
from nlosctl.solvers.mixture.verdicts import mark_behind, near_sensor, verdicts
from nlosctl.solvers.optimization.split_batches import solve_parts

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
    least_evidence: float = option(
        3.0,
        unit="nat",
        meaning="no_consensus below this log evidence of the best mode over that of outliers; -1000 keeps every fix",
    )
    search_outside: bool = option(
        True, meaning="whether points outside the search region are compared with the best inside (outside_field)"
    )
    exclude_behind_walls: bool = option(
        False, meaning="leave out points that walls of the scene hide from every sensor"
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
    candidates = BearingCandidates.of(
        grouped, model, max_pairs=options.max_pairs, exclude_behind_walls=options.exclude_behind_walls
    )
    outside = OutsideSearch(batch.size, candidates.beyond) if options.search_outside else None
    modes = find_modes(
        model.mixture,
        candidates.points,
        candidates.count,
        candidates.allowed,
        most=options.max_modes,
        gap=options.mode_gap * batch.measurements,
        outside=outside,
    )
    fixes, probability = rank_modes(model.mixture, modes)
    gain = outlier_gain(radians(options.field_of_view_deg))
    best = modes.hessian.at(slice(None), 0)
    evidence = log_evidence(model.mixture, fixes.cost[:, 0], probability, best, model.region.area_m2, gain)
    x, y, direct = fixes.x[:, 0], fixes.y[:, 0], probability > 0.5
    further = verdicts(model.lines, x, y, fixes.covariance.at(slice(None), 0), direct)
    further[Status.DEGENERATE] |= ~modes.settled & near_sensor(model.lines, x, y, model.minimum_range_m)
    further[Status.NO_CONSENSUS] = evidence < options.least_evidence
    unordered = groups.unordered(options.path_prior)
    if outside is not None:
        rival = find_rival(
            model,
            outside.mode,
            fixes,
            probability,
            at_boundary=modes.at_boundary,
            unordered=unordered,
            ambiguous_rows=options.ambiguous_rows,
            least_evidence=options.least_evidence,
            gain=gain,
        )
        fixes, probability, further[Status.OUTSIDE_FIELD] = rival.fixes, rival.probability, rival.better
    status = ranked_status(
        fixes,
        modes.candidates,
        model.uninformative(),
        options.ambiguous_within,
        modes.at_boundary,
        unordered=unordered,
        ambiguous_rows=options.ambiguous_rows,
        further=further,
    )
    if candidates.count == 0:
        status[:] = Status.TOO_FEW
    else:
        mark_behind(status, model.lines)
    if options.covariance == "posterior":
        covariance = posterior_covariance(model.mixture, modes, candidates.allowed)
        fixes = replace(fixes, covariance=covariance)
    lines = model.lines
    estimates = ranked_estimates(fixes, status, lines.center_x, lines.center_y, options.covariance)
    if not batch.want_flags:
        return Solution(estimates=estimates)
    x, y = fixes.x[:, 0], fixes.y[:, 0]
    numbers = {"los_probability": probability, **lines.residuals(grouped, x, y)}
    return Solution(estimates=estimates, flags=ranked_flags(status, groups, probability > 0.5, numbers))


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
    flags=("los", "los_probability", "residual_rad", "residual_m"),
    flags_needing={"residual_m": "range_m"},
    searches=True,
    covariance_kinds=("inliers", "posterior"),
    randomized=True,
    reads=frozenset({"range_m", "range_std_m"}),
)
