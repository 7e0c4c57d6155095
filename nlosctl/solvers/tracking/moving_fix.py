"""Position and velocity of sources that move within a snapshot, by bearings or ranges whose rows have times.

The likelihood is that of rows at p + v (t_i - t), one velocity within the snapshot: target-motion analysis (Nardone,
Aidala 1981; Nardone, Lindgren, Gong 1984). See docs/moving-sources.md.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, Point, StatusArray, ignoring_invalid
from nlosctl.contract.batches import Batch, BearingBatch, RangeBatch
from nlosctl.contract.results import Flags, Solution
from nlosctl.contract.statuses import Status
from nlosctl.contract.tables import VELOCITY
from nlosctl.errors import UsageError
from nlosctl.geometry.blocks import sum_measurements
from nlosctl.models.bearings import SightLines
from nlosctl.models.ranges.circles import RangeCircles
from nlosctl.models.ranges.spheres import RangeRows, range_rows
from nlosctl.models.sight import bearing_lines
from nlosctl.models.space.lines import SpaceLines
from nlosctl.models.space.sphere_lines import SphereLines
from nlosctl.solvers.bearings.joint_range_bearing import range_columns
from nlosctl.solvers.optimization.split_batches import take_snapshots
from nlosctl.solvers.ranges.paired_estimates import RangeOptimum, paired_estimates
from nlosctl.solvers.tracking.moving_rows import MovingRows, split_state
from nlosctl.solvers.tracking.moving_source import MovingOptimum, find_moving_optima, judge_moving
from nlosctl.solvers.tracking.moving_starts import bearing_starts, range_starts, ray_origins
from nlosctl.solvers.tracking.trusted_rows import trusted_bearings, trusted_ranges

__all__ = ["moving_rows", "solve_moving_bearings", "solve_moving_ranges"]

_PLAUSIBLE_STDS = 5.0
"""Bearings of the opposite sense explain a snapshot if their chi-square is within so many of its standard deviations.
"""

_DECISIVE_NATS = 10.0

BatchT = TypeVar("BatchT", BearingBatch, RangeBatch)


def solve_moving_bearings(
    batch: BearingBatch,
    *,
    use_ranges: bool,
    lognormal: bool,
    min_range_m: float,
    ambiguous_within: float,
    max_iterations: int,
) -> Solution:
    """Return position and velocity of each snapshot by its bearings, and its ranges if they are used.

    too_few: fewer scalars than unknowns; degenerate: see `judge_moving`; behind: the source is behind a sensor when
    that sees it, or bearings of the opposite sense have an answer where these have none. ambiguous: another optimum is
    within ``ambiguous_within`` nats. Raises UsageError for what has no model of motion.
    """
    elapsed_s = _times(batch)
    lines: Any = _straight_lines(batch)
    ranges = range_columns(batch, use_ranges)
    followed = trusted_bearings(batch, use_ranges=use_ranges, lognormal=lognormal)
    moving = MovingRows.of(followed.rows, ray_origins(lines), elapsed_s)
    starts = bearing_starts(lines, moving, None if ranges is None else ranges[0])
    optima = find_moving_optima(moving, starts, max_iterations)
    status, other_status = (judge_moving(moving, optimum, min_range_m) for optimum in optima)
    scalars = sum_measurements(followed.scalars.astype(np.float64)).astype(np.int64)
    for optimum, word in zip(optima, (status, other_status), strict=True):
        place, _ = split_state(optimum.state)
        word[(word == Status.OK) & lines.outside_scene(*place)] = Status.INFEASIBLE
        word[np.isin(word, (Status.OK, Status.INFEASIBLE)) & _is_behind(lines, moving, optimum)] = Status.BEHIND
    lost = np.flatnonzero(np.isin(status, (Status.DEGENERATE, Status.NOT_CONVERGED)))
    if lost.size and ranges is None:
        opposite = _suits_opposite(take_snapshots(batch, lost), optima[0].cost[lost], min_range_m, max_iterations)
        status[lost[opposite]] = Status.BEHIND
    status[scalars < len(optima[0].state)] = Status.TOO_FEW
    return _finished(
        batch, lines, moving, optima, (status, other_status), scalars, ambiguous_within, followed.residuals
    )


def solve_moving_ranges(
    batch: RangeBatch, *, min_range_m: float, ambiguous_within: float, max_iterations: int
) -> Solution:
    """Return position and velocity of each snapshot by its ranges; statuses and errors as with bearings."""
    elapsed_s, rows = _times(batch), range_rows(batch)
    if isinstance(rows, RangeCircles) and rows.bent_snapshots().any():
        raise UsageError("motion=velocity is not for rows that a circle reflects; leave those rows out")
    followed = trusted_ranges(batch)
    moving = MovingRows.of(followed.rows, rows.sensor, elapsed_s)
    starts = range_starts(batch, moving, rows.center, max_iterations)
    optima = find_moving_optima(moving, starts, max_iterations)
    status, other_status = (judge_moving(moving, optimum, min_range_m) for optimum in optima)
    if rows.restricted:
        for optimum, word in zip(optima, (status, other_status), strict=True):
            hidden = rows.unseen(*split_state(optimum.state)[0]).any(axis=1)
            word[(word == Status.OK) & hidden] = Status.INFEASIBLE
    scalars = np.full(batch.size, batch.measurements)
    status[scalars < len(optima[0].state)] = Status.TOO_FEW
    return _finished(batch, rows, moving, optima, (status, other_status), scalars, ambiguous_within, followed.residuals)


def moving_rows(batch: BearingBatch | RangeBatch) -> tuple[MovingRows, Point]:
    """Return the rows of a batch at their times, and the local origins; raises UsageError as the solutions do."""
    elapsed_s = _times(batch)
    if isinstance(batch, RangeBatch):
        circles = range_rows(batch)
        return MovingRows.of(trusted_ranges(batch).rows, circles.sensor, elapsed_s), circles.center
    lines: Any = _straight_lines(batch)
    followed = trusted_bearings(batch, use_ranges=True, lognormal=False)
    return MovingRows.of(followed.rows, ray_origins(lines), elapsed_s), lines.center


def _times(batch: Batch) -> FloatArray:
    """Return the times (B, K) after the mean; raises UsageError for a batch that has no model of motion."""
    if batch.elapsed_s is None:
        raise UsageError("motion=velocity is for localize, which reads the times of rows; leave it out")
    if batch.std == "unknown":
        raise UsageError("motion=velocity needs stated standard deviations; leave out one of it and `estimate_std`")
    if batch.target_z_m is not None:
        raise UsageError("motion=velocity in three dimensions estimates the height: leave out target_z_m")
    return batch.elapsed_s


def _straight_lines(batch: BearingBatch) -> SightLines | SpaceLines:
    """Return the rays of a batch; raises UsageError for rows that circles or spheres reflect, and for geodesics."""
    lines = bearing_lines(batch)
    if isinstance(lines, SphereLines) or getattr(lines, "circles", None) is not None:
        raise UsageError("motion=velocity is not for rows that a circle or sphere reflects; leave those rows out")
    if not isinstance(lines, SightLines | SpaceLines):
        raise UsageError("motion=velocity is not for azimuths of geodesics; set `dimensions` to 2")
    return lines


def _is_behind(lines: SightLines | SpaceLines, moving: MovingRows, optimum: MovingOptimum) -> BoolArray:
    """Return where (B,) a source is behind a ray's origin at the time of the row."""
    directions = lines.directions() if isinstance(lines, SpaceLines) else (lines.cosine, lines.sine)
    behind = np.zeros(optimum.cost.shape, dtype=bool)
    with ignoring_invalid():
        for k in range(moving.count):
            away = zip(moving.point(k, optimum.state), moving.origin, directions, strict=True)
            behind |= np.sum([ray[:, k] * (part - own[:, k]) for part, own, ray in away], axis=0) < 0.0
    return behind


