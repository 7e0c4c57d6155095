"""Maximum of the mixture likelihood of ranges: every row is direct, or an outlier, too long or too short."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from nlosctl.arrays import FloatArray, Point
from nlosctl.contract.batches import RangeBatch
from nlosctl.contract.learning import Learning
from nlosctl.contract.methods import MethodSpec
from nlosctl.contract.options import option
from nlosctl.contract.results import Solution
from nlosctl.contract.statuses import Status
from nlosctl.solvers.mixture.modes import Modes, find_modes
from nlosctl.solvers.mixture.outlier_counts import expected_counts, next_alpha, next_bias_mean_m
from nlosctl.solvers.mixture.outlier_options import MixtureModeOptions, OutlierOptions
from nlosctl.solvers.mixture.path_groups import PathGroups, restore_rows
from nlosctl.solvers.mixture.posterior import direct_probability, posterior_covariance
from nlosctl.solvers.mixture.range_candidates import RangeCandidates
from nlosctl.solvers.mixture.range_rows import BiasLaw, RangeOutlierModel, grouped_ranges, range_outlier_model
from nlosctl.solvers.mixture.ranked_estimates import (
    direct_at,
    rank_modes,
    ranked_estimates,
    ranked_flags,
    ranked_status,
)
from nlosctl.solvers.mixture.verdicts import is_uncertain, prefer_feasible_modes
from nlosctl.solvers.optimization.point_costs import cost_at_points, spread_m
from nlosctl.solvers.tracking.path_rows import PathRows

__all__ = ["METHOD", "RangeMixtureOptions", "solve"]


_FURTHER_NATS = 1.0
"""Of a fix that leaves out a row the rivals' mass counts so much beyond ``ambiguous_within``: then half a per cent of
the ok fixes of five sensors are absurd with a quarter of outliers."""


@dataclass(frozen=True, kw_only=True)
class RangeMixtureOptions(OutlierOptions, MixtureModeOptions):
    """Parameters of ``mixture-ml`` on ranges."""

    bias: Literal["both", "positive", "none"] = option(
        "both",
        meaning="outliers: any range, too long or too short; most of them late, by a positive bias; or no outliers",
    )
    bias_mean_m: float | None = option(
        None,
        unit="m",
        minimum=0.0,
        exclusive=True,
        meaning="mean of a positive bias; default: unknown, between the std and the longest range",
    )
    nlos_density_per_m: float | None = option(
        None,
        unit="1/m",
        minimum=0.0,
        exclusive=True,
        meaning="density of an outlier's range that may be any; default: one over the diagonal of the search region",
    )
    mode_gap: float = option(
        3.0,
        unit="nat per row",
        minimum=0.0,
        meaning="crossings less likely than the best by more than this times the number of rows are not followed",
    )
    least_evidence: float = option(
        1.8,
        unit="nat",
        meaning="no_consensus below this log evidence of the best mode over that of outliers; -1000 keeps every fix",
    )


def solve(batch: RangeBatch, options: RangeMixtureOptions) -> Solution:
    """Solve a batch by the maximum of (23) of Ananthasubramaniam and Madhow, with ranges in place of bearings.

    Every crossing of two circles in the search region is scored, the best few that are apart are followed to their
    modes. In space those are the crossings of three spheres, and with a measured height, which is always right, those
    of two at that height. The default search region, that of the sensors, is enlarged by the longest range. The cost is
    the negative log-likelihood in nats. With ``bias=positive`` small biases make the likelihood of a row wide and skew:
    then the covariance is always that of the posterior.

    no_candidate: no crossing in the field; no_consensus: three or more rows agree no better than without a source;
    degenerate: on a sensor, or a standard deviation beyond the farthest; too_few: all sensors at one point.
    """
    groups, model, candidates, modes = _search(batch, options)
    modes = prefer_feasible_modes(model, modes, options.ambiguous_within)
    fixes, at_best = rank_modes(model.mixture, modes)
    point, best = fixes.best_point, modes.hessian.at(slice(None), 0)
    evidence = model.log_evidence(fixes.cost[:, 0], at_best, best)
    further = {
        Status.NO_CONSENSUS: (evidence < options.least_evidence) & (batch.measurements > model.always_agree),
        Status.AMBIGUOUS: model.rivalled(fixes, options.ambiguous_within + _FURTHER_NATS),
        Status.DEGENERATE: is_uncertain(model.circles.distance_m(*point), fixes.covariance.at(slice(None), 0)),
        Status.INFEASIBLE: np.any(model.circles.unseen(*point) & (at_best > 0.5), axis=1),
    }
    kind = "posterior" if options.bias == "positive" else options.covariance
    status = ranked_status(
        fixes,
        modes.candidates,
        candidates.degenerate,
        options.ambiguous_within,
        modes.at_boundary,
        unordered=groups.unordered(options.path_prior),
        ambiguous_rows=options.ambiguous_rows,
        further=further,
    )
    status[candidates.degenerate] = Status.TOO_FEW
    if kind == "posterior":
        covariance = posterior_covariance(model.mixture, modes, model.region, candidates, fixes.covariance, status)
        fixes = replace(fixes, covariance=covariance)
    circles = model.circles
    estimates = ranked_estimates(fixes, status, circles, kind)
    if not batch.want_flags:
        return Solution(estimates=estimates)
    probability = direct_probability(model.mixture, modes, model.region, candidates, at_best, status)
    numbers = {"residual_m": circles.residual_m(*point)}
    return Solution(estimates=estimates, flags=ranked_flags(status, groups, at_best > 0.5, probability, numbers))


def _search(
    batch: RangeBatch, options: RangeMixtureOptions
) -> tuple[PathGroups, RangeOutlierModel, RangeCandidates, Modes]:
    """Return the groups of a batch in the file's order, its model, its candidates and the modes they lead to."""
    grouped, groups, model = _model(batch, options)
    candidates = RangeCandidates.of(grouped, model, options.max_pairs)
    modes = find_modes(
        model.mixture,
        candidates.points,
        candidates.count,
        candidates.allowed,
        most=options.max_modes,
        gap=options.mode_gap * batch.measurements,
    )
    return groups, model, candidates, modes


