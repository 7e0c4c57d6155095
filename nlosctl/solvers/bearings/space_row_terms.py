"""Directions in space, with or without elevations and ranges, as rows of a mixture."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import reduce

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, Point, ignoring_overflow
from nlosctl.geometry.blocks import RowBlock
from nlosctl.geometry.regions import Ball
from nlosctl.models.space.lines import SpaceLines
from nlosctl.models.space.measured_angles import Seen, Vector
from nlosctl.models.space.sphere_lines import SphereLines
from nlosctl.solvers.optimization.problem import RowDerivatives

__all__ = ["DirectDirections"]


_ALIKE = 0.05
"""Sensors nearer to each other than this share of their distance from a source see it, and its images, alike."""


@dataclass(frozen=True)
class DirectDirections(RowBlock):
    """Rows (B, K) of rays in space, direct, by plane mirrors or by spheres, with Gaussian errors of azimuth, elevation
    and range.

    A row can't be direct from points behind its sensor (its azimuth is off by more than a right angle), closer than
    the minimum range (B,) to the sensor or, with an elevation, to the vertical through it, where the azimuth loses its
    meaning, on another side of its mirror, or to which no path by its sphere leads.
    """

    lines: SpaceLines
    squared_minimum: FloatArray

    @classmethod
    def of(cls, lines: SpaceLines, squared_minimum: FloatArray) -> DirectDirections:
        """Return the rows of a block of rays; ``squared_minimum`` (B,) is the square of the minimum range."""
        return cls(replace(lines, refuses=True) if isinstance(lines, SphereLines) else lines, squared_minimum)

    @property
    def dimension(self) -> int:
        """The number of unknown coordinates: 2 where the height is exactly known."""
        return self.lines.unknowns

    def scalars(self) -> IntArray:
        """Return the number of scalars (B, K) of each row: azimuth, elevation, range."""
        count: IntArray = 1 + (self.lines.angles.has_elevation > 0.0).astype(np.int64)
        return count if self.lines.measured_m is None else count + np.isfinite(self.lines.measured_m)

    def half_chi_square(self, k: int, *point: FloatArray) -> FloatArray:
        """Return half the chi-square of row ``k`` at points (B, P); infinite where it can't be direct.

        Squared angles are series in their squared sines, as in the plane.
        """
        lines, angles, whole, at = self.lines, self.lines.angles, self.lines.whole(point), slice(k, k + 1)
        vx, vy, vz, squared_level, level, squared = lines.seen(at, whole, lines.row_path(at, whole))
        az_cos, az_sin = angles.cos_azimuth[:, k, None], angles.sin_azimuth[:, k, None]
        el_cos, el_sin = angles.cos_elevation[:, k, None], angles.sin_elevation[:, k, None]
        has = angles.has_elevation[:, k, None] > 0.0
        precision = [0.5 / lines.std[:, i, None] ** 2 for i in (k, angles.rows + k)]
        along, across = az_cos * vx + az_sin * vy, az_cos * vy - az_sin * vx
        if angles.in_tangent_plane:
            above = (el_cos * vz - el_sin * along) ** 2 / squared
            half = np.where(has, across * across / squared, _squared_angle(across * across / squared_level))
            along = np.where(has, el_cos * along + el_sin * vz, along)
            impossible = (along <= 0.0) | (squared < self.squared_minimum[:, None])
        else:
            above = _squared_angle((el_cos * vz - el_sin * level) ** 2 / squared)
            half = _squared_angle(across * across / squared_level)
            impossible = (along <= 0.0) | (squared_level < self.squared_minimum[:, None])
        half *= precision[0]
        half += np.where(has, above * precision[1], 0.0)
        if lines.measured_m is not None:
            measured, std = lines.measured_m[:, k, None], lines.std[:, 2 * angles.rows + k, None]
            distance = np.sqrt(squared)
            residual = np.log(measured / distance) if lines.is_lognormal else measured - distance
            half += np.where(np.isfinite(measured), 0.5 * (residual / std) ** 2, 0.0)
        if lines.mirrors is not None:
            impossible |= lines.mirrors.row_beyond(k, *whole)
        np.copyto(half, np.inf, where=impossible | np.isnan(half))
        return half

    def derivatives(self, k: int, *point: FloatArray) -> RowDerivatives:
        """Return half the chi-square of row ``k`` at points (B,), exact, and its derivatives; 0 where impossible."""
        lines, whole, at = self.lines, self.lines.whole(point), slice(k, k + 1)
        path = lines.row_path(at, whole)
        with ignoring_overflow():
            half, gradient, gauss, bend = lines.expansion(at, whole, path)
            hessian = gauss if bend is None else gauss + bend
        impossible = self._impossible(k, lines.seen(at, whole, path), whole) | ~np.isfinite(hessian.trace[:, 0])

        def finite(part: FloatArray) -> FloatArray:
            return np.where(impossible, 0.0, part[:, 0])

        return RowDerivatives(
            np.where(impossible, np.inf, half[:, 0]),
            tuple(map(finite, gradient)),
            gauss.map(finite),
            hessian.map(finite),
        )

    def ridges(self, ball: Ball) -> FloatArray:
        """Return the density (B, K) of the points of `sample_ridge` where it is greatest, apart from `on_ridge`.

        0 in rows without such points: rows by spheres, an azimuth with a range, and with an exactly known height an
        elevation.
        """
        lines, angles = self.lines, self.lines.angles
        std = lines.std[:, : angles.rows], lines.std[:, angles.rows : 2 * angles.rows]
        has, reach = angles.has_elevation > 0.0, self._reach(ball)
        azimuth = 1.0 / (np.sqrt(2.0 * np.pi) * std[0])
        sector = 2.0 * azimuth / (reach * reach)
        if lines.is_held:
            density = np.where(has, 0.0, sector)
        else:
            cone = azimuth / (np.sqrt(2.0 * np.pi) * std[1])
            density = np.where(has, 3.0 * cone / reach**3, sector / (2.0 * ball.radius[:, None]))
        if lines.measured_m is not None:
            ranged = np.isfinite(lines.measured_m)
            end = (
                0.0
                if lines.is_held
                else cone / (np.sqrt(2.0 * np.pi) * lines.std[:, 2 * angles.rows :][:, : angles.rows])
            )
            density = np.where(ranged, np.where(has, end, 0.0), density)
        if isinstance(lines, SphereLines):
            lines.spheres.place_in(density, np.zeros(lines.spheres.snapshot.shape))
        return density

    def on_ridge(self, k: int, ratio: FloatArray, *point: FloatArray) -> FloatArray:
        """Return the density over that (B, P): the volume per square radian and metre turns ``ratio`` into it."""
        if self.lines.is_held:
            return ratio
        angles, whole = self.lines.angles, self.lines.whole(point)
        at = slice(k, k + 1)
        seen = self.lines.seen(at, whole, self.lines.row_path(at, whole))
        distance = np.sqrt(seen.squared)
        with ignoring_overflow():
            if angles.in_tangent_plane:
                x, y, z = (part[:, k, None] for part in angles.directions())
                stretch = (x * seen[0] + y * seen[1] + z * seen[2]) / distance
            else:
                stretch = distance / seen.level
            density = np.where(angles.has_elevation[:, k, None] > 0.0, ratio * stretch, ratio)
            if self.lines.measured_m is not None:
                power = 3 if self.lines.is_lognormal else 2
                ranged = np.isfinite(self.lines.measured_m[:, k, None])
                density = np.where(ranged, density / distance**power, density)
        return np.where(np.isfinite(density), density, 0.0)

    def sample_ridge(self, ball: Ball, snapshot: IntArray, k: IntArray, normal: Point, uniform: Point) -> Point:
        """Return points (N,) about the ray of row ``k`` of a snapshot, as the direction's error is distributed.

        Rows without an elevation have points about their vertical half-plane, at the heights of the ball.
        """
        lines, angles, at = self.lines, self.lines.angles, (snapshot, k)
        reach, has = self._reach(ball)[at], angles.has_elevation[at] > 0.0
        std = lines.std[snapshot, k], lines.std[snapshot, angles.rows + k]
        az_cos, az_sin = angles.cos_azimuth[at], angles.sin_azimuth[at]
        azimuth = std[0] * normal[0]
        level = reach * np.sqrt(uniform[1])
        sector = _turned(az_cos, az_sin, level * np.cos(azimuth), level * np.sin(azimuth))
        if lines.is_held:
            return tuple(origin[at] + part for origin, part in zip(lines.origin, sector, strict=False))
        distance = reach * np.cbrt(uniform[2])
        if lines.measured_m is not None:
            measured, deviation = lines.measured_m[at], normal[2] * lines.std[snapshot, 2 * angles.rows + k]
            end = measured * np.exp(deviation) if lines.is_lognormal else measured + deviation
            distance = np.where(np.isfinite(measured), end, distance)
        rise = std[1] * normal[1]
        el_cos, el_sin = angles.cos_elevation[at], angles.sin_elevation[at]
        if angles.in_tangent_plane:
            ahead = np.sqrt(np.maximum(1.0 - azimuth**2 - rise**2, 0.0))
            along, across, up = el_cos * ahead - el_sin * rise, azimuth, el_sin * ahead + el_cos * rise
        else:
            steep_cos = el_cos * np.cos(rise) - el_sin * np.sin(rise)
            up = el_sin * np.cos(rise) + el_cos * np.sin(rise)
            along, across = steep_cos * np.cos(azimuth), steep_cos * np.sin(azimuth)
        cone = _turned(az_cos, az_sin, distance * along, distance * across)
        middle = self._middle_height(ball)[at] + ball.radius[snapshot] * (2.0 * uniform[2] - 1.0)
        vector = (
            np.where(has, cone[0], sector[0]),
            np.where(has, cone[1], sector[1]),
            np.where(has, distance * up, middle),
        )
        if lines.axes is not None:
            rows = [[part[at] for part in row] for row in lines.axes.rows]
            x, y, z = (reduce(np.add, [rows[i][axis] * vector[i] for i in range(3)]) for axis in range(3))
            vector = x, y, z
        return tuple(origin[at] + part for origin, part in zip(lines.origin, vector, strict=True))

    def at_zenith(self, *point: FloatArray) -> BoolArray:
        """Return to which rows (B, K) points (B,) are so nearly above or below that their azimuth is no Gaussian."""
        lines, whole = self.lines, self.lines.whole(point)
        zenith = np.zeros((point[0].shape[0], lines.rows), dtype=bool)
        with ignoring_overflow():
            for k in range(lines.rows):
                at = slice(k, k + 1)
                seen = lines.seen(at, whole, lines.row_path(at, whole))
                zenith[:, at] = lines.angles.at_zenith(at, seen, lines.std[:, lines.rows + k, None])
        return zenith

    def near_sensors(self, snapshot: IntArray, *point: FloatArray) -> BoolArray:
        """Return which rows (b, K, K) of some snapshots have different sensors that see points (B,) alike."""
        origin, range_m = [part[snapshot] for part in self.lines.origin], self.lines.range_m(*point)[snapshot]
        apart = reduce(np.add, [(part[:, :, None] - part[:, None]) ** 2 for part in origin])
        least = _ALIKE * np.minimum(range_m[:, :, None], range_m[:, None])
        return np.asarray((apart > 0.0) & (apart < least * least))

    def _middle_height(self, ball: Ball) -> FloatArray:
        """Return the heights (B, K) of the balls' centers over the sensors, along the sensors' own third axis."""
        offset = [middle[:, None] - origin for middle, origin in zip(ball.center, self.lines.origin, strict=True)]
        if self.lines.axes is None:
            return offset[2]
        return self.lines.axes.seen((offset[0], offset[1], offset[2]), slice(None))[2]

    def _reach(self, ball: Ball) -> FloatArray:
        """Return the distance (B, K) of the origins from the farthest points of the balls."""
        pairs = zip(ball.center, self.lines.origin, strict=False)
        return reduce(np.hypot, [middle[:, None] - origin for middle, origin in pairs]) + ball.radius[:, None]

    def _impossible(self, k: int, seen: Seen, whole: Vector) -> BoolArray:
        """Return which points (B,) row ``k`` can't be direct from."""
        angles = self.lines.angles
        along, squared = (
            angles.cos_azimuth[:, k] * seen.x[:, 0] + angles.sin_azimuth[:, k] * seen.y[:, 0],
            seen.level_squared,
        )
        if angles.in_tangent_plane:
            squared = seen.squared
            ahead = angles.cos_elevation[:, k] * along + angles.sin_elevation[:, k] * seen.z[:, 0]
            along = np.where(angles.has_elevation[:, k] > 0.0, ahead, along)
        impossible: BoolArray = (along <= 0.0) | (squared[:, 0] < self.squared_minimum)
        mirrors = self.lines.mirrors
        return impossible if mirrors is None else impossible | mirrors.row_beyond(k, *whole)


def _squared_angle(squared_sine: FloatArray) -> FloatArray:
    """Return squared angles by a series in their squared sines: 0.2 % short at 30 degrees, 2 % at 45."""
    series = squared_sine * (8.0 / 45.0)
    series += 1.0 / 3.0
    series *= squared_sine
    series += 1.0
    return squared_sine * series


def _turned(
    cosine: FloatArray, sine: FloatArray, along: FloatArray, across: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return x and y of vectors by their parts along and on the left of a direction."""
    return cosine * along - sine * across, sine * along + cosine * across
