"""All paths of a snapshot together: direct are those that agree on a common target."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import erfc

from nlosctl.contract.batches import TripletBatch
from nlosctl.contract.methods import MethodSpec
from nlosctl.contract.options import option
from nlosctl.contract.results import Estimates, Flags, Solution
from nlosctl.contract.statuses import Status
from nlosctl.models.triplets import path_rows, snapshot_centers
from nlosctl.solvers.common_target import CommonTargets, TargetModel, weigh_targets
from nlosctl.solvers.path_estimates import judge_targets
from nlosctl.solvers.path_reasons import reasons
from nlosctl.solvers.triplet_fits import fit_paths
from nlosctl.solvers.triplet_problem import TripletProblem

__all__ = ["METHOD", "JointOptions", "solve"]

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class JointOptions:
    """Parameters of ``joint``."""

    false_alarm: float = option(
        0.05, minimum=0.0, maximum=1.0, exclusive=True, meaning="probability of flagging a direct path"
    )
    targets: int = option(1, minimum=1, maximum=3, meaning="how many targets a snapshot may have")
    prior_indirect: float = option(
        0.5, minimum=0.0, maximum=1.0, exclusive=True, meaning="share of indirect paths expected before the data"
    )
    clutter: float = option(
        0.002,
        minimum=0.0,
        maximum=1.0,
        exclusive=True,
        meaning="share of the indirect paths that are over something else and may be shorter than the direct path",
    )
    ambiguous_within: float = option(
        2.0, unit="nats", minimum=0.0, meaning="another set of targets this near makes an estimate ambiguous"
    )


def solve(batch: TripletBatch, options: JointOptions) -> Solution:
    """Flag the paths of a batch, all of a snapshot together.

    ``p_value`` is that of the path by itself (as in chi2) times ``direct_probability``, the posterior probability
    that it belongs to a common target: for a direct path that is near 1 wherever enough others see the target.
    """
    rows = path_rows(batch)
    fits = fit_paths(rows)
    center_x, center_y = snapshot_centers(batch)
    x, y = rows.frame.to_global(fits.x, fits.y)
    problem = TripletProblem.of_snapshots(batch, center_x, center_y)
    model = TargetModel(prior_indirect=options.prior_indirect, clutter=options.clutter, targets=options.targets)
    proposed = (rows.dense(x) - center_x[:, None], rows.dense(y) - center_y[:, None])
    common = weigh_targets(problem, *proposed, model)
    own_p_value = rows.dense(erfc(np.sqrt(fits.cost)))
    p_value = own_p_value * common.direct
    ip = p_value < options.false_alarm
    inconsistent = own_p_value < options.false_alarm
    flags = Flags(
        used=~np.isnan(p_value),
        columns={
            "ip": ip,
            "p_value": p_value,
            "reason": reasons(ip.shape, ("inconsistent", inconsistent), ("off_target", ip & ~inconsistent)),
            "direct_probability": common.direct,
        },
    )
    return Solution(estimates=_estimates(problem, common, center_x, center_y, options.ambiguous_within), flags=flags)


def _estimates(
    problem: TripletProblem, common: CommonTargets, center_x: FloatArray, center_y: FloatArray, ambiguous_within: float
) -> Estimates:
    """Return the best set of targets of each snapshot, in order of rising target; at least one row a snapshot."""
    rows, targets, positions, covariances, counts, statuses = ([] for _ in range(6))
    for place in range(common.x.shape[0]):
        information = common.information
        covariance = type(information)(information.xx[place], information.xy[place], information.yy[place]).inverse()
        x, y = common.x[place], common.y[place]
        status = judge_targets(problem, x, y, covariance, np.isfinite(x + y))
        status[(status == Status.OK) & (common.lead < ambiguous_within)] = Status.AMBIGUOUS
        status[common.supporters[place] < 1.0] = Status.NO_TARGET
        present = np.flatnonzero(np.isfinite(x)) if place else np.arange(x.shape[0])
        rows.append(present)
        targets.append(np.full(present.shape, place, dtype=np.int64))
        positions.append(np.stack([x + center_x, y + center_y], axis=1)[present])
        covariances.append(np.stack([covariance.xx, covariance.xy, covariance.yy], axis=1)[present])
        counts.append(common.supporters[place][present].astype(np.int64))
        statuses.append(status[present])
    row, target = np.concatenate(rows), np.concatenate(targets)
    order = np.lexsort((target, row))
    status = np.concatenate(statuses)[order]
    answered = (status <= Status.BOUNDARY)[:, None]
    return Estimates(
        row=row[order],
        target=target[order],
        alternative=np.zeros_like(row),
        position_m=np.where(answered, np.concatenate(positions)[order], np.nan),
        covariance_m2=np.where(answered, np.concatenate(covariances)[order], np.nan),
        cost=np.where(answered[:, 0], common.cost[row[order]], np.nan),
        n_used=np.where(answered[:, 0], np.concatenate(counts)[order], 0),
        status=status,
    )


METHOD = MethodSpec(
    name="joint",
    kind="triplets",
    job="detect-ip",
    summary="all paths of a snapshot together: direct are those that agree on a common target",
    reference="Shen, Molisch 2012, Section IV-C (several pairs); posterior over targets, Laplace's approximation",
    options=JointOptions,
    solve=solve,
    cost="negative log-evidence of the best set of targets, in nats",
    minimum_measurements=1,
    flags=("ip", "p_value", "reason", "direct_probability"),
)
