"""Circles: where a ray from inside leaves one. Coordinates are about the circle's centre."""

from __future__ import annotations

import numpy as np

from nlosctl.arrays import FloatArray

__all__ = ["CircleExit", "leave_circle"]


class CircleExit:
    """Where rays leave a circle: ``x``, ``y`` about its centre, ``distance_m`` from the ray's origin.

    ``normal_m`` is radius times the cosine of the angle between ray and normal.
    """

    __slots__ = ("distance_m", "normal_m", "x", "y")

    def __init__(self, x: FloatArray, y: FloatArray, distance_m: FloatArray, normal_m: FloatArray) -> None:
        self.x, self.y, self.distance_m, self.normal_m = x, y, distance_m, normal_m


def leave_circle(x: FloatArray, y: FloatArray, cosine: FloatArray, sine: FloatArray, radius: FloatArray) -> CircleExit:
    """Return where rays from (x, y) along (cosine, sine) leave circles of ``radius``. All shapes broadcast.

    Equations (41)-(43) of Song, Willett, Zhou 2013 without a slope: hit = s + k u with
    k = -s.u + sqrt((s.u)^2 - s.s + R^2), the forward one of the two. NaN for rays that do not start inside.
    """
    along = x * cosine + y * sine
    depth = radius * radius - (x * x + y * y)
    normal = np.sqrt(np.where(depth > 0.0, along * along + depth, np.nan))
    # The form that does not cancel: k = depth / (s.u + normal) where the ray looks outwards.
    distance = np.where(along > 0.0, depth / np.where(along > 0.0, along + normal, 1.0), normal - along)
    return CircleExit(x + distance * cosine, y + distance * sine, distance, normal)
