"""Slant ranges: the height of each sensor above the plane of the targets."""

from __future__ import annotations

import dataclasses

import numpy as np

from nlosctl.errors import UsageError
from nlosctl.io.measurements.reader import Chunk

__all__ = ["with_sensor_heights"]


def with_sensor_heights(chunk: Chunk, target_z_m: float) -> Chunk:
    """Return the chunk with ``sensor_height_m``: the height of each sensor above the plane of the targets, in metres.

    Raises UsageError without heights of all sensors, and for other measurements than ranges.
    """
    if "bearing_rad" in chunk.columns or "range_m" not in chunk.columns:
        raise UsageError("`target_z_m` is for files of ranges, whose heights make them slant ranges; leave it out")
    if "sensor_z_m" not in chunk.columns:
        raise UsageError(
            "`target_z_m` needs the height of each sensor: a column 'sensor_z_m', or position = [x, y, z] in the scene"
        )
    height = chunk.columns["sensor_z_m"] - target_z_m
    if np.isnan(height).any():
        raise UsageError("`target_z_m` needs the height of each sensor, and the scene lacks some sensors; add them")
    return dataclasses.replace(chunk, columns={**chunk.columns, "sensor_height_m": height})
