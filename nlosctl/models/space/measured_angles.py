"""Measured azimuths and elevations (B, K), compared with vectors that sensors see in their own axes.

With f = |(v_x, v_y)| and r = |v|, azimuth and elevation of v have the gradients a / f and t / r, where a and t are the
tangents of its direction.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray
from nlosctl.geometry.angles import cosine_sine
from nlosctl.geometry.blocks import RowBlock
from nlosctl.geometry.symmetric import SymmetricMatrix

__all__ = ["MeasuredAngles", "Vector"]

Vector = tuple[FloatArray, FloatArray, FloatArray]
"""Three coordinates as arrays of one shape."""

_ZENITH_STDS = 3.0
"""Nearer to the zenith than this many stds of the elevation the azimuth is no Gaussian angle."""


@dataclass(frozen=True)
class MeasuredAngles(RowBlock):
    """Cosines and sines (B, K) of azimuths and elevations; ``has_elevation`` is 0 in rows without one, else 1.

    With ``in_tangent_plane`` rows with an elevation have residuals in the tangent plane of the measured direction, also
    right at the zenith.
    """

    cos_azimuth: FloatArray
    sin_azimuth: FloatArray
    cos_elevation: FloatArray
    sin_elevation: FloatArray
    has_elevation: FloatArray
    in_tangent_plane: bool

    @classmethod
    def of(cls, azimuth_rad: FloatArray, elevation_rad: FloatArray, *, in_tangent_plane: bool) -> MeasuredAngles:
        """Return the angles (B, K), with NaN for missing elevations."""
        known = np.isfinite(elevation_rad)
        azimuth, elevation = cosine_sine(azimuth_rad), cosine_sine(np.where(known, elevation_rad, 0.0))
        return cls(*azimuth, *elevation, known.astype(np.float64), in_tangent_plane)

    @property
    def rows(self) -> int:
        """The number of rows, K."""
        return int(self.cos_azimuth.shape[1])

    def tangents(self) -> tuple[Vector, Vector]:
        """Return the unit tangents (B, K) of the directions, along the azimuth and the elevation; 0 without one."""
        a = (-self.sin_azimuth, self.cos_azimuth, np.zeros(self.cos_azimuth.shape, order="F"))
        t = (-self.sin_elevation * self.cos_azimuth, -self.sin_elevation * self.sin_azimuth, self.cos_elevation)
        return a, (t[0] * self.has_elevation, t[1] * self.has_elevation, t[2] * self.has_elevation)

    def directions(self) -> Vector:
        """Return the unit directions (B, K); level without an elevation."""
        return self.cos_elevation * self.cos_azimuth, self.cos_elevation * self.sin_azimuth, self.sin_elevation

    def along_m(self, seen: Vector) -> FloatArray:
        """Return how far vectors (B, K) reach along the directions; without an elevation in the level."""
        level = self.cos_azimuth * seen[0] + self.sin_azimuth * seen[1]
        return np.where(self.has_elevation > 0.0, self.cos_elevation * level + self.sin_elevation * seen[2], level)

    def widths_m(self, seen: Vector) -> tuple[FloatArray, FloatArray]:
        """Return by how many metres (B, K) a radian of azimuth and of elevation moves the ends of vectors.

        In the tangent plane both by the distance, else the azimuth by its level part.
        """
        squared = seen[0] * seen[0] + seen[1] * seen[1]
        level, distance = np.sqrt(squared), np.sqrt(squared + seen[2] * seen[2])
        if self.in_tangent_plane:
            level = np.where(self.has_elevation > 0.0, distance, level)
        return level, distance

    def at_zenith(self, seen: Vector, elevation_std_rad: FloatArray) -> BoolArray:
        """Return in which rows (B, K) vector or measured direction are too near to the zenith for an azimuth."""
        if self.in_tangent_plane:
            return np.zeros(self.cos_azimuth.shape, dtype=bool)
        level, distance = self.widths_m(seen)
        least = np.sin(np.minimum(_ZENITH_STDS * elevation_std_rad, 0.5 * np.pi))
        steep = np.minimum(level, self.cos_elevation * distance) < least * distance
        return np.asarray((self.has_elevation > 0.0) & steep)

    def compare(self, k: int, seen: Vector, extra_m2: FloatArray | None = None) -> Iterator[tuple[FloatArray, Vector]]:
        """Yield measured minus predicted (B,) and its derivatives by the vector, of azimuth and elevation of row ``k``.

        With ``extra_m2`` (B,) squared distances in the derivatives are that much larger.
        """
        if self.in_tangent_plane:
            yield from self._compare_in_tangent_plane(k, seen, extra_m2)
            return
        vx, vy, vz = seen
        squared = vx * vx + vy * vy
        whole = squared + vz * vz
        yield self._azimuth(k, seen, extra_m2)
        cosine, sine, has = self.cos_elevation[:, k], self.sin_elevation[:, k], self.has_elevation[:, k]
        level = np.sqrt(squared)
        weight = -has / (whole if extra_m2 is None else np.sqrt(whole * (whole + extra_m2)))
        slant = -vz / level * weight
        rise = np.arctan2(sine * level - cosine * vz, cosine * level + sine * vz) * has
        yield rise, (vx * slant, vy * slant, level * weight)

    def _azimuth(self, k: int, seen: Vector, extra_m2: FloatArray | None) -> tuple[FloatArray, Vector]:
        vx, vy, _ = seen
        cosine, sine = self.cos_azimuth[:, k], self.sin_azimuth[:, k]
        squared = vx * vx + vy * vy
        weight = 1.0 / (squared if extra_m2 is None else np.sqrt(squared * (squared + extra_m2)))
        residual = np.arctan2(sine * vx - cosine * vy, cosine * vx + sine * vy)
        return residual, (vy * weight, -vx * weight, np.zeros(vx.shape))

    def _compare_in_tangent_plane(
        self, k: int, seen: Vector, extra_m2: FloatArray | None
    ) -> Iterator[tuple[FloatArray, Vector]]:
        """Yield minus the parts of the predicted direction along the tangents of the measured one."""
        vx, vy, vz = seen
        whole = vx * vx + vy * vy + vz * vz
        inverse = 1.0 / np.sqrt(whole)
        unit = vx * inverse, vy * inverse, vz * inverse
        scale = inverse if extra_m2 is None else 1.0 / np.sqrt(whole + extra_m2)
        has = self.has_elevation[:, k]
        for tangent, level in zip(self.tangents(), (self._azimuth(k, seen, extra_m2), None), strict=True):
            mine = tuple(part[:, k] for part in tangent)
            along = mine[0] * unit[0] + mine[1] * unit[1] + mine[2] * unit[2]
            slopes = [(along * part - other) * scale for part, other in zip(unit, mine, strict=True)]
            if level is None:
                yield -along, (slopes[0] * has, slopes[1] * has, slopes[2] * has)
                continue
            x, y, z = (np.where(has > 0.0, *pair) for pair in zip(slopes, level[1], strict=True))
            yield np.where(has > 0.0, -along, level[0]), (x, y, z)

    def bending(self, k: int, seen: Vector, azimuth: FloatArray, rise: FloatArray) -> SymmetricMatrix:
        """Return the sum of the second derivatives of both residuals of row ``k``, times ``azimuth``, ``rise`` (B,)."""
        rise = rise * self.has_elevation[:, k]
        vx, vy, vz = seen
        squared = vx * vx + vy * vy
        whole = squared + vz * vz
        twist = azimuth / (squared * squared)
        if self.in_tangent_plane:
            flat = self.has_elevation[:, k] > 0.0
            twist = np.where(flat, 0.0, twist)
            total = self._bending_in_tangent_plane(k, seen, whole, np.where(flat, azimuth, 0.0), rise)
        else:
            level = np.sqrt(squared)
            lx, ly = vx / level, vy / level
            bend = -rise / (whole * whole)
            ff, fz, aa = 2.0 * level * vz * bend, (vz - level) * (vz + level) * bend, -vz / level * whole * bend
            total = SymmetricMatrix(
                ff * lx * lx + aa * ly * ly, (ff - aa) * lx * ly, ff * ly * ly + aa * lx * lx, fz * lx, fz * ly, -ff
            )
        cross = 2.0 * vx * vy * twist
        turn = (vx * vx - vy * vy) * twist
        return SymmetricMatrix(total.xx - cross, total.xy + turn, total.yy + cross, *total.parts[3:])

    def _bending_in_tangent_plane(
        self, k: int, seen: Vector, squared_m2: FloatArray, *residuals: FloatArray
    ) -> SymmetricMatrix:
        """Return minus the second derivatives of the direction's parts along the tangents, times residuals (B,)."""
        inverse = 1.0 / np.sqrt(squared_m2)
        unit = tuple(part * inverse for part in seen)
        total = SymmetricMatrix.full(inverse.shape, 0.0, 3)
        for tangent, residual in zip(self.tangents(), residuals, strict=True):
            mine = tuple(part[:, k] for part in tangent)
            along = mine[0] * unit[0] + mine[1] * unit[1] + mine[2] * unit[2]
            bend = SymmetricMatrix.symmetrized(mine, unit) + SymmetricMatrix.outer(*unit, weight=-3.0 * along)
            total.add_scaled(bend.add_to_diagonal(along), residual * inverse * inverse)
        return total
