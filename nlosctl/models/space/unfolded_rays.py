"""Rays in space, unfolded at plane mirrors, with the planes of their azimuths and elevations for linear fits.

A row seen in a mirror is unfolded as in the plane: its origin is the sensor's image, and ``axes`` turn the vector from
there to the source into what the sensor sees, v = H (x - p) + p - s, equation (3) of docs/three-dimensions.md.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ignoring_overflow
from nlosctl.geometry.blocks import column_blocks, side_by_side
from nlosctl.geometry.directions import dot
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.measured_height import TargetHeight
from nlosctl.models.obstacles import WallRows
from nlosctl.models.sight import Crossing
from nlosctl.models.space.measured_angles import MeasuredAngles, Seen, Vector
from nlosctl.models.space.open_sky import OpenSky
from nlosctl.models.space.plane_mirrors import PlaneMirrors
from nlosctl.models.space.sensor_axes import SensorAxes

__all__ = ["UnfoldedRays"]


@dataclass(frozen=True)
class UnfoldedRays(OpenSky):
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

    def normals(self, at: slice) -> Vector:
        """Return the unit normals (B, C) of the planes of measured azimuths, elevations and height; 0 of others."""
        x, y, z = (part[:, at] for part in self._planes[:3])
        return x, y, z

    def planes(self, at: slice, weight: FloatArray | None) -> tuple[Vector, FloatArray]:
        """Return the normals and the offsets (B, C) of planes along them, both times a weight.

        Offsets are less the part of a height that is exactly known.
        """
        x, y, z, offset = (part[:, at] if weight is None else weight * part[:, at] for part in self._planes)
        return (x, y, z), offset

    @cached_property
    def _planes(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """The unit normals (B, M) and the offsets along them."""
        x, y, z = np.zeros((3, *self.std.T.shape)).transpose(0, 2, 1)
        offset = np.zeros_like(x)
        for kind, normals in enumerate(self._normals_of_rows()):
            for block, part in zip((x, y, z), normals, strict=True):
                block[:, self._scalars(kind)] = part
            offset[:, self._scalars(kind)] = dot(normals, self._origin_over_held())
        if self.height is not None:
            up, offset[:, -1] = self.height.plane(*np.zeros((3, self.std.shape[0])))
            for block, part in zip((x, y, z), up, strict=True):
                block[:, -1] = part
        return x, y, z, offset

    def _normals_of_rows(self) -> tuple[tuple[FloatArray, ...], tuple[FloatArray, ...]]:
        """Return the unit normals (B, K) of the planes of azimuths and of elevations, 0 of others."""
        across, above = (self._from_sensor(tangent) for tangent in self.angles.tangents())
        return across, above

    def _origin_over_held(self) -> Vector:
        """Return the origins, over a height that is exactly known."""
        x, y, z = self.origin
        return (x, y, z) if self.held_m is None else (x, y, z - self.held_m[:, None])

    def _scalars(self, kind: int, at: slice = slice(None)) -> slice:
        """Return where the azimuths (0), elevations (1) or ranges (2) of the rows ``at`` are among the M scalars."""
        first, stop, _ = at.indices(self.rows)
        return slice(kind * self.rows + first, kind * self.rows + stop)

    def tube_width_m(self, *point: FloatArray) -> FloatArray:
        """Return by how many metres (B, M) each plane moves per unit of its scalar at points; 1 of a height."""
        widths, whole = np.ones(self.std.shape, order="F"), self.whole(point)
        for at in column_blocks(self.origin[0].shape):
            for kind, width in enumerate(self.angles.widths_m(at, self.seen(at, whole))):
                widths[:, self._scalars(kind, at)] = width
        return widths

    stansfield_width_m = tube_width_m

    def seen(self, at: slice, whole: Vector, path: Any = None) -> Seen:
        """Return the vectors from the sensors ``at`` (C of the K) to points with their height, as the sensors see them.

        Points are (B,), or (B, P) for one sensor.
        """
        return self._as_seen(self._from_origins(at, whole), at)

    def _from_origins(self, at: slice, whole: Vector) -> Vector:
        """Return the unfolded vectors from the sensors to the points."""
        x, y, z = (
            (part if part.ndim > 1 else part[:, None]) - origin[:, at]
            for part, origin in zip(whole, self.origin, strict=True)
        )
        return x, y, z

    def _as_seen(self, vector: Vector, at: slice) -> Seen:
        return Seen.of(*(vector if self.axes is None else self.axes.seen(vector, at)))

    def range_m(self, *point: FloatArray) -> FloatArray:
        """Return the unfolded distances (B, K) of points from the origins."""
        return np.sqrt(self.seen(slice(None), self.whole(point)).squared)

    def crossing(self, *point: FloatArray) -> Crossing:
        """Return points relative to the lines and planes without their directions."""
        every = slice(None)
        normals, offset = self.planes(every, None)
        with ignoring_overflow():
            reach = [part[:, None] * normal for part, normal in zip(point, normals, strict=False)]
            missed = np.abs((np.sum(reach, axis=0) - offset) / (self.std * self.tube_width_m(*point)))
            seen = self.seen(every, self.whole(point))
            range_m = np.sqrt(seen.squared)
        return Crossing(missed, range_m.min(axis=1), range_m.max(axis=1), self.angles.along_m(every, seen).min(axis=1))

    def beside_nearest_origin(self, *point: FloatArray, share: float) -> tuple[FloatArray, ...]:
        """Return the points ``share`` of the farthest distance along the ray whose origin is nearest to points."""
        range_m = self.range_m(*point)
        at = np.arange(range_m.shape[0]), np.argmin(range_m, axis=1)
        away_m = share * range_m.max(axis=1)
        rays = self._from_sensor(self.angles.directions())
        beside = (origin[at] + away_m * ray[at] for origin, ray in zip(self.origin, rays, strict=True))
        return tuple(beside)[: self.unknowns]

    def ends(self, measured_m: FloatArray) -> Vector:
        """Return the ends (B, K) of the rays at ranges; NaN without a range or an elevation."""
        reach_m = np.where(self.angles.has_elevation > 0.0, measured_m, np.nan)
        x, y, z = (origin + reach_m * ray for origin, ray in zip(self.origin, self.directions(), strict=True))
        return x, y, z

    def directions(self) -> tuple[FloatArray, ...]:
        """Return the unit vectors (B, K) of the unfolded rays, level in a row without an elevation."""
        return self._from_sensor(self.angles.directions())

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
            held = self.held_m.reshape(-1, *[1] * (point[0].ndim - 1))
            return point[0], point[1], np.broadcast_to(held, point[0].shape)
        x, y, z = point
        return x, y, z

    def _from_sensor(self, vector: tuple[FloatArray, ...], at: slice = slice(None)) -> tuple[FloatArray, ...]:
        """Return vectors in the axes of the sensors ``at`` as unfolded vectors in the frame."""
        return vector if self.axes is None else self.axes.unfolded(vector, at)
