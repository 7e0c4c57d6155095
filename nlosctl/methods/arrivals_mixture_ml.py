"""Maximum of the mixture likelihood of arrival times: every row is direct, or late."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from nlosctl.arrays import FloatArray, Point
from nlosctl.contract.batches import ArrivalBatch
from nlosctl.contract.learning import Learning
from nlosctl.contract.methods import MethodSpec
from nlosctl.contract.options import option
from nlosctl.contract.results import Solution
from nlosctl.contract.tables.arrivals import OFFSET
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.arrivals import ArrivalRows
from nlosctl.solvers.arrivals.judgement import judge_late_fixes
from nlosctl.solvers.arrivals.offset_integral import cost_without_offset
from nlosctl.solvers.arrivals.outlier_model import ArrivalOutlierModel, arrival_outlier_model
from nlosctl.solvers.arrivals.subset_candidates import ArrivalCandidates
from nlosctl.solvers.mixture.modes import Modes, find_modes
from nlosctl.solvers.mixture.outlier_counts import expected_counts, next_alpha
from nlosctl.solvers.mixture.outlier_options import LateOptions
from nlosctl.solvers.mixture.outside import OutsideSearch
from nlosctl.solvers.mixture.posterior import direct_probability, posterior_covariance
from nlosctl.solvers.mixture.ranked_estimates import rank_modes, ranked_estimates, ranked_flags
from nlosctl.solvers.optimization.point_costs import cost_at_points, spread_m
from nlosctl.solvers.tracking.arrival_rows import late_arrivals

__all__ = ["METHOD", "ArrivalMixtureOptions", "solve"]


@dataclass(frozen=True, kw_only=True)
class ArrivalMixtureOptions(LateOptions):
    """Parameters of ``mixture-ml`` on arrivals."""

    late_m: float | None = option(
        None,
        unit="m",
        minimum=0.0,
        exclusive=True,
        meaning="a late row is uniform over so many metres after the direct arrival; default: over an unknown number "
        "of metres up to the diagonal of the search region",
    )
    covariance: Literal["posterior", "inliers"] = option(
        "posterior", meaning="calibrated, of the whole posterior, or of the inlier rows (too small with late rows)"
    )
    ambiguous_within: float = option(
        2.0, unit="nat", minimum=0.0, meaning="another estimate this near makes a fix ambiguous"
    )
    least_evidence: float = option(
        1.8,
        unit="nat",
        meaning="no_consensus below this log evidence of the best mode over that of outliers; -1000 keeps every fix",
    )
    search_outside: bool = option(
        True, meaning="whether points outside the search region are compared with the best inside (outside_field)"
    )
    max_modes: int = option(20, minimum=1, maximum=100, meaning="largest number of modes; each is an alternative")
    max_subsets: int = option(
        500, minimum=1, meaning="sets of as many rows as unknowns that are solved; a random selection if there are more"
    )
    mode_gap: float = option(
        3.0,
        unit="nat per row",
        minimum=0.0,
        meaning="solutions less likely than the best by more than this times the number of rows are not followed",
    )


def solve(batch: ArrivalBatch, options: ArrivalMixtureOptions) -> Solution:
    """Solve a batch by the maximum of (23) of Ananthasubramaniam and Madhow, with late arrivals as outliers.

    Unknowns are the position and the offset. Both exact solutions of every set of as many rows as unknowns are scored
    (of sensors in a plane or on a line those beside it; with a measured height those of one row less at that height),
    the best few that are apart are followed to their modes by Newton steps. A late row is uniform over ``late_m`` after
    the direct arrival, or by default late by an unknown magnitude, so that its density falls with the delay, see
    `LateArrivals`; no row is early. The cost is the negative log-likelihood in nats.

    no_candidate: no solution in the search region; too_few: fewer scalars than unknowns, or all sensors at one point.
    """
    model, candidates = _prepare(batch, options)
    outside = OutsideSearch(batch.size, model.mixture.dimension, candidates.beyond) if options.search_outside else None
    modes = _modes(model, candidates, options, outside)
    judged = judge_late_fixes(
        model,
        candidates,
        modes,
        outside,
        ambiguous_within=options.ambiguous_within,
        least_evidence=options.least_evidence,
    )
    fixes, status, arrivals = judged.fixes, judged.status, model.arrivals
    if options.covariance == "posterior":
        covariance = posterior_covariance(model.mixture, modes, model.region, candidates, fixes.covariance, status)
        fixes = replace(fixes, covariance=covariance)
    columns = _offset_columns(arrivals, fixes.point[-1], fixes.covariance)
    position = replace(fixes, point=fixes.point[:-1], covariance=fixes.covariance.leading(len(arrivals.center)))
    estimates = ranked_estimates(position, status, arrivals, options.covariance, columns)
    if not batch.want_flags:
        return Solution(estimates=estimates)
    probability = direct_probability(model.mixture, modes, model.region, candidates, judged.probability, status)
    *point, offset = fixes.best_point
    numbers = {"residual_m": arrivals.arrival_m - arrivals.distance_m(*point) - offset[:, None]}
    return Solution(estimates=estimates, flags=ranked_flags(status, None, judged.used, probability, numbers))


def _prepare(batch: ArrivalBatch, options: ArrivalMixtureOptions) -> tuple[ArrivalOutlierModel, ArrivalCandidates]:
    model = arrival_outlier_model(batch, alpha=options.alpha, late_m=options.late_m)
    return model, ArrivalCandidates.of(batch, model, options.max_subsets)


def _modes(
    model: ArrivalOutlierModel,
    candidates: ArrivalCandidates,
    options: ArrivalMixtureOptions,
    outside: OutsideSearch | None,
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


def _cost_at(batch: ArrivalBatch, options: ArrivalMixtureOptions, points: Point, cell_m: float) -> FloatArray:
    """Return the negative log-likelihood (B, P) of the mixture at points, or of cells, which widen the rows' stds.

    The offset is integrated out, its prior flat.
    """
    wider = replace(batch, arrival_std_m=np.hypot(batch.arrival_std_m, spread_m(cell_m)))
    model = arrival_outlier_model(wider, alpha=options.alpha, late_m=options.late_m)
    return cost_at_points(model, model.arrivals.center, points, cost_without_offset)


def _offset_columns(arrivals: ArrivalRows, offset_m: FloatArray, covariance: SymmetricMatrix) -> dict[str, FloatArray]:
    """Return the columns (B, T) of the offset: value, std, covariances with x, y, z."""
    last = covariance.dimension - 1
    variance = covariance.entry(last, last)
    cross = [covariance.entry(last, axis) for axis in range(last)]
    if arrivals.held_z_m is not None:
        cross.append(np.zeros(variance.shape))
    names = (f"cov_{axis}_offset_m2" for axis in "xyz")
    columns = {"offset_m": offset_m + arrivals.origin_m[:, None], "offset_std_m": np.sqrt(np.maximum(variance, 0.0))}
    return {**columns, **dict(zip(names, cross, strict=False))}


def _direct_rows(
    batch: ArrivalBatch, options: ArrivalMixtureOptions, known_m: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return the likeliest position (B, D) and the probability (B, K) of each row to be direct there, else NaN.

    With known positions (B, D) those are the positions, at their likeliest offset.
    """
    model, candidates = _prepare(batch, options)
    arrivals = model.arrivals
    if known_m is not None:
        point = tuple(known_m[:, axis] - middle for axis, middle in enumerate(arrivals.center))
        return known_m, model.mixture.responsibilities(*point, model.likeliest_offset(*point))[0]
    fixes, direct = rank_modes(model.mixture, _modes(model, candidates, options, None))
    return np.stack(arrivals.absolute(*fixes.best_point[:-1]), axis=1), direct


