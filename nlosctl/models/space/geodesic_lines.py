"""Azimuths of geodesics on the earth: long-range direction finding of a source at a known height.

The unknowns are metres east and north in the azimuthal equidistant plane about a point: near the source for methods
that trust every row, among the sensors for those that do not. Geodesics are those of WGS 84, by pyproj.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ignoring_division, ignoring_invalid
from nlosctl.contract.batches import BearingBatch
from nlosctl.geometry.angles import wrap_angle
from nlosctl.geometry.blocks import sum_measurements
from nlosctl.geometry.earth_centred import geodesic_between, geodesic_end, local_axes, to_earth_centred, to_geodetic
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.sight import Crossing, Expansion, RayResiduals
from nlosctl.models.space.open_sky import OpenSky

__all__ = ["GeodesicLines", "geodesic_lines", "geodesics_about_sensors"]

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

    @property
    def of_rows(self) -> int:
        """The number of scalars: an azimuth of each row."""
        return self.rows

    @property
    def sensors_m(self) -> tuple[FloatArray, FloatArray]:
        """The sensors (B, K) in the plane."""
        latitude, longitude = (np.broadcast_to(part[:, None], self.azimuth.shape) for part in self._about())
        return in_plane(latitude, longitude, self.sensor_latitude, self.sensor_longitude)

    def scalars(self) -> int:
        """Return the number of azimuths of each snapshot."""
        return self.rows

    def absolute(self, *point: FloatArray) -> tuple[FloatArray, ...]:
        """Return the earth-centred coordinates of points."""
        return to_earth_centred(*self._ground(*point), self.height_m)

    def whole_covariance(self, covariance: SymmetricMatrix, *point: FloatArray) -> SymmetricMatrix:
        """Return the earth-centred covariances at points (B,), without a part along the vertical.

        The plane is true to scale about its own point alone: elsewhere its axes are those of small steps on the ground.
        """
        axes = local_axes(*self._ground(*point))
        steps = []
        for back, ahead in self._around(*point):
            azimuth, length = geodesic_between(*back, *ahead)
            scale = length / (2.0 * _STEP_M)
            toward = (np.sin(azimuth) * scale, np.cos(azimuth) * scale)
            steps.append(tuple(toward[0] * axes[:, 0, i] + toward[1] * axes[:, 1, i] for i in range(3)))
        return (
            SymmetricMatrix.outer(*steps[0], weight=covariance.xx)
            + SymmetricMatrix.symmetrized(*steps) * covariance.xy
            + SymmetricMatrix.outer(*steps[1], weight=covariance.yy)
        )

    def normals(self, at: slice) -> tuple[FloatArray, ...]:
        """Return the unit normals (B, C) of some geodesics where they pass the middle of the plane."""
        return self.planes(at, None)[0]

    def planes(self, at: slice, weight: FloatArray | None) -> tuple[tuple[FloatArray, ...], FloatArray]:
        """Return the normals and the offsets (B, C) of some geodesics along them, both times a weight."""
        x, y, offset = (part[:, at] if weight is None else weight * part[:, at] for part in self._planes)
        return (x, y), offset

    @cached_property
    def _planes(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        gradient = self._gradient(*self._middle())
        with ignoring_division():
            size = np.hypot(*gradient)
            return gradient[0] / size, gradient[1] / size, self.residual(*self._middle()) / size

    def tube_width_m(self, *point: FloatArray) -> FloatArray:
        """Return by how many metres (B, K) a geodesic moves per radian at points: its reduced length."""
        with ignoring_division():
            return 1.0 / np.hypot(*self._gradient(*point))

    stansfield_width_m = tube_width_m

    def paths_from(self, *point: FloatArray) -> None:
        """Return nothing: the other functions share no paths."""

    def residual(self, *point: FloatArray, paths: None = None) -> FloatArray:
        """Return measured minus predicted bearings (B, K)."""
        return self._seen(*self._ground(*point))[0]

    def row_seen(self, k: int, *point: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return measured minus predicted bearing of row ``k`` and the length of its geodesic, at points (B, ...)."""
        at = (slice(None), k, *([None] * (point[0].ndim - 1)))
        latitude, longitude = (
            np.broadcast_to(part[at], point[0].shape) for part in (self.sensor_latitude, self.sensor_longitude)
        )
        azimuth, range_m = geodesic_between(latitude, longitude, *self._ground(*point))
        return wrap_angle(azimuth - self.azimuth[at]), range_m

    def row_gradient(self, k: int, *point: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the derivatives (B,) of the predicted bearing of row ``k`` by east and north."""
        sensor = self.sensor_latitude[:, k], self.sensor_longitude[:, k]
        azimuths = [[geodesic_between(*sensor, *end)[0] for end in ends] for ends in self._around(*point)]
        east, north = (wrap_angle(back - ahead) / (2.0 * _STEP_M) for back, ahead in azimuths)
        return east, north

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

    def expanded(self, *point: FloatArray) -> Iterator[Expansion]:
        """Yield half the chi-square (B, K) and its derivatives; second derivatives of azimuths are left out."""
        scaled, slopes = self.residual(*point) / self.std, self.slopes(*point)
        gradient = tuple(scaled * slope for slope in slopes)
        yield 0.5 * scaled * scaled, gradient, SymmetricMatrix.outer(*slopes), None

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
        return self._seen(*self._ground(*point))[1]

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
        return self.ends(*at, self.azimuth[at], away_m)

    def ends(
        self, snapshot: IntArray, k: IntArray, azimuth: FloatArray, length_m: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the ends (N,) of geodesics from the sensors of rows ``k`` of snapshots."""
        sensor = self.sensor_latitude[snapshot, k], self.sensor_longitude[snapshot, k]
        end = geodesic_end(*sensor, azimuth, length_m)
        return in_plane(self.latitude[snapshot], self.longitude[snapshot], *end)

    def about_crossing(self, rounds: int = _ROUNDS) -> GeodesicLines:
        """Return the azimuths about the point (B,) where their geodesics meet, in least squares."""
        latitude, longitude = _great_circle_crossing(self.sensor_latitude, self.sensor_longitude, self.azimuth)
        lines = replace(self, latitude=latitude, longitude=longitude)
        for _ in range(rounds):
            middle = lines._middle()
            slopes, scaled = lines.slopes(*middle), lines.residual(*middle) / lines.std
            step = SymmetricMatrix.gram(*slopes).solve(*(sum_measurements(slope * scaled) for slope in slopes))
            length = np.hypot(*step)
            usable = np.isfinite(length) & (length < 0.2 * lines.range_m(*middle).max(axis=1))
            moved = lines._ground(*(np.where(usable, -part, 0.0) for part in step))
            lines = replace(lines, latitude=moved[0], longitude=moved[1])
        return lines

    def residuals(self, batch: BearingBatch, *point: FloatArray) -> dict[str, FloatArray]:
        """Return measured minus predicted bearings (B, K), and those of ranges along the ground."""
        columns = {"residual_rad": self.residual(*point)}
        if batch.range_m is not None:
            columns["residual_m"] = batch.range_m - self.range_m(*point)
        return columns

    def outside_scene(self, *point: FloatArray, paths: None = None) -> BoolArray:
        """Return which points (B,) the scene rules out: none."""
        return np.zeros(point[0].shape, dtype=bool)

    def _about(self) -> tuple[FloatArray, FloatArray]:
        return self.latitude, self.longitude

    def _middle(self) -> tuple[FloatArray, FloatArray]:
        return np.zeros(self.latitude.shape), np.zeros(self.latitude.shape)

    def _ground(self, *point: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return latitude and longitude (B, ...) of points."""
        east, north = point
        wide = (slice(None), *([None] * (east.ndim - 1)))
        latitude, longitude = (np.broadcast_to(part[wide], east.shape) for part in self._about())
        return geodesic_end(latitude, longitude, np.arctan2(east, north), np.hypot(east, north))

    def _around(self, *point: FloatArray) -> list[tuple[tuple[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]]:
        """Return latitude and longitude (B,) of the points a step back and ahead, to the east and to the north."""
        east, north = point
        steps = ((_STEP_M, 0.0), (0.0, _STEP_M))
        return [(self._ground(east - x, north - y), self._ground(east + x, north + y)) for x, y in steps]

    def _seen(self, latitude: FloatArray, longitude: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return measured minus predicted bearings (B, K) and lengths of geodesics to places (B,)."""
        place = (np.broadcast_to(part[:, None], self.azimuth.shape) for part in (latitude, longitude))
        azimuth, range_m = geodesic_between(self.sensor_latitude, self.sensor_longitude, *place)
        return wrap_angle(azimuth - self.azimuth), range_m

    def _gradient(self, *point: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the derivatives (B, K) of the predicted bearing by east and north, by central differences."""
        residuals = [[self._seen(*end)[0] for end in ends] for ends in self._around(*point)]
        east, north = (wrap_angle(back - ahead) / (2.0 * _STEP_M) for back, ahead in residuals)
        return east, north


def geodesic_lines(batch: BearingBatch) -> GeodesicLines:
    """Return the azimuths of an earth-centred batch about the point where their geodesics meet, in least squares."""
    return geodesics_about_sensors(batch).about_crossing()


def geodesics_about_sensors(batch: BearingBatch) -> GeodesicLines:
    """Return the azimuths of an earth-centred batch about the middle of each snapshot's sensors."""
    assert batch.sensor_z_m is not None  # noqa: S101 - batches in space have heights
    place = (batch.sensor_xy_m[..., 0], batch.sensor_xy_m[..., 1], batch.sensor_z_m)
    sensor = to_geodetic(*place)
    latitude, longitude, _ = to_geodetic(*(sum_measurements(part) / batch.measurements for part in place))
    height = np.zeros(batch.size) if batch.target_z_m is None else batch.target_z_m
    azimuth = 0.5 * np.pi - batch.bearing_rad
    return GeodesicLines(latitude, longitude, sensor[0], sensor[1], azimuth, batch.bearing_std_rad, height)


def in_plane(
    latitude: FloatArray, longitude: FloatArray, to_latitude: FloatArray, to_longitude: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return metres east and north of places (...) in the planes about points (...)."""
    azimuth, length = geodesic_between(latitude, longitude, to_latitude, to_longitude)
    return length * np.sin(azimuth), length * np.cos(azimuth)


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
