"""Bearings in space, some of them seen by reflection on spheres, or past opaque ones.

A row by a sphere is unfolded at the tangent plane where its measured direction meets the sphere, as on a circle; its
residuals and their derivatives are those of the true path. The mathematics is in docs/three-dimensions.md.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray
from nlosctl.geometry.blocks import rows_of
from nlosctl.geometry.directions import scaled
from nlosctl.geometry.planes import reflect_vector
from nlosctl.geometry.spheres import SpherePath
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.space.lines import SpaceLines
from nlosctl.models.space.measured_angles import Vector
from nlosctl.models.space.sphere_rows import OpaqueSphereRows, SphereRows

__all__ = ["SphereLines"]


@dataclass(frozen=True, kw_only=True)
class SphereLines(SpaceLines):
    """Rays (B, K) of `SpaceLines`, with the rows by ``spheres`` and the direct rows past each opaque sphere.

    Where no path leads to a point, or (seen from the blocker) it lies beyond a focus, the derivatives of the row are
    NaN and its residuals those of the unfolded ray; NaN too if ``refuses`` is set, so that a search does not go there.
    """

    spheres: SphereRows
    opaque: tuple[OpaqueSphereRows, ...]
    refuses: bool = False

    def normals(self) -> Vector:
        """Return the normals of `SpaceLines`, of rows by spheres in the two directions that a fit takes."""
        x, y, z = (part.copy() for part in super().normals())
        normals = (x, y, z)
        for first, directions in zip((0, self.rows), self.spheres.tangents.directions(), strict=True):
            for block, part in zip(normals, directions, strict=True):
                self.spheres.place_in(block[:, first : first + self.rows], part)
        return normals

    def tube_width_m(self, *point: FloatArray) -> FloatArray:
        """Return by how many metres (B, M) each plane moves per unit of its scalar at points; 1 of a height."""
        widths = super().tube_width_m(*point)
        stds = self._sphere_stds()
        spreads = self.spheres.tangents.spreads_m(self.spheres.pick_from(self.range_m(*point)), *stds)
        has_plane = self.spheres.tangents.has_plane
        for first, spread, std in zip((0, self.rows), spreads, stds, strict=True):
            self.spheres.place_in(widths[:, first : first + self.rows], np.where(has_plane, spread / std, 1.0))
        return widths

    def stansfield_width_m(self, *point: FloatArray) -> FloatArray:
        """Return the same: the weights of Stansfield's fit in space have the true widths."""
        return self.tube_width_m(*point)

    def based_at(self, *point: FloatArray) -> SphereLines:
        """Return the rays with planes of the rows by spheres turned so that their errors at points are independent."""
        range_m = self.spheres.pick_from(self.range_m(*point))
        tangents = self.spheres.tangents.based_at(range_m, *self._sphere_stds())
        return replace(self, spheres=replace(self.spheres, tangents=tangents))

    def paths_from(self, *point: FloatArray) -> SpherePath:
        """Return the paths of the rows by spheres from points, for the other functions of the same points."""
        return self.spheres.paths_from(*self.whole(point))

    def inside_circles(self, *point: FloatArray) -> tuple[FloatArray, ...]:
        """Return points, those that are not inside a row's sphere moved into it."""
        return self.spheres.moved_inside(*self.whole(point))[: self.unknowns]

    def compared(
        self, whole: Vector, k: int, extra_m2: FloatArray | None, paths: SpherePath | None
    ) -> Iterator[tuple[FloatArray, Vector]]:
        """Yield residual (B,) and its derivatives of azimuth and elevation of row ``k``, along the paths by spheres."""
        paths = self.spheres.paths_from(*whole) if paths is None else paths
        rows = np.arange(*np.searchsorted(self.spheres.measurement, (k, k + 1)))
        if not rows.size:
            yield from super().compared(whole, k, extra_m2, None)
            return
        path, snapshot = paths.take(rows), self.spheres.snapshot[rows]
        mirror = rows_of(self.spheres.tangents.normal, rows)
        exists = np.isfinite(path.flat.bearing_rad)
        exists &= (path.flat.tube_width_m > 0.0) | self.spheres.takes_any_path[rows]
        x, y, z = (part - origin[:, k] for part, origin in zip(whole, self.origin, strict=True))
        for part, along in zip((x, y, z), reflect_vector(path.vector, mirror), strict=True):
            part[snapshot] = np.where(exists, along, np.nan if self.refuses else part[snapshot])
        seen = (x, y, z) if self.axes is None else self.axes.seen((x, y, z), k)
        without_weight = np.isinf(self.std[snapshot, k])
        scale = np.where(without_weight, 0.0, np.where(exists, path.flat.length_m, np.nan))
        for residual, slopes in self.angles.compare(k, seen, extra_m2):
            x, y, z = (part.copy() for part in self._from_sensor(slopes, k))
            turned = reflect_vector((x[snapshot], y[snapshot], z[snapshot]), mirror)
            for part, slope in zip((x, y, z), scaled(path.gradient(turned), scale), strict=True):
                part[snapshot] = np.where(without_weight, 0.0, slope)
            yield residual, (x, y, z)

    def bending(self, *at: Any) -> SymmetricMatrix:
        """Return NaN: second derivatives along paths by spheres are not computed, and no matrix counts as exact."""
        return SymmetricMatrix.full(at[0].shape, np.nan, self.unknowns)

    def unseen(self, *point: FloatArray, paths: SpherePath | None = None) -> BoolArray:
        """Return to which rows (B, K) a point cannot be visible in the scene: regions A2 and A3 of spheres too."""
        unseen, whole = super().unseen(*point), self.whole(point)
        for rows in self.opaque:
            rows.place_in(unseen, rows.pick_from(unseen) | rows.outside(*whole))
        path = self.spheres.paths_from(*whole) if paths is None else paths
        self.spheres.place_in(unseen, self.spheres.outside(path, *whole))
        return unseen

    def under_horizon(self) -> BoolArray:
        """Return which rows (B, K) have a direction under the horizon of an opaque sphere: no wave comes from there."""
        under = super().under_horizon()
        self.spheres.place_in(under, self.spheres.under_horizon())
        return under

    @property
    def has_azimuth_alone(self) -> bool:
        """Whether a row by a sphere has no elevation, so that it has no plane for a linear fit."""
        return not self.spheres.tangents.has_plane.all()

    def _sphere_stds(self) -> tuple[FloatArray, FloatArray]:
        """Return the stds (N,) of azimuths and elevations of the rows by spheres."""
        count = self.rows
        return self.spheres.pick_from(self.std[:, :count]), self.spheres.pick_from(self.std[:, count : 2 * count])
