"""Bearings in space: azimuths, with elevations or without, of direct rows and of rows seen in plane mirrors.

A row seen in a mirror is unfolded as in the plane: its origin is the sensor's image, and ``axes`` turn the vector from
there to the source into what the sensor sees, v = H (x - p) + p - s with H = 1 - 2 n n'. The mathematics is in
docs/three-dimensions.md.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ignoring_overflow
from nlosctl.contract.batches import BearingBatch
from nlosctl.geometry.blocks import RowBlock
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.measured_angles import MeasuredAngles, Vector
from nlosctl.models.obstacles import WallRows
from nlosctl.models.plane_mirrors import PlaneMirrors
from nlosctl.models.sight import Crossing, RayResiduals

__all__ = ["SpaceLines"]


@dataclass(frozen=True)
class SpaceLines(RowBlock):
    """Rays (B, K) in space about a local origin (B,), and a measured height of the source; see `Sight`.

    The scalars are K azimuths, K elevations and, unless it is exactly known (``is_held``), the height ``height_m``
    (B,). ``axes`` are the rows of a matrix for each measurement that turns the vector from its origin into the axes of
    its sensor; None: all have those of the frame. Lengths in metres, standard deviations in radians.
    """

    center: Vector
    origin: Vector
    angles: MeasuredAngles
    std: FloatArray
    axes: tuple[Vector, Vector, Vector] | None = None
    mirrors: PlaneMirrors | None = None
    walls: WallRows | None = None
    height_m: FloatArray | None = None
    is_held: bool = False

    @property
    def unknowns(self) -> int:
        """The number of unknown coordinates: 2 where the height is exactly known."""
        return 2 if self.is_held else 3

    @property
    def rows(self) -> int:
        """The number of rows, K."""
        return self.angles.rows

    def with_std(self, std: FloatArray) -> SpaceLines:
        """Return the same rays with other standard deviations (B, M) of the angles; that of a height stays."""
        return replace(self, std=np.concatenate([std[:, : 2 * self.rows].T, self.std[:, 2 * self.rows :].T]).T)

    def scalars(self) -> IntArray:
        """Return the number (B,) of measured scalars."""
        elevations = np.count_nonzero(self.angles.has_elevation, axis=1)
        return np.asarray(elevations + (self.std.shape[1] - self.rows))

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
        across, above = (self._from_sensor(tangent) for tangent in self.angles.tangents())
        level = np.zeros((self.std.shape[0], self.std.shape[1] - 2 * self.rows))
        x, y, z = (np.concatenate([*pair, level], axis=1) for pair in zip(across, above, strict=True))
        z[:, 2 * self.rows :] = 1.0
        return x, y, z

    def offsets(self, normals: tuple[FloatArray, ...]) -> FloatArray:
        """Return the offsets (B, M) of the planes along normals, less the part of a height that is exactly known."""
        count = 2 * self.rows
        x, y, z = self.origin
        if self.is_held and self.height_m is not None:
            z = z - self.height_m[:, None]
        twice = (np.concatenate([part, part], axis=1) for part in (x, y, z))
        parts = [normal[:, :count] * part for normal, part in zip(normals, twice, strict=True)]
        offset: FloatArray = parts[0] + parts[1] + parts[2]
        if self.height_m is None or self.is_held:
            return offset
        return np.concatenate([offset, normals[2][:, count:] * self.height_m[:, None]], axis=1)

    def tube_width_m(self, *point: FloatArray) -> FloatArray:
        """Return by how many metres (B, M) each plane moves per unit of its scalar at points; 1 of a height."""
        seen = self._seen(self.whole(point))
        one = np.ones((self.std.shape[0], self.std.shape[1] - 2 * self.rows))
        return np.concatenate([*self.angles.widths_m(seen), one], axis=1)

    stansfield_width_m = tube_width_m

    def paths_from(self, *point: FloatArray) -> None:
        """Return nothing: these paths are straight."""

    def inside_circles(self, *point: FloatArray) -> tuple[FloatArray, ...]:
        """Return the points: no row is seen by a circle."""
        return point

    def linearized(
        self, *point: FloatArray, extra_m2: FloatArray | None = None
    ) -> Iterator[tuple[FloatArray, tuple[FloatArray, ...]]]:
        """Yield residual over std (B,) and derivatives of azimuth and elevation, row by row, then of the height.

        With ``extra_m2`` (B,) the squared distances are that much larger.
        """
        whole = self.whole(point)
        for k in range(self.rows):
            compared = self.angles.compare(k, self._seen(whole, k), extra_m2)
            for index, (residual, slopes) in zip((k, self.rows + k), compared, strict=True):
                inverse = 1.0 / self.std[:, index]
                slopes = self._from_sensor(slopes, k)
                yield residual * inverse, tuple(slope * inverse for slope in slopes[: self.unknowns])
        if self.height_m is not None and not self.is_held:
            inverse = 1.0 / self.std[:, -1]
            zero = np.zeros(inverse.shape)
            yield (self.height_m - whole[2]) * inverse, (zero, zero, -inverse)

    def residual(self, *point: FloatArray, paths: None = None) -> FloatArray:
        """Return measured minus predicted scalars (B, M); 0 in rows without an elevation."""
        return self._gathered([residual for residual, _ in self.linearized(*point)]) * self.std

    def slopes(
        self, *point: FloatArray, paths: None = None, extra_m2: FloatArray | None = None
    ) -> tuple[FloatArray, ...]:
        """Return the derivatives (B, M) of the residuals over their stds; with ``extra_m2`` as in `linearized`."""
        every = [slopes for _, slopes in self.linearized(*point, extra_m2=extra_m2)]
        return tuple(self._gathered(parts) for parts in zip(*every, strict=True))

    def _gathered(self, parts: Sequence[FloatArray]) -> FloatArray:
        """Return the scalars (B,) in the order of `linearized` as a block (B, M) in the order of `std`."""
        count = 2 * self.rows
        return np.stack([*parts[:count:2], *parts[1:count:2], *parts[count:]]).T

    def information(
        self, *point: FloatArray, paths: None = None, extra_m2: FloatArray | None = None
    ) -> SymmetricMatrix:
        """Return the Fisher information (B,) of points; ``extra_m2`` as in `linearized`."""
        total = SymmetricMatrix.full(point[0].shape, 0.0, len(point))
        with ignoring_overflow():
            for _, slopes in self.linearized(*point, extra_m2=extra_m2):
                total += SymmetricMatrix.outer(*slopes)
        return total

    def ray_residuals(self, *point: FloatArray, paths: None = None) -> RayResiduals:
        """Return distances and chi-square of points, and where they are nearly above or below a row's sensor."""
        with ignoring_overflow():
            seen = self._seen(self.whole(point))
            range_m = _length(seen)
            chi_square = np.zeros(point[0].shape)
            for residual, _ in self.linearized(*point):
                chi_square += residual * residual
            behind = np.asarray((self.angles.along_m(seen) < 0.0).any(axis=1))
            zenith = np.asarray(self.angles.at_zenith(seen, self.std[:, self.rows : 2 * self.rows]).any(axis=1))
        return RayResiduals(range_m.min(axis=1), range_m.max(axis=1), behind, chi_square, zenith)

    def range_m(self, *point: FloatArray) -> FloatArray:
        """Return the unfolded distances (B, K) of points from the origins."""
        return _length(self._seen(self.whole(point)))

    def crossing(self, *point: FloatArray) -> Crossing:
        """Return points relative to the lines and planes without their directions."""
        normals, whole = self.normals(), self.whole(point)
        with ignoring_overflow():
            reach = [part[:, None] * normal for part, normal in zip(point, normals, strict=False)]
            missed = np.sum(reach, axis=0) - self.offsets(normals)
            missed = np.abs(missed / (self.std * self.tube_width_m(*point)))
            seen = self._seen(whole)
            range_m = _length(seen)
        return Crossing(missed, range_m.min(axis=1), range_m.max(axis=1), self.angles.along_m(seen).min(axis=1))

    def beside_nearest_origin(self, *point: FloatArray, share: float) -> tuple[FloatArray, ...]:
        """Return the points ``share`` of the farthest distance along the ray whose origin is nearest to points."""
        range_m = self.range_m(*point)
        at = np.arange(range_m.shape[0]), np.argmin(range_m, axis=1)
        away_m = share * range_m.max(axis=1)
        rays = self._from_sensor(self.angles.directions())
        beside = (origin[at] + away_m * ray[at] for origin, ray in zip(self.origin, rays, strict=True))
        return tuple(beside)[: self.unknowns]

    def residuals(self, batch: BearingBatch, *point: FloatArray) -> dict[str, FloatArray]:
        """Return measured minus predicted azimuths and elevations (B, K), NaN without one, and those of ranges."""
        plain = replace(self, angles=replace(self.angles, in_tangent_plane=False)).residual(*point)
        rise = np.where(self.angles.has_elevation > 0.0, plain[:, self.rows : 2 * self.rows], np.nan)
        columns = {"residual_rad": plain[:, : self.rows], "residual_elevation_rad": rise}
        if batch.range_m is not None:
            columns["residual_m"] = batch.range_m - self.range_m(*point)
        return columns

    def unseen(self, *point: FloatArray, paths: None = None) -> BoolArray:
        """Return to which rows (B, K) a point cannot be visible in the scene."""
        x, y, z = self.whole(point)
        unseen = np.zeros(self.origin[0].shape, dtype=bool)
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
        return np.zeros(self.origin[0].shape, dtype=bool)

    def all_under_horizon(self) -> BoolArray:
        """Return in which snapshots (B,) all directions are such."""
        return np.zeros(self.origin[0].shape[0], dtype=bool)

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
        """Return vectors in the axes of the sensors as unfolded vectors in the frame."""
        if self.axes is None:
            return vector
        at: Any = slice(None) if k is None else k
        one, two, three = self.axes
        x, y, z = (
            one[axis][:, at] * vector[0] + two[axis][:, at] * vector[1] + three[axis][:, at] * vector[2]
            for axis in range(3)
        )
        return x, y, z


def _length(vector: Vector) -> FloatArray:
    x, y, z = vector
    return np.sqrt(x * x + y * y + z * z)
