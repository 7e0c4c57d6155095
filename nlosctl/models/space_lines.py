"""Bearings in space: azimuths, with elevations or without, of direct rows and of rows seen in plane mirrors.

A row seen in a mirror is unfolded as in the plane: its origin is the sensor's image, and ``axes`` turn the vector from
there to the source into what the sensor sees, v = H (x - p) + p - s with H = 1 - 2 n n'. Azimuth and elevation of v have
the gradients a / f and t / r, with the tangents a, t of the direction, f = |(v_x, v_y)| and r = |v|.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, ignoring_overflow
from nlosctl.contract.batches import BearingBatch
from nlosctl.geometry.blocks import RowBlock
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.obstacles import WallRows
from nlosctl.models.plane_mirrors import PlaneMirrors
from nlosctl.models.sight import Crossing, RayResiduals

__all__ = ["SpaceLines"]

_ZENITH_STDS = 3.0
"""Nearer to the zenith than this many stds of the elevation the azimuth is no Gaussian angle."""

Vector = tuple[FloatArray, FloatArray, FloatArray]


@dataclass(frozen=True)
class SpaceLines(RowBlock):
    """Rays (B, K) in space about a local origin (B,), and a measured height of the source; see `Sight`.

    The scalars are K azimuths, K elevations (``has_elevation`` (B, K) is 0 in rows without one, else 1) and, unless it
    is exactly known (``is_held``), the height ``height_m`` (B,). ``axes`` are the rows of a matrix for each measurement
    that turns the vector from its origin into the axes of its sensor; None: all have those of the frame. With
    ``in_tangent_plane`` rows with an elevation have residuals in the tangent plane of the measured direction, which
    stays right at the zenith. Lengths in metres, standard deviations in radians.
    """

    center: Vector
    origin: Vector
    cos_azimuth: FloatArray
    sin_azimuth: FloatArray
    cos_elevation: FloatArray
    sin_elevation: FloatArray
    has_elevation: FloatArray
    std: FloatArray
    axes: tuple[Vector, Vector, Vector] | None = None
    mirrors: PlaneMirrors | None = None
    walls: WallRows | None = None
    height_m: FloatArray | None = None
    is_held: bool = False
    in_tangent_plane: bool = False

    @property
    def unknowns(self) -> int:
        """The number of unknown coordinates: 2 where the height is exactly known."""
        return 2 if self.is_held else 3

    @property
    def rows(self) -> int:
        """The number of rows, K."""
        return self.cos_azimuth.shape[1]

    def with_std(self, std: FloatArray) -> SpaceLines:
        """Return the same rays with other standard deviations (B, M) of the angles; that of a height stays."""
        return replace(self, std=np.concatenate([std[:, : 2 * self.rows].T, self.std[:, 2 * self.rows :].T]).T)

    def scalars(self) -> Any:
        """Return the number (B,) of measured scalars."""
        return self.rows + self.has_elevation.sum(axis=1).astype(np.int64) + (self.std.shape[1] - 2 * self.rows)

    def absolute(self, *point: FloatArray) -> tuple[FloatArray, ...]:
        """Return points in the frame, with the height that is exactly known."""
        return tuple(part + middle for part, middle in zip(self.whole(point), self.center, strict=True))

    def whole_covariance(self, covariance: SymmetricMatrix) -> SymmetricMatrix:
        """Return the covariances of x, y, z; zeros for a height that is exactly known."""
        if not self.is_held:
            return covariance
        return SymmetricMatrix(*covariance, *(np.zeros(covariance.xx.shape) for _ in range(3)))

    def normals(self) -> Vector:
        """Return the unit normals (B, M) of the planes of measured azimuths, elevations and height; 0 without one."""
        zero = np.zeros(self.cos_azimuth.shape)
        across = self._from_sensor((-self.sin_azimuth, self.cos_azimuth, zero))
        up = (-self.sin_elevation * self.cos_azimuth, -self.sin_elevation * self.sin_azimuth, self.cos_elevation)
        above = tuple(part * self.has_elevation for part in self._from_sensor(up))
        level = np.zeros((self.std.shape[0], self.std.shape[1] - 2 * self.rows))
        x, y, z = (np.concatenate([*pair, level], axis=1) for pair in zip(across, above, strict=True))
        z[:, 2 * self.rows :] = 1.0
        return x, y, z

    def offsets(self, normals: tuple[FloatArray, ...]) -> FloatArray:
        """Return the offsets (B, M) of the planes along normals; less the part of a height that is exactly known."""
        x, y, z = normals
        every = [np.concatenate([part, part], axis=1) for part in self.origin]
        if self.is_held and self.height_m is not None:
            every[2] = every[2] - self.height_m[:, None]
        elif self.height_m is not None:
            nothing = np.zeros((self.height_m.shape[0], 1))
            every = [np.concatenate([part, last], axis=1) for part, last in zip(every, (nothing, nothing, self.height_m[:, None]), strict=True)]
        return x * every[0] + y * every[1] + z * every[2]

    def tube_width_m(self, *point: FloatArray) -> FloatArray:
        """Return by how many metres (B, M) each plane moves per unit of its std: f of azimuths, r of elevations, 1 of heights.

        In the tangent plane r of both.
        """
        vx, vy, vz = self._seen(self.whole(point))
        squared = vx * vx + vy * vy
        level, slant = np.sqrt(squared), np.sqrt(squared + vz * vz)
        if self.in_tangent_plane:
            level = np.where(self.has_elevation > 0.0, slant, level)
        one = np.ones((squared.shape[0], self.std.shape[1] - 2 * self.rows))
        return np.concatenate([level, slant, one], axis=1)

    stansfield_width_m = tube_width_m

    def paths_from(self, *point: FloatArray) -> None:
        """Return nothing: these paths are straight."""

    def inside_circles(self, *point: FloatArray) -> tuple[FloatArray, ...]:
        """Return the points: no row is seen by a circle."""
        return point

    def linearized(
        self, *point: FloatArray, extra_m2: FloatArray | None = None
    ) -> Iterator[tuple[FloatArray, tuple[FloatArray, ...]]]:
        """Yield residual over std (B,) and derivatives of each azimuth and its elevation, row by row, then the height's.

        With ``extra_m2`` (B,) the squared distances are that much larger.
        """
        whole, known = self.whole(point), self.unknowns
        for k in range(self.rows):
            for residual, slopes, index in self._row(k, whole, extra_m2):
                inverse = 1.0 / self.std[:, index]
                yield residual * inverse, tuple(slope * inverse for slope in slopes[:known])
        if self.height_m is not None and not self.is_held:
            inverse = 1.0 / self.std[:, -1]
            zero = np.zeros(inverse.shape)
            yield (self.height_m - whole[2]) * inverse, (zero, zero, -inverse)

    def _row(self, k: int, point: Vector, extra_m2: Any) -> Iterator[tuple[FloatArray, Vector, int]]:
        """Yield residual (B,), its derivatives and the index of the scalar for the azimuth and the elevation of a row."""
        vx, vy, vz = self._seen(point, k)
        squared = vx * vx + vy * vy
        whole = squared + vz * vz
        cos_z, sin_z, has = self.cos_azimuth[:, k], self.sin_azimuth[:, k], self.has_elevation[:, k]
        cos_e, sin_e = self.cos_elevation[:, k], self.sin_elevation[:, k]
        level = np.sqrt(squared)
        weight = -1.0 / (squared if extra_m2 is None else np.sqrt(squared * (squared + extra_m2)))
        azimuth = np.arctan2(sin_z * vx - cos_z * vy, cos_z * vx + sin_z * vy)
        slopes: Vector = (-vy * weight, vx * weight, np.zeros(vx.shape))
        rise = np.arctan2(sin_e * level - cos_e * vz, cos_e * level + sin_e * vz) * has
        weight = -has / (whole if extra_m2 is None else np.sqrt(whole * (whole + extra_m2)))
        slant = -vz / level * weight
        rising: Vector = (vx * slant, vy * slant, level * weight)
        if self.in_tangent_plane:
            scale = 1.0 / np.sqrt(whole if extra_m2 is None else whole + extra_m2)
            ux, uy, uz = (part / np.sqrt(whole) for part in (vx, vy, vz))
            along = -sin_z * ux + cos_z * uy
            flat = has > 0.0
            azimuth = np.where(flat, -along, azimuth)
            slopes = _either(flat, ((sin_z + along * ux) * scale, (along * uy - cos_z) * scale, along * uz * scale), slopes)
            tx, ty = -sin_e * cos_z, -sin_e * sin_z
            above = (tx * ux + ty * uy + cos_e * uz) * has
            scale = scale * has
            rise, rising = -above, ((above * ux - tx) * scale, (above * uy - ty) * scale, (above * uz - cos_e) * scale)
        yield azimuth, self._from_sensor(slopes, k), k
        yield rise, self._from_sensor(rising, k), self.rows + k

    def residual(self, *point: FloatArray, paths: None = None) -> FloatArray:
        """Return measured minus predicted scalars (B, M); 0 in rows without an elevation."""
        return self._gathered(residual for residual, _ in self.linearized(*point)) * self.std

    def slopes(
        self, *point: FloatArray, paths: None = None, extra_m2: FloatArray | None = None
    ) -> tuple[FloatArray, ...]:
        """Return the derivatives (B, M) of the residuals over their stds; with ``extra_m2`` as in `linearized`."""
        every = [slopes for _, slopes in self.linearized(*point, extra_m2=extra_m2)]
        return tuple(self._gathered(iter(parts)) for parts in zip(*every, strict=True))

    def _gathered(self, parts: Iterator[FloatArray]) -> FloatArray:
        """Return the scalars (B,) in the order of `linearized` as a block (B, M) in the order of `std`."""
        values = list(parts)
        angles, rest = values[: 2 * self.rows], values[2 * self.rows :]
        return np.stack([*angles[0::2], *angles[1::2], *rest]).T

    def information(
        self, *point: FloatArray, paths: None = None, extra_m2: FloatArray | None = None
    ) -> SymmetricMatrix:
        """Return the Fisher information (B,) of points; rows of infinite std add nothing."""
        total = SymmetricMatrix.full(point[0].shape, 0.0, len(point))
        with ignoring_overflow():
            for _, slopes in self.linearized(*point, extra_m2=extra_m2):
                total += SymmetricMatrix.outer(*slopes)
        return total

    def ray_residuals(self, *point: FloatArray, paths: None = None) -> RayResiduals:
        """Return distances and chi-square of points, and where they are nearly above or below a row's sensor."""
        whole = self.whole(point)
        with ignoring_overflow():
            seen = self._seen(whole)
            squared = seen[0] * seen[0] + seen[1] * seen[1]
            range_m = np.sqrt(squared + seen[2] * seen[2])
            chi_square = np.zeros(point[0].shape)
            for residual, _ in self.linearized(*point):
                chi_square += residual * residual
            zenith = np.zeros(point[0].shape, dtype=bool)
            if not self.in_tangent_plane:
                near = np.sin(np.minimum(_ZENITH_STDS * self.std[:, self.rows : 2 * self.rows], 0.5 * np.pi))
                low = np.minimum(np.sqrt(squared), self.cos_elevation * range_m) < near * range_m
                zenith = ((self.has_elevation > 0.0) & low).any(axis=1)
        return RayResiduals(
            range_m.min(axis=1), range_m.max(axis=1), (self._along(seen) < 0.0).any(axis=1), chi_square, zenith
        )

    def range_m(self, *point: FloatArray) -> FloatArray:
        """Return the unfolded distances (B, K) of points from the origins."""
        vx, vy, vz = self._seen(self.whole(point))
        return np.sqrt(vx * vx + vy * vy + vz * vz)

    def crossing(self, *point: FloatArray) -> Crossing:
        """Return points relative to the lines and planes without their directions."""
        normals = self.normals()
        with ignoring_overflow():
            reach = sum(part[:, None] * normal for part, normal in zip(self.whole(point), normals, strict=True))
            if self.is_held and self.height_m is not None:
                reach = reach - self.height_m[:, None] * normals[2]
            missed = np.abs((reach - self.offsets(normals)) / (self.std * self.tube_width_m(*point)))
            seen = self._seen(self.whole(point))
            range_m = np.sqrt(seen[0] * seen[0] + seen[1] * seen[1] + seen[2] * seen[2])
        return Crossing(missed, range_m.min(axis=1), range_m.max(axis=1), self._along(seen).min(axis=1))

    def beside_nearest_origin(self, *point: FloatArray, share: float) -> tuple[FloatArray, ...]:
        """Return the points ``share`` of the farthest distance along the ray whose origin is nearest to points."""
        range_m = self.range_m(*point)
        at = np.arange(range_m.shape[0]), np.argmin(range_m, axis=1)
        away_m = share * range_m.max(axis=1)
        ray = (self.cos_elevation * self.cos_azimuth, self.cos_elevation * self.sin_azimuth, self.sin_elevation)
        pairs = zip(self.origin, self._from_sensor(ray), strict=True)
        return tuple(origin[at] + away_m * along[at] for origin, along in pairs)[: self.unknowns]

    def residuals(self, batch: BearingBatch, *point: FloatArray) -> dict[str, FloatArray]:
        """Return measured minus predicted azimuths and elevations (B, K), NaN without one, and those of ranges."""
        angles = replace(self, in_tangent_plane=False).residual(*point)
        rise = np.where(self.has_elevation > 0.0, angles[:, self.rows : 2 * self.rows], np.nan)
        columns = {"residual_rad": angles[:, : self.rows], "residual_elevation_rad": rise}
        if batch.range_m is not None:
            columns["residual_m"] = batch.range_m - self.range_m(*point)
        return columns

    def unseen(self, *point: FloatArray, paths: None = None) -> BoolArray:
        """Return to which rows (B, K) a point cannot be visible in the scene."""
        x, y, z = self.whole(point)
        unseen = np.zeros(self.cos_azimuth.shape, dtype=bool)
        if self.mirrors is not None:
            unseen |= self.mirrors.beyond(x, y, z)
        if self.walls is not None:
            unseen |= self.walls.unseen(self.origin[0], self.origin[1], x, y)
        return unseen

    def outside_scene(self, *point: FloatArray, paths: None = None) -> BoolArray:
        """Return which points (B,) the scene rules out."""
        return np.asarray(self.unseen(*point).any(axis=1))

    def under_horizon(self) -> BoolArray:
        """Return which rows (B, K) have a direction from which no wave can come: these have no such limit."""
        return np.zeros(self.cos_azimuth.shape, dtype=bool)

    def all_under_horizon(self) -> BoolArray:
        """Return in which snapshots (B,) all directions are such."""
        return np.zeros(self.cos_azimuth.shape[0], dtype=bool)

    def whole(self, point: tuple[FloatArray, ...]) -> Vector:
        """Return points about the local origins with their height."""
        if self.is_held and self.height_m is not None:
            return point[0], point[1], self.height_m
        x, y, z = point
        return x, y, z

    def _seen(self, point: Vector, k: int | None = None) -> Vector:
        """Return the vectors (B, K) from the sensors to the points as the sensors see them; (B,) of row ``k``."""
        at: Any = slice(None) if k is None else k
        wide: Any = (slice(None), None) if k is None else slice(None)
        x, y, z = (part[wide] - origin[:, at] for part, origin in zip(point, self.origin, strict=True))
        if self.axes is None:
            return x, y, z
        a, b, c = (row[0][:, at] * x + row[1][:, at] * y + row[2][:, at] * z for row in self.axes)
        return a, b, c

    def _from_sensor(self, vector: Vector, k: int | None = None) -> Vector:
        """Return vectors in the axes of the sensors as vectors in the frame, unfolded."""
        if self.axes is None:
            return vector
        at: Any = slice(None) if k is None else k
        x, y, z = (sum(row[axis][:, at] * part for row, part in zip(self.axes, vector, strict=True)) for axis in range(3))
        return x, y, z

    def _along(self, seen: Vector) -> FloatArray:
        """Return the distances (B, K) along the measured directions of vectors as the sensors see them."""
        level = self.cos_azimuth * seen[0] + self.sin_azimuth * seen[1]
        return np.where(self.has_elevation > 0.0, self.cos_elevation * level + self.sin_elevation * seen[2], level)


def _either(condition: BoolArray, one: Vector, other: Vector) -> Vector:
    x, y, z = (np.where(condition, *pair) for pair in zip(one, other, strict=True))
    return x, y, z
