"""Bearings in space: azimuths, with elevations or without, of direct rows and of rows seen in plane mirrors.

Residuals of angles, ranges and heights at points, with their first and second derivatives.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from nlosctl.arrays import FloatArray, ignoring_overflow
from nlosctl.contract.batches import BearingBatch
from nlosctl.geometry.blocks import add_measurements, column_blocks, side_by_side
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.sight import Expansion, RayResiduals
from nlosctl.models.space.measured_angles import Seen, Vector
from nlosctl.models.space.measured_ranges import compare_range
from nlosctl.models.space.unfolded_rays import UnfoldedRays

__all__ = ["SpaceLines"]


@dataclass(frozen=True)
class SpaceLines(UnfoldedRays):
    """The measured scalars of rays in space and what points predict for them; see `Sight`."""

    def with_ranges(self, range_m: FloatArray, std_m: FloatArray, *, lognormal: bool) -> SpaceLines:
        """Return the rays with ranges (B, K) as further scalars, NaN in rows without one."""
        known = np.where(np.isnan(range_m), 1.0, std_m / range_m if lognormal else std_m)
        parts = (self.std[:, : self.of_rows], known, self.std[:, self.of_rows :])
        std = side_by_side(*parts)
        return replace(self, std=std, measured_m=range_m, is_lognormal=lognormal)

    def paths_from(self, *point: FloatArray) -> Any:
        """Return nothing: the functions of the same points share no paths."""

    def row_path(self, at: slice, whole: Vector, paths: Any = None) -> Any:
        """Return what the functions of the rows ``at`` and of points share, from `paths_from` if given: nothing."""

    def expanded(self, *point: FloatArray) -> Iterator[Expansion]:
        """Yield the expansions of rows, some at a time, and of a height."""
        whole, paths = self.whole(point), self.paths_from(*point)
        for at in self._blocks():
            yield self.expansion(at, whole, self.row_path(at, whole, paths))
        for residual, slopes in self._compare_height(whole):
            gradient = tuple(residual * slope for slope in slopes)
            yield 0.5 * residual * residual, gradient, SymmetricMatrix.outer(*slopes), None

    def expansion(self, at: slice, whole: Vector, path: Any = None) -> Expansion:
        """Return the expansion of the rows ``at`` at points (B,) with their height."""
        seen, unknowns, scales = self.seen(at, whole, path), self.unknowns, self._scales(at)
        azimuth, rise = map(np.multiply, self.angles.residuals(at, seen), scales)
        half = azimuth * azimuth
        half += rise * rise
        of_azimuth, of_rise = (slopes[:unknowns] for slopes in self.slopes_at(at, seen, path))
        gradient, gauss = [rise * slope for slope in of_rise], SymmetricMatrix.outer(*of_rise)
        for total, slope in zip(gradient, of_azimuth, strict=False):
            total += azimuth * slope
        gauss += SymmetricMatrix.outer(*of_azimuth)
        azimuth *= scales[0]
        rise *= scales[1]
        bend = self.bending_at(at, seen, azimuth, rise)
        if self.measured_m is not None:
            residual, slopes, bend_of_range = self.range_terms(at, whole, path)
            half += residual * residual
            for total, slope in zip(gradient, slopes, strict=False):
                total += residual * slope
            gauss += SymmetricMatrix.outer(*slopes[:unknowns])
            bend.add_scaled(bend_of_range, residual)
        half *= 0.5
        return half, tuple(gradient), gauss, SymmetricMatrix(*bend.parts[: len(gauss.parts)])

    def _blocks(self) -> Iterator[slice]:
        """Yield the rows that are compared at a time."""
        return column_blocks(self.origin[0].shape)

    def _compare_height(self, whole: Vector) -> Iterator[tuple[FloatArray, tuple[FloatArray, ...]]]:
        """Yield residual (B, 1) over std and derivatives of a measured height."""
        if self.height is not None:
            slopes = self.height.scaled_slopes(*whole)
            yield -self.height.scaled_residual(*whole)[:, None], tuple(-slope[:, None] for slope in slopes)

    def _scales(self, at: slice) -> tuple[FloatArray, FloatArray]:
        """Return the inverse stds (B, C) of azimuths and of elevations; 0 without an elevation."""
        return self._inverse_std[:, self._scalars(0, at)], self._inverse_std[:, self._scalars(1, at)]

    @cached_property
    def _inverse_std(self) -> FloatArray:
        inverse = 1.0 / self.std
        inverse[:, self._scalars(1)] *= self.angles.has_elevation
        return inverse

    def slopes_at(
        self, at: slice, seen: Seen, path: Any = None, extra_m2: FloatArray | None = None
    ) -> tuple[tuple[FloatArray, ...], tuple[FloatArray, ...]]:
        """Return the derivatives (B, C) of the residuals of azimuths and elevations over their stds.

        Those of azimuths may lack z.
        """
        of_azimuth, of_rise = self.angles.slopes(at, seen, self._scales(at), extra_m2)
        return self._from_sensor(of_azimuth, at), self._from_sensor(of_rise, at)

    def bending_at(self, at: slice, seen: Seen, azimuth: FloatArray, rise: FloatArray) -> SymmetricMatrix:
        """Return the sums (B, C) of the second derivatives of both residuals times ``azimuth`` and ``rise``."""
        bend = self.angles.bending(at, seen, azimuth, rise)
        return bend if self.axes is None else self.axes.unfolded_matrix(bend, at)

    def range_terms(self, at: slice, whole: Vector, path: Any) -> tuple[FloatArray, Vector, SymmetricMatrix]:
        """Return residuals (B, C) over std, derivatives and second derivatives of ranges; 0 in rows without one."""
        assert self.measured_m is not None  # noqa: S101 - asked for where there are ranges
        leg, std = self.last_leg(at, whole, path), self.std[:, self._scalars(2, at)]
        return compare_range(leg, self.measured_m[:, at], std, is_lognormal=self.is_lognormal)

    def last_leg(self, at: slice, whole: Vector, path: Any) -> Vector:
        """Return vectors (B, C) in the direction in which paths arrive at points (B,), as long as the paths."""
        return self._from_origins(at, whole)

    def residual(self, *point: FloatArray, paths: Any = None) -> FloatArray:
        """Return measured minus predicted scalars (B, M); 0 in rows without an elevation or a range."""
        residual, whole = np.empty(self.std.shape, order="F"), self.whole(point)
        paths = self.paths_from(*point) if paths is None else paths
        for at in self._blocks():
            path = self.row_path(at, whole, paths)
            for kind, part in enumerate(self.angles.residuals(at, self.seen(at, whole, path))):
                residual[:, self._scalars(kind, at)] = part
            residual[:, self._scalars(1, at)] *= self.angles.has_elevation[:, at]
            if self.measured_m is not None:
                ranges = self._scalars(2, at)
                residual[:, ranges] = self.range_terms(at, whole, path)[0] * self.std[:, ranges]
        for scaled, _ in self._compare_height(whole):
            residual[:, -1:] = scaled * self.std[:, -1:]
        return residual

    def slopes(
        self, *point: FloatArray, paths: Any = None, extra_m2: FloatArray | None = None
    ) -> tuple[FloatArray, ...]:
        """Return the derivatives (B, M) of the residuals over their stds.

        With ``extra_m2`` (B,) squared distances of angles are that much larger.
        """
        slopes = tuple(np.zeros(self.std.shape, order="F") for _ in point)
        for scalars, parts in self._scaled_slopes(point, paths, extra_m2):
            for block, part in zip(slopes, parts, strict=False):
                block[:, scalars] = part
        return slopes

    def _scaled_slopes(
        self, point: tuple[FloatArray, ...], paths: Any, extra_m2: FloatArray | None
    ) -> Iterator[tuple[slice, tuple[FloatArray, ...]]]:
        """Yield some scalars at a time and their derivatives (B, C) over their stds."""
        whole, paths = self.whole(point), self.paths_from(*point) if paths is None else paths
        for at in self._blocks():
            path = self.row_path(at, whole, paths)
            slopes = self.slopes_at(at, self.seen(at, whole, path), path, extra_m2)
            for kind, parts in enumerate(slopes):
                yield self._scalars(kind, at), parts[: self.unknowns]
            if self.measured_m is not None:
                yield self._scalars(2, at), self.range_terms(at, whole, path)[1][: self.unknowns]
        for _, parts in self._compare_height(whole):
            yield slice(self.of_rows, self.of_rows + 1), parts

    def information(self, *point: FloatArray, paths: Any = None, extra_m2: FloatArray | None = None) -> SymmetricMatrix:
        """Return the Fisher information (B,) of points; ``extra_m2`` as in `slopes`."""
        total = SymmetricMatrix.full(point[0].shape, 0.0, len(point))
        with ignoring_overflow():
            for _, parts in self._scaled_slopes(point, paths, extra_m2):
                total.add_gram(*parts)
        return total

    def ray_residuals(self, *point: FloatArray, paths: Any = None) -> RayResiduals:
        """Return distances and chi-square of points, and where they are nearly above or below a row's sensor."""
        whole, shape = self.whole(point), point[0].shape
        paths = self.paths_from(*point) if paths is None else paths
        nearest, farthest, chi_square = np.full(shape, np.inf), np.zeros(shape), np.zeros(shape)
        behind, zenith = np.zeros(shape, dtype=bool), np.zeros(shape, dtype=bool)
        with ignoring_overflow():
            for at in self._blocks():
                straight, path = self.seen(at, whole), self.row_path(at, whole, paths)
                np.minimum(nearest, straight.squared.min(axis=1), out=nearest)
                np.maximum(farthest, straight.squared.max(axis=1), out=farthest)
                behind |= (self.angles.along_m(at, straight) < 0.0).any(axis=1)
                zenith |= self.angles.at_zenith(at, straight, self.std[:, self._scalars(1, at)]).any(axis=1)
                seen = straight if path is None else self.seen(at, whole, path)
                azimuth, rise = map(np.multiply, self.angles.residuals(at, seen), self._scales(at))
                squares = azimuth * azimuth
                squares += rise * rise
                if self.measured_m is not None:
                    residual = self.range_terms(at, whole, path)[0]
                    squares += residual * residual
                add_measurements(chi_square, squares)
            for residual, _ in self._compare_height(whole):
                add_measurements(chi_square, residual * residual)
        return RayResiduals(np.sqrt(nearest), np.sqrt(farthest), behind, chi_square, zenith)

    def residuals(self, batch: BearingBatch, *point: FloatArray) -> dict[str, FloatArray]:
        """Return measured minus predicted azimuths and elevations (B, K), NaN without one, and those of ranges."""
        plain = replace(self, angles=replace(self.angles, in_tangent_plane=False)).residual(*point)
        rise = np.where(self.angles.has_elevation > 0.0, plain[:, self.rows : 2 * self.rows], np.nan)
        columns = {"residual_rad": plain[:, : self.rows], "residual_elevation_rad": rise}
        if batch.range_m is not None:
            columns["residual_m"] = batch.range_m - self.range_m(*point)
        return columns
