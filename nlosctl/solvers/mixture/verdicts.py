"""Statuses of robust fixes, judged by the rows classified as direct; `fix_status` judges fixes that use every row."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, Point, StatusArray, ignoring_overflow
from nlosctl.contract.results import is_fix
from nlosctl.contract.statuses import Status
from nlosctl.geometry.blocks import max_measurements
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.bearings import SightLines
from nlosctl.models.sight import Sight
from nlosctl.solvers.bearings.fix_status import mark_crossings_behind
from nlosctl.solvers.mixture.modes import Modes
from nlosctl.solvers.mixture.range_rows import RangeOutlierModel

__all__ = ["is_uncertain", "mark_behind", "near_sensor", "prefer_feasible_modes", "verdicts"]

_ON_SENSOR = 1e-6
"""A fix this near to a sensor, relative to the farthest one, is on it."""

_NEAR = 3.0
"""A point is near a sensor up to this many times the distance from which a row can be direct."""


def verdicts(lines: Any, point: Point, covariance: SymmetricMatrix, direct: BoolArray) -> dict[Status, BoolArray]:
    """Return which fixes (B,) about the local origin are infeasible or degenerate; ``direct`` (B, K) marks rows.

    infeasible: the scene hides the point from a direct row, or every direct row's bearing is below its horizon;
    degenerate: a standard deviation beyond the distance to the farthest origin.
    """
    with ignoring_overflow():
        farthest_m = lines.range_m(*point).max(axis=1)
        uncertain = ~((covariance.trace > 0.0) & (covariance.trace <= farthest_m * farthest_m))
    hidden = np.zeros(uncertain.shape, dtype=bool)
    if lines.outside_scene(*point).any():
        hidden |= (lines.unseen(*point) & direct).any(axis=1)
    under = lines.under_horizon()
    if under.any():
        hidden |= direct.any(axis=1) & ~(direct & ~under).any(axis=1)
    return {Status.INFEASIBLE: hidden, Status.DEGENERATE: uncertain}


def is_uncertain(distance_m: FloatArray, covariance: SymmetricMatrix) -> BoolArray:
    """Return which fixes (B,) at distances (B, K) from the sensors are degenerate.

    They are on a sensor, or a standard deviation is beyond the farthest.
    """
    farthest, nearest = max_measurements(distance_m), -max_measurements(-distance_m)
    with ignoring_overflow():
        uncertain: BoolArray = ~((covariance.trace > 0.0) & (covariance.trace <= farthest * farthest))
        uncertain |= nearest < _ON_SENSOR * farthest
    return uncertain


def near_sensor(lines: Any, point: Point, minimum_range_m: FloatArray) -> BoolArray:
    """Return which points (B,) are about as near to a sensor as a direct row allows.

    A likelihood that has no smooth optimum there still rises towards the sensor. The origins of circle rows, which are
    unfolded at one point of the circle, are no sensors.
    """
    range_m = lines.range_m(*point)
    if isinstance(lines, SightLines) and lines.circles is not None:
        lines.circles.place_in(range_m, np.full(lines.circles.snapshot.shape, np.inf))
    near: BoolArray = range_m.min(axis=1) <= _NEAR * minimum_range_m
    return near


def mark_behind(status: StatusArray, lines: Sight) -> None:
    """Write behind into the status (B,) of snapshots without a fix whose lines meet behind the sensors."""
    suspect = ~is_fix(status) & (status != Status.TOO_FEW)
    probe = np.where(suspect, Status.DEGENERATE, Status.OK).astype(np.uint8)
    mark_crossings_behind(probe, lines, np.zeros(status.shape))
    status[probe == Status.BEHIND] = Status.BEHIND


def prefer_feasible_modes(model: RangeOutlierModel, modes: Modes, within_nats: float) -> Modes:
    """Return the modes without those that the scene forbids.

    They stay where no other mode is left, or where they are likelier than the best other by more than ``within_nats``:
    a fix there is infeasible.
    """
    if not model.circles.restricted:
        return modes
    snapshot, index = np.nonzero(np.isfinite(modes.cost))
    point = tuple(part[snapshot, index] for part in modes.point)
    probability, _ = model.mixture.take(snapshot).responsibilities(*point)
    hidden = np.zeros(modes.cost.shape, dtype=bool)
    hidden[snapshot, index] = (model.circles.take(snapshot).unseen(*point) & (probability > 0.5)).any(axis=1)
    feasible = np.where(hidden, np.inf, modes.cost).min(axis=1)
    dropped = hidden & (modes.cost >= feasible[:, None] - within_nats) & np.isfinite(feasible)[:, None]
    if not dropped.any():
        return modes
    cost = np.where(dropped, np.inf, modes.cost)
    order = np.argsort(cost, axis=1, kind="stable")
    at = np.arange(cost.shape[0])[:, None], order
    point = tuple(part[at] for part in modes.point)
    return replace(modes, point=point, cost=cost[at], hessian=modes.hessian.at(*at))
