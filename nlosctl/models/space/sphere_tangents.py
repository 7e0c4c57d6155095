"""Rays by spheres unfolded at the tangent plane where the measured direction meets the sphere, for linear fits.

An error of the direction of d radians is worth wt d metres in the plane of incidence and ws d across it, with the
widths of `nlosctl.geometry.spheres`: errors across the ray are correlated where wt and ws differ. A linear fit takes
two directions across the ray in which they are independent.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray
from nlosctl.geometry.blocks import RowBlock
from nlosctl.geometry.directions import Vector, combine, cross, dot
from nlosctl.geometry.planes import reflect_vector
from nlosctl.geometry.spheres import SphereHit

__all__ = ["SphereTangents"]


@dataclass(frozen=True)
class SphereTangents(RowBlock):
    """The tangent planes of N rows, by their unit ``normal``; all is 0 in rows without a measured elevation.

    ``beside`` and ``across`` are unit vectors across the unfolded ray, in the plane of incidence and across it.
    ``turn_rad`` is the angle from them to the two directions of the fit, ``azimuth_turn_rad`` that to the directions in
    which azimuth and elevation grow; an error of the azimuth turns the ray by ``azimuth_share`` of it.
    """

    normal: Vector
    beside: Vector
    across: Vector
    first_leg_m: FloatArray
    strength: FloatArray
    across_strength: FloatArray
    azimuth_share: FloatArray
    azimuth_turn_rad: FloatArray
    turn_rad: FloatArray

    @classmethod
    def of(cls, hit: SphereHit, ray: Vector, along_azimuth: Vector, azimuth_share: FloatArray) -> SphereTangents:
        """Return the tangents where rays (N,) with unit tangents ``along_azimuth`` meet spheres; ray NaN: none."""
        beside = cross(hit.across, ray)
        turn = np.arctan2(dot(along_azimuth, hit.across), dot(along_azimuth, beside))
        parts = (hit.normal, reflect_vector(beside, hit.normal), hit.across)
        there = ~np.isnan(ray[0])
        normal, unfolded, across = (tuple(np.where(there, axis, 0.0) for axis in part) for part in parts)
        lengths = (hit.distance_m, hit.strength, hit.across_strength, azimuth_share, turn, turn)
        return cls(normal, unfolded, across, *(np.where(there, part, 0.0) for part in lengths))

    @property
    def has_plane(self) -> BoolArray:
        """Which rows have a measured elevation."""
        return np.asarray(self.first_leg_m != 0.0)

    def directions(self) -> tuple[Vector, Vector]:
        """Return the two unit vectors across the unfolded ray (N,) that the fit takes; 0 without an elevation."""
        cosine, sine = np.cos(self.turn_rad), np.sin(self.turn_rad)
        first = combine(cosine, self.beside, sine, self.across)
        return first, combine(-sine, self.beside, cosine, self.across)

    def spreads_m(self, range_m: FloatArray, azimuth_std: FloatArray, elevation_std: FloatArray) -> Vector:
        """Return the standard deviations (N,) along `directions`, ``range_m`` along the unfolded rays, in metres."""
        within, mixed, beside = self._errors(range_m, azimuth_std, elevation_std)
        cosine, sine = np.cos(self.turn_rad), np.sin(self.turn_rad)
        cross_term = 2.0 * cosine * sine * mixed
        squares = (
            cosine * cosine * within + cross_term + sine * sine * beside,
            sine * sine * within - cross_term + cosine * cosine * beside,
        )
        return tuple(np.sqrt(np.maximum(square, 0.0)) for square in squares)

    def based_at(self, range_m: FloatArray, azimuth_std: FloatArray, elevation_std: FloatArray) -> SphereTangents:
        """Return the tangents with directions along which the errors at ``range_m`` are independent."""
        within, mixed, beside = self._errors(range_m, azimuth_std, elevation_std)
        return replace(self, turn_rad=0.5 * np.arctan2(2.0 * mixed, within - beside))

    def _errors(self, range_m: FloatArray, azimuth_std: FloatArray, elevation_std: FloatArray) -> Vector:
        """Return the covariance (N,) of errors along ``beside`` and ``across``: its entries 11, 12, 22."""
        left = range_m - self.first_leg_m
        within_m, across_m = range_m - self.strength * left, range_m - self.across_strength * left
        cosine, sine = np.cos(self.azimuth_turn_rad), np.sin(self.azimuth_turn_rad)
        one, two = (azimuth_std * self.azimuth_share) ** 2, elevation_std**2
        within = (cosine * cosine * one + sine * sine * two) * within_m**2
        mixed = cosine * sine * (one - two) * within_m * across_m
        return within, mixed, (sine * sine * one + cosine * cosine * two) * across_m**2
