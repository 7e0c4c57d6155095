"""Ranges in space as spheres around sensors, with a measured height of the source or without.

A row by a plane mirror is unfolded as in the plane: its range is that from the image of its sensor. Where the height of
the source is exactly known the spheres are circles in the plane at that height, and the ranges slant ranges to it: the
snapshots are then those of `RangeCircles`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ignoring_division, ignoring_invalid
from nlosctl.contract.batches import RangeBatch
from nlosctl.contract.scene import Scene, SphereReflector
from nlosctl.errors import UsageError
from nlosctl.geometry.blocks import RowBlock, max_measurements, sum_measurements
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.measured_height import MeasuredHeight
from nlosctl.models.mirror_rows import MirrorRows
from nlosctl.models.obstacles import WallRows, locate_walls
from nlosctl.models.ranges.circles import RangeCircles, range_circles
from nlosctl.models.ranges.paths import FAR_OFF, RangePath
from nlosctl.models.space.plane_mirrors import PlaneMirrors, gather_plane_mirrors

__all__ = ["RangeRows", "RangeSpheres", "range_rows", "unfold_in_planes"]


@dataclass(frozen=True)
class RangeSpheres(RowBlock):
    """Ranges (B, K) in space about a local origin (B,), the mean of ``sensor``; as `RangeCircles` in the plane.

    Points and sensors, or their images in plane mirrors, are three arrays. ``level`` is a measured height. Metres.
    """

    center: tuple[FloatArray, ...]
    sensor: tuple[FloatArray, ...]
    range_m: FloatArray
    std_m: FloatArray
    level: MeasuredHeight | None = None
    mirrors: PlaneMirrors | None = None
    walls: WallRows | None = None

    @property
    def height(self) -> None:
        """Slant ranges to a plane are ranges in the plane."""
        return None

    @property
    def degrees_of_freedom(self) -> IntArray:
        """The number (B,) of measured scalars minus that of the unknowns."""
        heights = 0 if self.level is None else self.level.known
        return np.asarray(np.full(self.center[0].shape, self.range_m.shape[1] - 3) + heights)

    def absolute(self, *point: FloatArray) -> tuple[FloatArray, ...]:
        """Return points (B,), given about the local origins, in the frame."""
        return tuple(part + middle for part, middle in zip(point, self.center, strict=True))

    def whole_covariance(self, covariance: SymmetricMatrix, *point: FloatArray) -> SymmetricMatrix:
        """Return the covariance of x, y and z, which it is."""
        return covariance

    def distance_m(self, *point: FloatArray) -> FloatArray:
        """Return the distance (B, K) of points (B,) from the sensors; of reflected rows the length of the path."""
        x, y, z = (part[:, None] - own for part, own in zip(point, self.sensor, strict=True))
        return np.hypot(np.hypot(x, y), z)

    def residual_m(self, *point: FloatArray) -> FloatArray:
        """Return measured minus predicted range (B, K) at points (B,) about the local origin."""
        return self.range_m - self.distance_m(*point)

    def length_m(self, k: int, *point: FloatArray) -> FloatArray:
        """Return the predicted range of row ``k`` at points (B, P); as `path` has it."""
        away = [part - own[:, k, None] for part, own in zip(point, self.sensor, strict=True)]
        length = away[0] * away[0]
        for part in away[1:]:
            length += part * part
        np.sqrt(length, out=length)
        beyond = self._beyond(k, *point)
        return length if beyond is None else np.where(beyond, self._far_off(k)[:, None], length)

    def half_chi_squares(self, *point: FloatArray) -> FloatArray:
        """Return half the chi-square (B, P) at points (B, P), the measured height included."""
        total = np.zeros_like(point[0])
        for k in range(self.range_m.shape[1]):
            scaled = self.length_m(k, *point)
            scaled -= self.range_m[:, k, None]
            scaled /= self.std_m[:, k, None]
            scaled *= scaled
            total += scaled
        if self.level is not None:
            total += self.level.scaled_residual(point[2]) ** 2
        total *= 0.5
        return total

    def path(self, k: int, *point: FloatArray) -> RangePath:
        """Return the path of row ``k`` to points (B,): a thousand stds too long beyond the row's mirror."""
        x, y, z = (part - own[:, k] for part, own in zip(point, self.sensor, strict=True))
        length = np.maximum(np.sqrt(x * x + y * y + z * z), np.finfo(np.float64).tiny)
        along = (x / length, y / length, z / length)
        beyond = self._beyond(k, *point)
        if beyond is None:
            return RangePath(length, along, length)
        gone = tuple(np.where(beyond, 0.0, part) for part in along)
        return RangePath(np.where(beyond, self._far_off(k), length), gone, length)

    def _beyond(self, k: int, *point: FloatArray) -> BoolArray | None:
        return None if self.mirrors is None else self.mirrors.row_beyond(k, *point)

    def _far_off(self, k: int) -> FloatArray:
        return self.range_m[:, k] + FAR_OFF * self.std_m[:, k]

    def information(self, *point: FloatArray) -> SymmetricMatrix:
        """Return the Fisher information (B,) of the position at points (B,): sum of u u' / std^2, 1 / S^2 of a height.

        Not finite where a point lies on a sensor. Rows of infinite std add nothing.
        """
        away = [part[:, None] - own for part, own in zip(point, self.sensor, strict=True)]
        with ignoring_division():
            weight = 1.0 / (self.std_m * np.sqrt(away[0] * away[0] + away[1] * away[1] + away[2] * away[2]))
            total = SymmetricMatrix.gram(*(part * weight for part in away))
        if self.level is not None:
            total.diagonal[2][:] += self.level.inverse_std * self.level.inverse_std
        return total

    def squared_in_plane(self) -> FloatArray:
        """Return the squared ranges (B, K)."""
        return self.range_m * self.range_m

    @property
    def restricted(self) -> bool:
        """Whether the scene hides any point from any row."""
        return not (self.mirrors is None and self.walls is None)

    def unseen(self, *point: FloatArray) -> BoolArray:
        """Return to which rows (B, K) a point (B,) can't be visible: beyond a mirror, or past the scene's walls."""
        unseen = np.zeros(self.range_m.shape, dtype=bool, order="F")
        if self.mirrors is not None:
            unseen |= self.mirrors.beyond(*point)
        if self.walls is not None:
            unseen |= self.walls.unseen(self.sensor[0], self.sensor[1], point[0], point[1])
        return unseen

    def single_origin(self) -> BoolArray:
        """Return which snapshots (B,) have all their sensors, or images of them, at a single point."""
        away = self.distance_m(*(part[:, 0] for part in self.sensor))
        single: BoolArray = max_measurements(away) == 0.0
        return single


