"""One specular reflection on the inner side of a circle. Coordinates are relative to the centre.

Song, Willett, Zhou 2013, Section 3. With s, t the two points as complex numbers, w = s + t, p = s t and the
reflection point R exp(i theta), equation (33) is R |w| sin(arg w - theta) = |p| sin(arg p - 2 theta). Rotated by
arg(p) / 2 it is F(u) = |p| sin 2u - X sin u + Y cos u = 0 with X + i Y = R w exp(-i arg(p) / 2), and the number of
its roots changes where |X|^(2/3) + |Y|^(2/3) = (2 |p|)^(2/3): an astroid, which is the separatrix (37)-(38).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import FloatArray, IntArray, ignoring_division
from nlosctl.geometry.roots import bracketed_roots

__all__ = [
    "MAX_PATHS",
    "ReflectedPath",
    "all_points",
    "all_reflections",
    "count_reflections",
    "ray_tube_width",
    "reflect_at",
    "separatrix",
]


MAX_PATHS = 4
"""The largest number of specular points between two points in a circle (Lemma 1)."""

_TANGENT = 1e-12
"""Relative distance to the separatrix within which two of the points coincide."""


@dataclass(frozen=True)
class ReflectedPath:
    """Paths from a source to the reflection point to the sensor; all arrays have one shape, NaN where there is no path.

    ``hit_x``, ``hit_y`` is the reflection point, ``first_leg_m`` its distance from the sensor,
    ``second_leg_m`` from the source, ``bearing_rad`` its bearing from the sensor, in (-pi, pi].
    ``cosine``, ``sine`` are its direction to the source, ``tube_width_m`` the width of the ray tube there per
    radian of bearing: negative beyond a focus, zero on a caustic.
    """

    hit_x: FloatArray
    hit_y: FloatArray
    first_leg_m: FloatArray
    second_leg_m: FloatArray
    bearing_rad: FloatArray
    cosine: FloatArray
    sine: FloatArray
    tube_width_m: FloatArray

    @property
    def length_m(self) -> FloatArray:
        """The length of the whole path."""
        return self.first_leg_m + self.second_leg_m

    def bearing_gradient(self) -> tuple[FloatArray, FloatArray]:
        """Return the derivatives of ``bearing_rad`` with respect to the source's x and y: (sin b, -cos b) / spread.

        b is the direction from the reflection point to the source. The sign is that of a mirror, equation (23);
        the spread of the ray tube replaces the distance of a flat mirror.
        """
        with ignoring_division():
            inverse = 1.0 / self.tube_width_m
            return self.sine * inverse, -self.cosine * inverse

    def front_radius_m(self) -> FloatArray:
        """Return the radius of the wave front at the source, as a wave from the sensor has it: width over its slope.

        The second derivatives of the length by the source's position are (I - u u') over it, u the direction from the
        reflection point. Negative beyond a focus, infinite behind a mirror that makes the wave plane.
        """
        normal = self.hit_x * np.cos(self.bearing_rad) + self.hit_y * np.sin(self.bearing_rad)
        with ignoring_division():
            return np.asarray(self.tube_width_m / (1.0 - 2.0 * self.first_leg_m / normal))


def ray_tube_width(first_leg_m: FloatArray, second_leg_m: FloatArray, normal_m: FloatArray) -> FloatArray:
    """Return the width per radian of a ray tube after both legs; ``normal_m`` is radius times cos(incidence).

    For a concave mirror l1 + l2 - 2 l1 l2 / (R cos i), in the plane of incidence; zero on a caustic.
    """
    return first_leg_m + second_leg_m - 2.0 * first_leg_m * second_leg_m / normal_m


def all_reflections(
    sensor_x: FloatArray, sensor_y: FloatArray, source_x: FloatArray, source_y: FloatArray, radius: FloatArray
) -> ReflectedPath:
    """Return the paths (4, N) via the points of `all_points`."""
    hit_x, hit_y = all_points(sensor_x, sensor_y, source_x, source_y, radius)
    return reflect_at(hit_x, hit_y, sensor_x, sensor_y, source_x, source_y)


def all_points(
    sensor_x: FloatArray, sensor_y: FloatArray, source_x: FloatArray, source_y: FloatArray, radius: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return x, y (4, N) of every specular point between two points (N,) inside a circle (Lemma 1).

    There are two points, and two more inside the separatrix (one on it); the rest is NaN. All are NaN where both points
    are the centre (every point of the circle reflects) or one is not inside.
    """
    half_x, half_y, product, flip_x, flip_y, x, y, count = _turned(sensor_x, sensor_y, source_x, source_y, radius)
    angle = np.full((MAX_PATHS, count.shape[0]), np.nan)
    rows, folded = np.flatnonzero(count > 0), np.flatnonzero(count > 2)
    fold = -np.arctan2(np.cbrt(y[folded]), np.cbrt(x[folded]))
    quarter = np.full(rows.shape, 0.5 * np.pi)
    brackets: tuple[tuple[IntArray, FloatArray, FloatArray, float], ...] = (
        (rows, 0.0 * quarter, quarter, -1.0),
        (rows, 2.0 * quarter, 3.0 * quarter, 1.0),
        (folded, np.full_like(fold, -0.5 * np.pi), fold, -1.0),
        (folded, fold, np.zeros_like(fold), 1.0),
    )
    for number, (chosen, low, high, orientation) in enumerate(brackets):
        angle[number, chosen] = _turning_root(product[chosen], x[chosen], y[chosen], low, high, orientation)
    angle[2, folded] = np.where(count[folded] == 3, fold, angle[2, folded])
    angle[3, count == 3] = np.nan
    cosine, sine = flip_x * np.cos(angle), flip_y * np.sin(angle)
    return radius * (cosine * half_x - sine * half_y), radius * (cosine * half_y + sine * half_x)


