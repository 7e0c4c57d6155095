"""Azimuths of geodesics on the earth as rows of a mixture, and the points where two of them cross."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, sqrt

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, Point, ignoring_invalid
from nlosctl.geometry.blocks import RowBlock
from nlosctl.geometry.regions import Ball
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.space.geodesic_lines import GeodesicLines, in_plane
from nlosctl.solvers.bearings.ray_crossings import Candidates, gather
from nlosctl.solvers.optimization.problem import RowDerivatives

__all__ = ["DirectGeodesics", "cross_geodesics"]

_EARTH_RADIUS_M = 6371e3
"""Of a sphere as large as the earth: what geodesics that part are apart, to half a per cent."""

_FARTHEST_M = 0.9 * pi * _EARTH_RADIUS_M
"""Points along a geodesic are not taken from beyond this, near the antipode where all of a sensor's meet again."""


@dataclass(frozen=True)
class DirectGeodesics(RowBlock):
    """Rows (B, K) of azimuths with Gaussian errors, truncated to a right angle on either side.

    A row can't be direct from closer than the minimum range (B,) to its sensor. Second derivatives are Gauss-Newton's.
    """

    lines: GeodesicLines
    minimum_range_m: FloatArray

    @property
    def dimension(self) -> int:
        """The number of unknown coordinates: two, on the ground."""
        return self.lines.unknowns

    def scalars(self) -> IntArray:
        """Return the number of scalars (B, K) of each row: one."""
        return np.ones(self.lines.azimuth.shape, dtype=np.int64)

    def half_chi_square(self, k: int, *point: FloatArray) -> FloatArray:
        """Return half the chi-square of row ``k`` at points (B, P); infinite where it can't be direct."""
        residual, range_m = self.lines.row_seen(k, *point)
        half: FloatArray = 0.5 * (residual / self.lines.std[:, k, None]) ** 2
        np.copyto(half, np.inf, where=self._impossible(residual, range_m))
        return half

    def derivatives(self, k: int, *point: FloatArray) -> RowDerivatives:
        """Return half the chi-square of row ``k`` at points (B,), and its derivatives; 0 where impossible."""
        residual, range_m = self.lines.row_seen(k, *point)
        std = self.lines.std[:, k]
        impossible, scaled = self._impossible(residual, range_m), residual / std
        slopes = [np.where(impossible, 0.0, -part / std) for part in self.lines.row_gradient(k, *point)]
        gauss, half = SymmetricMatrix.outer(*slopes), np.where(impossible, np.inf, 0.5 * scaled * scaled)
        scaled = np.where(impossible, 0.0, scaled)
        return RowDerivatives(half, tuple(scaled * slope for slope in slopes), gauss, gauss)

    def ridges(self, ball: Ball) -> FloatArray:
        """Return the density (B, K) of the points of `sample_ridge` per radian and metre, over the distance."""
        reach: FloatArray = self._reach(ball)
        return sqrt(2.0 / pi) / (self.lines.std * reach * reach)

    def on_ridge(self, k: int, ratio: FloatArray, *point: FloatArray) -> FloatArray:
        """Return the density over that (B, P): the ground between geodesics and the plane turn ``ratio`` into it."""
        range_m = self.lines.row_seen(k, *point)[1]
        return np.where(range_m < _FARTHEST_M, ratio * _spread(np.hypot(*point)) / _spread(range_m), 0.0)

    def sample_ridge(self, ball: Ball, snapshot: IntArray, k: IntArray, normal: Point, uniform: Point) -> Point:
        """Return points (N,) about the geodesic of row ``k`` of a snapshot, as the azimuth's error is distributed."""
        lines, at = self.lines, (snapshot, k)
        azimuth = lines.azimuth[at] - lines.std[at] * normal[0]
        return lines.ends(snapshot, k, azimuth, self._reach(ball)[at] * np.sqrt(uniform[1]))

    def _reach(self, ball: Ball) -> FloatArray:
        """Return the distance (B, K) of the sensors from the farthest points of the discs."""
        east, north = (own - middle[:, None] for own, middle in zip(self.lines.sensors_m, ball.center, strict=True))
        return np.minimum(np.hypot(east, north) + ball.radius[:, None], _FARTHEST_M)

    def _impossible(self, residual: FloatArray, range_m: FloatArray) -> BoolArray:
        least = self.minimum_range_m if range_m.ndim == 1 else self.minimum_range_m[:, None]
        with ignoring_invalid():
            possible: BoolArray = (np.abs(residual) < 0.5 * pi) & (range_m >= least)
        return ~possible


def cross_geodesics(lines: GeodesicLines, first: IntArray, second: IntArray) -> Candidates:
    """Return where the geodesics of pairs of rows cross, to some metres; not valid where that is behind a sensor.

    Great circles of a sphere cross near there, and one step of Newton's method leads to the ellipsoid. ``first`` and
    ``second`` are (P,), the same pairs for all snapshots, or (B, P).
    """
    rows = [lines.sensor_latitude, lines.sensor_longitude, lines.azimuth, lines.std]
    latitude, longitude, azimuth, std = (
        np.stack([gather(part, index).ravel() for index in (first, second)], axis=1) for part in rows
    )
    here = np.zeros(std.shape[0])
    pairs = GeodesicLines(here, here, latitude, longitude, azimuth, std, here).about_crossing(rounds=1)
    with ignoring_invalid():
        valid = (np.abs(pairs.residual(here, here)) < 0.5 * pi).all(axis=1)
    shape = lines.latitude.shape[0], first.shape[-1]
    here, there = (np.repeat(part, shape[1]) for part in (lines.latitude, lines.longitude))
    east, north = in_plane(here, there, pairs.latitude, pairs.longitude)
    valid &= np.isfinite(east)
    point = (np.where(valid, part, 0.0).reshape(shape) for part in (east, north))
    return Candidates(tuple(point), valid.reshape(shape))


def _spread(distance_m: FloatArray) -> FloatArray:
    """Return how far apart geodesics of a point are after a distance, over what they were in a plane."""
    return np.sinc(distance_m / (pi * _EARTH_RADIUS_M))
