"""Azimuths of geodesics on the earth: long-range direction finding of a source at a known height.

The unknowns are metres east and north in the azimuthal equidistant plane about a point near the source, so that
directions from there and their covariance are those of the ground. Geodesics are those of WGS 84, by pyproj.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, ignoring_division, ignoring_invalid
from nlosctl.contract.batches import BearingBatch
from nlosctl.geometry.angles import wrap_angle
from nlosctl.geometry.blocks import sum_measurements
from nlosctl.geometry.earth_centred import geodesic_between, geodesic_end, local_axes, to_earth_centred, to_geodetic
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.sight import Crossing, RayResiduals
from nlosctl.models.space.open_sky import OpenSky

__all__ = ["GeodesicLines", "geodesic_lines"]

_STEP_M = 20.0
"""Half the distance of the points whose azimuths differ for a derivative: geodesics are exact to nanometres."""

_ROUNDS = 4
"""Gauss-Newton steps from the crossing of great circles; the plane moves with each."""


@dataclass(frozen=True)
class GeodesicLines(OpenSky):
    """Azimuths (B, K) from true north, clockwise, at sensors; angles in radians, ``height_m`` (B,) of the source.

    It has the interface `Sight` with D = 2; `absolute` gives earth-centred coordinates. Residuals are those of
    bearings: counter-clockwise.
    """

    latitude: FloatArray
    longitude: FloatArray
    sensor_latitude: FloatArray
    sensor_longitude: FloatArray
    azimuth: FloatArray
    std: FloatArray
    height_m: FloatArray

    unknowns = 2

    @property
    def center(self) -> tuple[FloatArray, ...]:
        """The earth-centred coordinates (B,) of the points about which the plane is."""
        return to_earth_centred(self.latitude, self.longitude, self.height_m)

    def with_std(self, std: FloatArray) -> GeodesicLines:
        """Return the same azimuths with other standard deviations (B, K)."""
        return replace(self, std=std)

    @property
    def rows(self) -> int:
        """The number of rows, K."""
        return int(self.azimuth.shape[1])

    def scalars(self) -> int:
        """Return the number of azimuths of each snapshot."""
        return self.rows

    def absolute(self, *point: FloatArray) -> tuple[FloatArray, ...]:
        """Return the earth-centred coordinates of points."""
        return to_earth_centred(*self._ground(*point), self.height_m)

    def whole_covariance(self, covariance: SymmetricMatrix) -> SymmetricMatrix:
        """Return the earth-centred covariances, without a part along the vertical."""
        axes = local_axes(self.latitude, self.longitude)
        east, north = (tuple(axes[:, i, j] for j in range(3)) for i in range(2))
        cross = SymmetricMatrix.symmetrized(east, north) * covariance.xy
        return (
            SymmetricMatrix.outer(*east, weight=covariance.xx)
            + cross
            + SymmetricMatrix.outer(*north, weight=covariance.yy)
        )

    def normals(self) -> tuple[FloatArray, ...]:
        """Return the unit normals (B, K) of the geodesics where they pass the middle of the plane."""
        gradient = self._gradient(*self._middle())
        with ignoring_division():
            size = np.hypot(*gradient)
            return gradient[0] / size, gradient[1] / size

    def offsets(self, normals: tuple[FloatArray, ...]) -> FloatArray:
        """Return the offsets (B, K) of the geodesics along normals, which may have any length."""
        with ignoring_division():
            distance = self.residual(*self._middle()) / np.hypot(*self._gradient(*self._middle()))
        return distance * np.hypot(*normals)

    def tube_width_m(self, *point: FloatArray) -> FloatArray:
        """Return by how many metres (B, K) a geodesic moves per radian at points: its reduced length."""
        with ignoring_division():
            return 1.0 / np.hypot(*self._gradient(*point))

    stansfield_width_m = tube_width_m

    def paths_from(self, *point: FloatArray) -> None:
        """Return nothing: the other functions share no paths."""

    def residual(self, *point: FloatArray, paths: None = None) -> FloatArray:
        """Return measured minus predicted bearings (B, K)."""
        latitude, longitude = (np.broadcast_to(part[:, None], self.azimuth.shape) for part in self._ground(*point))
        azimuth, _ = geodesic_between(self.sensor_latitude, self.sensor_longitude, latitude, longitude)
        return wrap_angle(azimuth - self.azimuth)

    def slopes(
        self, *point: FloatArray, paths: None = None, extra_m2: FloatArray | None = None
    ) -> tuple[FloatArray, ...]:
        """Return the derivatives (B, K) of the residuals over their stds; ``extra_m2`` adds to squared distances."""
        gradient = self._gradient(*point)
        scale = -1.0 / self.std
        if extra_m2 is not None:
            squared = 1.0 / (gradient[0] * gradient[0] + gradient[1] * gradient[1])
            scale = scale * np.sqrt(squared / (squared + extra_m2[:, None]))
        return gradient[0] * scale, gradient[1] * scale

    def linearized(self, *point: FloatArray) -> Iterator[tuple[FloatArray, tuple[FloatArray, ...]]]:
        """Yield residual over std (B,) and derivatives, row by row."""
        scaled, slopes = self.residual(*point) / self.std, self.slopes(*point)
        for k in range(self.azimuth.shape[1]):
            yield scaled[:, k], tuple(slope[:, k] for slope in slopes)

    def bending(self, *at: Any) -> SymmetricMatrix:
        """Return zeros (B,): second derivatives of azimuths are left out."""
        return SymmetricMatrix.full(at[0].shape, 0.0)

    def information(
        self, *point: FloatArray, paths: None = None, extra_m2: FloatArray | None = None
    ) -> SymmetricMatrix:
        """Return the Fisher information (B,) of points."""
        return SymmetricMatrix.gram(*self.slopes(*point, extra_m2=extra_m2))

    def ray_residuals(self, *point: FloatArray, paths: None = None) -> RayResiduals:
        """Return distances along the ground and the chi-square of points; behind is more than a right angle off."""
        residual, range_m = self.residual(*point), self.range_m(*point)
        chi_square = sum_measurements((residual / self.std) ** 2)
        behind = np.asarray((np.abs(residual) > 0.5 * np.pi).any(axis=1))
        return RayResiduals(range_m.min(axis=1), range_m.max(axis=1), behind, chi_square)

    def range_m(self, *point: FloatArray) -> FloatArray:
        """Return the lengths (B, K) of the geodesics to points."""
        latitude, longitude = (np.broadcast_to(part[:, None], self.azimuth.shape) for part in self._ground(*point))
        return geodesic_between(self.sensor_latitude, self.sensor_longitude, latitude, longitude)[1]

    def crossing(self, *point: FloatArray) -> Crossing:
        """Return points relative to the geodesics without their directions."""
        residual, range_m = self.residual(*point), self.range_m(*point)
        missed = np.abs(np.arctan(np.tan(residual))) / self.std
        along_m = (range_m * np.cos(residual)).min(axis=1)
        return Crossing(missed, range_m.min(axis=1), range_m.max(axis=1), along_m)

    def beside_nearest_origin(self, *point: FloatArray, share: float) -> tuple[FloatArray, ...]:
        """Return the points ``share`` of the farthest distance along the geodesic of the nearest sensor."""
        range_m = self.range_m(*point)
        at = np.arange(range_m.shape[0]), np.argmin(range_m, axis=1)
        away_m = share * range_m.max(axis=1)
        beside = geodesic_end(self.sensor_latitude[at], self.sensor_longitude[at], self.azimuth[at], away_m)
        azimuth, length = geodesic_between(self.latitude, self.longitude, *beside)
        return length * np.sin(azimuth), length * np.cos(azimuth)

    def residuals(self, batch: BearingBatch, *point: FloatArray) -> dict[str, FloatArray]:
        """Return measured minus predicted bearings (B, K), and those of ranges along the ground."""
        columns = {"residual_rad": self.residual(*point)}
        if batch.range_m is not None:
            columns["residual_m"] = batch.range_m - self.range_m(*point)
        return columns

    def outside_scene(self, *point: FloatArray, paths: None = None) -> BoolArray:
        """Return which points (B,) the scene rules out: none."""
        return np.zeros(point[0].shape, dtype=bool)

    def _middle(self) -> tuple[FloatArray, FloatArray]:
        return np.zeros(self.latitude.shape), np.zeros(self.latitude.shape)

    def _ground(self, *point: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return latitude and longitude (B,) of points."""
        east, north = point
        return geodesic_end(self.latitude, self.longitude, np.arctan2(east, north), np.hypot(east, north))

    def _gradient(self, *point: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the derivatives (B, K) of the predicted bearing by east and north, by central differences."""
        east, north = point
        parts = [
            self.residual(east - dx, north - dy) - self.residual(east + dx, north + dy)
            for dx, dy in ((_STEP_M, 0.0), (0.0, _STEP_M))
        ]
        return wrap_angle(parts[0]) / (2.0 * _STEP_M), wrap_angle(parts[1]) / (2.0 * _STEP_M)


def geodesic_lines(batch: BearingBatch) -> GeodesicLines:
    """Return the azimuths of an earth-centred batch about the point where their geodesics meet, in least squares."""
    assert batch.sensor_z_m is not None  # noqa: S101 - batches in space have heights
    sensor = to_geodetic(batch.sensor_xy_m[..., 0], batch.sensor_xy_m[..., 1], batch.sensor_z_m)
    azimuth = 0.5 * np.pi - batch.bearing_rad
    height = np.zeros(batch.size) if batch.target_z_m is None else batch.target_z_m
    latitude, longitude = _great_circle_crossing(sensor[0], sensor[1], azimuth)
    lines = GeodesicLines(latitude, longitude, sensor[0], sensor[1], azimuth, batch.bearing_std_rad, height)
    for _ in range(_ROUNDS):
        middle = lines._middle()
        slopes, scaled = lines.slopes(*middle), lines.residual(*middle) / lines.std
        step = lines.information(*middle).solve(*(sum_measurements(slope * scaled) for slope in slopes))
        length = np.hypot(*step)
        usable = np.isfinite(length) & (length < 0.2 * lines.range_m(*middle).max(axis=1))
        moved = lines._ground(*(np.where(usable, -part, 0.0) for part in step))
        lines = replace(lines, latitude=moved[0], longitude=moved[1])
    return lines


def _great_circle_crossing(
    latitude: FloatArray, longitude: FloatArray, azimuth: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the latitude and longitude (B,) nearest to the planes of great circles (B, K) on a sphere, in front."""
    axes = local_axes(latitude, longitude)
    along = np.cos(azimuth)[..., None] * axes[..., 1, :] + np.sin(azimuth)[..., None] * axes[..., 0, :]
    normal = np.cross(axes[..., 2, :], along)
    with ignoring_invalid():
        nearest = np.linalg.eigh(np.einsum("bki,bkj->bij", normal, normal))[1][..., 0]
    nearest *= np.sign(np.einsum("bki,bi->b", along, nearest))[:, None]
    return np.arcsin(np.clip(nearest[:, 2], -1.0, 1.0)), np.arctan2(nearest[:, 1], nearest[:, 0])
