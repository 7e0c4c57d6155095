"""Flat mirrors: images of points and of directions (Song, Willett, Zhou, Appendix 6.1, with no slope)."""

from __future__ import annotations

import numpy as np

from nlosctl.arrays import FloatArray

__all__ = ["reflect_direction", "reflect_points", "side_of_line"]


def reflect_points(
    x: FloatArray, y: FloatArray, point_x: FloatArray, point_y: FloatArray, angle_rad: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the images of points in mirrors through ``point`` at ``angle_rad`` to +x. All shapes broadcast.

    Equation (47) of Song et al., written with the mirror's angle, so that vertical mirrors are ordinary.
    """
    cosine, sine = np.cos(2.0 * angle_rad), np.sin(2.0 * angle_rad)
    dx, dy = x - point_x, y - point_y
    return point_x + cosine * dx + sine * dy, point_y + sine * dx - cosine * dy


def reflect_direction(direction_rad: FloatArray, angle_rad: FloatArray) -> FloatArray:
    """Return the image of directions in mirrors at ``angle_rad``; not wrapped. Its own inverse."""
    return 2.0 * angle_rad - direction_rad


def side_of_line(
    x: FloatArray, y: FloatArray, point_x: FloatArray, point_y: FloatArray, angle_rad: FloatArray
) -> FloatArray:
    """Return the signed distance of points from lines through ``point`` at ``angle_rad``; positive to the left."""
    return np.cos(angle_rad) * (y - point_y) - np.sin(angle_rad) * (x - point_x)
