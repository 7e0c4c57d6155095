"""Rows in space seen by reflection on spheres, and direct rows past opaque spheres, as flat arrays (N,).

Sensor, source and centre span a plane in which everything is the circle of `nlosctl.models.circle_rows`; Song, Willett,
Zhou 2013, Section 3. The regions A2 and A3 hold with the angle between sensor and source seen from the centre.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ignoring_division
from nlosctl.contract.scene import Scene, SphereReflector
from nlosctl.geometry.blocks import rows_of
from nlosctl.geometry.circular_reflection import all_points
from nlosctl.geometry.directions import Vector, cross, dot, length, scaled
from nlosctl.geometry.short_arc import short_arc_point
from nlosctl.geometry.spheres import SpherePath, central_plane, elevation_above_horizon, leave_sphere
from nlosctl.geometry.visibility import horizon_elevation, sees_by_reflection, sees_directly
from nlosctl.models.circle_rows import GROUND_TOLERANCE, free_legs, least_of, misplaced_sensors, move_inside
from nlosctl.models.selected_rows import SpaceRows
from nlosctl.models.space.sphere_tangents import SphereTangents

__all__ = ["OpaqueSphereRows", "SphereRows", "locate_opaque_spheres", "locate_sphere_rows", "sphere_table"]


@dataclass(frozen=True)
class SphereRows(SpaceRows):
    """N rows of a block whose wave is reflected by a sphere.

    ``blocker_radius`` is NaN where the sphere has none: then any of up to four paths may be the row's.
    ``least_elevation_rad`` is the horizon, or the scene's least elevation; NaN without a blocker. ``takes_any_path``
    marks rows that may take another path than that on the short arc: no blocker, or a sensor above it. Directions are
    in the coordinates of the batch: the ray is the measured unit direction, NaN in rows that give their azimuth alone,
    ``level`` that of the azimuth without elevation, ``aside`` the one a right angle to its left.
    """

    radius: FloatArray
    blocker_radius: FloatArray
    least_elevation_rad: FloatArray
    takes_any_path: BoolArray
    ray_x: FloatArray
    ray_y: FloatArray
    ray_z: FloatArray
    level: Vector
    aside: Vector
    tangents: SphereTangents

    @property
    def ray(self) -> Vector:
        """The measured directions."""
        return self.ray_x, self.ray_y, self.ray_z

    def paths_from(self, *point: FloatArray) -> SpherePath:
        """Return the path (N,) of each row from points, three arrays (B,) about the local origins.

        From a sensor on the blocker that on the short arc, the only one that can be free (Lemma 3). Of several possible
        paths the one seen nearest to the measured direction, free ones before blocked ones. NaN where the point or the
        sensor is not inside the sphere.
        """
        return self.paths_to(*self.about_center(*point))

    def paths_to(self, *source: FloatArray) -> SpherePath:
        """Return the same path (N,) of each row from a point of its own (N,) about its centre."""
        plane = central_plane(self.sensor, source)
        hit_x, hit_y = short_arc_point(*plane.points, self.radius)
        several = np.flatnonzero(self.takes_any_path)
        if several.size:
            some = plane.take(several)
            options = all_points(*some.points, self.radius[several])
            off = self._off_ray(several, some.path_by(*options).direction)
            blocked = ~free_legs(*options, *some.points, self.blocker_radius[several])
            hit_x[several], hit_y[several] = least_of(off + np.where(blocked, 2.0 * np.pi, 0.0), *options)
        return plane.path_by(hit_x, hit_y)

    def _off_ray(self, rows: IntArray, direction: Vector) -> FloatArray:
        """Return the angles (P, n) of directions from the measured ones of ``rows``, or of their azimuths alone."""
        ray = tuple(part[rows] for part in self.ray)
        apart = np.arccos(np.clip(dot(direction, ray), -1.0, 1.0))
        aside, level = (dot(direction, rows_of(axis, rows)) for axis in (self.aside, self.level))
        return np.where(np.isnan(ray[0]), np.abs(np.arctan2(aside, level)), apart)

    def upright(self) -> Vector:
        """Return the unit normals (N,) of the planes of centre, sensor and azimuth.

        Where the sensor's vertical leads to the centre all paths with that azimuth are in them.
        """
        normal = cross(self.sensor, self.level)
        with ignoring_division():
            return scaled(normal, 1.0 / length(normal))

    def axis_distance_m(self, *point: FloatArray) -> FloatArray:
        """Return the distances (N,) of points (B,) from the lines of centre and sensor: the width of an azimuth."""
        with ignoring_division():
            return length(cross(self.sensor, self.about_center(*point))) / length(self.sensor)

    def moved_inside(self, *point: FloatArray) -> tuple[FloatArray, ...]:
        """Return points that are moved, where they are not inside a row's sphere, as `move_inside` does."""
        return move_inside(self, self.radius, *point)

    def outside(self, path: SpherePath, *point: FloatArray) -> BoolArray:
        """Return which rows (N,) can't see their point (B,): not in the sphere, or not in A2 where it has a blocker.

        ``path`` is that of `paths_from` for the points.
        """
        limits = (self.radius, self.blocker_radius, self.least_elevation_rad)
        seen = sees_by_reflection(*path.plane.points, path.flat, *limits)
        return ~np.where(np.isnan(self.blocker_radius), np.isfinite(path.flat.bearing_rad), seen)

    def under_horizon(self) -> BoolArray:
        """Return which rows (N,) have a direction under their horizon, from where no wave can come."""
        return elevation_above_horizon(self.sensor, self.ray) < self.least_elevation_rad


