"""Rows with the variances of the errors that they share added to their own, as if they were independent."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.models.shared_causes.causes import SensorCauses, SharedCauses
from nlosctl.models.sight import has_geodesics

__all__ = ["share_without_position", "widened"]

_STDS = {"bearings": "bearing_std_rad", "ranges": "range_std_m", "arrivals": "arrival_std_m"}


def share_without_position(kind: str, batch: Any, causes: SharedCauses) -> FloatArray:
    """Return each scalar's own variance (B, S) as a share of that with the errors of offsets, which need no position.

    The scalars are azimuths, in space elevations, and ranges where the rows have them.
    """
    name = _STDS[kind]
    variance = _offset_variance(causes.sensors, causes.covariance)
    if causes.reference is not None:
        variance = variance + _offset_variance(causes.reference, causes.covariance)
    parts = [variance / getattr(batch, name) ** 2]
    if kind == "bearings" and batch.dimension == 3 and not has_geodesics(batch):
        parts.append(np.zeros(variance.shape))
    if kind == "bearings" and batch.range_std_m is not None:
        parts.append(np.nan_to_num((causes.sensors.range_offset_std_m / batch.range_std_m) ** 2))
    return np.asarray(1.0 / (1.0 + np.concatenate(parts, axis=1)))


def _offset_variance(sensors: SensorCauses, covariance: FloatArray) -> FloatArray:
    calibrated = np.append(np.diag(covariance), 0.0)
    return np.asarray(sensors.offset_std**2 + calibrated[sensors.entry])


def widened(kind: str, batch: Any, share: FloatArray) -> tuple[Any, FloatArray]:
    """Return the batch with larger stds, and the share (B, S) of its own in the variance of each scalar.

    ``share`` is that wanted. ``direction_std_rad``, which is of two scalars, has the larger of their variances. The
    speed of arrivals is exact then: its error is one of those that rows share.
    """
    count = int(batch.sensor.shape[1])
    changed: dict[str, Any] = {}
    if kind == "bearings" and batch.dimension == 3 and share.shape[1] > count:
        azimuth, rise = share[:, :count], share[:, count : 2 * count]
        if batch.direction_std_rad is not None:
            least = np.minimum(azimuth, rise)
            share = np.concatenate([least, least, share[:, 2 * count :]], axis=1)
            azimuth = rise = least
            changed["direction_std_rad"] = batch.direction_std_rad / np.sqrt(least)
        elif batch.elevation_std_rad is not None:
            changed["elevation_std_rad"] = batch.elevation_std_rad / np.sqrt(rise)
        changed["bearing_std_rad"] = batch.bearing_std_rad / np.sqrt(azimuth)
        of_ranges = slice(2 * count, 3 * count)
    else:
        changed[_STDS[kind]] = getattr(batch, _STDS[kind]) / np.sqrt(share[:, :count])
        of_ranges = slice(count, 2 * count)
    if kind == "bearings" and batch.range_std_m is not None and share[:, of_ranges].shape[1] == count:
        changed["range_std_m"] = batch.range_std_m / np.sqrt(share[:, of_ranges])
    if kind == "arrivals":
        changed["speed_std"] = None
    return dataclasses.replace(
        batch, **{name: None if value is None else np.asfortranarray(value) for name, value in changed.items()}
    ), share
