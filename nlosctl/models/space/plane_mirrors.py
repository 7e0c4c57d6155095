"""Plane mirrors in space: the mirror of each row of a block, and the images of its sensor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ignoring_invalid
from nlosctl.contract.scene import LineReflector, PlaneReflector, Scene, SegmentReflector
from nlosctl.geometry.blocks import RowBlock

__all__ = ["PlaneMirrors", "gather_plane_mirrors"]


@dataclass(frozen=True)
class PlaneMirrors(RowBlock):
    """The mirror of each row (B, K): unit normal, and offset along it about the local origin; 0 for direct rows.

    ``sensor_side_m`` is the sensor's signed distance from it, NaN for direct rows.
    """

    normal: tuple[FloatArray, FloatArray, FloatArray]
    offset_m: FloatArray
    sensor_side_m: FloatArray

    def side_m(self, *point: FloatArray) -> FloatArray:
        """Return the signed distances (B, K) of points (B,) from the mirrors."""
        x, y, z = (part[:, None] * normal for part, normal in zip(point, self.normal, strict=True))
        return np.asarray(x + y + z - self.offset_m)

    def beyond(self, *point: FloatArray) -> BoolArray:
        """Return for which rows (B, K) a point (B,) is on the mirror, or on another side of it than the sensor."""
        with ignoring_invalid():
            return np.asarray(self.side_m(*point) * self.sensor_side_m <= 0.0)

    def row_beyond(self, k: int, *point: FloatArray) -> BoolArray:
        """Return the same of row ``k`` for points (B,) or (B, P)."""
        wide = (slice(None), k, *([None] * (point[0].ndim - 1)))
        x, y, z = (part * normal[wide] for part, normal in zip(point, self.normal, strict=True))
        with ignoring_invalid():
            return np.asarray((x + y + z - self.offset_m[wide]) * self.sensor_side_m[wide] <= 0.0)

    def reflected(self, vector: tuple[FloatArray, ...]) -> tuple[FloatArray, ...]:
        """Return vectors (B, K) reflected by the mirrors: v - 2 n (n . v)."""
        along = sum(2.0 * normal * part for normal, part in zip(self.normal, vector, strict=True))
        return tuple(part - along * normal for part, normal in zip(vector, self.normal, strict=True))

    def images(self, point: tuple[FloatArray, ...]) -> tuple[FloatArray, ...]:
        """Return the images of points (B, K), given in the frame, in the mirrors."""
        twice = sum(2.0 * normal * part for normal, part in zip(self.normal, point, strict=True)) - 2.0 * self.offset_m
        return tuple(part - twice * normal for part, normal in zip(point, self.normal, strict=True))

    def about(self, *origin: FloatArray) -> PlaneMirrors:
        """Return the same mirrors about local origins (B,)."""
        return PlaneMirrors(self.normal, self.side_m(*origin) * -1.0, self.sensor_side_m)


def gather_plane_mirrors(scene: Scene, reflector: IntArray, sensor: tuple[FloatArray, ...]) -> PlaneMirrors | None:
    """Return the mirrors of rows (B, K) with sensors (B, K) in the frame; None where all rows are direct.

    Lines and segments are vertical walls. Rows by other reflectors have no plane mirror: zeros, as direct rows.
    """
    table = np.array([_plane(mirror) for mirror in scene.reflectors] or [[0.0] * 4])
    mirrored = (reflector >= 0) & (np.abs(table[:, :3]).max(axis=1) > 0.0)[reflector]
    if not mirrored.any():
        return None
    x, y, z, offset = (np.where(mirrored, column[reflector], 0.0) for column in table.T)
    side = x * sensor[0] + y * sensor[1] + z * sensor[2] - offset
    return PlaneMirrors((x, y, z), offset, np.where(mirrored, side, np.nan))


def _plane(mirror: object) -> list[float]:
    """Return the unit normal of a mirror and its offset along it."""
    if isinstance(mirror, LineReflector | SegmentReflector):
        along = np.array(mirror.direction)
        normal = np.array([-along[1], along[0], 0.0]) / np.hypot(*along)
        return [*normal.tolist(), float(normal[:2] @ np.array(mirror.point))]
    if isinstance(mirror, PlaneReflector):
        normal = np.array(mirror.normal) / np.linalg.norm(mirror.normal)
        return [*normal.tolist(), float(normal @ np.array(mirror.point))]
    return [0.0] * 4