def _std_fault(options: ArrivalMixtureOptions, pool: str) -> str:
    """Return why it can't estimate standard deviations: the residuals of late rows determine none."""
    return "`estimate_std` is not for arrivals that may be late; use `method` ml"


def _count_outliers(batch: ArrivalBatch, options: ArrivalMixtureOptions) -> FloatArray:
    """Return the expected numbers (B, 2) of late rows and of rows."""
    model, candidates = _prepare(batch, options)
    modes = _modes(model, candidates, options, None)
    return expected_counts(model.mixture, modes, model.region, candidates)


def _next_options(sums: Sequence[float], options: ArrivalMixtureOptions) -> dict[str, float | None]:
    return {"alpha": next_alpha(*sums)}


METHOD = MethodSpec(
    name="mixture-ml",
    kind="arrivals",
    job="localize",
    summary="maximum of the mixture likelihood of direct and late rows: the recommended robust method",
    reference="Ananthasubramaniam, Madhow, equation (23), on arrivals",
    options=ArrivalMixtureOptions,
    solve=solve,
    cost="negative log-likelihood of the mixture, in nats",
    minimum_measurements=2,
    cost_at=_cost_at,
    flags=("los", "los_probability", "residual_m"),
    estimate_columns=tuple(column.name for column in OFFSET),
    searches=True,
    covariance_kinds=("inliers", "posterior"),
    randomized=True,
    dimensions=(2, 3),
    direct_rows=_direct_rows,
    path_rows=lambda batch, options: late_arrivals(batch, alpha=options.alpha, late_m=options.late_m),
    std_fault=_std_fault,
    learning=Learning(options=("alpha",), statistics=_count_outliers, update=_next_options),
)
