"""Random batches of arrival times for the laws."""

from __future__ import annotations

import numpy as np

from nlosctl.contract.batches import ArrivalBatch
from nlosctl.contract.fields import CircleField
from nlosctl.testing.trials import Draw, Trial

__all__ = ["ARRIVAL_DRAW", "draw_arrivals"]

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


ARRIVAL_DRAW = Draw(
    trial=draw_arrivals, faults=("one point", "on one line", "far away", "differences too long"), directions=()
)
"""How batches of arrivals are drawn."""
