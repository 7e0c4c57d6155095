"""Where a range by a circle and another range of the snapshot agree: initial estimates.

The points of one path length by a circle are a curve, not a circle: the ends of the rays that leave the sensor in all
directions, are reflected (equations (41)-(45) of Song, Willett, Zhou 2013), and have the measured length. Along it the
other row's path length passes through its own measured value at the crossings.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import FloatArray, IntArray, ignoring_overflow
from nlosctl.geometry.circles import cross_circles, leave_circle
from nlosctl.models.circle_rows import CirclePaths
from nlosctl.models.ranges.circles import RangeCircles

__all__ = ["MOST_CROSSINGS", "cross_by_circle", "cross_circle_pairs", "pairs_by_circle"]

MOST_CROSSINGS = 4
"""So many crossings of a pair are returned."""

_DIRECTIONS = 64
_REFINEMENTS = 14
_SAME_LENGTH = 1e-6
"""A point is on the curve of its row if its path length equals the range up to this share."""


@dataclass(frozen=True)
class _Curve:
    """The curves (n,) of points of one path length by a circle; sensors about its centre, that about the origin."""

    rows: CirclePaths
    range_m: FloatArray

    def directions(self) -> FloatArray:
        """Return directions (n, M) from the sensor: all, or with a blocker those above the least elevation."""
        rows = self.rows
        widest = np.where(rows.has_choice, np.pi, 0.5 * np.pi - rows.least_elevation_rad)
        up = np.arctan2(rows.sensor_y, rows.sensor_x)
        return up[:, None] + widest[:, None] * np.linspace(-1.0, 1.0, _DIRECTIONS)

    def points(self, direction: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the points x, y (n, M) about the local origin in some directions."""
        rows = self.rows
        sensor_x, sensor_y, radius = rows.sensor_x[:, None], rows.sensor_y[:, None], rows.radius[:, None]
        cosine, sine = np.cos(direction), np.sin(direction)
        hit = leave_circle(sensor_x, sensor_y, cosine, sine, radius)
        normal_x, normal_y = hit.x / radius, hit.y / radius
        twice = 2.0 * (cosine * normal_x + sine * normal_y)
        rest = self.range_m[:, None] - hit.distance_m
        x = hit.x + rest * (cosine - twice * normal_x) + rows.center_x[:, None]
        y = hit.y + rest * (sine - twice * normal_y) + rows.center_y[:, None]
        return x, y

    def off_curve(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the path length minus the range at points (n, M), over the range; NaN where no path leads there."""
        return self.rows.lengths_from(x, y) / self.range_m[:, None] - 1.0


def cross_circle_pairs(circles: RangeCircles, first: IntArray, second: IntArray) -> FloatArray:
    """Return the crossings (B, P, n, 2) of pairs (P,) or (B, P) of rows; n is 2, `MOST_CROSSINGS` with rows by circles.

    Ranges that never agree have one where they do most nearly; NaN where there are fewer.
    """
    squared, snapshot = circles.squared_in_plane(), np.arange(circles.range_m.shape[0])[:, None]
    centers = [
        np.stack([circles.sensor_x[snapshot, index], circles.sensor_y[snapshot, index]], axis=-1)
        for index in (first, second)
    ]
    radii = [np.sqrt(np.maximum(squared[snapshot, index], 0.0)) for index in (first, second)]
    points = cross_circles(centers[0], radii[0], centers[1], radii[1], gap_tolerance=np.inf)
    if circles.circles is None:
        return points
    shape = points.shape[:2]
    first, second = (np.broadcast_to(index, shape) for index in (first, second))
    wide = np.full((*shape, MOST_CROSSINGS, 2), np.nan)
    wide[:, :, :2] = points
    at = pairs_by_circle(circles, first, second)
    if at[0].size:
        wide[at] = np.stack(cross_by_circle(circles, at[0], first[at], second[at]), axis=-1)
    return wide


def pairs_by_circle(circles: RangeCircles, first: IntArray, second: IntArray) -> tuple[IntArray, IntArray]:
    """Return the indices (n,) of snapshots and of pairs with a row by a circle; ``first``, ``second`` (B, P)."""
    bent = np.zeros(circles.range_m.shape, dtype=bool)
    if circles.circles is not None:
        circles.circles.place_in(bent, np.ones(circles.circles.snapshot.shape, dtype=bool))
    of_first, of_second = (np.take_along_axis(bent, index, axis=1) for index in (first, second))
    snapshot, pair = np.nonzero(of_first | of_second)
    return snapshot, pair


def cross_by_circle(
    circles: RangeCircles, snapshot: IntArray, first: IntArray, second: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Return the crossings x, y (n, `MOST_CROSSINGS`) of pairs of rows ``first``, ``second`` of snapshots, all (n,).

    At least one row of each pair is by a circle. Where the lengths never agree there is one point, the nearest to that.
    NaN where there are fewer.
    """
    assert circles.circles is not None  # noqa: S101 - such a pair exists
    number = np.full(circles.range_m.shape, -1, dtype=np.int64)
    circles.circles.place_in(number, np.arange(circles.circles.snapshot.shape[0]))
    swap = number[snapshot, first] < 0
    first, second = np.where(swap, second, first), np.where(swap, first, second)
    curve = _Curve(circles.circles.alone(number[snapshot, first]), circles.range_m[snapshot, first])
    other = circles.range_m[snapshot, second]
    bent = np.flatnonzero(number[snapshot, second] >= 0)
    bent_rows = circles.circles.alone(number[snapshot, second][bent])
    height = 0.0 if circles.height is None else circles.height[snapshot, second][:, None]

    def excess(x: FloatArray, y: FloatArray) -> FloatArray:
        dx = x - circles.sensor_x[snapshot, second][:, None]
        dy = y - circles.sensor_y[snapshot, second][:, None]
        length = np.sqrt(dx * dx + dy * dy + height * height)
        if bent.size:
            length[bent] = bent_rows.lengths_from(x[bent], y[bent])
        return length - other[:, None]

    with ignoring_overflow():
        direction = curve.directions()
        value = excess(*curve.points(direction))
        low, high = _brackets(value)
        rows = np.arange(value.shape[0])[:, None]
        found = _refine(curve, excess, direction[rows, low], direction[rows, high], value[rows, low], value[rows, high])
        nearest = np.argmin(np.where(np.isnan(value), np.inf, np.abs(value)), axis=1)
        none = (low == high).all(axis=1)
        found[none, 0] = direction[none, nearest[none]]
        there = (low != high) | (none[:, None] & (np.arange(MOST_CROSSINGS) == 0))
        x, y = curve.points(found)
        there &= np.abs(curve.off_curve(x, y)) <= _SAME_LENGTH
    return np.where(there, x, np.nan), np.where(there, y, np.nan)


def _brackets(value: FloatArray) -> tuple[IntArray, IntArray]:
    """Return neighbours (n, `MOST_CROSSINGS`) between which values (n, M) change their sign; equal where none do."""
    changes = value[:, :-1] * value[:, 1:] <= 0.0
    order = np.argsort(~changes, axis=1, kind="stable")[:, :MOST_CROSSINGS]
    return order, order + np.take_along_axis(changes, order, axis=1)


def _refine(
    curve: _Curve,
    excess: Callable[[FloatArray, FloatArray], FloatArray],
    low: FloatArray,
    high: FloatArray,
    value_low: FloatArray,
    value_high: FloatArray,
) -> FloatArray:
    """Return the directions (n, C) between two at which ``excess`` is zero: false position, Illinois variant."""
    for _ in range(_REFINEMENTS):
        middle = high - value_high * (high - low) / (value_high - value_low)
        middle = np.where(np.isfinite(middle), middle, high)
        value = excess(*curve.points(middle))
        crossed = value * value_high < 0.0
        low = np.where(crossed, high, low)
        value_low = np.where(crossed, value_high, 0.5 * value_low)
        high, value_high = middle, value
    return high
