"""Ranges as circles around sensors: residual, information, and a local origin.

The range of a row that names a reflector is the length of the whole path, sensor - reflection point - source. By a
flat mirror that is the distance from the sensor's image (equation (3) of Song, Willett, Zhou 2013). By a circle it is
the shortest path by its inner side that no blocker cuts. By Fermat's principle the gradient is in both cases the unit
vector from the reflection point to the source, and the second derivatives are those of the wave front there.

A slant range from a sensor at a height h over the targets' plane reads sqrt(d^2 + h^2) at a distance d in the plane,
by an upright mirror too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ignoring_division, ignoring_invalid
from nlosctl.contract.batches import RangeBatch
from nlosctl.contract.scene import Scene
from nlosctl.geometry.blocks import RowBlock, max_measurements, sum_measurements
from nlosctl.geometry.lines import reflect_points, side_of_line
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.circle_rows import CirclePaths, locate_circle_paths
from nlosctl.models.measured_height import MeasuredHeight
from nlosctl.models.mirror_rows import MirrorRows, gather_mirrors
from nlosctl.models.obstacles import DirectRows, WallRows, locate_direct_rows, locate_walls, unseen_rows
from nlosctl.models.ranges.paths import FAR_OFF, BentPaths, RangePath

__all__ = ["RangeCircles", "range_circles", "unfold_in_lines"]


@dataclass(frozen=True)
class RangeCircles(RowBlock):
    """Ranges (B, K) about a local origin (B,), the mean of ``sensor_x``, ``sensor_y``. All in metres.

    Those are the sensors' positions, or their images in the row's mirror: then the range is that from there.
    ``circles`` lists the rows by a circle, which have no such point: the functions of this class return their true
    lengths.
    ``height`` is None where every range is measured in the plane. ``mirrors``, ``direct`` (the direct rows, once for
    each opaque circle) and ``walls`` are what the scene forbids; None or empty without. In space ``held_z_m`` (B,) is
    the height of this plane.
    """

    center_x: FloatArray
    center_y: FloatArray
    sensor_x: FloatArray
    sensor_y: FloatArray
    range_m: FloatArray
    std_m: FloatArray
    height: FloatArray | None
    mirrors: MirrorRows | None = None
    circles: CirclePaths | None = None
    direct: tuple[DirectRows, ...] = ()
    walls: WallRows | None = None
    held_z_m: FloatArray | None = None

    @property
    def center(self) -> tuple[FloatArray, ...]:
        """The local origin (B,), as one array per coordinate."""
        return self.center_x, self.center_y

    def absolute(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, ...]:
        """Return points (B,), given about the local origins, in the frame; in space with the height of the plane."""
        point = x + self.center_x, y + self.center_y
        return point if self.held_z_m is None else (*point, self.held_z_m)

    def whole_covariance(self, covariance: SymmetricMatrix, *point: FloatArray) -> SymmetricMatrix:
        """Return the covariances of all coordinates; zeros for the height of the plane in space."""
        if self.held_z_m is None:
            return covariance
        return SymmetricMatrix(*covariance, *(np.zeros(covariance.xx.shape) for _ in range(3)))

    @property
    def sensor(self) -> tuple[FloatArray, ...]:
        """The sensors, or their images (B, K), as one array per coordinate."""
        return self.sensor_x, self.sensor_y

    @property
    def level(self) -> MeasuredHeight | None:
        """In the plane no height is unknown."""
        return None

    @property
    def degrees_of_freedom(self) -> int:
        """The number of measured scalars minus that of the unknowns."""
        return int(self.range_m.shape[1]) - 2

    def distance_m(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the distance (B, K) in the plane of points (B,), about the local origin, from the sensors.

        Of reflected rows the length of the path; NaN where no path exists.
        """
        distance = np.hypot(x[:, None] - self.sensor_x, y[:, None] - self.sensor_y)
        if self.circles is not None:
            self.circles.place_in(distance, self.circles.paths_from(x, y).length_m)
        return distance

    def residual_m(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return measured minus predicted range (B, K) at points (B,) about the local origin."""
        distance = self.distance_m(x, y)
        return self.range_m - (distance if self.height is None else np.hypot(distance, self.height))

    def length_m(self, k: int, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the predicted range of row ``k`` at points (B, P); as `path` has it."""
        length = x - self.sensor_x[:, k, None]
        across = y - self.sensor_y[:, k, None]
        length *= length
        across *= across
        length += across
        if self.height is not None:
            length += self.height[:, k, None] ** 2
        np.sqrt(length, out=length)
        if self.circles is not None:
            rows = self.circles.of_measurement(k)
            if rows.snapshot.size:
                length[rows.snapshot] = rows.lengths_from(x, y)
        impossible = self._impossible(k, x, y, length)
        return length if impossible is None else np.where(impossible, self._far_off(k)[:, None], length)

    def half_chi_squares(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return half the chi-square (B, P) at points (B, P)."""
        total = np.zeros_like(x)
        for k in range(self.range_m.shape[1]):
            scaled = self.length_m(k, x, y)
            scaled -= self.range_m[:, k, None]
            scaled /= self.std_m[:, k, None]
            scaled *= scaled
            total += scaled
        total *= 0.5
        return total

    def path(self, k: int, x: FloatArray, y: FloatArray) -> RangePath:
        """Return the path of row ``k`` to points (B,).

        Where no path exists (beyond the row's mirror, outside of its circle) a thousand stds too long for the range.
        """
        dx, dy = x - self.sensor_x[:, k], y - self.sensor_y[:, k]
        height = 0.0 if self.height is None else self.height[:, k]
        length = np.maximum(np.sqrt(dx * dx + dy * dy + height * height), np.finfo(np.float64).tiny)
        along_x, along_y = dx / length, dy / length
        bent = self.bent_paths(k, x, y)
        radius = length if bent is None else length.copy()
        if bent is not None:
            at = bent.snapshot
            length[at], radius[at] = bent.path.length_m, bent.path.radius_m
            along_x[at], along_y[at] = bent.path.along
        impossible = self._impossible(k, x, y, length)
        if impossible is not None:
            length = np.where(impossible, self._far_off(k), length)
            along_x, along_y = np.where(impossible, 0.0, along_x), np.where(impossible, 0.0, along_y)
        return RangePath(length, (along_x, along_y), radius)

    def _impossible(self, k: int, x: FloatArray, y: FloatArray, length_m: FloatArray) -> BoolArray | None:
        """Return where row ``k`` has no path to points (B,) or (B, P); None if every row has one everywhere."""
        if self.mirrors is None and self.circles is None:
            return None
        impossible = np.isnan(length_m)
        if self.mirrors is not None:
            impossible |= self.mirrors.row_beyond(k, x, y)
        return impossible

    def _far_off(self, k: int) -> FloatArray:
        return self.range_m[:, k] + FAR_OFF * self.std_m[:, k]

    def bent_paths(self, k: int, x: FloatArray, y: FloatArray) -> BentPaths | None:
        """Return the paths of row ``k`` by circles to points (B,); None if no snapshot has one."""
        rows: CirclePaths | None = None if self.circles is None else self.circles.of_measurement(k)
        if rows is None or not rows.snapshot.size:
            return None
        path = rows.paths_from(x, y)
        radius, there = path.front_radius_m(), np.isfinite(path.length_m)
        radius = np.where(there & (radius != 0.0), radius, np.inf)
        along_x, along_y = np.where(there, path.cosine, 0.0), np.where(there, path.sine, 0.0)
        return BentPaths(rows.snapshot, RangePath(path.length_m, (along_x, along_y), radius))

    def information(self, x: FloatArray, y: FloatArray) -> SymmetricMatrix:
        """Return the Fisher information (B,) of the position at points (B,): sum of u u' / std^2.

        u is the gradient of a range, the unit vector from the sensor or from the reflection point (shorter for slant
        ranges); not finite where a point lies on a sensor, or where no path leads to it. Rows of infinite std add
        nothing.
        """
        dx, dy = x[:, None] - self.sensor_x, y[:, None] - self.sensor_y
        squared = dx * dx + dy * dy
        if self.height is not None:
            squared += self.height * self.height
        with ignoring_division():
            weight = 1.0 / (self.std_m * np.sqrt(squared))
            dx *= weight
            dy *= weight
        if self.circles is not None:
            path = self.circles.paths_from(x, y)
            inverse_std = 1.0 / self.circles.pick_from(self.std_m)
            informative = inverse_std > 0.0
            self.circles.place_in(dx, np.where(informative, path.cosine * inverse_std, 0.0))
            self.circles.place_in(dy, np.where(informative, path.sine * inverse_std, 0.0))
        return SymmetricMatrix.gram(dx, dy)

    def squared_in_plane(self) -> FloatArray:
        """Return the squared ranges (B, K) less the squared heights: negative where noise made a range too short."""
        squared = self.range_m * self.range_m
        return squared if self.height is None else squared - self.height * self.height

    def bent_snapshots(self) -> BoolArray:
        """Return which snapshots (B,) have a row by a circle."""
        bent = np.zeros(self.center_x.shape, dtype=bool)
        if self.circles is not None:
            bent[self.circles.snapshot] = True
        return bent

    @property
    def restricted(self) -> bool:
        """Whether the scene hides any point from any row."""
        return not (self.mirrors is None and self.circles is None and self.walls is None and not self.direct)

    def unseen(self, x: FloatArray, y: FloatArray) -> BoolArray:
        """Return to which rows (B, K) a point (B,) can't be visible in the scene; see `unseen_rows`."""
        return unseen_rows(self.sensor_x, self.sensor_y, self.mirrors, self.direct, self.circles, self.walls, x, y)

    def single_origin(self) -> BoolArray:
        """Return which snapshots (B,) have all their sensors, or images of them, at a single point, and one path there.

        A row by a circle and a row by another way do not measure the same, even from one sensor.
        """
        away = np.hypot(self.sensor_x - self.sensor_x[:, :1], self.sensor_y - self.sensor_y[:, :1])
        if self.circles is not None:
            radius = np.zeros(away.shape)
            self.circles.place_in(radius, self.circles.radius)
            away += np.abs(radius - radius[:, :1])
        single: BoolArray = max_measurements(away) == 0.0
        return single


def range_circles(batch: RangeBatch) -> RangeCircles:
    """Return the circles of a batch, about the mean of each snapshot's (unfolded) sensor positions.

    A row by a circle whose sensor is not inside it, or is under the blocker, has no path: NaN.
    """
    x, y = batch.sensor_xy_m[..., 0], batch.sensor_xy_m[..., 1]
    scene, mirrors, circles = batch.scene, None, None
    reflector = batch.reflector
    if reflector is None:
        reflector = np.full(x.shape, -1, dtype=np.int64, order="F")
    direct = locate_direct_rows(scene, reflector, x, y)
    if (reflector >= 0).any():
        circles = locate_circle_paths(scene, reflector, x, y)
        x, y, mirrors = unfold_in_lines(scene, reflector, x, y)
    center_x = sum_measurements(x) / x.shape[1]
    center_y = sum_measurements(y) / y.shape[1]
    return RangeCircles(
        center_x=center_x,
        center_y=center_y,
        sensor_x=x - center_x[:, None],
        sensor_y=y - center_y[:, None],
        range_m=batch.range_m,
        std_m=batch.range_std_m,
        height=batch.sensor_height_m if batch.sensor_height_m.any() else None,
        mirrors=None if mirrors is None else mirrors.about(center_x, center_y),
        circles=None if circles is None else circles.about(center_x, center_y),
        direct=tuple(rows.about(center_x, center_y) for rows in direct),
        walls=locate_walls(scene, reflector, center_x, center_y),
    )


def unfold_in_lines(
    scene: Scene, reflector: IntArray, x: FloatArray, y: FloatArray
) -> tuple[FloatArray, FloatArray, MirrorRows | None]:
    """Return the images of sensors (B, K) in the flat mirrors of their rows, and those mirrors; None without."""
    point_x, point_y, angle = gather_mirrors(scene, reflector)
    flat = (reflector >= 0) & np.isfinite(angle)
    if not flat.any():
        return x, y, None
    with ignoring_invalid():
        image_x, image_y = reflect_points(x, y, point_x, point_y, angle)
        side = np.where(flat, side_of_line(x, y, point_x, point_y, angle), np.nan)
    mirrors = MirrorRows(point_x, point_y, angle, side)
    return np.where(flat, image_x, x), np.where(flat, image_y, y), mirrors
