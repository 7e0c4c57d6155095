"""Ranges in space from arrays, made by equations of their own."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.contract.batches import RangeBatch

Array = npt.NDArray[np.float64]


def distances(sensors: Array, sources: Array) -> Array:
    """Return the distances (B, K) of sources (B, 3) from sensors (K, 3) or (B, K, 3)."""
    return np.asarray(np.linalg.norm(sources[:, None, :] - sensors, axis=2))


def sphere_batch(
    sensors: Any, range_m: Any, std_m: Any = 0.1, z_m: Any = None, z_std_m: Any = None, **more: Any
) -> RangeBatch:
    """Return a batch of ranges (B, K) in space from sensors (..., 3); other arguments are broadcast."""
    ranges = np.asfortranarray(range_m, dtype=float)
    shape = ranges.shape
    sensor = np.broadcast_to(np.asarray(sensors, dtype=float), (*shape, 3))
    fields: dict[str, Any] = {
        "seed": np.zeros(shape[0], dtype=np.uint64),
        "dimension": 3,
        "sensor": np.asfortranarray(np.broadcast_to(np.arange(shape[1]), shape)),
        "sensor_xy_m": np.asfortranarray(sensor[..., :2]),
        "sensor_z_m": np.asfortranarray(sensor[..., 2]),
        "range_m": ranges,
        "range_std_m": np.asfortranarray(np.broadcast_to(np.asarray(std_m, dtype=float), shape)),
        "path": np.full(shape, -1, dtype=np.int64, order="F"),
        "sensor_height_m": np.zeros(shape, order="F"),
    }
    if z_m is not None:
        fields["target_z_m"] = np.broadcast_to(np.asarray(z_m, dtype=float), shape[:1]).copy()
        fields["target_z_std_m"] = np.broadcast_to(np.asarray(z_std_m, dtype=float), shape[:1]).copy()
    return RangeBatch(**{**fields, **more})
