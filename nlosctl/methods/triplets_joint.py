"""All paths of a snapshot together: direct are those that agree on a common target."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import BoolArray, FloatArray
from nlosctl.contract.batches import TripletBatch
from nlosctl.contract.methods import MethodSpec
from nlosctl.contract.options import option
from nlosctl.contract.results import Estimates, Flags, Solution, has_position
from nlosctl.contract.statuses import Status
from nlosctl.geometry.blocks import sum_measurements
from nlosctl.models.triplets import paths_of, snapshot_centers
from nlosctl.solvers.triplets.common_target import CommonTargets, TargetModel, weigh_targets
from nlosctl.solvers.triplets.detail_columns import DETAIL_COLUMNS, detail_columns, reasons
from nlosctl.solvers.triplets.likelihood import TripletProblem, level_part, with_height
from nlosctl.solvers.triplets.target_fits import fit_paths
from nlosctl.solvers.triplets.target_status import judge_targets, p_values
from nlosctl.solvers.triplets.wall_detours import Walls

__all__ = ["METHOD", "JointOptions", "solve"]


@dataclass(frozen=True, kw_only=True)
class JointOptions:
    """Parameters of ``joint``."""

    false_alarm: float = option(
        0.05, minimum=0.0, maximum=1.0, exclusive=True, meaning="probability of flagging a direct path"
    )
    targets: int = option(1, minimum=1, maximum=3, meaning="largest number of targets in a snapshot")
    prior_indirect: float = option(
        0.5, minimum=0.0, maximum=1.0, exclusive=True, meaning="prior share of indirect paths"
    )
    clutter: float = option(
        0.002,
        minimum=0.0,
        maximum=1.0,
        exclusive=True,
        meaning="share of the indirect paths that are over something else and may be shorter than the direct path",
    )
    target_radius_m: float | None = option(
        None,
        unit="m",
        minimum=0.0,
        meaning="distance of the points at which a target scatters from its centre; default: the column's, else 0",
    )
    ambiguous_within: float = option(
        2.0, unit="nats", minimum=0.0, meaning="another set of targets this near makes an estimate ambiguous"
    )


def solve(batch: TripletBatch, options: JointOptions) -> Solution:
    """Flag the paths of a batch, all of a snapshot together.

    ``p_value`` is that of the path by itself (as in chi2) times ``direct_probability``, the posterior probability
    that it belongs to a common target: for a direct path that is near 1 wherever enough others see the target.

    If all direct paths are blocked, detours over a target that is near a wall may meet at a point of the wall, and fit
    it as direct paths would. A target on a wall of the scene is ambiguous if its paths fit better as such detours.
    Without the walls in the scene 3 % of the snapshots of a room without direct paths are ok. In space a target behind
    a wall of the scene is ambiguous, too. Paths without elevations have no p-value: ``direct_probability`` flags them.
    A target of paths that lack one is ambiguous, since detours over a floor have the azimuths of direct paths. A
    measured height is that of every target, and of nothing else.
    """
    rows = paths_of(batch)
    fits = fit_paths(rows)
    center = snapshot_centers(batch)
    problem = TripletProblem.of_snapshots(batch, center, options.target_radius_m)
    model = TargetModel(prior_indirect=options.prior_indirect, clutter=options.clutter, targets=options.targets)
    common = weigh_targets(problem, rows.dense_from(center, *fits.point), model, _own_scatterers(batch, center))
    own_p_value = rows.dense(p_values(rows, fits))
    # Without any valid hypothesis of a target (a lone path along its baseline) a path is judged by itself.
    weighed = sum_measurements(common.direct)[:, None] > 0.0
    direct_probability = np.where(weighed, common.direct, np.nan)
    p_value = own_p_value * np.where(weighed, common.direct, 1.0)
    # A path without spare scalars has no p-value of its own: its membership alone decides.
    ip = np.where(np.isnan(p_value), common.direct * weighed, p_value) < options.false_alarm
    inconsistent = own_p_value < options.false_alarm
    estimates, used = _estimates(batch, problem, common, center, options.ambiguous_within)
    flags = Flags(
        used=used,
        columns={
            "ip": ip,
            "p_value": p_value,
            "reason": reasons(ip.shape, ("inconsistent", inconsistent), ("off_target", ip & ~inconsistent)),
            "direct_probability": direct_probability,
            **(detail_columns(rows, options.false_alarm) if batch.want_details else {}),
        },
    )
    return Solution(estimates=estimates, flags=flags)


def _own_scatterers(batch: TripletBatch, center: tuple[FloatArray, ...]) -> tuple[FloatArray, ...] | None:
    """Return the scatterers (three arrays (B, K)) that fit each path without the height of the target; None without."""
    if batch.target_z_m is None:
        return None
    rows = paths_of(replace(batch, target_z_m=None, target_z_std_m=None))
    return rows.dense_from(center, *fit_paths(rows).point)


def _lacks_elevations(batch: TripletBatch) -> BoolArray:
    """Return in which snapshots (B,) in space a path lacks an elevation."""
    lacks = np.zeros(batch.size, dtype=bool)
    for elevation in (batch.dod_elevation_rad, batch.doa_elevation_rad) if batch.dimension == 3 else ():
        lacks |= True if elevation is None else np.isnan(elevation).any(axis=1)
    return lacks


def _estimates(
    batch: TripletBatch,
    problem: TripletProblem,
    common: CommonTargets,
    center: tuple[FloatArray, ...],
    ambiguous_within: float,
) -> tuple[Estimates, BoolArray]:
    """Return the best set of targets of each snapshot, and the paths (B, K) that they rest on.

    Every snapshot has at least one row, if only for its status; targets are numbered by the likelihood of each.
    """
    targets, size = common.point[0].shape
    information, held = common.information, problem.held
    covariance = information.inverse() if held is None else with_height(level_part(information).inverse())
    point = common.point
    if held is not None:
        point = (*point[:2], np.where(np.isfinite(point[2]), held.z_m, np.nan))
    status = np.empty((targets, size), dtype=np.uint8)
    walls = Walls(batch.scene, center)
    for index in range(targets):
        place = tuple(part[index] for part in point)
        status[index] = judge_targets(problem, place, covariance.at(index), np.isfinite(place[0]))
        paths = common.supported[index] & (status[index] == Status.OK)[:, None]
        detours = walls.may_be_detours(problem, place, information.at(index), paths)
        status[index][detours] = Status.AMBIGUOUS
    status[(status == Status.OK) & ((common.lead < ambiguous_within) | _lacks_elevations(batch))] = Status.AMBIGUOUS
    status[~common.supported.any(axis=2) | common.unfounded] = Status.NO_TARGET
    answered = has_position(status)
    supported = common.supported & answered[:, :, None]
    present = (np.isfinite(common.point[0]) | (np.arange(targets) == 0)[:, None]).T

    def listed(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return what is present of (T, B), snapshot by snapshot."""
        return np.asarray(values.T[present])

    row, target = np.nonzero(present)
    estimates = Estimates.of(
        listed(status),
        tuple(listed(part + own) for part, own in zip(point, center, strict=True)),
        covariance.map(listed),
        listed(np.broadcast_to(common.cost, (targets, size))),
        listed(np.count_nonzero(supported, axis=2)),
        row=row,
        target=target,
        chi_square=listed(common.chi_square),
        degrees_of_freedom=listed(problem.degrees_of_freedom(supported)),
    )
    return estimates, np.logical_or.reduce(supported, axis=0)


def _remark(options: JointOptions) -> str:
    """Return to which level the false-alarm probability holds."""
    return "the false-alarm probability is guaranteed (to a fifth) down to 0.01; chi2 keeps it at any level"


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
    dimensions=(2, 3),
    remark=_remark,
    flags=("ip", "p_value", "reason", "direct_probability"),
    details=DETAIL_COLUMNS,
    reads=frozenset({"target_radius_m"}),
)
