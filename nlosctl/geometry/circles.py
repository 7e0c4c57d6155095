"""Circles: exit points of rays, and crossings or closest approaches of two circles."""

from __future__ import annotations

import numpy as np

from nlosctl.arrays import FloatArray, ignoring_invalid, ignoring_overflow

__all__ = ["CircleExit", "cross_circles", "leave_circle"]


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
    k = -s.u + sqrt((s.u)^2 - s.s + R^2), the forward of the two. NaN for rays whose origin is not inside.
    """
    along = x * cosine + y * sine
    depth = radius * radius - (x * x + y * y)
    normal = np.sqrt(np.where(depth > 0.0, along * along + depth, np.nan))
    # The form that does not cancel: k = depth / (s.u + normal) where the ray looks outwards.
    distance = np.where(along > 0.0, depth / np.where(along > 0.0, along + normal, 1.0), normal - along)
    return CircleExit(x + distance * cosine, y + distance * sine, distance, normal)


def cross_circles(
    center_1_xy: FloatArray,
    radius_1: FloatArray,
    center_2_xy: FloatArray,
    radius_2: FloatArray,
    *,
    gap_tolerance: float,
) -> FloatArray:
    """Return the points (..., 2, 2) where pairs of circles meet: two roots, each x and y. All in metres.

    Centres (..., 2) and radii (...) broadcast. The first root is to the left of the line from centre 1 to
    centre 2, the second to the right. Circles that miss each other by at most ``gap_tolerance`` have one point,
    the middle of the closest approach, as their first root. Missing roots are NaN: circles farther
    apart, concentric circles, and radii that are not positive.
    """
    dx, dy = center_2_xy[..., 0] - center_1_xy[..., 0], center_2_xy[..., 1] - center_1_xy[..., 1]
    distance = np.hypot(dx, dy)
    with ignoring_overflow():
        unit_x, unit_y = dx / distance, dy / distance
        difference = radius_1 - radius_2
        outside, inside = distance - radius_1 - radius_2, np.abs(difference) - distance
        # Heron's formula by its factors, so that near-tangent circles keep their digits.
        product = (radius_1 + radius_2 + distance) * outside * inside * (distance + np.abs(difference))
        height = np.sqrt(product) / (2.0 * distance)
        along = 0.5 * distance + 0.5 * difference * ((radius_1 + radius_2) / distance)
        gap = np.maximum(outside, inside)
        crosses = gap <= 0.0
        near = (gap > 0.0) & (gap <= gap_tolerance) & (distance > 0.0)
        real = (radius_1 > 0.0) & (radius_2 > 0.0)
    along = np.where(crosses, along, np.where(near, _closest_approach(radius_1, difference, outside, inside), np.nan))
    height = np.where(crosses, height, 0.0)
    points = np.empty((*along.shape, 2, 2))
    x, y = center_1_xy[..., 0], center_1_xy[..., 1]
    with ignoring_invalid():
        points[..., 0, 0] = x + along * unit_x - height * unit_y
        points[..., 0, 1] = y + along * unit_y + height * unit_x
        points[..., 1, 0] = x + along * unit_x + height * unit_y
        points[..., 1, 1] = y + along * unit_y - height * unit_x
    points[~real] = np.nan
    points[..., 1, :][~crosses] = np.nan
    return points


def _closest_approach(
    radius_1: FloatArray, difference: FloatArray, outside: FloatArray, inside: FloatArray
) -> FloatArray:
    """Return how far from centre 1, towards centre 2, the middle of the gap is: outside, 2 within 1, 1 within 2."""
    within = np.where(difference > 0.0, radius_1 - 0.5 * inside, -(radius_1 + 0.5 * inside))
    return np.where(outside > 0.0, radius_1 + 0.5 * outside, within)
