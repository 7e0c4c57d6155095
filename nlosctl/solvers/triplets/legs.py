"""Legs of paths: straight lines between a node (transmitter or receiver) and a target, and the angles measured there.

In space a direction is an azimuth and an elevation. The derivatives are those of numerics by unit vectors: u from the
node to the target, a and t across it, along which azimuth and elevation grow.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray
from nlosctl.geometry.angles import cosine_sine
from nlosctl.geometry.blocks import RowBlock
from nlosctl.geometry.directions import Vector
from nlosctl.geometry.symmetric import SymmetricMatrix, dot

__all__ = ["Leg", "Node", "Residual", "angle_residual", "cross_rays", "leg_to", "length_residual"]


@dataclass(frozen=True)
class Node(RowBlock):
    """One end of the paths (B, K): its position about a local origin (D arrays, metres), and the measured direction.

    ``cosine`` and ``sine`` are those of the azimuth. In space ``elevation_rad`` and its inverse standard deviation are
    0 in rows without elevation.
    """

    position: tuple[FloatArray, ...]
    cosine: FloatArray
    sine: FloatArray
    inverse_std: FloatArray
    elevation_rad: FloatArray | None = None
    inverse_elevation_std: FloatArray | None = None

    def residuals(self, *point: FloatArray) -> tuple[FloatArray, FloatArray | None, FloatArray]:
        """Return measured minus predicted azimuth and elevation (radians, (B, K)) and distances (m), at points (B,).

        The elevation is NaN in rows without one, and None in the plane.
        """
        along = [part[:, None] - own for part, own in zip(point, self.position, strict=True)]
        azimuth = angle_residual(self.cosine, self.sine, along[0], along[1])
        squared = along[0] * along[0] + along[1] * along[1]
        if self.elevation_rad is None or self.inverse_elevation_std is None:
            return azimuth, None, np.sqrt(squared)
        elevation = self.elevation_rad - np.arctan2(along[2], np.sqrt(squared))
        distance = np.sqrt(squared + along[2] * along[2])
        return azimuth, np.where(self.inverse_elevation_std > 0.0, elevation, np.nan), distance

    def frame(self) -> tuple[Vector, Vector, Vector]:
        """Return the measured direction in space, and the tangents along which azimuth and elevation grow."""
        level, rise = cosine_sine(np.asarray(self.elevation_rad))
        cosine, sine = self.cosine, self.sine
        across = (-sine, cosine, np.zeros_like(sine))
        return (level * cosine, level * sine, rise), across, (-rise * cosine, -rise * sine, level)

    def ray(self, elevation_rad: FloatArray) -> Vector:
        """Return the unit vectors with the measured azimuths and other elevations."""
        level, rise = cosine_sine(elevation_rad)
        return level * self.cosine, level * self.sine, rise

    def map(self, change: Callable[[FloatArray], FloatArray]) -> Node:
        """Return the node with a function applied to each array."""
        position, direction = tuple(map(change, self.position)), (self.cosine, self.sine, self.inverse_std)
        heights = (part if part is None else change(part) for part in (self.elevation_rad, self.inverse_elevation_std))
        return Node(position, *map(change, direction), *heights)

    def mirrored(self, normal: tuple[float, ...], distance_m: FloatArray) -> Node:
        """Return the image in a wall at a distance (B, K), positive on the side of its unit normal.

        Standard deviations across the ray stay; in a slanting plane those of the two angles are not mixed.
        """
        position = tuple(part - 2.0 * distance_m * along for part, along in zip(self.position, normal, strict=True))
        ray = (self.cosine, self.sine) if self.elevation_rad is None else self.frame()[0]
        towards = sum(part * along for part, along in zip(ray, normal, strict=True))
        ray = tuple(part - 2.0 * towards * along for part, along in zip(ray, normal, strict=True))
        if self.elevation_rad is None:
            return replace(self, position=position, cosine=ray[0], sine=ray[1])
        level = np.hypot(ray[0], ray[1])
        return replace(
            self,
            position=position,
            cosine=ray[0] / level,
            sine=ray[1] / level,
            inverse_std=self.inverse_std * level / np.cos(self.elevation_rad),
            elevation_rad=np.arctan2(ray[2], level),
        )

    @property
    def has_elevation(self) -> BoolArray:
        """Which rows (B, K) measure an elevation; none in the plane."""
        return np.asarray(0.0 * self.cosine if self.inverse_elevation_std is None else self.inverse_elevation_std) > 0.0


class Residual(NamedTuple):
    """A residual (N,) in standard deviations, its slopes by the target (D arrays), and the inverse of its std."""

    value: FloatArray
    slope: tuple[FloatArray, ...]
    inverse_std: FloatArray


class Leg(NamedTuple):
    """A leg to targets (N,): its length, the inverse of that, the unit vector (D arrays), and the angles measured.

    ``level`` is its length in the x-y plane (in the plane, all of it); ``elevation`` is None in the plane.
    """

    distance: FloatArray
    inverse: FloatArray
    unit: tuple[FloatArray, ...]
    level: FloatArray
    azimuth: Residual
    elevation: Residual | None

    def add_angle_bend(self, bend: SymmetricMatrix) -> None:
        """Add what the curvature of the angles adds to the Gauss-Newton matrix.

        With h the level part of u, scaled to length 1, the second derivatives of the measured minus the predicted
        azimuth are (h a' + a h') / f^2 over a level distance f, and of the elevation (u t' + t u' + tan e a a') / r^2.
        """
        if self.elevation is None:
            curvature = self.azimuth.value * (self.azimuth.inverse_std * self.inverse) * self.inverse
            ux, uy = self.unit
            both = 2.0 * ux * uy * curvature
            bend_xx, bend_xy, bend_yy = bend
            bend_xx -= both
            bend_yy += both
            bend_xy += (ux * ux - uy * uy) * curvature
            return
        level, rise = 1.0 / self.level, self.elevation.value * self.elevation.inverse_std * self.inverse * self.inverse
        h, a, t = self._frame()
        _add_both(bend, h, a, self.azimuth.value * self.azimuth.inverse_std * level * level)
        _add_both(bend, self.unit, t, rise)
        bend.add_scaled(SymmetricMatrix.outer(*a), rise * self.unit[2] * self.distance * level)

    def add_length_bend(self, bend: SymmetricMatrix, pull: FloatArray) -> None:
        """Add ``pull`` times the second derivatives of the length: (1 - u u') / r."""
        weight = pull * self.inverse
        if self.elevation is None:
            ux, uy = self.unit
            bend_xx, bend_xy, bend_yy = bend
            bend_xx += weight * uy * uy
            bend_xy -= weight * ux * uy
            bend_yy += weight * ux * ux
            return
        for across in self._frame()[1:]:
            bend.add_scaled(SymmetricMatrix.outer(*across), weight)

    def _frame(self) -> tuple[tuple[FloatArray, ...], ...]:
        """Return the unit vectors h, a and t in space."""
        level, rise = self.distance / self.level, self.unit[2]
        h = (self.unit[0] * level, self.unit[1] * level, np.zeros_like(level))
        return h, (-h[1], h[0], h[2]), (-rise * h[0], -rise * h[1], self.level * self.inverse)


def _add_both(
    matrix: SymmetricMatrix, left: tuple[FloatArray, ...], right: tuple[FloatArray, ...], weight: FloatArray
) -> None:
    """Add ``weight (l r' + r l')`` in place."""
    for i in range(len(left)):
        for j in range(i + 1):
            part = matrix.entry(i, j)
            part += weight * (left[i] * right[j] + right[i] * left[j])


def leg_to(node: Node, k: int, *point: FloatArray) -> Leg:
    """Return the legs of path ``k`` from its node to targets (N,)."""
    along = [part - own[:, k] for part, own in zip(point, node.position, strict=True)]
    if node.elevation_rad is None or node.inverse_elevation_std is None:
        return _plane_leg(node, k, *along)
    inverse_std, inverse_elevation_std = node.inverse_std[:, k], node.inverse_elevation_std[:, k]
    dx, dy, dz = along
    squared = dx * dx + dy * dy
    level = np.sqrt(squared)
    distance = np.sqrt(squared + dz * dz)
    inverse, inverse_level = 1.0 / distance, 1.0 / level
    hx, hy = dx * inverse_level, dy * inverse_level
    azimuth_slope, slope = inverse_std * inverse_level, inverse_elevation_std * inverse
    value = angle_residual(node.cosine[:, k], node.sine[:, k], dx, dy) * inverse_std
    azimuth = Residual(value, (hy * azimuth_slope, -hx * azimuth_slope, np.zeros_like(value)), inverse_std)
    rise, cosine = dz * inverse, level * inverse
    slopes = (rise * hx * slope, rise * hy * slope, -cosine * slope)
    elevation = (node.elevation_rad[:, k] - np.arctan2(dz, level)) * inverse_elevation_std
    unit = (dx * inverse, dy * inverse, rise)
    return Leg(distance, inverse, unit, level, azimuth, Residual(elevation, slopes, inverse_elevation_std))


def length_residual(legs: Sequence[Leg], path_length_m: FloatArray, inverse_std: FloatArray) -> Residual:
    """Return the residual (N,) of the path length, predicted minus measured, over two legs."""
    tx, rx = legs
    value = (tx.distance + rx.distance - path_length_m) * inverse_std
    return Residual(value, tuple((a + b) * inverse_std for a, b in zip(tx.unit, rx.unit, strict=True)), inverse_std)


def _plane_leg(node: Node, k: int, dx: FloatArray, dy: FloatArray) -> Leg:
    inverse_std = node.inverse_std[:, k]
    distance = np.sqrt(dx * dx + dy * dy)
    inverse = 1.0 / distance
    value = angle_residual(node.cosine[:, k], node.sine[:, k], dx, dy) * inverse_std
    ux, uy = dx * inverse, dy * inverse
    slope = inverse_std * inverse
    return Leg(distance, inverse, (ux, uy), distance, Residual(value, (uy * slope, -ux * slope), inverse_std), None)


def cross_rays(departing: Node, arriving: Node) -> tuple[FloatArray, ...]:
    """Return where two rays cross (D arrays, the shape of the nodes' arrays), NaN where that is behind a node.

    In space the point nearest to both; of a ray without elevation, to the vertical half-plane of its azimuth. NaN for
    two of these, and for parallel rays.
    """
    if departing.elevation_rad is not None:
        return _cross_in_space(departing, arriving)
    (tx_x, tx_y), (rx_x, rx_y) = departing.position, arriving.position
    along_x, along_y, cosine, sine = departing.cosine, departing.sine, arriving.cosine, arriving.sine
    dx, dy = rx_x - tx_x, rx_y - tx_y
    inverse = 1.0 / (sine * along_x - cosine * along_y)
    along, back = (sine * dx - cosine * dy) * inverse, (along_y * dx - along_x * dy) * inverse
    along = np.where((along > 0.0) & (back > 0.0), along, np.nan)
    return tx_x + along * along_x, tx_y + along * along_y


def _cross_in_space(departing: Node, arriving: Node) -> tuple[FloatArray, ...]:
    shape = departing.cosine.shape
    matrix, right = SymmetricMatrix.full(shape, 0.0, 3), tuple(np.zeros(shape) for _ in range(3))
    for node in (departing, arriving):
        _, *normals = node.frame()
        for normal, measured in zip(normals, (np.ones(shape, dtype=bool), node.has_elevation), strict=True):
            weight = np.where(measured, 1.0, 0.0)
            offset = weight * dot(normal, node.position)
            matrix.add_scaled(SymmetricMatrix.outer(*normal), weight)
            for total, part in zip(right, normal, strict=True):
                total += part * offset
    point = matrix.solve(*right)
    valid = np.ones(shape, dtype=bool)
    for node in (departing, arriving):
        ahead = [part - own for part, own in zip(point, node.position, strict=True)]
        level = ahead[0] * node.cosine + ahead[1] * node.sine
        valid &= np.where(node.has_elevation, dot(ahead, node.frame()[0]), level) > 0.0
    return tuple(np.where(valid, part, np.nan) for part in point)


def angle_residual(cosine: FloatArray, sine: FloatArray, dx: FloatArray, dy: FloatArray) -> FloatArray:
    """Return the angle from (dx, dy) to (cosine, sine)."""
    return np.arctan2(sine * dx - cosine * dy, cosine * dx + sine * dy)
