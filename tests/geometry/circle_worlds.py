"""Reflection on a circle by slow, independent methods: complex numbers and brute force."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

ComplexArray = npt.NDArray[np.complex128]

EARTH_M, IONOSPHERE_M = 6371e3, 6671e3


def draw_disc(generator: np.random.Generator, count: int, radius: float = 1.0) -> ComplexArray:
    """Return points uniformly distributed over a disc about the origin."""
    return radius * np.sqrt(generator.random(count)) * np.exp(2j * np.pi * generator.random(count))


def quartic_points(sensor: complex, source: complex) -> ComplexArray:
    """Return the specular points on the unit circle, by angle: roots of Alhazen's quartic of modulus one."""
    w, p = sensor + source, sensor * source
    roots = np.roots([np.conj(p), -np.conj(w), 0.0, w, -p])
    on_circle = roots[np.abs(np.abs(roots) - 1.0) < 1e-6]
    return on_circle[np.argsort(np.angle(on_circle))]


def distance_from_center(start: ComplexArray, end: ComplexArray) -> npt.NDArray[np.float64]:
    """Return the distance of segments between points from the origin."""
    along = end - start
    share = np.clip(np.real(-start * np.conj(along)) / np.abs(along) ** 2, 0.0, 1.0)
    return np.abs(start + share * along)


def unblocked_points(sensor: complex, source: complex, radius: float, blocker: float) -> ComplexArray:
    """Return the specular points whose two legs do not cross the blocker (by more than a millimetre)."""
    points = radius * quartic_points(sensor / radius, source / radius)
    clear = np.minimum(
        distance_from_center(np.full_like(points, sensor), points),
        distance_from_center(points, np.full_like(points, source)),
    )
    return points[clear >= blocker - 1e-3]


def parts(points: ComplexArray) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return x and y, contiguous."""
    return np.real(points).copy(), np.imag(points).copy()
