"""Bearings as sight lines: every row, direct, seen in a flat mirror or on a circle, as a ray from an origin.

A row seen in a mirror is unfolded: its origin is the sensor's image, its direction the bearing's image
(equations (3), (4) of Song, Willett, Zhou 2013). On a circle the mirror is the tangent where the bearing meets it
(41)-(45), carried as point and direction: the ray is the very one that the wave came along. After that all rows are
alike, except for two things: at a point off the ray, the bearing of a circle row is that of its true path; and the
error across the ray is std times the width of the ray tube instead of std times distance.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, ignoring_division, ignoring_overflow
from nlosctl.contract.batches import BearingBatch
from nlosctl.geometry.angles import cosine_sine
from nlosctl.geometry.blocks import RowBlock, sum_measurements
from nlosctl.geometry.circular_reflection import ReflectedPath
from nlosctl.geometry.lines import reflect_direction, reflect_points, side_of_line
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.circle_rows import CircleRows, locate_circle_rows
from nlosctl.models.mirror_rows import Focusing, MirrorRows, gather_mirrors, place_tangents
from nlosctl.models.obstacles import DirectRows, WallRows, locate_direct_rows, locate_walls, unseen_rows
from nlosctl.models.sight import Crossing, RayResiduals

__all__ = ["SightLines", "sight_lines"]


@dataclass(frozen=True)
class SightLines(RowBlock):
    """Rays (B, K) about a local origin (B,): ``origin + t (cosine, sine)``, t > 0.

    ``handedness`` is -1 where the row was unfolded by a mirror (a bearing that turns one way turns the ray the
    other way), else 1. ``focusing`` and ``circles`` are None if no row is seen on a circle; ``direct`` lists the
    direct rows once for each opaque circle of the scene. Lengths in metres, ``std_rad`` in radians.
    """

    center_x: FloatArray
    center_y: FloatArray
    origin_x: FloatArray
    origin_y: FloatArray
    cosine: FloatArray
    sine: FloatArray
    std_rad: FloatArray
    handedness: FloatArray | None
    mirrors: MirrorRows | None
    focusing: Focusing | None = None
    circles: CircleRows | None = None
    direct: tuple[DirectRows, ...] = ()
    walls: WallRows | None = None

    @property
    def center(self) -> tuple[FloatArray, FloatArray]:
        """The local origins (B,)."""
        return self.center_x, self.center_y

    @property
    def unknowns(self) -> int:
        """The number of unknown coordinates."""
        return 2

    @property
    def std(self) -> FloatArray:
        """The standard deviations (B, K) of the bearings, radians."""
        return self.std_rad

    def with_std(self, std: FloatArray) -> SightLines:
        """Return the same rays with other stds (B, K)."""
        return replace(self, std_rad=std)

    def scalars(self) -> int:
        """Return the number of bearings of each snapshot."""
        return int(self.origin_x.shape[1])

    def normals(self, at: slice) -> tuple[FloatArray, FloatArray]:
        """Return the unit normals (B, C) of the lines ``at`` some measurements."""
        return self.sine[:, at], -self.cosine[:, at]

    def planes(self, at: slice, weight: FloatArray | None) -> tuple[tuple[FloatArray, FloatArray], FloatArray]:
        """Return the normals (B, C) of lines and the lines' offsets along them, both times a weight."""
        x, y = self.normals(at)
        if weight is not None:
            x, y = weight * x, weight * y
        return (x, y), x * self.origin_x[:, at] + y * self.origin_y[:, at]

    def absolute(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return points (B,) in the frame."""
        return x + self.center_x, y + self.center_y

    def whole_covariance(self, covariance: SymmetricMatrix, *point: FloatArray) -> SymmetricMatrix:
        """Return the covariances, which are those of both coordinates."""
        return covariance

    def range_m(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the unfolded distance (B, K) of points (B,), given about the local origin, from the origins."""
        dx, dy = x[:, None] - self.origin_x, y[:, None] - self.origin_y
        return np.sqrt(dx * dx + dy * dy)

    stansfield_width_m = range_m

    def tube_width_m(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the width of each ray's tube (B, K) per radian of bearing at points (B,): the range, if unfocused."""
        range_m = self.range_m(x, y)
        if self.focusing is None:
            return range_m
        return range_m - self.focusing.strength * (range_m - self.focusing.first_leg_m)

    def inside_circles(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, ...]:
        """Return points (B,), those that are not inside a row's circle moved into it."""
        return (x, y) if self.circles is None else self.circles.moved_inside(x, y)

    def paths_from(self, x: FloatArray, y: FloatArray) -> ReflectedPath | None:
        """Return the paths of the circle rows from points (B,), for the other functions of the same points."""
        return None if self.circles is None else self.circles.paths_from(x, y)

    def ray_residuals(self, x: FloatArray, y: FloatArray, paths: ReflectedPath | None = None) -> RayResiduals:
        """Return the distances and chi-square of points (B,), in one pass over the measurements.

        ``paths``, here and below, are those of `paths_from` for the same points, if already computed.
        """
        nearest, farthest = np.full(x.shape, np.inf), np.zeros(x.shape)
        chi_square = np.zeros(x.shape)
        behind = np.zeros(x.shape, dtype=bool)
        bent = None if self.circles is None else self.residual_rad(x, y, paths)
        with ignoring_overflow():
            for k in range(self.origin_x.shape[1]):
                cosine, sine = self.cosine[:, k], self.sine[:, k]
                dx, dy = x - self.origin_x[:, k], y - self.origin_y[:, k]
                squared_range = dx * dx + dy * dy
                np.minimum(nearest, squared_range, out=nearest)
                np.maximum(farthest, squared_range, out=farthest)
                along = cosine * dx + sine * dy
                behind |= along < 0.0
                scaled = np.arctan2(sine * dx - cosine * dy, along) if bent is None else bent[:, k].copy()
                scaled /= self.std_rad[:, k]
                chi_square += scaled * scaled
        return RayResiduals(np.sqrt(nearest), np.sqrt(farthest), behind, chi_square)

    def residual_rad(self, x: FloatArray, y: FloatArray, paths: ReflectedPath | None = None) -> FloatArray:
        """Return the ray's direction minus that of the points (B,) from the origins, (B, K) in (-pi, pi].

        Equals the measured minus the predicted bearing, times ``handedness``, for circle rows too, except
        where no path leads to the point.
        """
        dx, dy = x[:, None] - self.origin_x, y[:, None] - self.origin_y
        with ignoring_overflow():
            residual = np.arctan2(self.sine * dx - self.cosine * dy, self.cosine * dx + self.sine * dy)
        if self.circles is not None:
            bent = -self.circles.residual_rad(self.circles.paths_from(x, y) if paths is None else paths)
            straight = self.circles.pick_from(residual)
            self.circles.place_in(residual, np.where(np.isfinite(bent), bent, straight))
        return residual

    residual = residual_rad

    def bearing_residual_rad(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return measured minus predicted bearing (B, K) at points (B,) about the local origin."""
        residual = self.residual_rad(x, y)
        return residual if self.handedness is None else residual * self.handedness

    def residuals(self, batch: BearingBatch, x: FloatArray, y: FloatArray) -> dict[str, FloatArray]:
        """Return measured minus predicted values (B, K) at points (B,), by the name of their flag column.

        ``residual_rad``, and ``residual_m`` if the batch has ranges: a mirrored row's range is the unfolded length.
        """
        residuals = {"residual_rad": self.bearing_residual_rad(x, y)}
        if batch.range_m is not None:
            residuals["residual_m"] = batch.range_m - self.range_m(x, y)
        return residuals

    def information(
        self, x: FloatArray, y: FloatArray, paths: ReflectedPath | None = None, *, extra_m2: FloatArray | None = None
    ) -> SymmetricMatrix:
        """Return the Fisher information (B,) of the position at points (B,); equations (27)-(29).

        Rows of infinite std add nothing; NaN where another row has no path to the point. With ``extra_m2`` (B,) the
        squared ranges are that much larger, except for rows on a circle.
        """
        slope_x, slope_y = self.slopes(x, y, paths, extra_m2=extra_m2)
        return SymmetricMatrix.gram(slope_x, slope_y)

    def slopes(
        self, x: FloatArray, y: FloatArray, paths: ReflectedPath | None = None, *, extra_m2: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Return the derivatives (B, K) of the residuals over their stds by x and by y; arguments of `information`."""
        dx, dy = x[:, None] - self.origin_x, y[:, None] - self.origin_y
        with ignoring_division():
            squared_range = dx * dx + dy * dy
            weight = 1.0 / (self.std_rad * squared_range)
            if extra_m2 is not None:
                weight *= np.sqrt(squared_range / (squared_range + extra_m2[:, None]))
            dx *= weight
            dy *= weight
        if self.circles is not None:
            paths = self.circles.paths_from(x, y) if paths is None else paths
            slope_x, slope_y = paths.bearing_gradient()
            inverse_std = 1.0 / self.circles.pick_from(self.std_rad)
            informative = inverse_std > 0.0
            self.circles.place_in(dx, np.where(informative, -slope_y * inverse_std, 0.0))
            self.circles.place_in(dy, np.where(informative, slope_x * inverse_std, 0.0))
        return dy, -dx

    def crossing(self, x: FloatArray, y: FloatArray) -> Crossing:
        """Return points (B,) relative to the lines without their directions."""
        width_m = self.std_rad * self.tube_width_m(x, y)
        dx, dy = x[:, None] - self.origin_x, y[:, None] - self.origin_y
        with ignoring_overflow():
            missed = np.abs((self.sine * dx - self.cosine * dy) / width_m)
            range_m = np.sqrt(dx * dx + dy * dy)
            along_m = (self.cosine * dx + self.sine * dy).min(axis=1)
        return Crossing(missed, range_m.min(axis=1), range_m.max(axis=1), along_m)

    def beside_nearest_origin(self, x: FloatArray, y: FloatArray, share: float) -> tuple[FloatArray, FloatArray]:
        """Return the points ``share`` of the farthest distance along the ray whose origin is nearest to points (B,).

        The origins of circle rows, which are unfolded at one point of the circle, are no sensors; not finite where
        there are no others.
        """
        rows, range_m = np.arange(x.shape[0]), self.range_m(x, y)
        farthest_m = range_m.max(axis=1)
        if self.circles is not None:
            self.circles.place_in(range_m, np.full(self.circles.snapshot.shape, np.inf))
        at = rows, np.argmin(range_m, axis=1)
        away_m = np.where(np.isfinite(range_m[at]), share * farthest_m, np.nan)
        return self.origin_x[at] + away_m * self.cosine[at], self.origin_y[at] + away_m * self.sine[at]

    def under_horizon(self) -> BoolArray:
        """Return which rows (B, K) have a bearing under the horizon of their circle."""
        under = np.zeros(self.std_rad.shape, dtype=bool)
        if self.circles is not None:
            self.circles.place_in(under, self.circles.under_horizon())
        return under

    def all_under_horizon(self) -> BoolArray:
        """Return in which snapshots (B,) every bearing is below its horizon, where no wave can come from."""
        if self.circles is None:
            return np.zeros(self.center_x.shape, dtype=bool)
        under = np.bincount(self.circles.snapshot[self.circles.under_horizon()], minlength=self.center_x.shape[0])
        return np.asarray(under == self.origin_x.shape[1])

    def outside_scene(self, x: FloatArray, y: FloatArray, paths: ReflectedPath | None = None) -> BoolArray:
        """Return which points (B,) the scene rules out.

        Those on the wrong side of a row's mirror (or on the mirror), behind a wall or beyond the end of a reflecting
        wall, and outside the regions A2 and A3 of rows by circles and direct rows.
        """
        if self.mirrors is None and self.walls is None and not self.direct:
            return np.zeros(x.shape[0], dtype=bool)
        return np.asarray(self.unseen(x, y, paths).any(axis=1))

    def unseen(self, x: FloatArray, y: FloatArray, paths: ReflectedPath | None = None) -> BoolArray:
        """Return to which rows (B, K) a point (B,) cannot be visible in the scene."""
        parts = (self.mirrors, self.direct, self.circles, self.walls)
        return unseen_rows(self.origin_x, self.origin_y, *parts, x, y, paths)


def sight_lines(batch: BearingBatch) -> SightLines:
    """Return the unfolded rays of a batch, about the mean of their origins in each snapshot.

    A circle row whose sensor is not inside its circle, or under the blocker, makes its snapshot NaN.
    """
    x, y, direction = batch.sensor_xy_m[..., 0], batch.sensor_xy_m[..., 1], batch.bearing_rad
    reflected = batch.reflector >= 0
    direct = locate_direct_rows(batch.scene, batch.reflector, x, y) if batch.scene.reflectors else ()
    handedness, mirrors, focusing, circles = None, None, None, None
    if reflected.any():
        point_x, point_y, angle = gather_mirrors(batch.scene, batch.reflector)
        circles = locate_circle_rows(batch.scene, batch.reflector, x, y, direction)
        if circles is not None:
            focusing = place_tangents(circles, point_x, point_y, angle)
        sensor_side = side_of_line(x, y, point_x, point_y, angle)
        image_x, image_y = reflect_points(x, y, point_x, point_y, angle)
        x, y = np.where(reflected, image_x, x), np.where(reflected, image_y, y)
        direction = np.where(reflected, reflect_direction(direction, angle), direction)
        handedness = np.where(reflected, -1.0, 1.0)
        mirrors = MirrorRows(point_x, point_y, angle, np.where(reflected, sensor_side, np.nan))
        if circles is not None:
            circles.place_in(mirrors.sensor_side_m, np.full(circles.snapshot.shape, np.nan))
    center_x = sum_measurements(x) / x.shape[1]
    center_y = sum_measurements(y) / y.shape[1]
    cosine, sine = cosine_sine(direction)
    return SightLines(
        center_x=center_x,
        center_y=center_y,
        origin_x=x - center_x[:, None],
        origin_y=y - center_y[:, None],
        cosine=cosine,
        sine=sine,
        std_rad=batch.bearing_std_rad,
        handedness=handedness,
        mirrors=None if mirrors is None else mirrors.about(center_x, center_y),
        focusing=focusing,
        circles=None if circles is None else circles.about(center_x, center_y),
        direct=tuple(rows.about(center_x, center_y) for rows in direct),
        walls=locate_walls(batch.scene, batch.reflector, center_x, center_y) if batch.scene.reflectors else None,
    )
