"""Random batches of arrival times, and of their independent differences, for the laws."""

from __future__ import annotations

import dataclasses

import numpy as np

from nlosctl.contract.batches import ArrivalBatch
from nlosctl.contract.fields import CircleField
from nlosctl.testing.trials import Draw, Trial

__all__ = ["ARRIVAL_DRAW", "PAIR_DRAW", "draw_arrivals", "draw_pairs"]

_SCALES_M = (1.0, 1e3, 1e6)


def draw_arrivals(generator: np.random.Generator, snapshots: int, measurements: int, fault: str | None) -> Trial:
    """Draw arrivals of one source per snapshot, each at a different sensor; unequal stds of 0.01 % to 1 % of the size.

    The offsets are up to a hundred sizes.
    """
    shape = (snapshots, measurements)
    scale = float(generator.choice(_SCALES_M))
    sensor_xy = generator.uniform(-scale, scale, (*shape, 2))
    source_xy = generator.uniform(-scale, scale, (snapshots, 1, 2))
    if fault == "one point":
        sensor_xy[:] = sensor_xy[:, :1]
    if fault == "on one line":
        sensor_xy[..., 1] = 0.5 * sensor_xy[..., 0]
    if fault == "far away":
        source_xy *= 1e5
    std = scale * 10.0 ** generator.uniform(-4.0, -2.0, shape)
    distance = np.hypot(*np.moveaxis(sensor_xy - source_xy, -1, 0))
    arrival = distance + std * generator.normal(size=shape)
    if fault == "differences too long":
        arrival *= 10.0
    origin = 100.0 * scale * generator.normal(size=snapshots)
    batch = ArrivalBatch(
        field=CircleField(x_m=0.0, y_m=0.0, radius_m=6.0 * scale),
        seed=np.asarray(generator.integers(0, 2**63, snapshots), dtype=np.uint64),
        sensor=np.asfortranarray(np.tile(np.arange(measurements), (snapshots, 1)), dtype=np.int64),
        sensor_xy_m=np.asfortranarray(sensor_xy),
        arrival_m=np.asfortranarray(arrival - arrival.min(axis=1, initial=np.inf)[:, None]),
        arrival_std_m=np.asfortranarray(std),
        origin_m=origin,
    )
    return Trial(batch=batch, size_m=3.0 * scale)


def draw_pairs(generator: np.random.Generator, snapshots: int, measurements: int, fault: str | None) -> Trial:
    """Draw differences of pairs of sensors as `draw_arrivals` draws arrivals: each sensor and a random earlier one."""
    trial = draw_arrivals(generator, snapshots, measurements + 1, fault)
    arrivals: ArrivalBatch = trial.batch
    other = np.tile(np.arange(measurements), (snapshots, 1))
    other = (other * generator.random(other.shape)).round().astype(np.int64)
    first = np.take_along_axis(arrivals.arrival_m, other, axis=1)
    batch = dataclasses.replace(
        arrivals,
        sensor=np.asfortranarray(arrivals.sensor[:, 1:]),
        sensor_xy_m=np.asfortranarray(arrivals.sensor_xy_m[:, 1:]),
        arrival_m=np.asfortranarray(arrivals.arrival_m[:, 1:] - first),
        arrival_std_m=np.asfortranarray(arrivals.arrival_std_m[:, 1:]),
        origin_m=np.zeros(snapshots),
        reference_xy_m=np.asfortranarray(np.take_along_axis(arrivals.sensor_xy_m, other[..., None], axis=1)),
    )
    return dataclasses.replace(trial, batch=batch)


_FAULTS = ("one point", "on one line", "far away", "differences too long")

ARRIVAL_DRAW = Draw(trial=draw_arrivals, faults=_FAULTS, directions=())
"""How batches of arrivals are drawn."""

PAIR_DRAW = Draw(trial=draw_pairs, faults=_FAULTS, directions=())
"""How batches of independent differences are drawn."""
