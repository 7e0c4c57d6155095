"""Batches of bearings and of ranges from arrays or single values."""

from __future__ import annotations

from typing import Any

import numpy as np

from nlosctl.contract.batches import BearingBatch, RangeBatch
from nlosctl.contract.fields import Field, SensorsField
from nlosctl.contract.scene import Scene


def bearing_batch(
    sensor_xy: Any,
    bearing_rad: Any,
    std_rad: Any = 0.01,
    reflector: Any = -1,
    scene: Scene | None = None,
    *,
    want_flags: bool = True,
    **columns: Any,
) -> BearingBatch:
    """Return a batch of bearings (B, K), each by a sensor of its own; the other arguments are broadcast.

    ``columns`` replace the fields of the batch.
    """
    bearing = np.asfortranarray(bearing_rad, dtype=float)
    shape = bearing.shape
    fields: dict[str, Any] = {
        "scene": scene or Scene(),
        "seed": np.zeros(shape[0], dtype=np.uint64),
        "want_flags": want_flags,
        "sensor": np.asfortranarray(np.tile(np.arange(shape[1]), (shape[0], 1))),
        "sensor_xy_m": np.asfortranarray(np.broadcast_to(np.asarray(sensor_xy, dtype=float), (*shape, 2))),
        "bearing_rad": bearing,
        "bearing_std_rad": np.asfortranarray(np.broadcast_to(np.asarray(std_rad, dtype=float), shape)),
        "path": np.zeros(shape, dtype=np.int64, order="F"),
        "reflector": np.asfortranarray(np.broadcast_to(np.asarray(reflector, dtype=np.int64), shape)),
    }
    return BearingBatch(**{**fields, **columns})


def range_batch(
    sensor_xy: Any, range_m: Any, std_m: Any = 0.1, height: Any = 0.0, sensor: Any = None, field: Field | None = None
) -> RangeBatch:
    """Return a batch of ranges (B, K); the other arguments are broadcast, ``sensor`` None: all different."""
    ranges = np.asfortranarray(range_m, dtype=float)
    shape = ranges.shape
    return RangeBatch(
        seed=np.zeros(shape[0], dtype=np.uint64),
        field=field or SensorsField(factor=1.0),
        sensor=np.asfortranarray(np.broadcast_to(np.arange(shape[1]) if sensor is None else sensor, shape)),
        sensor_xy_m=np.asfortranarray(np.broadcast_to(np.asarray(sensor_xy, dtype=float), (*shape, 2))),
        range_m=ranges,
        range_std_m=np.asfortranarray(np.broadcast_to(np.asarray(std_m, dtype=float), shape)),
        path=np.full(shape, -1, dtype=np.int64, order="F"),
        sensor_height_m=np.asfortranarray(np.broadcast_to(np.asarray(height, dtype=float), shape)),
    )
