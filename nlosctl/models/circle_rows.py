"""Rows seen by reflection on circles: the true path of each row; of bearings the residual and gradient.

Song, Willett, Zhou 2013, Section 3. The rows of a block (B, K) that name a circle are stored as flat arrays (N,).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import reduce
from typing import Self

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray
from nlosctl.contract.scene import CircleReflector, Scene
from nlosctl.geometry.angles import wrap_angle
from nlosctl.geometry.circular_reflection import ReflectedPath, all_points, reflect_at
from nlosctl.geometry.short_arc import short_arc_point
from nlosctl.geometry.visibility import clears_blocker, elevation, horizon_elevation, sees_by_reflection
from nlosctl.models.selected_rows import SelectedRows

__all__ = [
    "GROUND_TOLERANCE",
    "CirclePaths",
    "CircleRows",
    "circle_table",
    "free_legs",
    "least_of",
    "likeliest_points",
    "locate_circle_paths",
    "locate_circle_rows",
    "misplaced_sensors",
    "move_inside",
]


GROUND_TOLERANCE = 1e-6
"""A sensor may be this share of the blocker's radius under it (6 m on the earth): coordinates are rounded."""


@dataclass(frozen=True)
class CirclePaths(SelectedRows):
    """N rows of a block whose wave is reflected by a circle.

    ``blocker_radius`` is NaN where the circle has none: then any of up to four paths may be the row's.
    ``least_elevation_rad`` is the horizon, or the scene's least elevation; NaN without a blocker. ``takes_any_path``
    marks rows that may take another path than that on the short arc: no blocker, or a sensor above it.
    """

    radius: FloatArray
    blocker_radius: FloatArray
    least_elevation_rad: FloatArray
    takes_any_path: BoolArray

    @property
    def has_choice(self) -> BoolArray:
        """Which rows have no blocker, so that several paths are possible."""
        return np.isnan(self.blocker_radius)

    def paths_from(self, x: FloatArray, y: FloatArray) -> ReflectedPath:
        """Return the path (N,) of each row from points (B,).

        From a sensor on the blocker that on the short arc, the only one that can be free (Lemma 3). Of several possible
        paths that of `choose_points`. NaN where the point or the sensor is not inside the circle.
        """
        source_x, source_y = self.about_center(x, y)
        geometry = (self.sensor_x, self.sensor_y, source_x, source_y, self.radius)
        several = self.takes_any_path
        if not several.any():
            hit_x, hit_y = short_arc_point(*geometry)
        elif several.all():
            hit_x, hit_y = self.choose_points(several, *geometry)
        else:
            hit_x, hit_y = np.empty_like(source_x), np.empty_like(source_y)
            hit_x[several], hit_y[several] = self.choose_points(several, *(part[several] for part in geometry))
            hit_x[~several], hit_y[~several] = short_arc_point(*(part[~several] for part in geometry))
        return reflect_at(hit_x, hit_y, self.sensor_x, self.sensor_y, source_x, source_y)

    def choose_points(
        self,
        rows: BoolArray,
        sensor_x: FloatArray,
        sensor_y: FloatArray,
        source_x: FloatArray,
        source_y: FloatArray,
        radius: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        """Return the reflection points (n,) of some ``rows`` (N,) with several possible paths: of the likeliest."""
        return likeliest_points(sensor_x, sensor_y, source_x, source_y, radius, self.blocker_radius[rows])

    def moved_inside(self, *point: FloatArray) -> tuple[FloatArray, ...]:
        """Return points that are moved, where they are not inside a row's circle, as `move_inside` does."""
        return move_inside(self, self.radius, *point)

    def alone(self, rows: IntArray) -> Self:
        """Return some rows (n,), each in a snapshot of its own."""
        return replace(self.picked(rows), shape=(rows.shape[0], 1), snapshot=np.arange(rows.shape[0]))

    def lengths_from(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the lengths (N, P) of the paths of the rows from points (B, P), as those of `paths_from`."""
        size, points = self.snapshot.shape[0], x.shape[1]
        each = self.picked(np.repeat(np.arange(size), points))
        wide = replace(each, snapshot=np.arange(size * points))
        path = wide.paths_from(x[self.snapshot].ravel(), y[self.snapshot].ravel())
        return path.length_m.reshape(size, points)

    def outside(self, x: FloatArray, y: FloatArray, path: ReflectedPath) -> BoolArray:
        """Return which rows (N,) can't see their point (B,): not in the circle, or not in A2 where it has a blocker.

        ``path`` is that of `paths_from` for the points.
        """
        source_x, source_y = self.about_center(x, y)
        limits = (self.radius, self.blocker_radius, self.least_elevation_rad)
        seen = sees_by_reflection(self.sensor_x, self.sensor_y, source_x, source_y, path, *limits)
        return ~np.where(self.has_choice, np.isfinite(path.bearing_rad), seen)


@dataclass(frozen=True)
class CircleRows(CirclePaths):
    """N rows of bearings that are seen by reflection on a circle."""

    bearing_rad: FloatArray

    def choose_points(
        self,
        rows: BoolArray,
        sensor_x: FloatArray,
        sensor_y: FloatArray,
        source_x: FloatArray,
        source_y: FloatArray,
        radius: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        """Return the points (n,) seen nearest to the bearings, free ones before blocked ones."""
        geometry = (sensor_x, sensor_y, source_x, source_y, radius)
        return _nearest_point(self.bearing_rad[rows], self.blocker_radius[rows], *geometry)

    def residual_rad(self, path: ReflectedPath) -> FloatArray:
        """Return measured minus predicted bearing (N,), in (-pi, pi]."""
        return wrap_angle(self.bearing_rad - path.bearing_rad)

    def under_horizon(self) -> BoolArray:
        """Return which rows (N,) have a bearing under their horizon, from where no wave can come."""
        return elevation(self.sensor_x, self.sensor_y, self.bearing_rad) < self.least_elevation_rad


def move_inside(rows: SelectedRows, radius: FloatArray, *point: FloatArray) -> tuple[FloatArray, ...]:
    """Return points, D arrays (B,), those not inside a row's circle or sphere (N,) moved to the middle height there.

    That is half way between the sensor's distance from the centre and the radius, in the same direction.
    """
    source = rows.about_center(*point)
    distance: FloatArray = reduce(np.hypot, source)
    far = distance >= radius
    snapshot = rows.snapshot[far]
    scale = 0.5 * (radius + reduce(np.hypot, rows.sensor))[far] / distance[far]
    moved = tuple(part.copy() for part in point)
    for part, away, middle in zip(moved, source, rows.center, strict=True):
        part[snapshot] = away[far] * scale + middle[far]
    return moved


def locate_circle_rows(
    scene: Scene, reflector: IntArray, sensor_x: FloatArray, sensor_y: FloatArray, bearing_rad: FloatArray
) -> CircleRows | None:
    """Return the circle rows of a block (B, K) of bearings; as `locate_circle_paths`."""
    paths = locate_circle_paths(scene, reflector, sensor_x, sensor_y)
    return None if paths is None else CircleRows(**vars(paths), bearing_rad=paths.pick_from(bearing_rad))


def locate_circle_paths(
    scene: Scene, reflector: IntArray, sensor_x: FloatArray, sensor_y: FloatArray
) -> CirclePaths | None:
    """Return the circle rows of a block (B, K), centres in the scene's coordinates, or None if it has no such rows.

    Rows whose sensor is not inside the circle, or under the blocker, get a sensor that is NaN: no path leads to it.
    """
    table = circle_table(scene)
    measurement, snapshot = np.nonzero(((reflector >= 0) & np.isfinite(table[0])[reflector]).T)
    if not snapshot.size:
        return None
    index = (snapshot, measurement)
    middle_x, middle_y, radius, blocker, least = (column[reflector[index]] for column in table)
    x, y = sensor_x[index] - middle_x, sensor_y[index] - middle_y
    distance = np.hypot(x, y)
    outside, under = misplaced_sensors(distance, radius, blocker)
    impossible = outside | under
    horizon = horizon_elevation(distance, blocker)
    return CirclePaths(
        shape=reflector.shape,
        snapshot=snapshot,
        measurement=measurement,
        sensor_x=np.where(impossible, np.nan, x),
        sensor_y=np.where(impossible, np.nan, y),
        center_x=middle_x,
        center_y=middle_y,
        radius=radius,
        blocker_radius=blocker,
        least_elevation_rad=np.fmax(horizon, least),
        takes_any_path=np.isnan(blocker) | (distance > blocker * (1.0 + GROUND_TOLERANCE)),
    )


def misplaced_sensors(
    distance_m: FloatArray, radius: FloatArray, blocker_radius: FloatArray
) -> tuple[BoolArray, BoolArray]:
    """Return which sensors, by their distance from the centre, are not inside the circle, and which under the blocker.

    ``blocker_radius`` is NaN without a blocker.
    """
    return ~(distance_m < radius), distance_m < blocker_radius * (1.0 - GROUND_TOLERANCE)


def circle_table(scene: Scene) -> tuple[FloatArray, ...]:
    """Return centre x, y, radius, blocker's radius and least elevation of each reflector (S,); NaN if it has none."""
    rows = [
        [
            *reflector.center,
            reflector.radius,
            np.nan if reflector.blocker_radius is None else reflector.blocker_radius,
            np.nan if reflector.min_elevation_deg is None else np.radians(reflector.min_elevation_deg),
        ]
        if isinstance(reflector, CircleReflector)
        else [np.nan] * 5
        for reflector in scene.reflectors
    ]
    return tuple(np.array(rows, dtype=np.float64).reshape(-1, 5).T.copy())


def likeliest_points(
    sensor_x: FloatArray,
    sensor_y: FloatArray,
    source_x: FloatArray,
    source_y: FloatArray,
    radius: FloatArray,
    blocker_radius: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return the reflection points (N,) of the shortest free paths; of the shortest of all where none is free.

    ``blocker_radius`` is NaN without a blocker. The result is NaN where there is no path.
    """
    hit_x, hit_y = all_points(sensor_x, sensor_y, source_x, source_y, radius)
    length = np.hypot(hit_x - sensor_x, hit_y - sensor_y) + np.hypot(hit_x - source_x, hit_y - source_y)
    free = free_legs(hit_x, hit_y, sensor_x, sensor_y, source_x, source_y, blocker_radius)
    return least_of(length + np.where(free, 0.0, 4.0 * radius), hit_x, hit_y)


def _nearest_point(
    bearing_rad: FloatArray,
    blocker_radius: FloatArray,
    sensor_x: FloatArray,
    sensor_y: FloatArray,
    source_x: FloatArray,
    source_y: FloatArray,
    radius: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return the reflection points (N,) that are seen nearest to the bearings, free ones before blocked ones."""
    hit_x, hit_y = all_points(sensor_x, sensor_y, source_x, source_y, radius)
    off = np.abs(wrap_angle(bearing_rad - np.arctan2(hit_y - sensor_y, hit_x - sensor_x)))
    if not np.isnan(blocker_radius).all():
        free = free_legs(hit_x, hit_y, sensor_x, sensor_y, source_x, source_y, blocker_radius)
        off += np.where(free, 0.0, 2.0 * np.pi)
    return least_of(off, hit_x, hit_y)


def free_legs(
    hit_x: FloatArray,
    hit_y: FloatArray,
    sensor_x: FloatArray,
    sensor_y: FloatArray,
    source_x: FloatArray,
    source_y: FloatArray,
    blocker_radius: FloatArray,
) -> BoolArray:
    """Return the paths by reflection points that no blocker cuts; shapes broadcast, ``blocker_radius`` NaN: none."""
    first = clears_blocker(sensor_x, sensor_y, hit_x, hit_y, blocker_radius)
    second = clears_blocker(source_x, source_y, hit_x, hit_y, blocker_radius)
    return np.isnan(blocker_radius) | (first & second)


def least_of(figure: FloatArray, hit_x: FloatArray, hit_y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the points (N,) of (4, N) with the least figure."""
    best = np.argmin(np.where(np.isnan(figure), np.inf, figure), axis=0)
    column = np.arange(best.shape[0])
    return hit_x[best, column], hit_y[best, column]
