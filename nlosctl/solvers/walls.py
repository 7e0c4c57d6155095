"""What the walls of a scene hide from the sensors."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nlosctl.contract.scene import LineReflector, Scene, SegmentReflector
from nlosctl.geometry.segments import crosses_segment

__all__ = ["hidden_by_walls"]

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]


def hidden_by_walls(
    scene: Scene,
    sensor_x: FloatArray,
    sensor_y: FloatArray,
    x: FloatArray,
    y: FloatArray,
    center_x: FloatArray,
    center_y: FloatArray,
) -> BoolArray:
    """Return which points (B, P) no sensor (B, K) sees: the straight way to each crosses a wall.

    Walls are the scene's line and segment reflectors. Points and sensors are about the local origins ``center``
    (B,), metres.
    """
    hidden = np.ones(x.shape, dtype=bool)
    for k in range(sensor_x.shape[1]):
        blocked = np.zeros(x.shape, dtype=bool)
        for wall in scene.reflectors:
            ends = _ends(wall)
            if ends is None:
                continue
            (x1, y1), (x2, y2) = ends
            corners = (x1 - center_x, y1 - center_y, x2 - center_x, y2 - center_y)
            blocked |= crosses_segment(
                sensor_x[:, k, None],
                sensor_y[:, k, None],
                x,
                y,
                *(corner[:, None] for corner in corners),
                endless=isinstance(wall, LineReflector),
            )
        hidden &= blocked
    return hidden


def _ends(wall: object) -> tuple[tuple[float, float], tuple[float, float]] | None:
    """Return two points of a wall: the ends of a segment, or any two of a line; None for other reflectors."""
    if isinstance(wall, SegmentReflector):
        return wall.start, wall.end
    if isinstance(wall, LineReflector):
        return wall.point, (wall.point[0] + wall.direction[0], wall.point[1] + wall.direction[1])
    return None