RangeRows = RangeCircles | RangeSpheres
"""Ranges in the plane, or in space."""


def range_rows(batch: RangeBatch) -> RangeRows:
    """Return the ranges of a batch about the mean of each snapshot's (unfolded) sensor positions.

    In space those are spheres, or circles at a height that is exactly known. UsageError for rows by spheres.
    """
    if batch.dimension == 2 or batch.sensor_z_m is None:
        return range_circles(batch)
    sensor: tuple[FloatArray, ...] = (batch.sensor_xy_m[..., 0], batch.sensor_xy_m[..., 1], batch.sensor_z_m)
    reflector = batch.reflector
    if reflector is None:
        reflector = np.full(batch.range_m.shape, -1, dtype=np.int64, order="F")
    sensor, mirrors = unfold_in_planes(batch.scene, reflector, sensor)
    center = tuple(sum_measurements(part) / part.shape[1] for part in sensor)
    local = tuple(np.asfortranarray(part - middle[:, None]) for part, middle in zip(sensor, center, strict=True))
    walls = locate_walls(batch.scene, reflector, center[0], center[1])
    if batch.height_held and batch.target_z_m is not None:
        return RangeCircles(
            center[0],
            center[1],
            local[0],
            local[1],
            batch.range_m,
            batch.range_std_m,
            np.asfortranarray(sensor[2] - batch.target_z_m[:, None]),
            mirrors=None if mirrors is None else _mirrors_at_height(mirrors, center, batch.target_z_m),
            walls=walls,
            held_z_m=batch.target_z_m,
        )
    level = None
    if batch.target_z_m is not None and batch.target_z_std_m is not None:
        level = MeasuredHeight.of(batch.target_z_m, batch.target_z_std_m, center[2])
    mirrors = None if mirrors is None else mirrors.about(*center)
    return RangeSpheres(center, local, batch.range_m, batch.range_std_m, level, mirrors, walls)


def unfold_in_planes(
    scene: Scene, reflector: IntArray, sensor: tuple[FloatArray, ...]
) -> tuple[tuple[FloatArray, ...], PlaneMirrors | None]:
    """Return the images of sensors (...) in the plane mirrors of their rows, and those mirrors; None without."""
    spheres = [index for index, mirror in enumerate(scene.reflectors) if isinstance(mirror, SphereReflector)]
    if np.isin(reflector, spheres).any():
        raise UsageError("Ranges by a sphere are not solved in three dimensions; leave these rows out.")
    mirrors = gather_plane_mirrors(scene, reflector, sensor)
    return (sensor, None) if mirrors is None else (mirrors.images(sensor), mirrors)


def _mirrors_at_height(mirrors: PlaneMirrors, center: tuple[FloatArray, ...], z_m: FloatArray) -> MirrorRows:
    """Return the lines in which plane mirrors, given in the frame, cut the planes at heights (B,), about local origins.

    A horizontal mirror cuts no line: it has the whole plane on one side, which is the sensor's or not.
    """
    local = mirrors.about(center[0], center[1], z_m)
    (x, y, _), offset_m = local.normal, local.offset_m
    level = np.hypot(x, y)
    flat = level == 0.0
    with ignoring_division():
        away = offset_m / (level * level)
        point_x, point_y = np.where(flat, 0.0, x * away), np.where(flat, 0.0, y * away)
    with ignoring_invalid():
        behind = -offset_m * mirrors.sensor_side_m <= 0.0
    side = np.where(flat, np.where(behind, 0.0, np.nan), mirrors.sensor_side_m)
    return MirrorRows(point_x, point_y, np.arctan2(-x, y), side)
