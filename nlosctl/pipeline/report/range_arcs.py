"""Ranges by straight mirrors as arcs: parts of circles about the images of the sensors."""

from __future__ import annotations

import numpy as np

from nlosctl.arrays import FloatArray, ignoring_invalid
from nlosctl.contract.scene import LineReflector, SegmentReflector

__all__ = ["range_arcs"]


def range_arcs(sensor_m: FloatArray, range_m: FloatArray, mirror: LineReflector | SegmentReflector) -> FloatArray:
    """Return the arcs (N, 4) of points whose path by a mirror to sensors (N, 2) has the length of the ranges (N,).

    An arc is the centre x, y (the image of the sensor) and the first and the last direction from there in radians,
    counter-clockwise; the radius is the range. The points are on the sensor's side of the mirror, where the straight
    line from the image crosses it, a segment between its ends. Both directions are 0 where the range is shorter than
    any such path.
    """
    along = np.array(mirror.direction, dtype=np.float64)
    along = along / np.hypot(*along)
    normal = np.array([-along[1], along[0]])
    height = (sensor_m - np.array(mirror.point)) @ normal
    image = sensor_m - 2.0 * height[:, None] * normal
    toward = np.where(height >= 0.0, 1.0, -1.0)[:, None] * normal
    middle = np.arctan2(toward[:, 1], toward[:, 0])
    distance = np.abs(height)
    with ignoring_invalid():
        half = np.arccos(np.minimum(distance / range_m, 1.0))
    first, last = -half, half
    if isinstance(mirror, SegmentReflector):
        ends = [_turn(np.array(end) - image, toward) for end in (mirror.start, mirror.end)]
        first = np.maximum(first, np.minimum(*ends))
        last = np.minimum(last, np.maximum(*ends))
    exists = (last > first) & (distance < range_m)
    arcs = np.column_stack([image, middle + first, middle + last])
    arcs[~exists, 2:] = 0.0
    return arcs


def _turn(offset_m: FloatArray, toward: FloatArray) -> FloatArray:
    """Return the angles (N,) of offsets (N, 2) from unit vectors (N, 2), counter-clockwise."""
    across = toward[:, 0] * offset_m[:, 1] - toward[:, 1] * offset_m[:, 0]
    angle: FloatArray = np.arctan2(across, np.sum(toward * offset_m, axis=1))
    return angle
