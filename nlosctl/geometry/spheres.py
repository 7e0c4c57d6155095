"""Reflection on the inner side of a sphere. Coordinates are relative to its centre, in metres.

Centre, sensor and source span a plane in which the sphere is the circle of Song, Willett, Zhou 2013 (Section 3): paths,
regions A2 and A3 and the opaque sphere are those of `nlosctl.geometry.circular_reflection`, `short_arc` and
`visibility`, given the coordinates of `CentralPlane`. Only the widths of ray tubes and the gradients have a part across
that plane.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ignoring_division, ignoring_overflow
from nlosctl.geometry.blocks import RowBlock
from nlosctl.geometry.circles import leave_circle
from nlosctl.geometry.circular_reflection import ReflectedPath, reflect_at
from nlosctl.geometry.directions import Vector, combine, cross, dot, length, scaled, subtract

__all__ = [
    "CentralPlane",
    "SphereHit",
    "SpherePath",
    "central_plane",
    "cross_spheres",
    "elevation_above_horizon",
    "leave_sphere",
]

_ALIGNED = 1e-12
"""Angle in radians between sensor and source, seen from the centre, below which every plane through both will do."""


@dataclass(frozen=True)
class CentralPlane(RowBlock):
    """The plane of centre, sensor and source: unit vectors ``toward`` the sensor, ``across`` it, and their ``normal``.

    In it the sensor is at (``sensor_m``, 0), the source at (``source_x``, ``source_y``), ``source_y`` >= 0. Shape (N,).
    """

    toward: Vector
    across: Vector
    normal: Vector
    sensor_m: FloatArray
    source_x: FloatArray
    source_y: FloatArray

    @property
    def points(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Sensor x, y and source x, y in the plane, as the functions of the circle take them."""
        return self.sensor_m, np.zeros_like(self.sensor_m), self.source_x, self.source_y

    def path_by(self, hit_x: FloatArray, hit_y: FloatArray) -> SpherePath:
        """Return the paths by reflection points in the plane, (N,) or several for each row (P, N)."""
        return SpherePath(self, reflect_at(hit_x, hit_y, *self.points))

    def direction(self, cosine: FloatArray, sine: FloatArray) -> Vector:
        """Return vectors of the plane, given in it, in space."""
        return combine(cosine, self.toward, sine, self.across)


def central_plane(sensor: Vector, source: Vector) -> CentralPlane:
    """Return the planes of the centre, sensors and sources, shapes (N,).

    Where sensor and source are in one line with the centre any plane through both; where the sensor is the centre a
    plane through the source.
    """
    sensor_m, source_m = length(sensor), length(source)
    with ignoring_division():
        toward = _where(sensor_m > 0.0, scaled(sensor, 1.0 / sensor_m), (1.0, 0.0, 0.0))
        across = subtract(source, scaled(toward, dot(source, toward)))
        width = length(across)
        across = _where(width > _ALIGNED * source_m, scaled(across, 1.0 / width), _perpendicular(toward))
    # Once more: what rounding left along the sensor's direction counts where source and sensor are nearly aligned.
    across = subtract(across, scaled(toward, dot(across, toward)))
    across = scaled(across, 1.0 / length(across))
    normal = cross(toward, across)
    return CentralPlane(toward, across, normal, sensor_m, dot(source, toward), np.abs(dot(source, across)))


@dataclass(frozen=True)
class SpherePath:
    """Paths from a source by the sphere to a sensor: ``flat`` in its ``plane``; (N,) or (P, N), NaN without a path."""

    plane: CentralPlane
    flat: ReflectedPath

    @property
    def hit(self) -> Vector:
        """The reflection points."""
        return self.plane.direction(self.flat.hit_x, self.flat.hit_y)

    @property
    def direction(self) -> Vector:
        """The unit directions from the sensor to the reflection points."""
        return self.plane.direction(*self._outgoing())

    @property
    def vector(self) -> Vector:
        """The vectors from the sensor in that direction, as long as the whole path."""
        return scaled(self.direction, self.flat.length_m)

    @property
    def last_leg(self) -> Vector:
        """The vectors in the direction from the reflection points to the sources, as long as the whole paths."""
        return scaled(self.plane.direction(self.flat.cosine, self.flat.sine), self.flat.length_m)

    @property
    def across_width_m(self) -> FloatArray:
        """Width of the ray tube per radian across the plane: l1 + l2 - 2 l1 l2 cos(i) / R (sagittal).

        That in the plane is ``flat.tube_width_m`` (tangential). Times the sine of the angle between direction and
        vertical it is the source's distance from the line through centre and sensor, by symmetry about that line.
        """
        flat, (cosine, sine) = self.flat, self._outgoing()
        normal = flat.hit_x * cosine + flat.hit_y * sine
        squared_radius = flat.hit_x * flat.hit_x + flat.hit_y * flat.hit_y
        return flat.length_m - 2.0 * flat.first_leg_m * flat.second_leg_m * normal / squared_radius

    def gradient(self, vector: Vector) -> Vector:
        """Return the derivatives of ``vector . direction`` by the source's position, for constant vectors.

        du/dx = (-sin p e1 + cos p e2) (sin b e1 - cos b e2)' / wt + k k' / ws: p is the direction from the sensor, b
        that to the source in the plane (e1, e2), k its normal; wt and ws are the widths in the plane and across it.
        """
        cosine, sine = self._outgoing()
        with ignoring_division():
            within = dot(vector, self.plane.direction(-sine, cosine)) / self.flat.tube_width_m
            beside = dot(vector, self.plane.normal) / self.across_width_m
        return combine(within, self.plane.direction(self.flat.sine, -self.flat.cosine), beside, self.plane.normal)

    def take(self, rows: IntArray) -> SpherePath:
        """Return the paths (N,) of some rows."""
        flat = ReflectedPath(**{name: array[rows] for name, array in vars(self.flat).items()})
        return SpherePath(self.plane.take(rows), flat)

    def _outgoing(self) -> tuple[FloatArray, FloatArray]:
        """Return cosine and sine, in the plane, of the direction from the sensor."""
        with ignoring_division():
            inverse = 1.0 / self.flat.first_leg_m
            return (self.flat.hit_x - self.plane.sensor_m) * inverse, self.flat.hit_y * inverse


