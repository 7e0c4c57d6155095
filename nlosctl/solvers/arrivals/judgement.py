"""The status of the best fix of arrivals, some of them late: is it one source, in the search region, at a distance?"""

from __future__ import annotations

from dataclasses import replace
from math import exp

import numpy as np

from nlosctl.arrays import BoolArray, Point, ignoring_invalid
from nlosctl.contract.results import has_position
from nlosctl.contract.statuses import Status
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.solvers.arrivals.far_field import are_plane_waves, distance_is_open
from nlosctl.solvers.arrivals.outlier_model import ArrivalOutlierModel
from nlosctl.solvers.arrivals.subset_candidates import ArrivalCandidates
from nlosctl.solvers.mixture.consensus import find_rival, rival_mass
from nlosctl.solvers.mixture.judgement import Judgement
from nlosctl.solvers.mixture.modes import Modes
from nlosctl.solvers.mixture.outside import OutsideSearch
from nlosctl.solvers.mixture.ranked_estimates import rank_modes, ranked_status
from nlosctl.solvers.mixture.verdicts import is_uncertain

__all__ = ["judge_late_fixes"]

_FAR = 0.05
"""The distance of a fix may be open if its standard deviation is more than this share of it."""


def judge_late_fixes(
    model: ArrivalOutlierModel,
    candidates: ArrivalCandidates,
    modes: Modes,
    outside: OutsideSearch | None,
    *,
    ambiguous_within: float,
    least_evidence: float,
) -> Judgement:
    """Return the statuses of the best of ``modes``, and their ranked fixes with the offset as the last coordinate.

    no_consensus: less than ``least_evidence`` nats of evidence; ambiguous: another mode within ``ambiguous_within``
    nats or with exp(-``ambiguous_within``) of the mass, no spare row, or a single one among those used while others are
    late: any rows of that number may agree. degenerate: an uncertain fix, a distance that is open, arrivals without a
    fix that are those of a plane wave, or no set of rows with a solution.
    """
    fixes, probability = rank_modes(model.mixture, modes)
    spare = fixes.misfit.degrees_of_freedom[:, 0]
    of_position = fixes.covariance.leading(model.mixture.dimension - 1)
    covariance = of_position.at(slice(None), 0)
    point, measured = fixes.best_point[:-1], model.arrivals.degrees_of_freedom
    late = (probability <= 0.5).any(axis=1)
    further = {
        Status.NO_CONSENSUS: (model.log_evidence(modes.best) < least_evidence) & (measured > 0),
        Status.DEGENERATE: is_uncertain(model.arrivals.distance_m(*point), covariance),
        Status.AMBIGUOUS: (measured <= 0) | (spare <= len(point) - 2) | ((spare <= 1) & late),
    }
    further[Status.AMBIGUOUS] |= rival_mass(fixes, model.volume * model.window_m) >= exp(-ambiguous_within)
    far = _may_be_far(point, covariance) & (measured > 0)
    if outside is not None:
        rival = find_rival(
            model.mixture,
            outside.mode,
            fixes,
            probability,
            is_convincing=lambda rows, _: model.log_evidence_outside(outside.mode, rows) >= least_evidence,
            at_boundary=modes.at_boundary,
            margin=ambiguous_within,
        )
        fixes, probability, further[Status.OUTSIDE_FIELD] = rival.fixes, rival.probability, rival.better
        far |= rival.better
    status = ranked_status(
        replace(fixes, covariance=of_position),
        modes.candidates,
        model.too_few(),
        ambiguous_within,
        modes.at_boundary,
        further=further,
    )
    used = probability > 0.5
    some = np.flatnonzero(far & has_position(status) & (status != Status.NO_CONSENSUS))
    rows = model.arrivals.take(some)
    rows = replace(rows, std_m=np.where(used[some], rows.std_m, np.inf))
    is_open = distance_is_open(rows, *(part[some] for part in fixes.best_point[:-1]))
    status[some[is_open]] = Status.DEGENERATE
    lost = np.flatnonzero((status == Status.NO_CANDIDATE) | (status == Status.NO_CONSENSUS))
    status[lost[are_plane_waves(model.arrivals.take(lost))]] = Status.DEGENERATE
    without = np.flatnonzero(status == Status.NO_CANDIDATE)
    status[without[~candidates.points(without).valid.any(axis=1)]] = Status.DEGENERATE
    status[model.too_few()] = Status.TOO_FEW
    return Judgement(status, fixes, probability, used)


def _may_be_far(point: Point, covariance: SymmetricMatrix) -> BoolArray:
    """Return which fixes (B,) about the local origin are so uncertain that a plane wave may explain them."""
    squared = np.sum([part * part for part in point], axis=0)
    with ignoring_invalid():
        far: BoolArray = covariance.trace > _FAR * _FAR * squared
    return far
