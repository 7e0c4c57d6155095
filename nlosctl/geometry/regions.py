"""Regions of the plane, one per snapshot: is a point inside, how far from the edge, how large is it?

Coordinates are metres about each snapshot's local origin. Points have shape (B,) or (B, P); a region has one row
for each snapshot.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ignoring_overflow
from nlosctl.geometry.blocks import RowBlock

__all__ = ["BoxRegion", "CircleRegion", "Disc", "PolygonRegion", "Region"]


class Disc(NamedTuple):
    """Discs; each array (B,)."""

    x: FloatArray
    y: FloatArray
    radius: FloatArray

    @classmethod
    def about(cls, region: Region, rows: IntArray) -> Disc:
        """Return the discs about the bounds of some rows of a region; their radius is not zero."""
        xmin, xmax, ymin, ymax = (bound[rows] for bound in region.bounds_m)
        radius = np.maximum(0.5 * np.hypot(xmax - xmin, ymax - ymin), np.finfo(np.float64).tiny ** 0.25)
        return cls(0.5 * (xmin + xmax), 0.5 * (ymin + ymax), radius)


class Region(Protocol):
    """B regions."""

    @property
    def area_m2(self) -> FloatArray:
        """The areas (B,)."""
        ...

    @property
    def bounds_m(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """The least and greatest x, then the least and greatest y, each (B,)."""
        ...

    def contains(self, x: FloatArray, y: FloatArray) -> BoolArray:
        """Return which points are inside, the edge included (a polygon's up to rounding); false for NaN."""
        ...

    def edge_distance_m(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the distance to the edge, negative outside."""
        ...

    def on_edge(self, x: FloatArray, y: FloatArray, tolerance_m: FloatArray | float) -> BoolArray:
        """Return which points are within ``tolerance_m`` (a number or (B,)) of the edge; false for NaN."""
        ...

    def take(self, rows: IntArray) -> Region:
        """Return the regions of some rows."""
        ...


@dataclass(frozen=True)
class BoxRegion(RowBlock):
    """Boxes along the axes; each array (B,)."""

    xmin: FloatArray
    xmax: FloatArray
    ymin: FloatArray
    ymax: FloatArray

    @property
    def area_m2(self) -> FloatArray:
        """The areas (B,)."""
        return (self.xmax - self.xmin) * (self.ymax - self.ymin)

    @property
    def bounds_m(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """The least and greatest x, then the least and greatest y, each (B,)."""
        return self.xmin, self.xmax, self.ymin, self.ymax

    def contains(self, x: FloatArray, y: FloatArray) -> BoolArray:
        """Return which points are inside, the edge included; false for NaN."""
        xmin, xmax, ymin, ymax = (_beside(edge, x) for edge in self.bounds_m)
        inside: BoolArray = (x >= xmin) & (x <= xmax) & (y >= ymin) & (y <= ymax)
        return inside

    def edge_distance_m(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the distance to the edge, negative outside."""
        xmin, xmax, ymin, ymax = (_beside(edge, x) for edge in self.bounds_m)
        inner_x, inner_y = np.minimum(x - xmin, xmax - x), np.minimum(y - ymin, ymax - y)
        outside = np.hypot(np.minimum(inner_x, 0.0), np.minimum(inner_y, 0.0))
        return np.where(outside > 0.0, -outside, np.minimum(inner_x, inner_y))

    def on_edge(self, x: FloatArray, y: FloatArray, tolerance_m: FloatArray | float) -> BoolArray:
        """Return which points are within ``tolerance_m`` of the edge; false for NaN."""
        return _near(self.edge_distance_m(x, y), tolerance_m)


@dataclass(frozen=True)
class CircleRegion(RowBlock):
    """Discs; each array (B,)."""

    x: FloatArray
    y: FloatArray
    radius: FloatArray

    @property
    def area_m2(self) -> FloatArray:
        """The areas (B,)."""
        return np.pi * self.radius * self.radius

    @property
    def bounds_m(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """The least and greatest x, then the least and greatest y, each (B,)."""
        return self.x - self.radius, self.x + self.radius, self.y - self.radius, self.y + self.radius

    def contains(self, x: FloatArray, y: FloatArray) -> BoolArray:
        """Return which points are inside, the edge included; false for NaN."""
        inside: BoolArray = self.edge_distance_m(x, y) >= 0.0
        return inside

    def edge_distance_m(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the distance to the edge, negative outside."""
        return _beside(self.radius, x) - np.hypot(x - _beside(self.x, x), y - _beside(self.y, x))

    def on_edge(self, x: FloatArray, y: FloatArray, tolerance_m: FloatArray | float) -> BoolArray:
        """Return which points are within ``tolerance_m`` of the edge; false for NaN."""
        return _near(self.edge_distance_m(x, y), tolerance_m)


@dataclass(frozen=True)
class PolygonRegion(RowBlock):
    """Simple polygons of V vertices in order; ``x`` and ``y`` have shape (B, V)."""

    x: FloatArray
    y: FloatArray

    @property
    def area_m2(self) -> FloatArray:
        """The areas (B,), by the shoelace formula about the first vertex."""
        x, y = self.x - self.x[:, :1], self.y - self.y[:, :1]
        twice = np.zeros(x.shape[0])
        for v in range(1, x.shape[1] - 1):
            twice += x[:, v] * y[:, v + 1] - x[:, v + 1] * y[:, v]
        return 0.5 * np.abs(twice)

    @property
    def bounds_m(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """The least and greatest x, then the least and greatest y, each (B,)."""
        return self.x.min(axis=1), self.x.max(axis=1), self.y.min(axis=1), self.y.max(axis=1)

    def contains(self, x: FloatArray, y: FloatArray) -> BoolArray:
        """Return which points are inside by counting the edges to their right; false for NaN."""
        inside = np.zeros(x.shape, dtype=bool)
        for x1, y1, x2, y2 in self._edges(x):
            with ignoring_overflow():
                crossing_x = x1 + (y - y1) * (x2 - x1) / (y2 - y1)
                inside ^= ((y1 > y) != (y2 > y)) & (x < crossing_x)
        return inside

    def edge_distance_m(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the distance to the edge, negative outside."""
        nearest = np.full(x.shape, np.inf)
        for x1, y1, x2, y2 in self._edges(x):
            along_x, along_y = x2 - x1, y2 - y1
            length2 = along_x * along_x + along_y * along_y
            dot = (x - x1) * along_x + (y - y1) * along_y
            with ignoring_overflow():  # an edge whose length is zero up to rounding: either end will do
                share = np.clip(dot / np.where(length2 > 0.0, length2, 1.0), 0.0, 1.0)
            np.minimum(nearest, np.hypot(x - x1 - share * along_x, y - y1 - share * along_y), out=nearest)
        return np.where(self.contains(x, y), nearest, -nearest)

    def on_edge(self, x: FloatArray, y: FloatArray, tolerance_m: FloatArray | float) -> BoolArray:
        """Return which points are within ``tolerance_m`` of the edge; false for NaN."""
        return _near(self.edge_distance_m(x, y), tolerance_m)

    def _edges(self, like: FloatArray) -> list[tuple[FloatArray, FloatArray, FloatArray, FloatArray]]:
        count = self.x.shape[1]
        corners = [(_beside(self.x[:, v], like), _beside(self.y[:, v], like)) for v in range(count)]
        return [(*corners[v - 1], *corners[v]) for v in range(count)]


def _beside(values: FloatArray, points: FloatArray) -> FloatArray:
    """Return values (B,) so that they broadcast against points (B,) or (B, P)."""
    return values if points.ndim == 1 else values[:, None]


def _near(distance: FloatArray, tolerance_m: FloatArray | float) -> BoolArray:
    tolerance = np.asarray(tolerance_m)
    if tolerance.ndim == 1:
        tolerance = _beside(tolerance, distance)
    near: BoolArray = np.abs(distance) <= tolerance
    return near
