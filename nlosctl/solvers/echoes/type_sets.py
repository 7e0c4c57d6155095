"""Crossings of the circles of every pair of sensors (type sets, equation (2) of Liang, Zeng, Li); tuples of circles.

A *circle* is numbered sensor * M + echo; there are U = N M of them, some absent. A *point* is a crossing of
two circles of different sensors: it has two parents and a root, 0 or 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray
from nlosctl.geometry.circles import cross_circles
from nlosctl.geometry.regions import Region
from nlosctl.solvers.echoes.echoes import Echoes

__all__ = ["CrossingTable", "Gate", "Seeds", "cross_all", "find_seeds", "gather_circles"]


_CHUNK = 1 << 16
"""Number of distances per block: temporaries stay in cache."""


@dataclass(frozen=True)
class Gate:
    """Where points of one snapshot may be: its search region (one row) and ``margin_m`` around it."""

    region: Region
    margin_m: float

    def contains(self, *point: FloatArray) -> BoolArray:
        """Return which points (D arrays (...)) are inside; NaN is not."""
        distance = self.region.edge_distance_m(*(part.reshape(1, -1) for part in point))
        inside: BoolArray = distance.reshape(point[0].shape) >= -self.margin_m
        return inside


@dataclass(frozen=True)
class CrossingTable:
    """Crossings of all pairs of circles: ``x`` and ``y`` (2, U, U) by root, metres; infinite without a crossing."""

    sensors: int
    most: int
    x: FloatArray
    y: FloatArray


@dataclass(frozen=True)
class Seeds:
    """Points (P,): coordinates and parents; the first parent is of the sensor with the smaller number."""

    x: FloatArray
    y: FloatArray
    parent_1: IntArray
    parent_2: IntArray

    def take(self, rows: IntArray | slice) -> Seeds:
        """Return some of the seeds."""
        return Seeds(self.x[rows], self.y[rows], self.parent_1[rows], self.parent_2[rows])


def cross_all(echoes: Echoes, gap_tolerance_m: float, gate: Gate) -> CrossingTable:
    """Return the crossings of all circles of different sensors inside the gate; equation (2).

    Circles that miss each other by at most ``gap_tolerance_m`` have one, the midpoint of their closest approach.
    """
    sensors, most = echoes.radius.shape
    count = sensors * most
    circle = np.flatnonzero(np.isfinite(echoes.radius))
    sensor = circle // most
    first, second = np.nonzero(sensor[:, None] < sensor[None, :])
    first, second = circle[first], circle[second]
    centers = np.stack([echoes.sensor_x, echoes.sensor_y], axis=-1)
    radius = echoes.radius.reshape(-1)
    points = cross_circles(
        centers[first // most], radius[first], centers[second // most], radius[second], gap_tolerance=gap_tolerance_m
    )
    keep = gate.contains(points[..., 0], points[..., 1])
    x, y = np.full((2, count * count), np.inf), np.full((2, count * count), np.inf)
    forward, backward = first * count + second, second * count + first
    for table, axis in ((x, 0), (y, 1)):
        for root in (0, 1):
            values = np.where(keep[:, root], points[:, root, axis], np.inf)
            table[root][forward] = values
            table[root][backward] = values
    x, y = x.reshape(2, count, count), y.reshape(2, count, count)
    return CrossingTable(sensors, most, x, y)


def find_seeds(table: CrossingTable) -> Seeds:
    """Return each point of the table once."""
    root, parent_1, parent_2 = np.nonzero(np.isfinite(table.x))
    once = parent_1 < parent_2
    root, parent_1, parent_2 = root[once], parent_1[once], parent_2[once]
    return Seeds(table.x[root, parent_1, parent_2], table.y[root, parent_1, parent_2], parent_1, parent_2)


def gather_circles(table: CrossingTable, seeds: Seeds) -> tuple[IntArray, Seeds]:
    """Return the tuples of circles (S, N) that the first stage builds around the seeds, and those seeds.

    Each sensor that is not a parent contributes the circle whose crossings with both parents are nearest to the seed
    (least sum of squares). A seed is dropped if some sensor has no circle that crosses both parents.
    """
    count = seeds.x.shape[0]
    circles = np.empty((count, table.sensors), dtype=np.int64)
    complete = np.ones(count, dtype=bool)
    size = max(1, _CHUNK // (table.sensors * table.most))
    for start in range(0, count, size):
        chunk = slice(start, start + size)
        some = seeds.take(chunk)
        squared = _nearest_squared(table, some.parent_1, some) + _nearest_squared(table, some.parent_2, some)
        by_sensor = squared.reshape(-1, table.sensors, table.most)
        chosen = by_sensor.argmin(axis=2)
        least = np.take_along_axis(by_sensor, chosen[:, :, None], axis=2)[:, :, 0]
        rows = np.arange(some.x.shape[0])
        circles[chunk] = chosen + np.arange(table.sensors) * table.most
        for parent in (some.parent_1, some.parent_2):
            circles[start + rows, parent // table.most] = parent
            least[rows, parent // table.most] = 0.0
        complete[chunk] = np.isfinite(least).all(axis=1)
    kept = np.flatnonzero(complete)
    return circles[kept], seeds.take(kept)


def _nearest_squared(table: CrossingTable, parent: IntArray, seeds: Seeds) -> FloatArray:
    """Return the squared distance (P, U) from each seed to the nearer root of its parent with every circle."""
    nearest = np.empty((2, parent.shape[0], table.x.shape[2]))
    for root in (0, 1):
        dx = np.take(table.x[root], parent, axis=0)
        dy = np.take(table.y[root], parent, axis=0)
        dx -= seeds.x[:, None]
        dy -= seeds.y[:, None]
        np.multiply(dx, dx, out=dx)
        np.multiply(dy, dy, out=dy)
        np.add(dx, dy, out=nearest[root])
    smaller: FloatArray = np.minimum(nearest[0], nearest[1], out=nearest[0])
    return smaller