def _suits_opposite(batch: BearingBatch, cost: FloatArray, min_range_m: float, max_iterations: int) -> BoolArray:
    """Return where (B,) bearings of the opposite sense have an answer, fit it, and cost far less than ``cost`` (B,).

    A false maximum of a state that is not observable costs little, so the last condition is not met there.
    """
    turned = np.asfortranarray(batch.bearing_rad - np.copysign(np.pi, batch.bearing_rad))
    risen = None if batch.elevation_rad is None else np.asfortranarray(-batch.elevation_rad)
    batch = replace(batch, bearing_rad=turned, elevation_rad=risen, range_m=None, range_std_m=None)
    lines, followed = _straight_lines(batch), trusted_bearings(batch, use_ranges=False, lognormal=False)
    moving = MovingRows.of(followed.rows, ray_origins(lines), _times(batch))
    best, _ = find_moving_optima(moving, bearing_starts(lines, moving, None), max_iterations)
    degrees = sum_measurements(followed.scalars.astype(np.float64)) - len(best.state)
    with ignoring_invalid():
        fits = 2.0 * best.cost <= degrees + _PLAUSIBLE_STDS * np.sqrt(2.0 * np.maximum(degrees, 1.0))
    answered = judge_moving(moving, best, min_range_m) == Status.OK
    return np.asarray(answered & fits & ~(best.cost + _DECISIVE_NATS > cost) & ~_is_behind(lines, moving, best))


