"""The rings of ranges: points about their circles, as the error of a direct row is distributed, and their density."""

from __future__ import annotations

from math import pi, sqrt

import numpy as np

from nlosctl.arrays import FloatArray, IntArray, Point
from nlosctl.geometry.regions import Ball
from nlosctl.models.ranges.spheres import RangeRows, RangeSpheres

__all__ = ["ring_density", "sample_ring"]


def ring_density(circles: RangeRows) -> FloatArray:
    """Return the density (B, K) of the points of `sample_ring` on the circles; 0 for rows by a circle."""
    if isinstance(circles, RangeSpheres):
        area_m2 = 4.0 * pi * circles.range_m * circles.range_m
        return np.asarray(1.0 / (circles.std_m * sqrt(2.0 * pi) * area_m2))
    density = 1.0 / (circles.std_m * sqrt(2.0 * pi) * 2.0 * pi * circles.range_m)
    if circles.circles is not None:
        circles.circles.place_in(density, np.zeros(circles.circles.snapshot.shape))
    return density


def sample_ring(
    circles: RangeRows, ball: Ball, snapshot: IntArray, k: IntArray, normal: Point, uniform: Point
) -> Point:
    """Return points (N,) about the circle of row ``k`` of a snapshot, from normal deviates and uniform numbers.

    The first are deviates of the range, the second turn about the sensor, from the direction of the ball's centre; in
    space they are points of the sphere.
    """
    at = snapshot, k
    if isinstance(circles, RangeSpheres):
        distance = circles.range_m[at] + circles.std_m[at] * normal[0]
        height, turn = 1.0 - 2.0 * uniform[2], 2.0 * pi * uniform[1]
        across = np.sqrt(1.0 - height * height)
        direction = across * np.cos(turn), across * np.sin(turn), height
        return tuple(own[at] + distance * part for own, part in zip(circles.sensor, direction, strict=True))
    x, y = circles.sensor_x[at], circles.sensor_y[at]
    distance = circles.range_m[at] + circles.std_m[at] * normal[0]
    if circles.height is not None:
        distance = np.sqrt(np.maximum(distance * distance - circles.height[at] ** 2, 0.0))
    middle_x, middle_y = (part[snapshot] for part in ball.center)
    angle = np.arctan2(middle_y - y, middle_x - x) + 2.0 * pi * uniform[1]
    return x + distance * np.cos(angle), y + distance * np.sin(angle)
