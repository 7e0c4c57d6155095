"""Lines as mirrors and walls: images, sides, crossings."""

from __future__ import annotations

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, ignoring_division

__all__ = ["crosses_segment", "reflect_direction", "reflect_in_segment", "reflect_points", "side_of_line"]


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


def crosses_segment(
    from_x: FloatArray,
    from_y: FloatArray,
    to_x: FloatArray,
    to_y: FloatArray,
    x1: FloatArray,
    y1: FloatArray,
    x2: FloatArray,
    y2: FloatArray,
    *,
    endless: bool = False,
) -> BoolArray:
    """Return whether the ways from one point to another cross the wall from (x1, y1) to (x2, y2). All shapes broadcast.

    Both ways' ends must be off the wall's line, on different sides; a way through an end of the wall crosses it.
    With ``endless`` the wall continues beyond both ends. False for NaN.
    """
    along_x, along_y = x2 - x1, y2 - y1
    side_from = along_x * (from_y - y1) - along_y * (from_x - x1)
    side_to = along_x * (to_y - y1) - along_y * (to_x - x1)
    crosses: BoolArray = side_from * side_to < 0.0
    if endless:
        return crosses
    way_x, way_y = to_x - from_x, to_y - from_y
    side_1 = way_x * (y1 - from_y) - way_y * (x1 - from_x)
    side_2 = way_x * (y2 - from_y) - way_y * (x2 - from_x)
    return crosses & (side_1 * side_2 <= 0.0)


def reflect_in_segment(
    from_x: FloatArray,
    from_y: FloatArray,
    to_x: FloatArray,
    to_y: FloatArray,
    x1: FloatArray,
    y1: FloatArray,
    x2: FloatArray,
    y2: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return the specular point x, y on the wall from (x1, y1) to (x2, y2) of the way from one point to another.

    All shapes broadcast. NaN where there is no path: the points are on different sides of the wall's line, or on it, or
    the point would be beyond an end of the wall.
    """
    angle = np.arctan2(y2 - y1, x2 - x1)
    image_x, image_y = reflect_points(from_x, from_y, x1, y1, angle)
    along_x, along_y = x2 - x1, y2 - y1
    side_to = along_x * (to_y - y1) - along_y * (to_x - x1)
    side_image = along_x * (image_y - y1) - along_y * (image_x - x1)
    hit = crosses_segment(image_x, image_y, to_x, to_y, x1, y1, x2, y2)
    with ignoring_division():
        share = side_image / (side_image - side_to)
        x, y = image_x + share * (to_x - image_x), image_y + share * (to_y - image_y)
    return np.where(hit, x, np.nan), np.where(hit, y, np.nan)