def _finished(
    batch: BatchT,
    frame: SightLines | SpaceLines | RangeRows,
    moving: MovingRows,
    optima: tuple[MovingOptimum, MovingOptimum],
    statuses: tuple[StatusArray, StatusArray],
    scalars: IntArray,
    ambiguous_within: float,
    residuals: Any,
) -> Solution:
    """Return the solution of snapshots with two optima each: the second is the alternative where it is an answer."""
    status, other_status = statuses
    with ignoring_invalid():
        second = (status == Status.OK) & (other_status == Status.OK)
        ambiguous = second & (optima[1].cost - optima[0].cost <= ambiguous_within)
    status[ambiguous] = other_status[ambiguous] = Status.AMBIGUOUS
    others = np.flatnonzero(second)
    columns = [_velocity_columns(moving, optimum) for optimum in optima]
    estimates = paired_estimates(
        others,
        frame,
        (_position(optima[0]), _position(optima[1])),
        (optima[0].cost, optima[1].cost),
        (status, other_status),
        (2.0 * optima[0].cost, 2.0 * optima[1].cost),
        batch.measurements,
        scalars - len(optima[0].state),
        columns=(columns[0], {name: values[others] for name, values in columns[1].items()}),
    )
    flags = None
    if batch.want_flags:
        with ignoring_invalid():
            flags = Flags.of_fixes(status, moving.residuals(residuals, optima[0].state))
    return Solution(estimates=estimates, flags=flags)


def _position(optimum: MovingOptimum) -> RangeOptimum:
    place, _ = split_state(optimum.state)
    covariance = optimum.information.inverse().leading(len(place))
    return RangeOptimum(place, covariance, optimum.cost, optimum.converged)


def _velocity_columns(moving: MovingRows, optimum: MovingOptimum) -> dict[str, FloatArray]:
    """Return velocities (B,) and their covariances by the names of the columns."""
    _, movement = split_state(optimum.state)
    size, whole = len(movement), optimum.information.inverse()
    per_second = 1.0 / moving.duration_s
    values = [part * per_second for part in movement]
    pairs = [(one, other) for one in range(size) for other in range(one + 1)]
    values += [whole.entry(size + one, size + other) * (per_second * per_second) for one, other in pairs]
    names = [column.name for column in VELOCITY if size == 3 or not column.of_space]
    return dict(zip(names, values, strict=True))
