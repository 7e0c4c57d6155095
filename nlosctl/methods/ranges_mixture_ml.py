"""Maximum of the mixture likelihood of ranges: every row is direct, or an outlier, too long or too short."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.contract.batches import RangeBatch
from nlosctl.contract.methods import MethodSpec
from nlosctl.contract.options import option
from nlosctl.contract.results import Solution
from nlosctl.contract.statuses import Status
from nlosctl.geometry.blocks import max_measurements
from nlosctl.solvers.mixture.consensus import log_evidence
from nlosctl.solvers.mixture.modes import find_modes
from nlosctl.solvers.mixture.outlier_options import MixtureModeOptions, OutlierOptions
from nlosctl.solvers.mixture.posterior_grid import posterior_covariance
from nlosctl.solvers.mixture.range_rows import RangeCandidates, RangeOutlierModel, grouped_ranges, range_outlier_model
from nlosctl.solvers.mixture.ranked_estimates import rank_modes, ranked_estimates, ranked_flags, ranked_status

__all__ = ["METHOD", "RangeMixtureOptions", "solve"]


@dataclass(frozen=True, kw_only=True)
class RangeMixtureOptions(OutlierOptions, MixtureModeOptions):
    """Parameters of ``mixture-ml`` on ranges."""

    nlos_density_per_m: float | None = option(
        None,
        unit="1/m",
        minimum=0.0,
        exclusive=True,
        meaning="density of an outlier's range; default: one over the diagonal of the search region",
    )
    least_evidence: float = option(
        1.5,
        unit="nat",
        meaning="no_consensus below this log evidence of the best mode over that of outliers; -1000 keeps every fix",
    )
    mode_gap: float = option(
        3.0,
        unit="nat per row",
        minimum=0.0,
        meaning="crossings less likely than the best by more than this times the number of rows are not followed",
    )


def solve(batch: RangeBatch, options: RangeMixtureOptions) -> Solution:
    """Solve a batch by the maximum of (23) of Ananthasubramaniam and Madhow, with ranges in place of bearings.

    Every crossing of two circles in the search region is scored, the best few that are apart are followed to their
    modes. The default search region, that of the sensors, is enlarged by the longest range. The cost is the negative
    log-likelihood in nats. no_candidate: no crossing in the field; too_few: all sensors at one point.
    """
    grouped, groups = grouped_ranges(batch)
    model = range_outlier_model(
        grouped,
        groups,
        alpha=options.alpha,
        nlos_density_per_m=options.nlos_density_per_m,
        path_prior=options.path_prior,
    )
    candidates = RangeCandidates.of(grouped, model, options.max_pairs)
    modes = find_modes(
        model.mixture,
        candidates.points,
        candidates.count,
        candidates.allowed,
        most=options.max_modes,
        gap=options.mode_gap * batch.measurements,
    )
    fixes, probability = rank_modes(model.mixture, modes)
    if options.covariance == "posterior":
        covariance = posterior_covariance(model.mixture, modes, candidates.allowed)
        fixes = replace(fixes, covariance=covariance)
    best, gain = modes.hessian.at(slice(None), 0), _outlier_gain(batch, model)
    evidence = log_evidence(model.mixture, fixes.cost[:, 0], probability, best, model.region.area_m2, gain)
    status = ranked_status(
        fixes,
        modes.candidates,
        candidates.degenerate,
        options.ambiguous_within,
        modes.at_boundary,
        unordered=groups.unordered(options.path_prior),
        ambiguous_rows=options.ambiguous_rows,
        further={Status.NO_CONSENSUS: evidence < options.least_evidence},
    )
    status[candidates.degenerate] = Status.TOO_FEW
    circles = model.circles
    estimates = ranked_estimates(fixes, status, circles.center_x, circles.center_y, options.covariance)
    if not batch.want_flags:
        return Solution(estimates=estimates)
    numbers = {"los_probability": probability, "residual_m": circles.residual_m(modes.x[:, 0], modes.y[:, 0])}
    return Solution(estimates=estimates, flags=ranked_flags(status, groups, probability > 0.5, numbers))


def _outlier_gain(batch: RangeBatch, model: RangeOutlierModel) -> FloatArray:
    """Return by how much outliers are rarer (B,) if there is no source than in the mixture: less than 1.

    Without a source the ranges of a snapshot are uniform up to somewhat more than the longest, which is K / (K + 1) of
    that in the mean.
    """
    count = batch.measurements
    density = np.exp(model.mixture.log_nlos / count)
    return (count + 1.0) / count * max_measurements(batch.range_m) * density


METHOD = MethodSpec(
    name="mixture-ml",
    kind="ranges",
    job="localize",
    summary="maximum of the mixture likelihood of direct rows and outliers: the recommended robust method",
    reference="Ananthasubramaniam, Madhow, equation (23), on ranges",
    options=RangeMixtureOptions,
    solve=solve,
    cost="negative log-likelihood of the mixture, in nats",
    minimum_measurements=2,
    flags=("los", "los_probability", "residual_m"),
    searches=True,
    covariance_kinds=("inliers", "posterior"),
    randomized=True,
)
