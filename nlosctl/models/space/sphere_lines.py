"""Bearings in space, some of them seen by reflection on spheres, or past opaque ones.

A row by a sphere is unfolded at the tangent plane where its measured direction meets the sphere, as on a circle; its
residuals and their derivatives are those of the true path. The mathematics is in docs/three-dimensions.md.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray
from nlosctl.geometry.directions import scaled
from nlosctl.geometry.planes import reflect_vector
from nlosctl.geometry.spheres import SpherePath
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.sight import Expansion
from nlosctl.models.space.lines import SpaceLines
from nlosctl.models.space.measured_angles import Seen, Vector
from nlosctl.models.space.sphere_rows import OpaqueSphereRows, SphereRows

__all__ = ["SphereLines"]


class RowPath(NamedTuple):
    """The paths (N,) by spheres of one row: its snapshots (n,), and of each of their points (N,) the path.

    ``mirror`` is the normal of the tangent plane that unfolds the row, ``exists`` where the path leads to the point.
    """

    snapshot: IntArray
    by_sphere: SpherePath
    mirror: tuple[FloatArray, ...]
    exists: BoolArray


@dataclass(frozen=True, kw_only=True)
class SphereLines(SpaceLines):
    """Rays (B, K) of `SpaceLines`, with the rows by ``spheres`` and the direct rows past each opaque sphere.

    Where no path leads to a point, or (seen from the blocker) it lies beyond a focus, the derivatives of the row are
    NaN and its residuals those of the unfolded ray; NaN too if ``refuses`` is set, so that a search does not go there.
    """

    spheres: SphereRows
    opaque: tuple[OpaqueSphereRows, ...]
    refuses: bool = False

    def _normals_of_rows(self) -> tuple[tuple[FloatArray, ...], tuple[FloatArray, ...]]:
        """Return the normals of `SpaceLines`, of rows by spheres in the two directions that a fit takes.

        An azimuth alone has that of the upright plane of its initial estimates.
        """
        both = super()._normals_of_rows()
        spheres, has_plane = self.spheres, self.spheres.tangents.has_plane
        first, second = spheres.tangents.directions()
        upright = zip(first, spheres.upright(), strict=True)
        first = tuple(np.where(has_plane, *pair) for pair in upright)
        for normals, directions in zip(both, (first, second), strict=True):
            for block, part in zip(normals, directions, strict=True):
                spheres.place_in(block, part)
        return both

    def tube_width_m(self, *point: FloatArray) -> FloatArray:
        """Return by how many metres (B, M) each plane moves per unit of its scalar at points; 1 of a height."""
        widths = super().tube_width_m(*point)
        stds = self._sphere_stds()
        spreads = self.spheres.tangents.spreads_m(self.spheres.pick_from(super().range_m(*point)), *stds)
        has_plane = self.spheres.tangents.has_plane
        instead = self.spheres.axis_distance_m(*self.whole(point)), np.ones(has_plane.shape)
        for first, spread, std, other in zip((0, self.rows), spreads, stds, instead, strict=True):
            self.spheres.place_in(widths[:, first : first + self.rows], np.where(has_plane, spread / std, other))
        return widths

    def stansfield_width_m(self, *point: FloatArray) -> FloatArray:
        """Return the same: the weights of Stansfield's fit in space have the true widths."""
        return self.tube_width_m(*point)

    def based_at(self, *point: FloatArray) -> SphereLines:
        """Return the rays with planes of the rows by spheres turned so that their errors at points are independent."""
        range_m = self.spheres.pick_from(super().range_m(*point))
        tangents = self.spheres.tangents.based_at(range_m, *self._sphere_stds())
        return replace(self, spheres=replace(self.spheres, tangents=tangents))

    def paths_from(self, *point: FloatArray) -> SpherePath:
        """Return the paths of the rows by spheres from points, for the other functions of the same points."""
        return self.spheres.paths_from(*self.whole(point))

    def inside_circles(self, *point: FloatArray) -> tuple[FloatArray, ...]:
        """Return points, those that are not inside a row's sphere moved into it."""
        return self.spheres.moved_inside(*self.whole(point))[: self.unknowns]

    def _blocks(self) -> Iterator[slice]:
        """Yield the rows one by one."""
        return (slice(k, k + 1) for k in range(self.rows))

    def row_path(self, at: slice, whole: Vector, paths: SpherePath | None = None) -> RowPath | None:
        """Return the paths of one row by spheres from points (B,) or (B, P), taken from those of all rows if given."""
        part = self.spheres.of_measurement(at.start)
        snapshot = part.snapshot
        if not snapshot.size:
            return None
        if paths is not None:
            path = paths.take(self.spheres.span(at.start))
        else:
            points = whole[0].size // whole[0].shape[0]
            part = part if points == 1 else part.picked(np.repeat(np.arange(snapshot.size), points))
            about = (axis[snapshot].ravel() - middle for axis, middle in zip(whole, part.center, strict=True))
            path = part.paths_to(*about)
        exists = np.isfinite(path.flat.bearing_rad) & ((path.flat.tube_width_m > 0.0) | part.takes_any_path)
        return RowPath(snapshot, path, part.tangents.normal, exists)

    def seen(self, at: slice, whole: Vector, path: RowPath | None = None) -> Seen:
        """Return the vectors from one sensor to points (B,) or (B, P) as it sees them, as long as their paths."""
        if path is None:
            return super().seen(at, whole)
        vector = self._from_origins(at, whole)
        for part, along in zip(vector, reflect_vector(path.by_sphere.vector, path.mirror), strict=True):
            shape = (path.snapshot.shape[0], part.shape[1])
            instead = np.nan if self.refuses else part[path.snapshot]
            part[path.snapshot] = np.where(path.exists.reshape(shape), along.reshape(shape), instead)
        return self._as_seen(vector, at)

    def slopes_at(
        self, at: slice, seen: Seen, path: RowPath | None = None, extra_m2: FloatArray | None = None
    ) -> tuple[tuple[FloatArray, ...], tuple[FloatArray, ...]]:
        """Return the derivatives (B, 1) of `SpaceLines` of one row at points (B,), along the paths by spheres."""
        of_azimuth, of_rise = super().slopes_at(at, seen, None, extra_m2)
        if path is None:
            return of_azimuth, of_rise
        if len(of_azimuth) < len(of_rise):
            of_azimuth = (*of_azimuth, np.zeros(seen.x.shape))
        without_weight = np.isinf(self.std[path.snapshot, at.start])
        scale = np.where(without_weight, 0.0, np.where(path.exists, path.by_sphere.flat.length_m, np.nan))
        for slopes in (of_azimuth, of_rise):
            x, y, z = (slope[path.snapshot, 0] for slope in slopes)
            along = scaled(path.by_sphere.gradient(reflect_vector((x, y, z), path.mirror)), scale)
            for slope, part in zip(slopes, along, strict=True):
                slope[path.snapshot, 0] = np.where(without_weight, 0.0, part)
        return of_azimuth, of_rise

    def last_leg(self, at: slice, whole: Vector, path: RowPath | None) -> Vector:
        """Return vectors (B, 1) from the sphere to points (B,), as long as the whole paths of one row."""
        vector = super().last_leg(at, whole, None)
        if path is not None:
            for part, along in zip(vector, path.by_sphere.last_leg, strict=True):
                instead = np.nan if self.refuses else part[path.snapshot, 0]
                part[path.snapshot, 0] = np.where(path.exists, along, instead)
        return vector

    def range_m(self, *point: FloatArray) -> FloatArray:
        """Return the lengths (B, K) of the paths from points; unfolded where no path exists."""
        range_m = super().range_m(*point)
        along = self.spheres.paths_from(*self.whole(point)).flat.length_m
        self.spheres.place_in(range_m, np.where(np.isfinite(along), along, self.spheres.pick_from(range_m)))
        return range_m

    def bending_at(self, at: slice, seen: Seen, azimuth: FloatArray, rise: FloatArray) -> SymmetricMatrix:
        """Return the sums (B, 1) of `SpaceLines` of one row, 0 where it is by a sphere: they are not computed."""
        bend = super().bending_at(at, seen, azimuth, rise)
        snapshot = self.spheres.snapshot[self.spheres.span(at.start)]
        for part in bend:
            part[snapshot] = 0.0
        return bend

    def expanded(self, *point: FloatArray) -> Iterator[Expansion]:
        """Yield the expansions of `SpaceLines` with NaN for second derivatives: no matrix counts as exact."""
        for half, gradient, gauss, _ in super().expanded(*point):
            yield half, gradient, gauss, gauss.map(lambda part: np.full(part.shape, np.nan))

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

    def first_leg_m(self) -> FloatArray:
        """Return how far (B, K) along unfolded rays they meet the sphere; 0 of other rows."""
        leg = super().first_leg_m()
        self.spheres.place_in(leg, self.spheres.tangents.first_leg_m)
        return leg

    @property
    def has_azimuth_alone(self) -> bool:
        """Whether a row by a sphere has no elevation: its plane is for initial estimates alone."""
        return not self.spheres.tangents.has_plane.all()

    def _sphere_stds(self) -> tuple[FloatArray, FloatArray]:
        """Return the stds (N,) of azimuths and elevations of the rows by spheres."""
        count = self.rows
        return self.spheres.pick_from(self.std[:, :count]), self.spheres.pick_from(self.std[:, count : 2 * count])
