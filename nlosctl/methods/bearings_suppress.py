"""Sequential aggregation with outlier suppression: sets of rows that agree, grown from pairs that cross."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from nlosctl.arrays import FloatArray, IntArray
from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.methods import MethodSpec
from nlosctl.contract.options import option
from nlosctl.contract.results import Solution
from nlosctl.solvers.mixture.bearing_candidates import BearingCandidates
from nlosctl.solvers.mixture.judgement import FixesToJudge, judge_robust_fixes
from nlosctl.solvers.mixture.outlier_model import grouped_batch, outlier_model
from nlosctl.solvers.mixture.outlier_options import BearingOutlierOptions
from nlosctl.solvers.mixture.outside import OutsideSearch
from nlosctl.solvers.mixture.path_groups import PathGroups
from nlosctl.solvers.mixture.ranked_estimates import ranked_estimates, ranked_flags
from nlosctl.solvers.sequential.starting_pairs import (
    count_bootstraps,
    count_path_bootstraps,
    few_direct_sensors,
    path_bootstrap_failure,
)
from nlosctl.solvers.sequential.suppression import follow_best, suppress_outliers

__all__ = ["METHOD", "SuppressOptions", "solve"]


@dataclass(frozen=True, kw_only=True)
class SuppressOptions(BearingOutlierOptions):
    """Parameters of ``suppress``."""

    failure_probability: float = option(
        0.001,
        minimum=0.0,
        maximum=1.0,
        exclusive=True,
        meaning="largest probability, by (27), that no initial pair consists of two direct paths",
    )
    bootstraps: int | None = option(
        None, minimum=1, meaning="initial pairs; default: as many as failure_probability needs"
    )
    acceptance: Literal["threshold", "likelihood"] = option(
        "threshold",
        meaning="a row joins a set if all residuals stay below their thresholds (as published), or if the likelihood"
        " does not get worse (repairs masking)",
    )
    rivals: int = option(
        10,
        minimum=0,
        meaning="likeliest crossings, apart from each other, to start from besides; 0: none, as published",
    )
    max_pairs: int = option(
        5000,
        minimum=1,
        meaning="pairs of rows to choose from; a random subset if there are more. All draws depend on the row order",
    )


def solve(batch: BearingBatch, options: SuppressOptions) -> Solution:
    """Solve a batch by steps 0 to 5 of Section IV-B of Ananthasubramaniam and Madhow.

    The initial pairs are random and all different, as many as (27) needs; with several paths per sensor a pair is
    right only if both *paths* are direct. Beyond the paper, sets also grow from the ``rivals`` likeliest crossings by
    (23), so that no better crossing is missed before a fix is ok. Estimates outside the search region are pruned; if
    none is left, further random pairs are tried until one is inside. The estimate is the one with the greatest
    likelihood (23), the cost its negative logarithm in nats. The covariance is the inverse of the information, (18),
    of the rows in the set, at the estimate. The statuses are those of ``mixture-ml``, judged at the optimum of (23)
    that the estimate leads to. The draws depend on the order of the rows within a snapshot: another order moves fixes
    as another seed does.
    """
    grouped, groups = grouped_batch(batch)
    model = outlier_model(grouped, groups, options)
    lines = model.lines
    candidates = BearingCandidates.of(
        grouped, model, max_pairs=options.max_pairs, exclude_behind_walls=options.exclude_behind_walls
    )
    outside = OutsideSearch(batch.size, model.mixture.dimension, candidates.beyond) if options.search_outside else None
    bootstraps, failure = _initial_pairs(groups, options)
    found = suppress_outliers(
        candidates,
        grouped.seed,
        bootstraps=bootstraps,
        rivals=options.rivals,
        alpha=options.alpha,
        field_of_view_deg=options.field_of_view_deg,
        by_likelihood=options.acceptance == "likelihood",
        lognormal=options.range_noise == "lognormal",
        max_pairs=options.max_pairs,
        outside=outside,
    )
    probability = model.mixture.responsibilities(*found.fixes.best_point)[0]
    mode, settled, at_boundary = follow_best(candidates, found.fixes, outside)
    to_judge = FixesToJudge(found.fixes, probability, found.used, mode, settled, at_boundary, found.candidates)
    judged = judge_robust_fixes(model, groups, options, to_judge, outside, too_few=model.too_few())
    estimates = ranked_estimates(judged.fixes, judged.status, lines, "inliers")
    estimates = replace(estimates, search_failure=failure[estimates.row])
    if not batch.want_flags:
        return Solution(estimates=estimates)
    numbers = lines.residuals(grouped, *judged.fixes.best_point)
    flags = ranked_flags(judged.status, groups, judged.used, judged.probability, numbers)
    return Solution(estimates=estimates, flags=flags)


def _initial_pairs(groups: PathGroups, options: SuppressOptions) -> tuple[IntArray, FloatArray]:
    """Return the number of initial pairs (B,), as many as (27) needs, and the probability (B,) that none is right.

    It is known where sensors have several paths, and NaN where it is at most that of the options; it includes that
    fewer than two sensors have a direct path.
    """
    size, count = groups.size.shape
    alpha, wanted = options.alpha, options.failure_probability
    bootstraps = np.full(size, options.bootstraps or count_bootstraps(count, alpha, wanted), dtype=np.int64)
    failure = np.full(size, np.nan)
    several = (groups.size > 1).any(axis=1)
    sensors, pairs = groups.direct_pairs(options.path_prior)
    for kind in sorted({*zip(sensors[several].tolist(), pairs[several].tolist(), strict=True)}):
        same = several & (sensors == kind[0]) & (pairs == kind[1])
        number = options.bootstraps or count_path_bootstraps(*kind, alpha, wanted)
        tried = min(number, options.max_pairs, kind[1])
        few = few_direct_sensors(kind[0], alpha)
        reached = few + (1.0 - few) * path_bootstrap_failure(*kind, alpha, tried)
        bootstraps[same], failure[same] = number, reached if reached > wanted else np.nan
    return bootstraps, failure


METHOD = MethodSpec(
    name="suppress",
    kind="bearings",
    job="localize",
    summary="outlier suppression: sets of rows that agree, grown from random pairs and the likeliest crossings",
    reference="Ananthasubramaniam, Madhow, Section IV-B, equations (23), (25), (27)",
    options=SuppressOptions,
    solve=solve,
    cost="negative log-likelihood of the mixture, in nats",
    minimum_measurements=1,
    flags=("los", "los_probability", "residual_rad", "residual_elevation_rad", "residual_m"),
    flags_needing={"residual_m": "range_m", "residual_elevation_rad": "elevation_rad"},
    searches=True,
    covariance_kinds=("inliers",),
    randomized=True,
    exempt_from=frozenset({"order"}),
    dimensions=(2, 3),
    reads=frozenset({"range_m", "range_std_m", "path"}),
)