@dataclass(frozen=True)
class SphereHit:
    """Where rays from sensors meet the sphere: ``point``, the ``normal`` of the tangent plane there, the first leg.

    ``across`` is the unit normal of the plane of centre and ray. l2 metres after the first leg l1 the width of the ray
    tube per radian is l1 + l2 - ``strength`` l2 within that plane (strength 2 l1 / (R cos i)), and the same with
    ``across_strength`` (2 l1 cos i / R) across it.
    """

    point: Vector
    normal: Vector
    across: Vector
    distance_m: FloatArray
    strength: FloatArray
    across_strength: FloatArray


def leave_sphere(sensor: Vector, direction: Vector, radius: FloatArray) -> SphereHit:
    """Return where rays from sensors along unit directions leave the sphere; NaN for sensors that are not inside."""
    plane = central_plane(sensor, direction)
    exit_ = leave_circle(plane.sensor_m, np.zeros_like(plane.sensor_m), plane.source_x, plane.source_y, radius)
    point = plane.direction(exit_.x, exit_.y)
    return SphereHit(
        point=point,
        normal=scaled(point, 1.0 / radius),
        across=plane.normal,
        distance_m=exit_.distance_m,
        strength=2.0 * exit_.distance_m / exit_.normal_m,
        across_strength=2.0 * exit_.distance_m * exit_.normal_m / (radius * radius),
    )


def cross_spheres(centers: Sequence[Vector], radii: Sequence[FloatArray]) -> tuple[Vector, Vector]:
    """Return both points that three spheres have in common, mirror images in the plane of their centres.

    Each of the three centres is three arrays; all shapes broadcast. Spheres that have no point in common give, twice,
    the point of the plane where the planes of their pairs' circles cross it. Not finite for centres on a line.
    """
    first, second, third = centers
    with ignoring_overflow():
        along = subtract(second, first)
        distance = length(along)
        toward = scaled(along, 1.0 / distance)
        aside = subtract(third, first)
        i = dot(aside, toward)
        aside = subtract(aside, scaled(toward, i))
        j = length(aside)
        across = scaled(aside, 1.0 / j)
        squares = [radius * radius for radius in radii]
        x = 0.5 * ((squares[0] - squares[1]) / distance + distance)
        y = (0.5 * (squares[0] - squares[2] + i * i + j * j) - i * x) / j
        z = np.sqrt(np.maximum(squares[0] - x * x - y * y, 0.0))
        normal = cross(toward, across)
        place = [origin + x * one + y * two for origin, one, two in zip(first, toward, across, strict=True)]
        points = [tuple(part + sign * z * up for part, up in zip(place, normal, strict=True)) for sign in (1.0, -1.0)]
    return points[0], points[1]


def elevation_above_horizon(sensor: Vector, direction: Vector) -> FloatArray:
    """Return the elevation in [-pi / 2, pi / 2] of directions above the plane that touches the sensor's own sphere."""
    return np.arctan2(dot(sensor, direction), length(cross(sensor, direction)))


def _perpendicular(unit: Vector) -> Vector:
    """Return unit vectors perpendicular to unit vectors: in the plane of z, or of x for steep ones."""
    x, y, z = unit
    steep = np.abs(z) > 0.5
    none = np.zeros_like(x)
    across = _where(steep, (none, z, -y), (-y, x, none))
    return scaled(across, 1.0 / length(across))


def _where(condition: BoolArray, vector: Vector, other: tuple[FloatArray | float, ...]) -> Vector:
    """Return one vector where a condition holds, the other elsewhere."""
    x, y, z = (np.where(condition, one, two) for one, two in zip(vector, other, strict=True))
    return x, y, z
