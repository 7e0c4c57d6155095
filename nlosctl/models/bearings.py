"""Bearings as sight lines: every row, direct or seen in a flat mirror, as a ray from an origin.

A row seen in a mirror is unfolded: its origin is the sensor's image, its direction the bearing's image
(equations (3), (4) of Song, Willett, Zhou 2013). After that all rows are alike.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.scene import Scene
from nlosctl.geometry.blocks import sum_measurements
from nlosctl.geometry.mirrors import reflect_direction, reflect_points, side_of_line
from nlosctl.geometry.symmetric import Symmetric2x2

__all__ = ["MirrorRows", "SightLines", "Survey", "predict_bearings", "sight_lines"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class MirrorRows:
    """The mirror of each row: a point on it (about the local origin), its angle, and the side of the sensor.

    Shape (B, K). ``sensor_side_m`` is the sensor's signed distance from it, NaN for direct rows.
    """

    point_x: FloatArray
    point_y: FloatArray
    angle_rad: FloatArray
    sensor_side_m: FloatArray


@dataclass(frozen=True)
class Survey:
    """What the rays say of a point (B,): unfolded distances in metres, whether it is behind any, chi-square."""

    nearest_m: FloatArray
    farthest_m: FloatArray
    behind: BoolArray
    chi_square: FloatArray


@dataclass(frozen=True)
class SightLines:
    """Rays (B, K) about a local origin (B,): ``origin + t (cosine, sine)``, t > 0.

    ``handedness`` is -1 where the row was unfolded by a mirror (a bearing that turns one way turns the ray the
    other way), else 1. Lengths in metres, ``std_rad`` in radians.
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

    def range_m(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the unfolded distance (B, K) of points (B,), given about the local origin, from the origins."""
        dx, dy = x[:, None] - self.origin_x, y[:, None] - self.origin_y
        return np.sqrt(dx * dx + dy * dy)

    def survey(self, x: FloatArray, y: FloatArray) -> Survey:
        """Return what the rays of each snapshot say of a point (B,), in one pass over the measurements."""
        nearest, farthest = np.full(x.shape, np.inf), np.zeros(x.shape)
        chi_square = np.zeros(x.shape)
        behind = np.zeros(x.shape, dtype=bool)
        with np.errstate(invalid="ignore", over="ignore"):
            for k in range(self.origin_x.shape[1]):
                cosine, sine = self.cosine[:, k], self.sine[:, k]
                dx, dy = x - self.origin_x[:, k], y - self.origin_y[:, k]
                squared_range = dx * dx + dy * dy
                np.minimum(nearest, squared_range, out=nearest)
                np.maximum(farthest, squared_range, out=farthest)
                along = cosine * dx + sine * dy
                behind |= along < 0.0
                scaled = np.arctan2(sine * dx - cosine * dy, along)
                scaled /= self.std_rad[:, k]
                chi_square += scaled * scaled
        return Survey(np.sqrt(nearest), np.sqrt(farthest), behind, chi_square)

    def residual_rad(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the ray's direction minus that of the points (B,) from the origins, (B, K) in (-pi, pi].

        Equals the measured minus the predicted bearing, times ``handedness``.
        """
        dx, dy = x[:, None] - self.origin_x, y[:, None] - self.origin_y
        with np.errstate(invalid="ignore", over="ignore"):
            return np.arctan2(self.sine * dx - self.cosine * dy, self.cosine * dx + self.sine * dy)

    def bearing_residual_rad(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return measured minus predicted bearing (B, K) at points (B,) about the local origin."""
        residual = self.residual_rad(x, y)
        return residual if self.handedness is None else residual * self.handedness

    def information(self, x: FloatArray, y: FloatArray) -> Symmetric2x2:
        """Return the Fisher information (B,) of the position at points (B,); equations (27)-(29)."""
        dx, dy = x[:, None] - self.origin_x, y[:, None] - self.origin_y
        with np.errstate(divide="ignore", invalid="ignore"):
            weight = 1.0 / (self.std_rad * (dx * dx + dy * dy))
            dx *= weight
            dy *= weight
        return Symmetric2x2(sum_measurements(dy * dy), -sum_measurements(dx * dy), sum_measurements(dx * dx))

    def beyond_mirror(self, x: FloatArray, y: FloatArray) -> BoolArray:
        """Return which points (B,) lie on another side of a row's mirror than its sensor, or on the mirror."""
        beyond = np.zeros(x.shape[0], dtype=bool)
        if self.mirrors is None:
            return beyond
        rows = self.mirrors
        with np.errstate(invalid="ignore"):
            side = side_of_line(x[:, None], y[:, None], rows.point_x, rows.point_y, rows.angle_rad)
        wrong = side * rows.sensor_side_m <= 0.0
        for k in range(wrong.shape[1]):
            beyond |= wrong[:, k]
        return beyond


def sight_lines(batch: BearingBatch) -> SightLines:
    """Return the unfolded rays of a batch, about the mean of their origins in each snapshot."""
    x, y, direction = batch.sensor_xy_m[..., 0], batch.sensor_xy_m[..., 1], batch.bearing_rad
    reflected = batch.reflector >= 0
    handedness = None
    mirrors = None
    if reflected.any():
        point_x, point_y, angle = _gather_mirrors(batch.scene, batch.reflector)
        image_x, image_y = reflect_points(x, y, point_x, point_y, angle)
        sensor_side = side_of_line(x, y, point_x, point_y, angle)
        x, y = np.where(reflected, image_x, x), np.where(reflected, image_y, y)
        direction = np.where(reflected, reflect_direction(direction, angle), direction)
        handedness = np.where(reflected, -1.0, 1.0)
        mirrors = MirrorRows(point_x, point_y, angle, np.where(reflected, sensor_side, np.nan))
    center_x = sum_measurements(x) / x.shape[1]
    center_y = sum_measurements(y) / y.shape[1]
    if mirrors is not None:
        mirrors = MirrorRows(
            mirrors.point_x - center_x[:, None],
            mirrors.point_y - center_y[:, None],
            mirrors.angle_rad,
            mirrors.sensor_side_m,
        )
    return SightLines(
        center_x=center_x,
        center_y=center_y,
        origin_x=x - center_x[:, None],
        origin_y=y - center_y[:, None],
        cosine=np.cos(direction),
        sine=np.sin(direction),
        std_rad=batch.bearing_std_rad,
        handedness=handedness,
        mirrors=mirrors,
    )


def predict_bearings(sensor_xy_m: FloatArray, reflector: IntArray, scene: Scene, source_xy_m: FloatArray) -> FloatArray:
    """Return the noise-free bearings (...) of sources (..., 2) from sensors (..., 2), in (-pi, pi].

    By the image of the source, equation (2) of Song et al. with atan2: the sensor looks at the image.
    """
    x, y = source_xy_m[..., 0], source_xy_m[..., 1]
    if (reflector >= 0).any():
        point_x, point_y, angle = _gather_mirrors(scene, reflector)
        image_x, image_y = reflect_points(x, y, point_x, point_y, angle)
        x, y = np.where(reflector >= 0, image_x, x), np.where(reflector >= 0, image_y, y)
    return np.arctan2(y - sensor_xy_m[..., 1], x - sensor_xy_m[..., 0])


def _gather_mirrors(scene: Scene, reflector: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return point x, point y and angle of the mirror of each row; whatever for direct rows (-1)."""
    table = np.array(
        [[*mirror.point, np.arctan2(mirror.direction[1], mirror.direction[0])] for mirror in scene.reflectors]
    )
    point_x, point_y, angle = table.T
    return point_x[reflector], point_y[reflector], angle[reflector]
