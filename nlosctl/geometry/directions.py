"""Directions in space by azimuth and elevation, and small algebra on vectors given as three arrays.

Azimuths are counter-clockwise from +x in the x-y plane, elevations above that plane, radians. Shapes broadcast.
"""

from __future__ import annotations

import numpy as np

from nlosctl.arrays import FloatArray, ignoring_division
from nlosctl.geometry.angles import cosine_sine

__all__ = [
    "Vector",
    "angle_gradients",
    "azimuth_elevation",
    "combine",
    "cross",
    "direction_frame",
    "dot",
    "length",
    "scaled",
    "subtract",
]

Vector = tuple[FloatArray, ...]
"""Vectors in space: the arrays of their x, y and z."""


def direction_frame(azimuth_rad: FloatArray, elevation_rad: FloatArray) -> tuple[Vector, Vector, Vector]:
    """Return the unit direction u of the angles and its tangents a, t, along which azimuth and elevation grow.

    u = (cos e cos z, cos e sin z, sin e), a = (-sin z, cos z, 0), t = (-sin e cos z, -sin e sin z, cos e): a
    right-handed frame (u, a, t), also at elevations of +-90 degrees. NaN where an angle is.
    """
    cosine, sine = cosine_sine(azimuth_rad)
    level, rise = cosine_sine(elevation_rad)
    return (level * cosine, level * sine, rise), (-sine, cosine, 0.0 * sine), (-rise * cosine, -rise * sine, level)


def azimuth_elevation(x: FloatArray, y: FloatArray, z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return azimuth in (-pi, pi] and elevation in [-pi / 2, pi / 2] of vectors of any length; 0, 0 of the zero one."""
    return np.arctan2(y, x), np.arctan2(z, np.sqrt(x * x + y * y))


def angle_gradients(x: FloatArray, y: FloatArray, z: FloatArray) -> tuple[Vector, Vector]:
    """Return the derivatives of azimuth and elevation by the vector: a / f and t / r, per metre of its coordinates.

    f is its length in the x-y plane, r that in space. Not finite for vertical vectors, where the azimuth is undefined.
    """
    level_squared = x * x + y * y
    with ignoring_division():
        level = np.sqrt(level_squared)
        inverse = 1.0 / level_squared
        lifted = 1.0 / (level_squared + z * z)
        slant = -z * lifted / level
        return (-y * inverse, x * inverse, 0.0 * x), (slant * x, slant * y, level * lifted)


def dot(left: Vector, right: Vector) -> FloatArray:
    """Return the scalar products."""
    return left[0] * right[0] + left[1] * right[1] + left[2] * right[2]


def cross(left: Vector, right: Vector) -> Vector:
    """Return the vector products."""
    return (
        left[1] * right[2] - left[2] * right[1],
        left[2] * right[0] - left[0] * right[2],
        left[0] * right[1] - left[1] * right[0],
    )


def length(vector: Vector) -> FloatArray:
    """Return the lengths, for vectors whose squares neither overflow nor vanish."""
    return np.asarray(np.sqrt(dot(vector, vector)))


def scaled(vector: Vector, factor: FloatArray | float) -> Vector:
    """Return the vectors times a factor."""
    return vector[0] * factor, vector[1] * factor, vector[2] * factor


def subtract(left: Vector, right: Vector) -> Vector:
    """Return the differences."""
    return left[0] - right[0], left[1] - right[1], left[2] - right[2]


def combine(first: FloatArray, one: Vector, second: FloatArray, other: Vector) -> Vector:
    """Return ``first * one + second * other``."""
    x, y, z = (first * a + second * b for a, b in zip(one, other, strict=True))
    return x, y, z
