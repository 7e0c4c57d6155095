"""A source that moves within a snapshot: the likeliest position and velocity, and whether they are determined."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, Point, StatusArray, ignoring_invalid, ignoring_overflow
from nlosctl.contract.statuses import Status
from nlosctl.geometry.blocks import RowBlock, max_measurements, rows_of
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.solvers.optimization.levenberg_marquardt import minimize
from nlosctl.solvers.optimization.two_optima import are_apart
from nlosctl.solvers.tracking.moving_rows import MovingRows

__all__ = ["MovingOptimum", "find_moving_optima", "judge_moving"]

_DESCENTS_AT_ONCE = 8192
_PATIENCE = 20
"""Refused steps after which a descent is given up."""

_EQUAL_NATS = 1e-6
"""Of ends whose costs differ by less than this, relative to the cost, one that has settled counts as the better."""

_CONDITION_LIMIT = 1e6
"""Largest condition number of the information, movements within the duration, of a state that is determined."""

_CREEPING_CONDITION = 1e4
"""A descent that has not settled at a larger condition creeps along a valley that leads to a false maximum."""

_RELATIVE_MINIMUM_RANGE = 1e-6
"""A path that passes a sensor at less than this share of the extent of the sensors is degenerate."""


@dataclass(frozen=True)
class MovingOptimum(RowBlock):
    """States (B,) about the local origin, their information (1 / m^2), half the chi-square, and whether it settled."""

    state: Point
    information: SymmetricMatrix
    cost: FloatArray
    converged: BoolArray


def find_moving_optima(
    moving: MovingRows, starts: Iterable[Point], max_iterations: int
) -> tuple[MovingOptimum, MovingOptimum]:
    """Return the likeliest states of B snapshots, and the likeliest that are apart from them and settled, else NaN."""
    points = list(starts)
    size = moving.duration_s.shape[0]
    ends = _descend(moving, points, max_iterations)
    every = np.arange(size)
    with ignoring_invalid():
        cost = np.where(np.isfinite(ends.cost), ends.cost, np.inf).reshape(len(points), size)
        settled = ends.converged.reshape(cost.shape) & np.isfinite(cost)
        best = np.argmin(cost + np.where(settled, 0.0, _EQUAL_NATS * (1.0 + cost)), axis=0)
    first = _with_information(moving, ends, best * size + every)
    covariance = first.information.inverse()
    rival = np.where(settled, cost, np.inf)
    for number in range(len(points)):
        there = rows_of(ends.state, number * size + every)
        rival[number, ~are_apart(there, first.state, covariance)] = np.inf
    second = np.argmin(rival, axis=0)
    other = _with_information(moving, ends, second * size + every)
    other.converged[~np.isfinite(rival[second, every])] = False
    return first, other


@dataclass(frozen=True)
class _Ends(RowBlock):
    state: Point
    cost: FloatArray
    converged: BoolArray


def _descend(moving: MovingRows, points: list[Point], max_iterations: int) -> _Ends:
    """Return where the descents from all points (S, B) end, one point of all snapshots after the other."""
    size = moving.duration_s.shape[0]
    at_once = max(1, _DESCENTS_AT_ONCE // max(1, size))
    parts = []
    for begin in range(0, len(points), at_once):
        group = points[begin : begin + at_once]
        rows = np.tile(np.arange(size), len(group))
        start = [np.concatenate(part) for part in zip(*group, strict=True)]
        parts.append(minimize(moving.take(rows), *start, max_iterations=max_iterations, patience=_PATIENCE))
    return _Ends(
        tuple(np.concatenate(part) for part in zip(*(end.point for end in parts), strict=True)),
        np.concatenate([end.cost for end in parts]),
        np.concatenate([end.converged for end in parts]),
    )


def _with_information(moving: MovingRows, ends: _Ends, index: IntArray) -> MovingOptimum:
    chosen = ends.take(index)
    return MovingOptimum(chosen.state, moving.information(chosen.state), chosen.cost, chosen.converged)


def judge_moving(moving: MovingRows, optimum: MovingOptimum, min_range_m: float) -> StatusArray:
    """Return the status (B,) of states: ok, not converged, or degenerate where the rows do not determine them.

    With noise a state that is not observable is a false maximum: the source moves with the sensor, or is far away. So
    degenerate is: the standard deviation of the position exceeds the distance to the farthest sensor, the path passes
    within ``min_range_m``, or a millionth of the sensors' extent, of a sensor that saw it, the condition is too bad, or
    the descent creeps towards such a maximum without end.
    """
    with ignoring_overflow():
        distance = moving.distance_m(optimum.state)
        farthest, nearest = max_measurements(distance), -max_measurements(-distance)
        smallest, largest = optimum.information.eigenvalues()
        position = optimum.information.inverse().leading(len(optimum.state) // 2)
        sure = (position.trace > 0.0) & (position.trace <= farthest * farthest)
        sure &= smallest * np.where(optimum.converged, _CONDITION_LIMIT, _CREEPING_CONDITION) > largest
        sure &= nearest > np.maximum(min_range_m, _RELATIVE_MINIMUM_RANGE * moving.extent_m)
    status = np.full(sure.shape, Status.OK, dtype=np.uint8)
    status[~optimum.converged] = Status.NOT_CONVERGED
    status[~sure] = Status.DEGENERATE
    return status
