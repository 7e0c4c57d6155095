"""The unlabelled echoes of one snapshot, sensor by sensor, in an order that does not depend on that of the rows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import FloatArray, IntArray, Point, ScalarT
from nlosctl.contract.batches import RangeBatch
from nlosctl.errors import DataError
from nlosctl.models.measured_height import MeasuredHeight

__all__ = ["Echoes", "read_echoes", "sensor_positions"]


@dataclass(frozen=True)
class Echoes:
    """N sensors and at most M echoes of each, in metres about a local origin, the mean of the sensors.

    ``radius``, ``range_m``, ``std_m`` and ``row`` have shape (N, M): ranges in the plane (0 where a slant range is
    shorter than the height; in space the ranges), ranges as measured, their std, and the index in the snapshot. They
    rise along a sensor; after its last echo they are NaN and -1. ``sensor`` (D arrays) and ``height`` are (N,); the
    heights are 0 in space. ``level`` is a measured height of the targets in space (1,), None without.
    """

    center: tuple[float, ...]
    sensor: Point
    height: FloatArray
    radius: FloatArray
    range_m: FloatArray
    std_m: FloatArray
    row: IntArray
    level: MeasuredHeight | None = None

    @property
    def least_sensors(self) -> int:
        """The number of sensors that determine a target with one scalar to spare."""
        return 1 + len(self.sensor) - (self.level is not None)

    @property
    def center_x(self) -> float:
        """The first coordinate of the local origin."""
        return self.center[0]

    @property
    def center_y(self) -> float:
        """The second coordinate of the local origin."""
        return self.center[1]

    @property
    def sensor_x(self) -> FloatArray:
        """The first coordinates (N,) of the sensors."""
        return self.sensor[0]

    @property
    def sensor_y(self) -> FloatArray:
        """The second coordinates (N,) of the sensors."""
        return self.sensor[1]

    def distance_m(self, sensor: int | slice, *point: FloatArray) -> FloatArray:
        """Return the distance (..., N) of points (..., 1) from sensors, or (...) of points (...) from one."""
        level = np.hypot(point[0] - self.sensor[0][sensor], point[1] - self.sensor[1][sensor])
        up = self.height[sensor] if len(point) == 2 else point[2] - self.sensor[2][sensor]
        return np.asarray(np.hypot(level, up))

    @property
    def sensors(self) -> int:
        """The number of sensors that have an echo, N."""
        return int(self.radius.shape[0])

    @property
    def most(self) -> int:
        """The largest number of echoes of a sensor, M."""
        return int(self.radius.shape[1])


def sensor_positions(batch: RangeBatch, snapshot: int | slice) -> Point:
    """Return the positions of sensors, D arrays: of a snapshot (K,) or several (B, K)."""
    plane = (batch.sensor_xy_m[snapshot, :, 0], batch.sensor_xy_m[snapshot, :, 1])
    return plane if batch.sensor_z_m is None else (*plane, batch.sensor_z_m[snapshot])


def read_echoes(batch: RangeBatch, snapshot: int, max_echoes: int) -> Echoes:
    """Return the echoes of one snapshot of a batch, sensors by position and echoes by range.

    Raises DataError where a sensor has more than ``max_echoes`` echoes.
    """
    place = sensor_positions(batch, snapshot)
    range_m, std, height = batch.range_m[snapshot], batch.range_std_m[snapshot], batch.sensor_height_m[snapshot]
    if batch.dimension == 3:
        height = np.zeros_like(height)
    sensor = batch.sensor[snapshot]
    order = np.lexsort((std, range_m, sensor, height, *place[::-1]))
    same = np.ones(order.shape[0], dtype=bool)
    for key in (*place, height, sensor):
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
    center = [part[order][first].mean() for part in place]
    level = None
    if batch.target_z_m is not None and batch.target_z_std_m is not None:
        mine = slice(snapshot, snapshot + 1)
        level = MeasuredHeight.of(batch.target_z_m[mine], batch.target_z_std_m[mine], np.array(center[-1:]))
        level = level if level.known.all() else None

    def spread(values: npt.NDArray[ScalarT], empty: float) -> npt.NDArray[ScalarT]:
        table = np.full((first.shape[0], most), empty, dtype=values.dtype)
        table[number, index] = values[order]
        return table

    return Echoes(
        center=tuple(map(float, center)),
        sensor=tuple(part[order][first] - middle for part, middle in zip(place, center, strict=True)),
        height=height[order][first],
        radius=spread(radius, np.nan),
        range_m=spread(range_m, np.nan),
        std_m=spread(std, np.nan),
        row=spread(np.arange(order.shape[0]), -1),
        level=level,
    )
