"""Regions of the plane or of space, one per snapshot: is a point inside, how far from the edge, how large is it?

Coordinates are metres about each snapshot's local origin, as D arrays. Points have shape (B,) or (B, P); a region has
one row for each snapshot.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce
from math import gamma, pi
from typing import NamedTuple, Protocol

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, Point, ignoring_overflow
from nlosctl.geometry.blocks import RowBlock, rows_of

__all__ = ["Ball", "BoxRegion", "CircleRegion", "PolygonRegion", "PrismRegion", "Region", "box_diagonal"]


class Ball(NamedTuple):
    """Balls (in the plane discs); each array (B,)."""

    center: Point
    radius: FloatArray

    @classmethod
    def about(cls, region: Region, rows: IntArray) -> Ball:
        """Return the balls about the bounds of some rows of a region; their radius is not zero."""
        lower, upper = rows_of(region.bounds_m, rows)
        radius = np.maximum(0.5 * box_diagonal(lower, upper), np.finfo(np.float64).tiny ** 0.25)
        return cls(tuple(0.5 * (least + most) for least, most in zip(lower, upper, strict=True)), radius)

    @property
    def volume(self) -> FloatArray:
        """The volumes (B,) in m3, in the plane the areas in m2."""
        dimension = len(self.center)
        return np.asarray(pi ** (0.5 * dimension) / gamma(0.5 * dimension + 1.0) * self.radius**dimension)


class Region(Protocol):
    """B regions."""

    @property
    def volume(self) -> FloatArray:
        """The volumes (B,) in m3, in the plane the areas in m2."""
        ...

    @property
    def bounds_m(self) -> tuple[Point, Point]:
        """The least and the greatest coordinates, D arrays (B,) each."""
        ...

    def contains(self, *point: FloatArray) -> BoolArray:
        """Return which points are inside, the edge included (a polygon's up to rounding); false for NaN."""
        ...

    def edge_distance_m(self, *point: FloatArray) -> FloatArray:
        """Return the distance to the edge, negative outside."""
        ...

    def on_edge(self, *point: FloatArray, tolerance_m: FloatArray | float) -> BoolArray:
        """Return which points are within ``tolerance_m`` (a number or (B,)) of the edge; false for NaN."""
        ...

    def take(self, rows: IntArray) -> Region:
        """Return the regions of some rows."""
        ...


@dataclass(frozen=True)
class BoxRegion(RowBlock):
    """Boxes along the axes; D arrays (B,) of the least and the greatest coordinates."""

    lower: Point
    upper: Point

    @property
    def volume(self) -> FloatArray:
        """The volumes (B,), in the plane the areas."""
        return reduce(np.multiply, [most - least for least, most in zip(self.lower, self.upper, strict=True)])

    @property
    def bounds_m(self) -> tuple[Point, Point]:
        """The least and the greatest coordinates, D arrays (B,) each."""
        return self.lower, self.upper

    def contains(self, *point: FloatArray) -> BoolArray:
        """Return which points are inside, the edge included; false for NaN."""
        inside = point[0] >= _beside(self.lower[0], point[0])
        inside &= point[0] <= _beside(self.upper[0], point[0])
        for part, least, most in zip(point[1:], self.lower[1:], self.upper[1:], strict=True):
            inside &= part >= _beside(least, part)
            inside &= part <= _beside(most, part)
        return inside

    def edge_distance_m(self, *point: FloatArray) -> FloatArray:
        """Return the distance to the edge, negative outside."""
        inner = [
            np.minimum(part - _beside(least, part), _beside(most, part) - part)
            for part, least, most in zip(point, self.lower, self.upper, strict=True)
        ]
        outside = reduce(np.hypot, [np.minimum(part, 0.0) for part in inner])
        return np.where(outside > 0.0, -outside, reduce(np.minimum, inner))

    def on_edge(self, *point: FloatArray, tolerance_m: FloatArray | float) -> BoolArray:
        """Return which points are within ``tolerance_m`` of the edge; false for NaN."""
        return _near(self.edge_distance_m(*point), tolerance_m)


@dataclass(frozen=True)
class CircleRegion(RowBlock):
    """Discs; each array (B,)."""

    x: FloatArray
    y: FloatArray
    radius: FloatArray

    @property
    def volume(self) -> FloatArray:
        """The areas (B,)."""
        return np.pi * self.radius * self.radius

    @property
    def bounds_m(self) -> tuple[Point, Point]:
        """The least and the greatest coordinates, two arrays (B,) each."""
        return (self.x - self.radius, self.y - self.radius), (self.x + self.radius, self.y + self.radius)

    def contains(self, *point: FloatArray) -> BoolArray:
        """Return which points are inside, the edge included; false for NaN."""
        inside: BoolArray = self.edge_distance_m(*point) >= 0.0
        return inside

    def edge_distance_m(self, *point: FloatArray) -> FloatArray:
        """Return the distance to the edge, negative outside."""
        x, y = point
        return _beside(self.radius, x) - np.hypot(x - _beside(self.x, x), y - _beside(self.y, x))

    def on_edge(self, *point: FloatArray, tolerance_m: FloatArray | float) -> BoolArray:
        """Return which points are within ``tolerance_m`` of the edge; false for NaN."""
        return _near(self.edge_distance_m(*point), tolerance_m)


@dataclass(frozen=True)
class PolygonRegion(RowBlock):
    """Simple polygons of V vertices in order; ``x`` and ``y`` have shape (B, V)."""

    x: FloatArray
    y: FloatArray

    @property
    def volume(self) -> FloatArray:
        """The areas (B,), by the shoelace formula about the first vertex."""
        x, y = self.x - self.x[:, :1], self.y - self.y[:, :1]
        twice = np.zeros(x.shape[0])
        for v in range(1, x.shape[1] - 1):
            twice += x[:, v] * y[:, v + 1] - x[:, v + 1] * y[:, v]
        return 0.5 * np.abs(twice)

    @property
    def bounds_m(self) -> tuple[Point, Point]:
        """The least and the greatest coordinates, two arrays (B,) each."""
        return (self.x.min(axis=1), self.y.min(axis=1)), (self.x.max(axis=1), self.y.max(axis=1))

    def contains(self, *point: FloatArray) -> BoolArray:
        """Return which points are inside by counting the edges to their right; false for NaN."""
        x, y = point
        inside = np.zeros(x.shape, dtype=bool)
        for x1, y1, x2, y2 in self._edges(x):
            with ignoring_overflow():
                crossing_x = x1 + (y - y1) * (x2 - x1) / (y2 - y1)
                inside ^= ((y1 > y) != (y2 > y)) & (x < crossing_x)
        return inside

    def edge_distance_m(self, *point: FloatArray) -> FloatArray:
        """Return the distance to the edge, negative outside."""
        x, y = point
        nearest = np.full(x.shape, np.inf)
        for x1, y1, x2, y2 in self._edges(x):
            along_x, along_y = x2 - x1, y2 - y1
            length2 = along_x * along_x + along_y * along_y
            dot = (x - x1) * along_x + (y - y1) * along_y
            with ignoring_overflow():  # an edge whose length is zero up to rounding: either end will do
                share = np.clip(dot / np.where(length2 > 0.0, length2, 1.0), 0.0, 1.0)
            np.minimum(nearest, np.hypot(x - x1 - share * along_x, y - y1 - share * along_y), out=nearest)
        return np.where(self.contains(x, y), nearest, -nearest)

    def on_edge(self, *point: FloatArray, tolerance_m: FloatArray | float) -> BoolArray:
        """Return which points are within ``tolerance_m`` of the edge; false for NaN."""
        return _near(self.edge_distance_m(*point), tolerance_m)

    def _edges(self, like: FloatArray) -> list[tuple[FloatArray, FloatArray, FloatArray, FloatArray]]:
        count = self.x.shape[1]
        corners = [(_beside(self.x[:, v], like), _beside(self.y[:, v], like)) for v in range(count)]
        return [(*corners[v - 1], *corners[v]) for v in range(count)]


@dataclass(frozen=True)
class PrismRegion(RowBlock):
    """Upright prisms: a region between two limits (B,) of one more coordinate, in space heights."""

    base: Region
    zmin: FloatArray
    zmax: FloatArray

    @property
    def volume(self) -> FloatArray:
        """The volumes (B,)."""
        return self.base.volume * (self.zmax - self.zmin)

    @property
    def bounds_m(self) -> tuple[Point, Point]:
        """The least and the greatest coordinates, D arrays (B,) each."""
        lower, upper = self.base.bounds_m
        return (*lower, self.zmin), (*upper, self.zmax)

    def contains(self, *point: FloatArray) -> BoolArray:
        """Return which points are inside, the edge included; false for NaN."""
        z = point[-1]
        inside: BoolArray = (
            self.base.contains(*point[:-1]) & (z >= _beside(self.zmin, z)) & (z <= _beside(self.zmax, z))
        )
        return inside

    def edge_distance_m(self, *point: FloatArray) -> FloatArray:
        """Return the distance to the edge, negative outside."""
        z = point[-1]
        beside, within = (
            self.base.edge_distance_m(*point[:-1]),
            np.minimum(z - _beside(self.zmin, z), _beside(self.zmax, z) - z),
        )
        outside = np.hypot(np.minimum(beside, 0.0), np.minimum(within, 0.0))
        return np.where(outside > 0.0, -outside, np.minimum(beside, within))

    def on_edge(self, *point: FloatArray, tolerance_m: FloatArray | float) -> BoolArray:
        """Return which points are within ``tolerance_m`` of the edge; false for NaN."""
        return _near(self.edge_distance_m(*point), tolerance_m)


def box_diagonal(lower: Point, upper: Point) -> FloatArray:
    """Return the lengths (B,) of the diagonals of boxes."""
    return reduce(np.hypot, [most - least for least, most in zip(lower, upper, strict=True)])


def _beside(values: FloatArray, points: FloatArray) -> FloatArray:
    """Return values (B,) so that they broadcast against points (B,) or (B, P)."""
    return values if points.ndim == 1 else values[:, None]


def _near(distance: FloatArray, tolerance_m: FloatArray | float) -> BoolArray:
    tolerance = np.asarray(tolerance_m)
    if tolerance.ndim == 1:
        tolerance = _beside(tolerance, distance)
    near: BoolArray = np.abs(distance) <= tolerance
    return near
