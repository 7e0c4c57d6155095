"""Snapshots of azimuths and elevations in space, made by equations of their own."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.scene import Scene

Array = npt.NDArray[np.float64]


def angles_of(vector: Array) -> tuple[Array, Array]:
    """Return azimuths and elevations (...) of vectors (..., 3)."""
    return (
        np.arctan2(vector[..., 1], vector[..., 0]),
        np.arctan2(vector[..., 2], np.hypot(vector[..., 0], vector[..., 1])),
    )


def space_batch(
    sensor: Array, azimuth: Array, elevation: Array, std: Any, elevation_std: Any, **more: Any
) -> BearingBatch:
    """Return a batch of sensors (B, K, 3) that measure azimuths and elevations (B, K), NaN without one."""
    shape = azimuth.shape
    fields: dict[str, Any] = {
        "seed": np.zeros(shape[0], dtype=np.uint64),
        "dimension": 3,
        "sensor": np.broadcast_to(np.arange(shape[1]), shape),
        "sensor_xy_m": np.asfortranarray(sensor[..., :2]),
        "sensor_z_m": np.asfortranarray(sensor[..., 2]),
        "bearing_rad": np.asfortranarray(azimuth),
        "bearing_std_rad": np.asfortranarray(np.broadcast_to(std, shape)),
        "elevation_rad": np.asfortranarray(elevation),
        "elevation_std_rad": np.asfortranarray(np.broadcast_to(elevation_std, shape)),
        "path": np.full(shape, -1),
        "reflector": np.full(shape, -1),
        "scene": Scene(),
    }
    return BearingBatch(**{**fields, **more})


def ring_world(
    generator: np.random.Generator, size: int, std_deg: float, *, without_elevation: bool = False, rows: int = 8
) -> tuple[BearingBatch, Array]:
    """Return snapshots of sensors on a ring of 500 m at 0 to 60 m, and sources (B, 3) up to 200 m high.

    Standard deviations are half to twice ``std_deg``; every second row may be ``without_elevation``.
    """
    turn = 2.0 * np.pi * np.arange(rows) / rows
    sensor = np.stack([500.0 * np.cos(turn), 500.0 * np.sin(turn), np.linspace(0.0, 60.0, rows)], axis=-1)
    sensor = np.broadcast_to(sensor, (size, rows, 3))
    source = np.stack(
        [
            generator.uniform(-300.0, 300.0, size),
            generator.uniform(-300.0, 300.0, size),
            generator.uniform(0.0, 200.0, size),
        ],
        axis=-1,
    )
    azimuth, elevation = angles_of(source[:, None] - sensor)
    std, elevation_std = np.radians(std_deg) * generator.uniform(0.5, 2.0, (2, size, rows))
    azimuth = azimuth + std * generator.standard_normal(azimuth.shape)
    elevation = elevation + elevation_std * generator.standard_normal(azimuth.shape)
    if without_elevation:
        elevation[:, 1::2] = np.nan
    return space_batch(sensor, azimuth, elevation, std, elevation_std), source


def with_height(batch: BearingBatch, height_m: Array, std_m: float) -> BearingBatch:
    """Return a batch with a measured height (B,) of the source."""
    return replace(batch, target_z_m=height_m, target_z_std_m=np.full(height_m.shape, std_m))


def dense_covariance(parts: Array) -> Array:
    """Return covariances (B, 3, 3) from their six columns: the lower triangle row by row."""
    dense = np.empty((parts.shape[0], 3, 3))
    for column, (i, j) in enumerate([(0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (2, 2)]):
        dense[:, i, j] = dense[:, j, i] = parts[:, column]
    return dense
