"""Noise-free bearings of sources."""

from __future__ import annotations

import numpy as np

from nlosctl.arrays import FloatArray, IntArray
from nlosctl.contract.scene import Scene
from nlosctl.geometry.lines import reflect_points
from nlosctl.models.circle_rows import circle_table, likeliest_points
from nlosctl.models.mirror_rows import gather_mirrors

__all__ = ["predict_bearings"]


def predict_bearings(sensor_xy_m: FloatArray, reflector: IntArray, scene: Scene, source_xy_m: FloatArray) -> FloatArray:
    """Return the noise-free bearings (...) of sources (..., 2) from sensors (..., 2), in (-pi, pi].

    By the image of the source, equation (2) of Song et al. with atan2: the sensor looks at the image. On a circle by
    equation (34), along the shortest path that no blocker cuts (of all where each is cut). NaN where there is no path.
    """
    x, y = source_xy_m[..., 0], source_xy_m[..., 1]
    if not (reflector >= 0).any():
        return np.arctan2(y - sensor_xy_m[..., 1], x - sensor_xy_m[..., 0])
    point_x, point_y, angle = gather_mirrors(scene, reflector)
    image_x, image_y = reflect_points(x, y, point_x, point_y, angle)
    x, y = np.where(reflector >= 0, image_x, x), np.where(reflector >= 0, image_y, y)
    bearing = np.arctan2(y - sensor_xy_m[..., 1], x - sensor_xy_m[..., 0])
    circle = (reflector >= 0) & np.isnan(angle)
    if circle.any():
        middle_x, middle_y, radius, blocker, _ = (column[reflector[circle]] for column in circle_table(scene))
        sensor, source = sensor_xy_m[circle], np.broadcast_to(source_xy_m, (*reflector.shape, 2))[circle]
        sensor_x, sensor_y = sensor[:, 0] - middle_x, sensor[:, 1] - middle_y
        hit_x, hit_y = likeliest_points(
            sensor_x, sensor_y, source[:, 0] - middle_x, source[:, 1] - middle_y, radius, blocker
        )
        bearing[circle] = np.arctan2(hit_y - sensor_y, hit_x - sensor_x)
    return bearing
