"""The mirror of each row of a block (B, K): a line of the scene, or the tangent where a bearing meets its circle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ignoring_invalid
from nlosctl.contract.scene import LineReflector, Scene, SegmentReflector
from nlosctl.geometry.blocks import RowBlock
from nlosctl.geometry.circles import leave_circle
from nlosctl.geometry.lines import side_of_line
from nlosctl.models.circle_rows import CircleRows

__all__ = ["Focusing", "MirrorRows", "gather_mirrors", "place_tangents"]


@dataclass(frozen=True)
class MirrorRows(RowBlock):
    """The mirror of each row: a point on it (about the local origin), its angle, and the side of the sensor.

    Shape (B, K). ``sensor_side_m`` is the sensor's signed distance from it, NaN for direct rows and for circle rows
    (whose mirror is the tangent where the bearing meets the circle).
    """

    point_x: FloatArray
    point_y: FloatArray
    angle_rad: FloatArray
    sensor_side_m: FloatArray

    def about(self, origin_x: FloatArray, origin_y: FloatArray) -> MirrorRows:
        """Return the same mirrors about local origins (B,)."""
        x, y = self.point_x - origin_x[:, None], self.point_y - origin_y[:, None]
        return MirrorRows(x, y, self.angle_rad, self.sensor_side_m)

    def beyond(self, x: FloatArray, y: FloatArray) -> BoolArray:
        """Return for which rows (B, K) a point (B,) is on the mirror, or on another side of it than the sensor."""
        with ignoring_invalid():
            side = side_of_line(x[:, None], y[:, None], self.point_x, self.point_y, self.angle_rad)
            return np.asarray(side * self.sensor_side_m <= 0.0)

    def row_beyond(self, k: int, x: FloatArray, y: FloatArray) -> BoolArray:
        """Return the same of row ``k`` for points (B,) or (B, P)."""
        parts = (self.point_x[:, k], self.point_y[:, k], self.angle_rad[:, k], self.sensor_side_m[:, k])
        point_x, point_y, angle, sensor_side = (part if x.ndim == 1 else part[:, None] for part in parts)
        beyond: BoolArray = side_of_line(x, y, point_x, point_y, angle) * sensor_side <= 0.0
        return beyond


@dataclass(frozen=True)
class Focusing(RowBlock):
    """How circles focus rays (B, K): spread = range - ``strength`` (range - ``first_leg_m``); 0 for other rows.

    ``strength`` is 2 l1 / (R cos i) with l1 the first leg, from the sensor to the circle.
    """

    first_leg_m: FloatArray
    strength: FloatArray


def gather_mirrors(scene: Scene, reflector: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return point x, point y and angle of the mirror of each row; NaN on circles, undefined for direct rows (-1)."""
    table = np.array(
        [
            [*mirror.point, np.arctan2(mirror.direction[1], mirror.direction[0])]
            if isinstance(mirror, LineReflector | SegmentReflector)
            else [np.nan] * 3
            for mirror in scene.reflectors
        ]
    )
    point_x, point_y, angle = table.T
    return point_x[reflector], point_y[reflector], angle[reflector]


def place_tangents(circles: CircleRows, point_x: FloatArray, point_y: FloatArray, angle: FloatArray) -> Focusing:
    """Write the tangents where the bearings meet their circles into the mirrors (B, K); equations (41)-(45)."""
    bearing = circles.bearing_rad
    hit = leave_circle(circles.sensor_x, circles.sensor_y, np.cos(bearing), np.sin(bearing), circles.radius)
    circles.place_in(point_x, hit.x + circles.center_x)
    circles.place_in(point_y, hit.y + circles.center_y)
    circles.place_in(angle, np.arctan2(hit.x, -hit.y))
    first_leg, strength = np.zeros_like(point_x), np.zeros_like(point_x)
    circles.place_in(first_leg, hit.distance_m)
    circles.place_in(strength, 2.0 * hit.distance_m / hit.normal_m)
    return Focusing(first_leg, strength)
