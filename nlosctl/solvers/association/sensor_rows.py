"""The unlabelled rows of snapshots by sensor, in an order that does not depend on that of the input.

A sensor is a name, a position and a reflector: a source gives it at most one row.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from nlosctl.arrays import IntArray
from nlosctl.contract.batches import BearingBatch
from nlosctl.errors import DataError

__all__ = ["SensorRows", "gather_measurements", "rows_by_sensor"]

_NOTHING = -1


@dataclass(frozen=True)
class SensorRows:
    """A batch whose rows (B, K) are ordered by sensor and bearing, and which of them each sensor has.

    ``order`` (B, K) is the index of each row in the batch as it was, ``sensor`` (B, K) its sensor, numbered from 0 in
    each snapshot; ``rows`` (B, N, M) are the rows of each sensor, -1 after the last, ``sensors`` (B,) their number.
    """

    batch: BearingBatch
    order: IntArray
    sensor: IntArray
    rows: IntArray
    sensors: IntArray


def rows_by_sensor(batch: BearingBatch, max_echoes: int) -> SensorRows:
    """Return the bearings of a batch by sensor, without ranges and priors.

    Raises DataError where a sensor has more than ``max_echoes`` bearings in a snapshot.
    """
    place = [batch.sensor_xy_m[..., 0], batch.sensor_xy_m[..., 1]]
    place += [] if batch.sensor_z_m is None else [batch.sensor_z_m]
    owner = [*place, batch.reflector, batch.sensor]
    angles = [batch.bearing_rad, batch.elevation_rad, batch.bearing_std_rad]
    order = np.lexsort([key for key in (*owner, *angles) if key is not None][::-1], axis=1)
    snapshot = np.arange(batch.size)
    ordered = gather_measurements(_bearings_alone(batch), snapshot, order)
    differs = np.zeros(order.shape, dtype=bool)
    for key in owner:
        values = np.take_along_axis(key, order, axis=1)
        differs[:, 1:] |= values[:, 1:] != values[:, :-1]
    sensor = np.cumsum(differs, axis=1)
    index = np.arange(order.shape[1])
    within = index - np.maximum.accumulate(np.where(differs, index, 0), axis=1)
    most = int(within.max(initial=0)) + 1
    if most > max_echoes:
        raise DataError(
            f"a sensor has {most} bearings in one snapshot, more than max_echoes={max_echoes}; "
            "the work grows with their square: leave out weak ones, or raise the parameter"
        )
    rows = np.full((batch.size, int(sensor.max(initial=0)) + 1, most), _NOTHING, dtype=np.int64)
    rows[snapshot[:, None], sensor, within] = index
    return SensorRows(ordered, order, sensor, rows, sensor[:, -1] + 1)


def gather_measurements(batch: BearingBatch, snapshot: IntArray, rows: IntArray) -> BearingBatch:
    """Return a batch whose snapshots are ``rows`` (T, n) of the snapshots (T,) of a batch."""
    arrays: dict[str, Any] = {}
    for field in dataclasses.fields(batch):
        values = getattr(batch, field.name)
        if isinstance(values, np.ndarray):
            index: Any = snapshot if values.ndim == 1 else (snapshot[:, None], rows)
            arrays[field.name] = np.asfortranarray(values[index])
    return replace(batch, **arrays)


def _bearings_alone(batch: BearingBatch) -> BearingBatch:
    nothing: dict[str, Any] = {"range_m": None, "range_std_m": None}
    nothing |= {"prior_xy_m": None, "prior_std_m": None, "prior_cov_m2": None}
    return replace(batch, **nothing)