def _turning_root(
    product: FloatArray, x: FloatArray, y: FloatArray, low: FloatArray, high: FloatArray, orientation: float
) -> FloatArray:
    """Return the root of F within the bracket, shapes (N,), where ``orientation`` times F rises through zero."""

    def condition(angle: FloatArray) -> tuple[FloatArray, FloatArray]:
        cosine, sine = np.cos(angle), np.sin(angle)
        value = 2.0 * product * sine * cosine - x * sine + y * cosine
        slope = 2.0 * product * (cosine * cosine - sine * sine) - x * cosine - y * sine
        return orientation * value, orientation * slope

    return bracketed_roots(condition, low, high, 0.5 * (low + high))


def count_reflections(
    sensor_x: FloatArray, sensor_y: FloatArray, source_x: FloatArray, source_y: FloatArray, radius: FloatArray
) -> IntArray:
    """Return the number of specular points between points inside a circle: 2, 3 or 4 (Lemma 1), shape (N,).

    0 where both points are the centre (infinitely many) or one is not inside.
    """
    return _turned(sensor_x, sensor_y, source_x, source_y, radius)[-1]


def separatrix(sensor_x: float, sensor_y: float, radius: float, parameter: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the curve across which the number of paths from a sensor changes between 2 and 4, shapes (P,).

    Equations (37)-(38), scaled and rotated to the sensor; ``parameter`` is theta in (0, 2 pi), the angle of the
    reflection point from the sensor's direction (the paper's t is its cot(theta / 2), not its tangent). On the curve
    two paths coincide and the width of their ray tubes is zero. No path reaches points beyond the circle.
    """
    distance = float(np.hypot(sensor_x, sensor_y))
    c = distance / radius
    # t = cot(theta / 2), numerator and denominator times sin^6(theta / 2).
    even, odd = np.cos(0.5 * parameter) ** 2, np.sin(0.5 * parameter) ** 2
    cubes = np.cos(0.5 * parameter) ** 3 * np.sin(0.5 * parameter) ** 3
    powers = (even**3, 3.0 * even**2 * odd, 3.0 * even * odd**2, odd**3)
    square = 2.0 * c * c
    h_parts = (1.0 - 3.0 * c + square, 1.0 - c + square, 1.0 + c + square, 1.0 + 3.0 * c + square)
    x_parts = (1.0 - c, 1.0 - 3.0 * c, 1.0 + 3.0 * c, 1.0 + c)
    h = sum(part * power for part, power in zip(h_parts, powers, strict=True))
    top = sum(part * power for part, power in zip(x_parts, powers, strict=True))
    toward_x, toward_y = (sensor_x / distance, sensor_y / distance) if distance > 0.0 else (1.0, 0.0)
    with ignoring_division():
        along, across = -radius * c * top / h, radius * 16.0 * c * c * cubes / h
        return along * toward_x - across * toward_y, along * toward_y + across * toward_x


def reflect_at(
    hit_x: FloatArray,
    hit_y: FloatArray,
    sensor_x: FloatArray,
    sensor_y: FloatArray,
    source_x: FloatArray,
    source_y: FloatArray,
) -> ReflectedPath:
    """Return the paths via known reflection points; shapes broadcast; the bearing is (34) by atan2."""
    out_x, out_y = hit_x - sensor_x, hit_y - sensor_y
    back_x, back_y = source_x - hit_x, source_y - hit_y
    first, second = _length(out_x, out_y), _length(back_x, back_y)
    with ignoring_division():
        normal = (out_x * hit_x + out_y * hit_y) / first
        spread = ray_tube_width(first, second, normal)
        cosine, sine = back_x / second, back_y / second
    return ReflectedPath(hit_x, hit_y, first, second, np.arctan2(out_y, out_x), cosine, sine, spread)


def _length(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return the lengths; faster than hypot, for lengths whose squares neither overflow nor vanish."""
    return np.sqrt(x * x + y * y)


def _turned(
    sensor_x: FloatArray, sensor_y: FloatArray, source_x: FloatArray, source_y: FloatArray, radius: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, IntArray]:
    """Return exp(i arg(p) / 2), |p|, the signs of X and Y, |X|, |Y| (all over the radius squared) and the count."""
    scale = 1.0 / radius
    s = (sensor_x + 1j * sensor_y) * scale
    t = (source_x + 1j * source_y) * scale
    product = s * t
    half = np.sqrt(product)
    length = np.abs(half)
    half = np.where(length > 0.0, half / np.where(length > 0.0, length, 1.0), 1.0)
    turned = (s + t) * np.conj(half)
    x, y, size = np.abs(turned.real), np.abs(turned.imag), np.abs(product)
    excess = np.cbrt(x * x) + np.cbrt(y * y) - np.cbrt(4.0 * size * size)
    tangent = np.abs(excess) <= _TANGENT * np.cbrt(4.0 * size * size)
    count = np.where(tangent & (size > 0.0), 3, np.where(excess < 0.0, 4, 2))
    inside = (np.abs(s) < 1.0) & (np.abs(t) < 1.0) & ((x > 0.0) | (y > 0.0) | (size > 0.0))
    count = np.where(inside, count, 0)
    return half.real, half.imag, size, np.copysign(1.0, turned.real), np.copysign(1.0, turned.imag), x, y, count
