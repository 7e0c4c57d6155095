"""A measured height of the source above a sphere: one scalar of a snapshot."""

from __future__ import annotations

from dataclasses import dataclass

from nlosctl.arrays import FloatArray
from nlosctl.geometry.blocks import RowBlock
from nlosctl.geometry.directions import length
from nlosctl.models.space.measured_angles import Vector

__all__ = ["SphereHeight"]


@dataclass(frozen=True)
class SphereHeight(RowBlock):
    """Measured distances (B,) in metres from the ``center`` (B,) of a sphere, about the local origin."""

    center: Vector
    distance_m: FloatArray

    def compare(self, point: Vector) -> tuple[FloatArray, Vector]:
        """Return measured minus predicted distance (B,) of points, and its derivatives."""
        x, y, z = (part - middle for part, middle in zip(point, self.center, strict=True))
        distance = length((x, y, z))
        return self.distance_m - distance, (-x / distance, -y / distance, -z / distance)

    def up(self) -> Vector:
        """Return the unit direction (B,) from the centre to the local origin."""
        distance = length(self.center)
        x, y, z = (-part / distance for part in self.center)
        return x, y, z

    def offset_m(self) -> FloatArray:
        """Return the offset (B,) along `up` of the tangent plane that is used where a fit needs one."""
        return self.distance_m - length(self.center)
