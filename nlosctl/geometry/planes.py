"""Planes in space as mirrors: images of points and directions, and sides. All shapes broadcast.

A plane is a point on it and a unit normal, of either sign.
"""

from __future__ import annotations

from nlosctl.arrays import FloatArray
from nlosctl.geometry.directions import Vector, dot, scaled, subtract

__all__ = ["reflect_in_plane", "reflect_vector", "side_of_plane"]


def side_of_plane(point: Vector, plane_point: Vector, normal: Vector) -> FloatArray:
    """Return the signed distance of points from planes in metres, positive on the side of the normal."""
    return dot(subtract(point, plane_point), normal)


def reflect_in_plane(point: Vector, plane_point: Vector, normal: Vector) -> Vector:
    """Return the images of points: H (x - p) + p with H = 1 - 2 n n'. Its own inverse."""
    return subtract(point, scaled(normal, 2.0 * side_of_plane(point, plane_point, normal)))


def reflect_vector(vector: Vector, normal: Vector) -> Vector:
    """Return the images H v of directions or gradients. Its own inverse."""
    return subtract(vector, scaled(normal, 2.0 * dot(vector, normal)))
