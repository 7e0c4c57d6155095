"""A measured height of the target: one more scalar beside the rows of a snapshot in space.

Its residual is (h - H) / S, with the height h of a point above a plane z = constant or above a sphere.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, Point, ignoring_overflow
from nlosctl.geometry.blocks import RowBlock
from nlosctl.geometry.directions import Vector, dot, length, scaled

__all__ = ["GroundHeight", "MeasuredHeight", "TargetHeight"]


@dataclass(frozen=True)
class MeasuredHeight(RowBlock):
    """Heights (B,) z about the local origin in metres and their inverse standard deviations; both 0 where unmeasured.

    Points are D arrays (B,) or (B, P), the last of them z.
    """

    z_m: FloatArray
    inverse_std: FloatArray

    @classmethod
    def of(cls, z_m: FloatArray, std_m: FloatArray, center_z: FloatArray) -> Self:
        """Return the heights (B,) that are measured with a standard deviation; NaN in either stands for none."""
        known = np.isfinite(z_m) & np.isfinite(std_m)
        return cls(np.where(known, z_m - center_z, 0.0), np.where(known, 1.0 / np.where(known, std_m, 1.0), 0.0))

    @property
    def known(self) -> BoolArray:
        """Which snapshots (B,) have a measured height."""
        return self.inverse_std > 0.0

    def scaled_residual(self, *point: FloatArray) -> FloatArray:
        """Return the height of points minus the measured one, over its standard deviation."""
        return (point[-1] - _beside(self.z_m, point[-1])) * _beside(self.inverse_std, point[-1])

    def scaled_slopes(self, *point: FloatArray) -> Vector:
        """Return the derivatives (B,) of that."""
        zero = np.zeros(self.inverse_std.shape)
        return zero, zero, self.inverse_std

    def plane(self, *point: FloatArray) -> tuple[Vector, FloatArray]:
        """Return the unit normal of the plane of that height, and its offset along it, for any points."""
        zero = np.zeros(point[0].shape)
        return (zero, zero, zero + 1.0), zero + _beside(self.z_m, zero)

    def reach_m(self, origin: Vector, ray: Vector, least_m: FloatArray) -> FloatArray:
        """Return the distance (B, K), above ``least_m``, from origins along unit rays to that height; NaN if none."""
        with ignoring_overflow():
            reach = (self.z_m[:, None] - origin[2]) / ray[2]
        return np.where(np.isfinite(reach) & (reach > least_m), reach, np.nan)


@dataclass(frozen=True)
class GroundHeight(RowBlock):
    """Distances (B,) in metres from the ``center`` (B,) of a sphere, about the local origin; all are measured."""

    center: Vector
    distance_m: FloatArray
    inverse_std: FloatArray

    @property
    def known(self) -> BoolArray:
        """Which snapshots (B,) have a measured height: all."""
        return self.inverse_std > 0.0

    def scaled_residual(self, *point: FloatArray) -> FloatArray:
        """Return the height of points minus the measured one, over its standard deviation."""
        return self._above(point)[0] * _beside(self.inverse_std, point[0])

    def scaled_slopes(self, *point: FloatArray) -> Vector:
        """Return the derivatives (B,) of that."""
        return scaled(self._above(point)[1], self.inverse_std)

    def plane(self, *point: FloatArray) -> tuple[Vector, FloatArray]:
        """Return the unit normal of the plane that touches the surface of that height under points, and its offset."""
        above, up = self._above(point)
        return up, dot(up, point) - above

    def reach_m(self, origin: Vector, ray: Vector, least_m: FloatArray) -> FloatArray:
        """Return the least distance (B, K), above ``least_m``, from origins along rays to that height; NaN if none."""
        about = tuple(part - middle[:, None] for part, middle in zip(origin, self.center, strict=True))
        along, square = dot(about, ray), dot(about, about) - (self.distance_m * self.distance_m)[:, None]
        with ignoring_overflow():
            root = np.sqrt(along * along - square)
            near, far = -along - root, -along + root
            return np.where(near > least_m, near, np.where(far > least_m, far, np.nan))

    def _above(self, point: Point) -> tuple[FloatArray, Vector]:
        """Return the height of points less the measured one, and the unit vectors along which it grows."""
        about = tuple(part - _beside(middle, part) for part, middle in zip(point, self.center, strict=True))
        distance = length(about)
        return distance - _beside(self.distance_m, distance), scaled(about, 1.0 / distance)


TargetHeight = MeasuredHeight | GroundHeight


def _beside(values: FloatArray, points: FloatArray) -> FloatArray:
    """Return values (B,) so that they broadcast against points (B,) or (B, P)."""
    return values if points.ndim == 1 else values[:, None]
