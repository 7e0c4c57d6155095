"""Bearings seen by reflection on circles: the true path of each row, its residual and gradient.

Song, Willett, Zhou 2013, Section 3. The rows of a block (B, K) that name a circle are held as flat arrays (N,).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nlosctl.contract.scene import CircleReflector, Scene
from nlosctl.geometry.angles import wrap_angle
from nlosctl.geometry.circular_reflection import ReflectedPath, all_points, reflect_at, short_arc_point
from nlosctl.geometry.visibility import elevation, horizon_elevation, sees_by_reflection
from nlosctl.models.placed_rows import PlacedRows

__all__ = ["CircleRows", "circle_table", "locate_circle_rows", "misplaced_sensors"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

_GROUND_TOLERANCE = 1e-6
"""A sensor may be this share of the blocker's radius under it (6 m on the earth): coordinates are rounded."""


@dataclass(frozen=True)
class CircleRows(PlacedRows):
    """N rows of a block that are seen by reflection on a circle.

    ``blocker_radius`` is NaN where the circle has none: then any of up to four paths may be the row's, else the one on
    the short arc is. ``least_elevation_rad`` is the horizon, or the scene's least elevation; NaN without a blocker.
    """

    radius: FloatArray
    blocker_radius: FloatArray
    least_elevation_rad: FloatArray
    bearing_rad: FloatArray

    @property
    def has_choice(self) -> BoolArray:
        """Which rows have no blocker, so that several paths are possible."""
        return np.isnan(self.blocker_radius)

    def paths_from(self, x: FloatArray, y: FloatArray) -> ReflectedPath:
        """Return the path (N,) of each row from points (B,): where there is a choice, the one nearest to its bearing.

        NaN where the point or the sensor is not inside the circle.
        """
        source_x, source_y = self.about_circle(x, y)
        arguments = (self.sensor_x, self.sensor_y, source_x, source_y, self.radius)
        choice = self.has_choice
        if not choice.any():
            hit_x, hit_y = short_arc_point(*arguments)
        elif choice.all():
            hit_x, hit_y = _nearest_point(self.bearing_rad, *arguments)
        else:
            hit_x, hit_y = np.empty_like(source_x), np.empty_like(source_y)
            hit_x[choice], hit_y[choice] = _nearest_point(
                self.bearing_rad[choice], *(argument[choice] for argument in arguments)
            )
            hit_x[~choice], hit_y[~choice] = short_arc_point(*(argument[~choice] for argument in arguments))
        return reflect_at(hit_x, hit_y, self.sensor_x, self.sensor_y, source_x, source_y)

    def residual_rad(self, path: ReflectedPath) -> FloatArray:
        """Return measured minus predicted bearing (N,), in (-pi, pi]."""
        return wrap_angle(self.bearing_rad - path.bearing_rad)

    def outside(self, x: FloatArray, y: FloatArray) -> BoolArray:
        """Return which rows (N,) can't see their point (B,): not in the circle, or not in A2 where it has a blocker."""
        source_x, source_y = self.about_circle(x, y)
        path = self.paths_from(x, y)
        limits = (self.radius, self.blocker_radius, self.least_elevation_rad)
        seen = sees_by_reflection(self.sensor_x, self.sensor_y, source_x, source_y, path, *limits)
        return ~np.where(self.has_choice, np.isfinite(path.bearing_rad), seen)

    def under_horizon(self) -> BoolArray:
        """Return which rows (N,) have a bearing under their horizon, from where no wave can come."""
        return elevation(self.sensor_x, self.sensor_y, self.bearing_rad) < self.least_elevation_rad


def locate_circle_rows(
    scene: Scene, reflector: IntArray, sensor_x: FloatArray, sensor_y: FloatArray, bearing_rad: FloatArray
) -> CircleRows | None:
    """Return the circle rows of a block (B, K), centres in the scene's coordinates, or None where there is none.

    Rows whose sensor is not inside the circle, or under the blocker, get a sensor that is NaN: no path leads to it.
    """
    table = circle_table(scene)
    measurement, snapshot = np.nonzero(((reflector >= 0) & np.isfinite(table[0])[reflector]).T)
    if not snapshot.size:
        return None
    place = (snapshot, measurement)
    middle_x, middle_y, radius, blocker, least = (column[reflector[place]] for column in table)
    x, y = sensor_x[place] - middle_x, sensor_y[place] - middle_y
    distance = np.hypot(x, y)
    outside, under = misplaced_sensors(distance, radius, blocker)
    impossible = outside | under
    horizon = horizon_elevation(distance, blocker)
    return CircleRows(
        snapshot=snapshot,
        measurement=measurement,
        sensor_x=np.where(impossible, np.nan, x),
        sensor_y=np.where(impossible, np.nan, y),
        center_x=middle_x,
        center_y=middle_y,
        radius=radius,
        blocker_radius=blocker,
        least_elevation_rad=np.fmax(horizon, least),
        bearing_rad=bearing_rad[place],
    )


def misplaced_sensors(
    distance_m: FloatArray, radius: FloatArray, blocker_radius: FloatArray
) -> tuple[BoolArray, BoolArray]:
    """Return which sensors, by their distance from the centre, are not inside the circle, and which under the blocker.

    ``blocker_radius`` is NaN where there is none.
    """
    return ~(distance_m < radius), distance_m < blocker_radius * (1.0 - _GROUND_TOLERANCE)


def circle_table(scene: Scene) -> tuple[FloatArray, ...]:
    """Return centre x, y, radius, blocker's radius and least elevation of each reflector (S,); NaN for what is not."""
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


def _nearest_point(
    bearing_rad: FloatArray,
    sensor_x: FloatArray,
    sensor_y: FloatArray,
    source_x: FloatArray,
    source_y: FloatArray,
    radius: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    hit_x, hit_y = all_points(sensor_x, sensor_y, source_x, source_y, radius)
    off = np.abs(wrap_angle(bearing_rad - np.arctan2(hit_y - sensor_y, hit_x - sensor_x)))
    best = np.argmin(np.where(np.isnan(off), np.inf, off), axis=0)
    column = np.arange(best.shape[0])
    return hit_x[best, column], hit_y[best, column]
