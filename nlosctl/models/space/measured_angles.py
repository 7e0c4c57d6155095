"""Measured azimuths and elevations (B, K), compared with vectors that sensors see in their own axes.

With f = |(v_x, v_y)| and r = |v|, azimuth and elevation of v have the gradients a / f and t / r, where a and t are the
tangents of its direction.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray
from nlosctl.geometry.angles import cosine_sine
from nlosctl.geometry.blocks import RowBlock
from nlosctl.geometry.directions import dot
from nlosctl.geometry.symmetric import SymmetricMatrix

__all__ = ["MeasuredAngles", "Seen", "Vector"]

Vector = tuple[FloatArray, FloatArray, FloatArray]
"""Three coordinates as arrays of one shape."""

_ZENITH_STDS = 3.0
"""Nearer to the zenith than this many stds of the elevation the azimuth is no Gaussian angle."""


class Seen(NamedTuple):
    """Vectors (B, C) that sensors see in their own axes, with lengths of their level parts and of themselves."""

    x: FloatArray
    y: FloatArray
    z: FloatArray
    level_squared: FloatArray
    level: FloatArray
    squared: FloatArray

    @classmethod
    def of(cls, x: FloatArray, y: FloatArray, z: FloatArray) -> Seen:
        """Return vectors with their lengths."""
        level_squared = x * x
        level_squared += y * y
        squared = z * z
        squared += level_squared
        return cls(x, y, z, level_squared, np.sqrt(level_squared), squared)

    @property
    def vector(self) -> Vector:
        """The vectors."""
        return self.x, self.y, self.z


@dataclass(frozen=True)
class MeasuredAngles(RowBlock):
    """Cosines and sines (B, K) of azimuths and elevations; ``has_elevation`` is 0 in rows without one, else 1.

    With ``in_tangent_plane`` rows with an elevation have residuals in the tangent plane of the measured direction, also
    right at the zenith. The functions of what sensors see are of the rows ``at`` (C of the K).
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

    def tangents(self, at: slice = slice(None)) -> tuple[Vector, Vector]:
        """Return the unit tangents (B, C) of the directions, along the azimuth and the elevation; 0 without one."""
        cosine, sine, lift = self.cos_azimuth[:, at], self.sin_azimuth[:, at], self.sin_elevation[:, at]
        has = self.has_elevation[:, at]
        a = (-sine, cosine, np.zeros(cosine.shape, order="F"))
        lift = lift * has
        return a, (-lift * cosine, -lift * sine, self.cos_elevation[:, at] * has)

    def directions(self, at: slice = slice(None)) -> Vector:
        """Return the unit directions (B, C); level without an elevation."""
        level = self.cos_elevation[:, at]
        return level * self.cos_azimuth[:, at], level * self.sin_azimuth[:, at], self.sin_elevation[:, at]

    def along_m(self, at: slice, seen: Seen) -> FloatArray:
        """Return how far vectors (B, C) reach along the directions; without an elevation in the level."""
        level = self.cos_azimuth[:, at] * seen.x + self.sin_azimuth[:, at] * seen.y
        along = self.cos_elevation[:, at] * level + self.sin_elevation[:, at] * seen.z
        return np.where(self.has_elevation[:, at] > 0.0, along, level)

    def widths_m(self, at: slice, seen: Seen) -> tuple[FloatArray, FloatArray]:
        """Return by how many metres (B, C) a radian of azimuth and of elevation moves the ends of vectors.

        In the tangent plane both by the distance, else the azimuth by its level part.
        """
        distance = np.sqrt(seen.squared)
        if self.in_tangent_plane:
            return np.where(self.has_elevation[:, at] > 0.0, distance, seen.level), distance
        return seen.level, distance

    def turned(self) -> FloatArray:
        """Return by how much residuals of azimuths (B, K) grow when the measured ones are turned about the vertical.

        In the tangent plane that is less the higher the direction; the plane turns with it, which changes no square.
        """
        if not self.in_tangent_plane:
            return np.ones(self.cos_azimuth.shape, order="F")
        return np.where(self.has_elevation > 0.0, self.cos_elevation, 1.0)

    def at_zenith(self, at: slice, seen: Seen, elevation_std_rad: FloatArray) -> BoolArray:
        """Return in which rows (B, C) vector or measured direction are too near to the zenith for an azimuth."""
        if self.in_tangent_plane:
            return np.zeros(seen.x.shape, dtype=bool)
        _, least = cosine_sine(np.minimum(_ZENITH_STDS * elevation_std_rad, 0.5 * np.pi))
        steep = (seen.level_squared < least * least * seen.squared) | (self.cos_elevation[:, at] < least)
        return np.asarray((self.has_elevation[:, at] > 0.0) & steep)

    def residuals(self, at: slice, seen: Seen) -> tuple[FloatArray, FloatArray]:
        """Return measured minus predicted azimuths and elevations (B, C); of rows without an elevation without meaning.

        In the tangent plane minus the parts of the predicted direction along the tangents of the measured one.
        """
        cosine, sine = self.cos_azimuth[:, at], self.sin_azimuth[:, at]
        azimuth = np.arctan2(sine * seen.x - cosine * seen.y, cosine * seen.x + sine * seen.y)
        if self.in_tangent_plane:
            left, above = self._along_tangents(at, seen)
            return np.where(self.has_elevation[:, at] > 0.0, -left, azimuth), -above
        cosine, sine = self.cos_elevation[:, at], self.sin_elevation[:, at]
        return azimuth, np.arctan2(sine * seen.level - cosine * seen.z, cosine * seen.level + sine * seen.z)

    def slopes(
        self, at: slice, seen: Seen, scales: tuple[FloatArray, FloatArray], extra_m2: FloatArray | None = None
    ) -> tuple[tuple[FloatArray, ...], tuple[FloatArray, ...]]:
        """Return the derivatives (B, C) of both residuals by the vectors, times ``scales``.

        Those of azimuths may lack z, which is 0. With ``extra_m2`` (B,) squared distances are that much larger.
        """
        weight = scales[0] / _enlarged(seen.level_squared, extra_m2)
        turn = seen.y * weight, -seen.x * weight
        if self.in_tangent_plane:
            return self._slopes_in_tangent_plane(at, seen, turn, scales, extra_m2)
        weight = scales[1] / _enlarged(seen.squared, extra_m2)
        slant = seen.z / seen.level
        slant *= weight
        return turn, (seen.x * slant, seen.y * slant, -seen.level * weight)

    def bending(self, at: slice, seen: Seen, azimuth: FloatArray, rise: FloatArray) -> SymmetricMatrix:
        """Return the sum of the second derivatives of both residuals, times ``azimuth`` and ``rise`` (B, C).

        ``rise`` is 0 in rows without an elevation.
        """
        x, y, z, level_squared, level, squared = seen
        xx, xy, yy = x * x, x * y, y * y
        twist = azimuth / (level_squared * level_squared)
        if self.in_tangent_plane:
            has = self.has_elevation[:, at]
            twist = np.where(has > 0.0, 0.0, twist)
            total = self._bending_in_tangent_plane(at, seen, np.where(has > 0.0, azimuth, 0.0), rise)
        else:
            bend = rise / (squared * squared)
            steep = z / level
            turned = (level - z * steep) * bend
            steep *= bend
            along = -2.0 * steep  # this and the next over the square of the level part
            across = steep * squared / level_squared
            total = SymmetricMatrix(
                along * xx + across * yy,
                (along - across) * xy,
                along * yy + across * xx,
                turned * x,
                turned * y,
                -along * level_squared,
            )
        xy *= twist
        xy += xy
        total.parts[0][...] -= xy
        total.parts[2][...] += xy
        xx -= yy
        xx *= twist
        total.parts[1][...] += xx
        return total

    def _along_tangents(self, at: slice, seen: Seen) -> tuple[FloatArray, FloatArray]:
        """Return the parts (B, C) of the predicted directions along both tangents of the measured ones."""
        inverse = 1.0 / np.sqrt(seen.squared)
        left, above = (dot(tangent, seen.vector) * inverse for tangent in self.tangents(at))
        return left, above

    def _slopes_in_tangent_plane(
        self,
        at: slice,
        seen: Seen,
        turn: tuple[FloatArray, ...],
        scales: tuple[FloatArray, FloatArray],
        extra_m2: FloatArray | None,
    ) -> tuple[tuple[FloatArray, ...], tuple[FloatArray, ...]]:
        inverse = 1.0 / np.sqrt(seen.squared)
        per_metre = inverse if extra_m2 is None else 1.0 / np.sqrt(seen.squared + extra_m2[:, None])
        both = []
        for tangent, along, scale in zip(self.tangents(at), self._along_tangents(at, seen), scales, strict=True):
            pairs = zip(seen.vector, tangent, strict=True)
            both.append(tuple((along * part * inverse - own) * (per_metre * scale) for part, own in pairs))
        has = self.has_elevation[:, at] > 0.0
        pairs = zip(both[0], (*turn, np.zeros(has.shape)), strict=True)
        return tuple(np.where(has, *pair) for pair in pairs), both[1]

    def _bending_in_tangent_plane(self, at: slice, seen: Seen, *residuals: FloatArray) -> SymmetricMatrix:
        """Return minus the second derivatives of the direction's parts along the tangents, times residuals (B, C)."""
        inverse = 1.0 / np.sqrt(seen.squared)
        unit = tuple(part * inverse for part in seen.vector)
        total = SymmetricMatrix.full(inverse.shape, 0.0, 3)
        parts = zip(self.tangents(at), self._along_tangents(at, seen), residuals, strict=True)
        for tangent, along, residual in parts:
            bend = SymmetricMatrix.symmetrized(tangent, unit) + SymmetricMatrix.outer(*unit, weight=-3.0 * along)
            total.add_scaled(bend.add_to_diagonal(along), residual * inverse * inverse)
        return total


def _enlarged(squared_m2: FloatArray, extra_m2: FloatArray | None) -> FloatArray:
    """Return squares (B, C), or their geometric means with squares larger by ``extra_m2`` (B,)."""
    return squared_m2 if extra_m2 is None else np.sqrt(squared_m2 * (squared_m2 + extra_m2[:, None]))
