"""Bearings in space: azimuths, with elevations or without, of direct rows and of rows seen in plane mirrors.

A row seen in a mirror is unfolded as in the plane: its origin is the sensor's image, and ``axes`` turn the vector from
there to the source into what the sensor sees, v = H (x - p) + p - s, equation (3) of docs/three-dimensions.md.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ignoring_overflow
from nlosctl.contract.batches import BearingBatch
from nlosctl.geometry.blocks import side_by_side
from nlosctl.geometry.directions import length, scaled
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.measured_height import TargetHeight
from nlosctl.models.obstacles import WallRows
from nlosctl.models.sight import Crossing, RayResiduals
from nlosctl.models.space.measured_angles import MeasuredAngles, Vector
from nlosctl.models.space.measured_ranges import compare_range
from nlosctl.models.space.plane_mirrors import PlaneMirrors
from nlosctl.models.space.scalar_rows import ScalarRows
from nlosctl.models.space.sensor_axes import SensorAxes

__all__ = ["SpaceLines"]


@dataclass(frozen=True)
class SpaceLines(ScalarRows):
    """Rays (B, K) in space about a local origin (B,), and a measured height of the source; see `Sight`.

    The scalars are K azimuths, K elevations, K ranges if ``measured_m`` (B, K) has any (NaN in rows without one; their
    std is that of the logarithm with ``is_lognormal``) and the ``height`` where it is measured; ``held_m`` (B,) is one
    that is exactly known. ``axes`` are None where all are the frame's. Metres and radians.
    """

    center: Vector
    origin: Vector
    angles: MeasuredAngles
    std: FloatArray
    axes: SensorAxes | None = None
    mirrors: PlaneMirrors | None = None
    walls: WallRows | None = None
    measured_m: FloatArray | None = None
    is_lognormal: bool = False
    height: TargetHeight | None = None
    held_m: FloatArray | None = None

    @property
    def is_held(self) -> bool:
        """Whether the height is exactly known."""
        return self.held_m is not None

    @property
    def unknowns(self) -> int:
        """The number of unknown coordinates: 2 where the height is exactly known."""
        return 2 if self.is_held else 3

    @property
    def rows(self) -> int:
        """The number of rows, K."""
        return self.angles.rows

    @property
    def of_rows(self) -> int:
        """The number of scalars of rows: those before the height."""
        return self.rows * (2 if self.measured_m is None else 3)

    def with_std(self, std: FloatArray) -> Self:
        """Return the same rays with other standard deviations (B, M) of the rows; that of a height stays."""
        return replace(self, std=side_by_side(std[:, : self.of_rows], self.std[:, self.of_rows :]))

    def with_ranges(self, range_m: FloatArray, std_m: FloatArray, *, lognormal: bool) -> SpaceLines:
        """Return the rays with ranges (B, K) as further scalars, NaN in rows without one."""
        known = np.where(np.isnan(range_m), 1.0, std_m / range_m if lognormal else std_m)
        parts = (self.std[:, : self.of_rows], known, self.std[:, self.of_rows :])
        std = side_by_side(*parts)
        return replace(self, std=std, measured_m=range_m, is_lognormal=lognormal)

    def scalars(self) -> IntArray:
        """Return the number (B,) of measured scalars."""
        others = self.rows + (self.std.shape[1] - self.of_rows)
        count: IntArray = np.count_nonzero(self.angles.has_elevation, axis=1) + others
        return count if self.measured_m is None else count + np.count_nonzero(np.isfinite(self.measured_m), axis=1)

    def absolute(self, *point: FloatArray) -> tuple[FloatArray, ...]:
        """Return points in the frame, with the height that is exactly known."""
        return tuple(part + middle for part, middle in zip(self.whole(point), self.center, strict=True))

    def whole_covariance(self, covariance: SymmetricMatrix, *point: FloatArray) -> SymmetricMatrix:
        """Return the covariances of x, y, z; zeros for a height that is exactly known."""
        if not self.is_held:
            return covariance
        return SymmetricMatrix(*covariance, *(np.zeros(covariance.xx.shape) for _ in range(3)))

    def normals(self) -> Vector:
        """Return the unit normals (B, M) of the planes of measured azimuths, elevations and height; 0 of others."""
        return self._normals

    @cached_property
    def _normals(self) -> Vector:
        across, above = (self._from_sensor(tangent) for tangent in self.angles.tangents())
        none = np.zeros((self.std.shape[0], self.std.shape[1] - 2 * self.rows))
        x, y, z = (side_by_side(*pair, none) for pair in zip(across, above, strict=True))
        if self.height is not None:
            for part, up in zip((x, y, z), self.height.plane(*np.zeros((3, self.std.shape[0])))[0], strict=True):
                part[:, self.of_rows] = up
        return x, y, z

    def offsets(self, normals: tuple[FloatArray, ...]) -> FloatArray:
        """Return the offsets (B, M) of the planes along normals, less the part of a height that is exactly known."""
        count = 2 * self.rows
        x, y, z = self.origin
        if self.held_m is not None:
            z = z - self.held_m[:, None]
        a, b, c = normals
        parts = [a[:, of] * x + b[:, of] * y + c[:, of] * z for of in (slice(self.rows), slice(self.rows, count))]
        size = length((a[:, count:], b[:, count:], c[:, count:]))
        if self.height is not None:
            size *= self.height.plane(*np.zeros((3, self.std.shape[0])))[1][:, None]
        return side_by_side(*parts, size)

    def tube_width_m(self, *point: FloatArray) -> FloatArray:
        """Return by how many metres (B, M) each plane moves per unit of its scalar at points; 1 of a height."""
        seen = self._seen(self.whole(point))
        one = np.ones((self.std.shape[0], self.std.shape[1] - 2 * self.rows))
        return side_by_side(*self.angles.widths_m(seen), one)

    stansfield_width_m = tube_width_m

    def paths_from(self, *point: FloatArray) -> Any:
        """Return the scalars of `linearized` at points, for the other functions of the same points."""
        with ignoring_overflow():
            return list(self.linearized(*point))

    def linearized(
        self, *point: FloatArray, extra_m2: FloatArray | None = None, paths: Any = None
    ) -> Iterator[tuple[FloatArray, tuple[FloatArray, ...]]]:
        """Yield residual over std (B,) and derivatives of azimuth and elevation, row by row, of ranges and the height.

        With ``extra_m2`` (B,) the squared distances are that much larger.
        """
        if isinstance(paths, list) and extra_m2 is None:
            yield from paths
            return
        whole = self.whole(point)
        every = [self.row_path(k, whole, paths) for k in range(self.rows)]
        for k, path in enumerate(every):
            compared = self.compared(k, self.seen(k, whole, path), extra_m2, path)
            for index, (residual, slopes) in zip((k, self.rows + k), compared, strict=True):
                inverse = 1.0 / self.std[:, index]
                yield residual * inverse, tuple(slope * inverse for slope in slopes[: self.unknowns])
        for k, path in enumerate([] if self.measured_m is None else every):
            residual, slopes, _ = self.range_terms(k, whole, path)
            yield residual, slopes[: self.unknowns]
        if self.height is not None:
            yield -self.height.scaled_residual(*whole), scaled(self.height.scaled_slopes(*whole), -1.0)

    def row_path(self, k: int, whole: Vector, paths: Any = None) -> Any:
        """Return what `seen` and `compared` of row ``k`` and points (B, ...) share, from `paths_from` if given."""
        return None

    def seen(self, k: int, whole: Vector, path: Any) -> Vector:
        """Return the vectors (B, ...) from the sensor of row ``k`` to points (B, ...) as it sees them."""
        wide = (slice(None), k, *([None] * (whole[0].ndim - 1)))
        x, y, z = (part - origin[wide] for part, origin in zip(whole, self.origin, strict=True))
        return (x, y, z) if self.axes is None else self.axes.seen((x, y, z), wide)

    def compared(
        self, k: int, seen: Vector, extra_m2: FloatArray | None, path: Any
    ) -> Iterator[tuple[FloatArray, Vector]]:
        """Yield residual (B,) and derivatives of azimuth and elevation of row ``k`` at points (B,)."""
        for residual, slopes in self.angles.compare(k, seen, extra_m2):
            yield residual, self._from_sensor(slopes, k)

    def row_bending(self, k: int, seen: Vector, azimuth: FloatArray, rise: FloatArray) -> SymmetricMatrix:
        """Return the sum (B,) of the second derivatives of both residuals of row ``k``, times ``azimuth``, ``rise``."""
        bend = self.angles.bending(k, seen, azimuth, rise)
        return bend if self.axes is None else self.axes.unfolded_matrix(bend, k)

    def bending(self, *at: Any) -> SymmetricMatrix:
        """Return the sum (B,) of residuals times their second derivatives; as `LinearizedRows.bending`."""
        *point, residuals = at
        whole = self.whole(tuple(point))
        total = SymmetricMatrix.full(whole[2].shape, 0.0, 3)
        for k in range(self.rows):
            weighed = (residuals[2 * k] / self.std[:, k], residuals[2 * k + 1] / self.std[:, self.rows + k])
            total += self.row_bending(k, self.seen(k, whole, None), *weighed)
            if self.measured_m is not None:
                residual, _, bend = self.range_terms(k, whole, None)
                total.add_scaled(bend, residual)
        return SymmetricMatrix(*total.parts[: (3 if self.is_held else 6)])

    def range_terms(self, k: int, whole: Vector, path: Any) -> tuple[FloatArray, Vector, SymmetricMatrix]:
        """Return residual over std, derivatives and second derivatives of the range of a row; 0 without one."""
        assert self.measured_m is not None  # noqa: S101 - asked for where there are ranges
        std, measured = self.std[:, 2 * self.rows + k], self.measured_m[:, k]
        return compare_range(self.last_leg(k, whole, path), measured, std, is_lognormal=self.is_lognormal)

    def last_leg(self, k: int, whole: Vector, path: Any) -> Vector:
        """Return vectors (B,) in the direction in which paths of row ``k`` arrive at points, as long as the paths."""
        x, y, z = (part - origin[:, k] for part, origin in zip(whole, self.origin, strict=True))
        return x, y, z

    def ray_residuals(self, *point: FloatArray, paths: Any = None) -> RayResiduals:
        """Return distances and chi-square of points, and where they are nearly above or below a row's sensor."""
        with ignoring_overflow():
            seen = self._seen(self.whole(point))
            range_m = length(seen)
            chi_square = np.zeros(point[0].shape)
            for residual, _ in self.linearized(*point, paths=paths):
                chi_square += residual * residual
            behind = np.asarray((self.angles.along_m(seen) < 0.0).any(axis=1))
            zenith = np.asarray(self.angles.at_zenith(seen, self.std[:, self.rows : 2 * self.rows]).any(axis=1))
        return RayResiduals(range_m.min(axis=1), range_m.max(axis=1), behind, chi_square, zenith)

    def range_m(self, *point: FloatArray) -> FloatArray:
        """Return the unfolded distances (B, K) of points from the origins."""
        return length(self._seen(self.whole(point)))

    def crossing(self, *point: FloatArray) -> Crossing:
        """Return points relative to the lines and planes without their directions."""
        normals, whole = self.normals(), self.whole(point)
        with ignoring_overflow():
            reach = [part[:, None] * normal for part, normal in zip(point, normals, strict=False)]
            missed = np.sum(reach, axis=0) - self.offsets(normals)
            missed = np.abs(missed / (self.std * self.tube_width_m(*point)))
            seen = self._seen(whole)
            range_m = length(seen)
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

    def ends(self, measured_m: FloatArray) -> Vector:
        """Return the ends (B, K) of the rays at ranges; NaN without a range or an elevation."""
        reach_m = np.where(self.angles.has_elevation > 0.0, measured_m, np.nan)
        rays = zip(self.origin, self._from_sensor(self.angles.directions()), strict=True)
        x, y, z = (origin + reach_m * ray for origin, ray in rays)
        return x, y, z

    def first_leg_m(self) -> FloatArray:
        """Return how far (B, K) along unfolded rays the points begin from which rows may come: 0."""
        return np.zeros(self.origin[0].shape)

    def unseen(self, *point: FloatArray, paths: Any = None) -> BoolArray:
        """Return to which rows (B, K) a point cannot be visible in the scene."""
        x, y, z = self.whole(point)
        unseen = np.zeros(self.origin[0].shape, dtype=bool)
        if self.mirrors is not None:
            unseen |= self.mirrors.beyond(x, y, z)
        if self.walls is not None:
            unseen |= self.walls.unseen(self.origin[0], self.origin[1], x, y)
        return unseen

    def outside_scene(self, *point: FloatArray, paths: Any = None) -> BoolArray:
        """Return which points (B,) the scene rules out."""
        return np.asarray(self.unseen(*point, paths=paths).any(axis=1))

    def whole(self, point: tuple[FloatArray, ...]) -> Vector:
        """Return points about the local origins with their height."""
        if self.held_m is not None:
            return (
                point[0],
                point[1],
                np.broadcast_to(self.held_m.reshape(-1, *[1] * (point[0].ndim - 1)), point[0].shape),
            )
        x, y, z = point
        return x, y, z

    def _seen(self, point: Vector) -> Vector:
        """Return the vectors (B, K) from the sensors to the points as the sensors see them."""
        x, y, z = (part[:, None] - origin for part, origin in zip(point, self.origin, strict=True))
        return (x, y, z) if self.axes is None else self.axes.seen((x, y, z), slice(None))

    def _from_sensor(self, vector: Vector, k: int | None = None) -> Vector:
        """Return vectors in the axes of the sensors as unfolded vectors in the frame."""
        return (
            vector if self.axes is None else self.axes.unfolded(vector, (slice(None), slice(None) if k is None else k))
        )