def _model(batch: RangeBatch, options: RangeMixtureOptions) -> tuple[RangeBatch, PathGroups, RangeOutlierModel]:
    """Return a batch with the rows of each group next to each other, the groups, and its model."""
    grouped, groups = grouped_ranges(batch)
    model = range_outlier_model(
        grouped,
        groups,
        alpha=options.alpha,
        law=BiasLaw(options.bias, options.bias_mean_m, options.nlos_density_per_m),
        path_prior=options.path_prior,
    )
    return grouped, groups, model


def _direct_rows(
    batch: RangeBatch, options: RangeMixtureOptions, known_m: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return the likeliest position (B, D) and the probability (B, K) of each row to be direct there, else NaN.

    With known positions (B, D) those are the positions.
    """
    if known_m is not None:
        _, groups, model = _model(batch, options)
        return known_m, restore_rows(direct_at(model.mixture, model.circles.center, known_m), groups)
    groups, model, _, modes = _search(batch, options)
    fixes, direct = rank_modes(model.mixture, modes)
    return np.stack(model.circles.absolute(*fixes.best_point), axis=1), restore_rows(direct, groups)


def _path_rows(batch: RangeBatch, options: RangeMixtureOptions) -> PathRows:
    """Return the rows of a path."""
    _, groups, model = _model(batch, options)
    circles = model.circles
    return PathRows.mixed(
        model.mixture, circles.center, groups, lambda *point: {"residual_m": circles.residual_m(*point)}
    )


def _cost_at(batch: RangeBatch, options: RangeMixtureOptions, points: Point, cell_m: float) -> FloatArray:
    """Return the negative log-likelihood (B, P) of the mixture at points, or of cells, which widen the rows' stds."""
    _, _, model = _model(replace(batch, range_std_m=np.hypot(batch.range_std_m, spread_m(cell_m))), options)
    return cost_at_points(model.mixture, model.circles.center, points, lambda part, at: part.score(*at))


def _count_outliers(batch: RangeBatch, options: RangeMixtureOptions) -> FloatArray:
    """Return the sums that `_next_options` needs, of each snapshot."""
    _, model, candidates, modes = _search(batch, options)
    return expected_counts(model.mixture, modes, model.region, candidates)


def _next_options(sums: Sequence[float], options: RangeMixtureOptions) -> dict[str, float | None]:
    outliers, sensors, *late = sums
    return {"alpha": next_alpha(outliers, sensors), "bias_mean_m": next_bias_mean_m(*late) if late else None}


def _refusal(options: RangeMixtureOptions, names: Sequence[str]) -> str:
    """Return why some options can't be estimated, empty if they can."""
    if options.bias == "none":
        return f"with bias=none there are no outliers to estimate {names[0]!r} from; set bias=both or bias=positive"
    if options.bias != "positive" and "bias_mean_m" in names:
        return f"'bias_mean_m' is of late ranges, but bias={options.bias}; set bias=positive"
    return ""


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
    reads=frozenset({"reflector", "path"}),
    direct_rows=_direct_rows,
    path_rows=_path_rows,
    cost_at=_cost_at,
    dimensions=(2, 3),
    learning=Learning(
        options=("alpha", "bias_mean_m"), statistics=_count_outliers, update=_next_options, refusal=_refusal
    ),
)
