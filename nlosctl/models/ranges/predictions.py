"""Noise-free ranges of sources, direct or by the reflectors of a scene."""

from __future__ import annotations

import numpy as np

from nlosctl.arrays import FloatArray, IntArray
from nlosctl.contract.scene import Scene
from nlosctl.geometry.circular_reflection import reflect_at
from nlosctl.models.circle_rows import circle_table, likeliest_points
from nlosctl.models.ranges.circles import unfold_in_lines
from nlosctl.models.ranges.spheres import unfold_in_planes

__all__ = ["predict_ranges", "predict_space_ranges"]


def predict_ranges(
    sensor_xy_m: FloatArray,
    sensor_height_m: FloatArray,
    source_xy_m: FloatArray,
    reflector: IntArray | None = None,
    scene: Scene | None = None,
) -> FloatArray:
    """Return the noise-free ranges (...) of sources (..., 2) from sensors (..., 2) at heights (...), in metres.

    ``reflector`` (...) are indices into ``scene.reflectors``, -1 for direct paths; by them the range is the length of
    the path, by a circle that of the shortest one that no blocker cuts (of all where each is cut). NaN where there is
    none.
    """
    x, y = source_xy_m[..., 0], source_xy_m[..., 1]
    if reflector is None or scene is None or not (reflector >= 0).any():
        return np.hypot(np.hypot(x - sensor_xy_m[..., 0], y - sensor_xy_m[..., 1]), sensor_height_m)
    sensor_x, sensor_y, _ = unfold_in_lines(scene, reflector, sensor_xy_m[..., 0], sensor_xy_m[..., 1])
    distance = np.hypot(x - sensor_x, y - sensor_y)
    middle_x, middle_y, radius, blocker, _ = (column[reflector] for column in circle_table(scene))
    bent = (reflector >= 0) & np.isfinite(radius)
    if bent.any():
        middle_x, middle_y = middle_x[bent], middle_y[bent]
        ends = [np.broadcast_to(part, bent.shape)[bent] for part in (sensor_x, sensor_y, x, y)]
        about = (ends[0] - middle_x, ends[1] - middle_y, ends[2] - middle_x, ends[3] - middle_y)
        hit_x, hit_y = likeliest_points(*about, radius[bent], blocker[bent])
        distance[bent] = reflect_at(hit_x, hit_y, *about).length_m
    return np.hypot(distance, sensor_height_m)


def predict_space_ranges(
    sensor: tuple[FloatArray, ...],
    source: tuple[FloatArray, ...],
    reflector: IntArray | None = None,
    scene: Scene | None = None,
) -> FloatArray:
    """Return the noise-free ranges (...) of sources from sensors, each three arrays (...), in metres.

    ``reflector`` (...) are indices into ``scene.reflectors``, -1 for direct paths; by them the range is the length of
    the path. UsageError for rows by spheres.
    """
    if reflector is not None and scene is not None and (reflector >= 0).any():
        sensor, _ = unfold_in_planes(scene, reflector, sensor)
    x, y, z = (theirs - own for theirs, own in zip(source, sensor, strict=True))
    return np.hypot(np.hypot(x, y), z)
