"""The unlabelled echoes of one snapshot, sensor by sensor, in an order that does not depend on that of the rows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import FloatArray, IntArray, ScalarT
from nlosctl.contract.batches import RangeBatch
from nlosctl.errors import DataError

__all__ = ["Echoes", "read_echoes"]


@dataclass(frozen=True)
class Echoes:
    """N sensors and at most M echoes of each, in metres about a local origin, the mean of the sensors.

    ``radius``, ``range_m``, ``std_m`` and ``row`` have shape (N, M): ranges in the plane (0 where a slant range is
    shorter than the height), ranges as measured, their std, and the index in the snapshot. They rise along a
    sensor; after its last echo they are NaN and -1. ``sensor_x``, ``sensor_y``, ``height`` are (N,).
    """

    center_x: float
    center_y: float
    sensor_x: FloatArray
    sensor_y: FloatArray
    height: FloatArray
    radius: FloatArray
    range_m: FloatArray
    std_m: FloatArray
    row: IntArray

    @property
    def sensors(self) -> int:
        """The number of sensors that have an echo, N."""
        return int(self.radius.shape[0])

    @property
    def most(self) -> int:
        """The largest number of echoes of a sensor, M."""
        return int(self.radius.shape[1])


def read_echoes(batch: RangeBatch, snapshot: int, max_echoes: int) -> Echoes:
    """Return the echoes of one snapshot of a batch, sensors by position and echoes by range.

    Raises DataError where a sensor has more than ``max_echoes`` echoes.
    """
    x, y = batch.sensor_xy_m[snapshot, :, 0], batch.sensor_xy_m[snapshot, :, 1]
    range_m, std, height = batch.range_m[snapshot], batch.range_std_m[snapshot], batch.sensor_height_m[snapshot]
    sensor = batch.sensor[snapshot]
    order = np.lexsort((std, range_m, sensor, height, y, x))
    same = np.ones(order.shape[0], dtype=bool)
    for key in (x, y, height, sensor):
        same[1:] &= key[order][1:] == key[order][:-1]
    same[:1] = False
    number = np.cumsum(~same) - 1
    first = np.flatnonzero(~same)
    index = np.arange(order.shape[0]) - first[number]
    most = int(index.max()) + 1
    if most > max_echoes:
        raise DataError(
            f"a sensor has {most} echoes in one snapshot, more than max_echoes={max_echoes}; "
            "the work grows with their square: leave out weak ones, or raise the parameter"
        )
    radius = np.sqrt(np.maximum(range_m * range_m - height * height, 0.0))
    center_x, center_y = x[order][first].mean(), y[order][first].mean()

    def spread(values: npt.NDArray[ScalarT], empty: float) -> npt.NDArray[ScalarT]:
        table = np.full((first.shape[0], most), empty, dtype=values.dtype)
        table[number, index] = values[order]
        return table

    return Echoes(
        center_x=float(center_x),
        center_y=float(center_y),
        sensor_x=x[order][first] - center_x,
        sensor_y=y[order][first] - center_y,
        height=height[order][first],
        radius=spread(radius, np.nan),
        range_m=spread(range_m, np.nan),
        std_m=spread(std, np.nan),
        row=spread(np.arange(order.shape[0]), -1),
    )
