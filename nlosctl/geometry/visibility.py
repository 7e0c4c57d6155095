"""Visibility from a sensor on or above an opaque circle, directly and by a concentric reflector around it.

Song, Willett, Zhou 2013, Lemmas 2 and 3. Coordinates are relative to the common centre, elevations to the
horizontal of the sensor. All lengths have a tolerance of ``TOLERANCE`` times the blocker's radius.
"""

from __future__ import annotations

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, ignoring_division
from nlosctl.geometry.circular_reflection import ReflectedPath

__all__ = [
    "TOLERANCE",
    "clears_blocker",
    "elevation",
    "horizon_elevation",
    "reach_by_reflection",
    "sees_by_reflection",
    "sees_by_reflection_from_ground",
    "sees_directly",
]


TOLERANCE = 1e-10
"""Relative tolerance of lengths: 0.6 mm on the earth."""


def elevation(sensor_x: FloatArray, sensor_y: FloatArray, bearing_rad: FloatArray) -> FloatArray:
    """Return the elevation, in [-pi / 2, pi / 2], of bearings above the horizontal of their sensors."""
    up_x, up_y = np.cos(bearing_rad), np.sin(bearing_rad)
    return np.arctan2(sensor_x * up_x + sensor_y * up_y, np.abs(sensor_x * up_y - sensor_y * up_x))


def horizon_elevation(sensor_radius: FloatArray, blocker_radius: FloatArray) -> FloatArray:
    """Return the elevation of the blocker's horizon: 0 for a sensor on it, negative for one above it."""
    return -_dip(sensor_radius, blocker_radius)


def clears_blocker(
    first_x: FloatArray, first_y: FloatArray, second_x: FloatArray, second_y: FloatArray, blocker_radius: FloatArray
) -> BoolArray:
    """Return which straight segments between points on or above the blocker do not cross it.

    Their angle is then at most the sum of the horizons, acos(r / r1) + acos(r / r2). False where NaN.
    """
    first_r, second_r = np.hypot(first_x, first_y), np.hypot(second_x, second_y)
    reach = _dip(first_r, blocker_radius) + _dip(second_r, blocker_radius)
    apart = _angle_between(first_x, first_y, second_x, second_y)
    return np.asarray(np.minimum(first_r, second_r) * (reach - apart) >= -TOLERANCE * blocker_radius)


def sees_directly(
    sensor_x: FloatArray,
    sensor_y: FloatArray,
    source_x: FloatArray,
    source_y: FloatArray,
    blocker_radius: FloatArray,
    min_elevation_rad: FloatArray,
) -> BoolArray:
    """Return which sources are in the region A3: above the blocker, with an unobstructed straight path.

    For a sensor on the blocker: rho cos(dphi) >= r. With ``min_elevation_rad`` -inf the horizon is the limit.
    """
    source_r = np.hypot(source_x, source_y)
    slack = TOLERANCE * blocker_radius
    free = clears_blocker(sensor_x, sensor_y, source_x, source_y, blocker_radius)
    bearing = np.arctan2(source_y - sensor_y, source_x - sensor_x)
    high = elevation(sensor_x, sensor_y, bearing) >= min_elevation_rad - TOLERANCE
    return free & high & (source_r >= blocker_radius - slack)


def sees_by_reflection(
    sensor_x: FloatArray,
    sensor_y: FloatArray,
    source_x: FloatArray,
    source_y: FloatArray,
    path: ReflectedPath,
    radius: FloatArray,
    blocker_radius: FloatArray,
    min_elevation_rad: FloatArray,
) -> BoolArray:
    """Return which sources are in the region A2: between the circles, with both legs of ``path`` unobstructed.

    False where ``path`` is NaN.
    """
    source_r = np.hypot(source_x, source_y)
    slack = TOLERANCE * blocker_radius
    first = clears_blocker(sensor_x, sensor_y, path.hit_x, path.hit_y, blocker_radius)
    second = clears_blocker(source_x, source_y, path.hit_x, path.hit_y, blocker_radius)
    high = elevation(sensor_x, sensor_y, path.bearing_rad) >= min_elevation_rad - TOLERANCE
    in_ring = (source_r >= blocker_radius - slack) & (source_r <= radius)
    return first & second & high & in_ring


def reach_by_reflection(
    source_radius: FloatArray, radius: FloatArray, blocker_radius: FloatArray, min_elevation_rad: FloatArray
) -> FloatArray:
    """Return the largest angle, seen from the centre, to a source visible by reflection from a sensor on the blocker.

    2 acos(r / R) - acos(r / rho) with the horizon as limit: the edge of A2 in Lemma 2. With a least elevation e the
    limiting ray passes the centre at q = r cos(e), and the reach is 2 acos(q / R) - e - acos(q / rho).
    """
    nearest = blocker_radius * np.cos(min_elevation_rad)
    return 2.0 * _dip(radius, nearest) - min_elevation_rad - _dip(source_radius, nearest)


def sees_by_reflection_from_ground(
    sensor_x: FloatArray,
    sensor_y: FloatArray,
    source_x: FloatArray,
    source_y: FloatArray,
    radius: FloatArray,
    blocker_radius: FloatArray,
    min_elevation_rad: FloatArray,
) -> BoolArray:
    """Return which sources are in A2 of a sensor on the blocker, in closed form; ``min_elevation_rad`` >= 0."""
    source_r = np.hypot(source_x, source_y)
    slack = TOLERANCE * blocker_radius
    reach = reach_by_reflection(source_r, radius, blocker_radius, min_elevation_rad)
    near = source_r * (reach - _angle_between(sensor_x, sensor_y, source_x, source_y)) >= -slack
    return near & (source_r >= blocker_radius - slack) & (source_r <= radius)


def _dip(outer_radius: FloatArray, inner_radius: FloatArray) -> FloatArray:
    """Return acos(inner / outer): the angle at the centre between a point and its tangent point; 0 if it is inside."""
    with ignoring_division():
        return np.arccos(np.minimum(inner_radius / outer_radius, 1.0))


def _angle_between(first_x: FloatArray, first_y: FloatArray, second_x: FloatArray, second_y: FloatArray) -> FloatArray:
    """Return the angle in [0, pi] between directions from the centre."""
    return np.arctan2(np.abs(first_x * second_y - first_y * second_x), first_x * second_x + first_y * second_y)