@dataclass(frozen=True)
class OpaqueSphereRows(SpaceRows):
    """N direct rows about the centre of one opaque sphere; ``min_elevation_rad`` is -inf without a limit."""

    blocker_radius: FloatArray
    min_elevation_rad: FloatArray

    def outside(self, *point: FloatArray) -> BoolArray:
        """Return which rows (N,) can't see their point (B,) about the local origin: not in the region A3."""
        plane = central_plane(self.sensor, self.about_center(*point))
        return ~sees_directly(*plane.points, self.blocker_radius, self.min_elevation_rad)


def locate_sphere_rows(
    scene: Scene,
    reflector: IntArray,
    sensor: Vector,
    ray: Vector,
    level: Vector,
    aside: Vector,
    azimuth_share: FloatArray,
) -> SphereRows:
    """Return the sphere rows of a block (B, K), centres in the scene's coordinates.

    ``sensor``, ``ray`` (NaN without an elevation), ``level`` and ``aside`` are three arrays (B, K), ``azimuth_share``
    as in `SphereTangents`. Rows whose sensor is not inside the sphere, or under the blocker,
    get a sensor that is NaN: no path leads to it.
    """
    table = sphere_table(scene)
    measurement, snapshot = np.nonzero(((reflector >= 0) & np.isfinite(table[0])[reflector]).T)
    index = (snapshot, measurement)
    *center, radius, blocker, least = (column[reflector[index]] for column in table)
    about = tuple(part[index] - middle for part, middle in zip(sensor, center, strict=True))
    distance = length(about)
    outside, under = misplaced_sensors(distance, radius, blocker)
    inside = np.where(outside | under, np.nan, 0.0)
    mine, ahead, along = (tuple(part[index] for part in vector) for vector in (ray, level, aside))
    hit = leave_sphere(about, mine, radius)
    return SphereRows(
        **_indices(reflector, snapshot, measurement),
        **_named("sensor", tuple(part + inside for part in about)),
        **_named("center", tuple(center)),
        **_named("ray", mine),
        tangents=SphereTangents.of(hit, mine, along, azimuth_share[index]),
        level=ahead,
        aside=along,
        radius=radius,
        blocker_radius=blocker,
        least_elevation_rad=np.fmax(horizon_elevation(distance, blocker), least),
        takes_any_path=np.isnan(blocker) | (distance > blocker * (1.0 + GROUND_TOLERANCE)),
    )


def locate_opaque_spheres(scene: Scene, reflector: IntArray, sensor: Vector) -> tuple[OpaqueSphereRows, ...]:
    """Return the direct rows of a block (B, K), once about each opaque sphere of the scene (centres in its frame).

    Layers about the same opaque sphere count once, with the least of their elevations.
    """
    measurement, snapshot = np.nonzero((reflector < 0).T)
    blockers: dict[tuple[float, ...], float] = {}
    for sphere in scene.reflectors:
        if isinstance(sphere, SphereReflector) and sphere.blocker_radius is not None:
            least = -np.inf if sphere.min_elevation_deg is None else np.radians(sphere.min_elevation_deg)
            key = (*sphere.center, sphere.blocker_radius)
            blockers[key] = min(blockers.get(key, np.inf), least)
    here = tuple(part[snapshot, measurement] for part in sensor)

    def fill(value: float) -> FloatArray:
        return np.full(snapshot.shape, value)

    return tuple(
        OpaqueSphereRows(
            **_indices(reflector, snapshot, measurement),
            **_named("sensor", tuple(part - middle for part, middle in zip(here, center, strict=True))),
            **_named("center", tuple(fill(middle) for middle in center)),
            blocker_radius=fill(radius),
            min_elevation_rad=fill(least),
        )
        for (*center, radius), least in blockers.items()
        if snapshot.size
    )


def sphere_table(scene: Scene) -> tuple[FloatArray, ...]:
    """Return centre x, y, z, radius, blocker's radius and least elevation of each reflector; NaN if not a sphere."""
    rows = [
        [
            *reflector.center,
            reflector.radius,
            np.nan if reflector.blocker_radius is None else reflector.blocker_radius,
            np.nan if reflector.min_elevation_deg is None else np.radians(reflector.min_elevation_deg),
        ]
        if isinstance(reflector, SphereReflector)
        else [np.nan] * 6
        for reflector in scene.reflectors
    ]
    return tuple(np.array(rows, dtype=np.float64).reshape(-1, 6).T.copy())


def _indices(reflector: IntArray, snapshot: IntArray, measurement: IntArray) -> dict[str, Any]:
    return {"shape": reflector.shape, "snapshot": snapshot, "measurement": measurement}


def _named(name: str, vector: Vector) -> dict[str, Any]:
    """Return the arrays of a vector by the names of their fields."""
    return {f"{name}_{axis}": part for axis, part in zip("xyz", vector, strict=True)}
