"""The status of the best fix of a mixture: does it beat outliers, the region's outside, and what the scene forbids?"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, radians

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, StatusArray
from nlosctl.contract.statuses import Status
from nlosctl.geometry.blocks import rows_of
from nlosctl.solvers.bearings.space_row_terms import DirectDirections
from nlosctl.solvers.mixture.consensus import (
    find_rival,
    log_evidence,
    loose_odds,
    outlier_gain,
    rival_mass,
    shared_outliers_mass,
    volume_with,
)
from nlosctl.solvers.mixture.initial_estimates import Mode
from nlosctl.solvers.mixture.outlier_model import OutlierModel
from nlosctl.solvers.mixture.outlier_options import BearingOutlierOptions
from nlosctl.solvers.mixture.outside import OutsideSearch
from nlosctl.solvers.mixture.path_groups import PathGroups
from nlosctl.solvers.mixture.ranked_estimates import RankedFixes, ranked_status
from nlosctl.solvers.mixture.verdicts import mark_behind, near_sensor, verdicts

__all__ = ["FixesToJudge", "Judgement", "judge_robust_fixes"]

_ELSEWHERE_OF_ALL_ROWS = 0.6
"""A fix on all rows is ambiguous if the odds that the source is elsewhere reach this: with a quarter of outliers less
than .5 % of the ok fixes of five sensors are absurd, and .99 of clean ones stay ok."""


@dataclass(frozen=True)
class FixesToJudge:
    """Ranked fixes, each row's ``probability`` (B, K) to be direct of the best, and its rows ``used`` (B, K).

    ``mode`` (B,) is the optimum of the likelihood at or near the best fix, ``settled`` where it is smooth and
    ``at_boundary`` where it is not in the search region; ``candidates`` (B,) marks snapshots with any candidate.
    """

    fixes: RankedFixes
    probability: FloatArray
    used: BoolArray
    mode: Mode
    settled: BoolArray
    at_boundary: BoolArray
    candidates: BoolArray


@dataclass(frozen=True)
class Judgement:
    """Statuses (B,), and the fixes with the better point outside the search region first where there is one."""

    status: StatusArray
    fixes: RankedFixes
    probability: FloatArray
    used: BoolArray


def judge_robust_fixes(
    model: OutlierModel,
    groups: PathGroups,
    options: BearingOutlierOptions,
    found: FixesToJudge,
    outside: OutsideSearch | None,
    *,
    too_few: BoolArray,
    distinct: bool = False,
) -> Judgement:
    """Return the statuses of a block of fixes, by `log_evidence`, `find_rival`, `verdicts` and `ranked_status`.

    ``too_few`` (B,) marks snapshots of fewer scalars than a position has. ``distinct``: the fixes are different modes,
        and the best is ambiguous where the source is likely elsewhere: at another mode, or far off because a row is an
        outlier. If it leaves out a row, exp(-``ambiguous_within``) is likely enough.
    """
    fixes, probability, used = found.fixes, found.probability, found.used
    gain = outlier_gain(radians(options.field_of_view_deg))
    further = _beside_likelihood(model, options, found, gain, distinct=distinct)
    unordered = groups.unordered(options.path_prior)
    if outside is not None:
        rival = find_rival(
            model.mixture,
            outside.mode,
            fixes,
            probability,
            is_convincing=lambda rows, own: (
                _evidence_outside(model, outside.mode, rows, own, gain) >= options.least_evidence
            ),
            at_boundary=found.at_boundary,
            unordered=unordered,
            ambiguous_rows=options.ambiguous_rows,
        )
        fixes, probability, further[Status.OUTSIDE_FIELD] = rival.fixes, rival.probability, rival.better
        used = np.where(rival.better[:, None], probability > 0.5, used)
    status = ranked_status(
        fixes,
        found.candidates,
        model.uninformative(),
        options.ambiguous_within,
        found.at_boundary,
        unordered=unordered,
        ambiguous_rows=options.ambiguous_rows,
        further=further,
    )
    if used.shape[1] > 1:
        mark_behind(status, model.crossing_lines)
    status[too_few] = Status.TOO_FEW
    return Judgement(status, fixes, probability, used)


def _evidence_outside(
    model: OutlierModel, mode: Mode, rows: IntArray, probability: FloatArray, gain: float
) -> FloatArray:
    """Return the `log_evidence` (N,) of modes outside the search region of some snapshots, which is enlarged."""
    volume = volume_with(model.region.take(rows), rows_of(mode.point, rows))
    return log_evidence(model.mixture.take(rows), mode.cost[rows], probability, mode.hessian.take(rows), volume, gain)


def _beside_likelihood(
    model: OutlierModel, options: BearingOutlierOptions, found: FixesToJudge, gain: float, *, distinct: bool
) -> dict[Status, BoolArray]:
    """Return the snapshots (B,) of each status that the scene, the evidence or the mass of other modes imposes."""
    fixes, used, mode = found.fixes, found.used, found.mode
    point, volume = fixes.best_point, model.volume
    covariance = fixes.covariance.at(slice(None), 0)
    further = verdicts(model.lines, point, covariance, used)
    further[Status.DEGENERATE] |= ~found.settled & near_sensor(model.lines, point, model.minimum_range_m)
    if isinstance(model.direct, DirectDirections):
        further[Status.DEGENERATE] |= (model.direct.at_zenith(*point) & used).any(axis=1)
    if used.shape[1] > 1:  # a row alone agrees with nothing, nor does it disagree
        evidence = log_evidence(model.mixture, mode.cost, found.probability, mode.hessian, volume, gain)
        further[Status.NO_CONSENSUS] = evidence < options.least_evidence
    if distinct:
        elsewhere = rival_mass(fixes, volume)
        if isinstance(model.direct, DirectDirections):
            elsewhere += shared_outliers_mass(model.mixture, model.direct, fixes, volume)
        elsewhere += loose_odds(model.mixture, point, covariance, found.probability, used, volume)
        leaves_out = np.count_nonzero(used, axis=1) < used.shape[1]
        least = np.where(leaves_out, exp(-options.ambiguous_within), _ELSEWHERE_OF_ALL_ROWS)
        further[Status.AMBIGUOUS] = elsewhere >= least
    return further
