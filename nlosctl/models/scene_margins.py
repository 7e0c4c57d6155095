"""How far points are from the edge of what the scene allows: signed distances with their gradients."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import FloatArray, IntArray
from nlosctl.geometry.circular_reflection import ReflectedPath
from nlosctl.geometry.directions import Vector, combine, dot, length, scaled, subtract
from nlosctl.geometry.lines import side_of_line
from nlosctl.geometry.spheres import central_plane, elevation_above_horizon
from nlosctl.geometry.visibility import elevation, horizon_elevation
from nlosctl.models.bearings import SightLines
from nlosctl.models.circle_rows import CircleRows
from nlosctl.models.mirror_rows import MirrorRows
from nlosctl.models.obstacles import DirectRows
from nlosctl.models.sight import Sight
from nlosctl.models.space.lines import SpaceLines
from nlosctl.models.space.plane_mirrors import PlaneMirrors
from nlosctl.models.space.sphere_lines import SphereLines
from nlosctl.models.space.sphere_rows import OpaqueSphereRows, SphereRows

__all__ = ["Margins", "scene_margins"]


_CLEARANCE = 1e-8
"""Margins end this share of a radius inside of the edge (7 cm on the earth), so that their zero is allowed."""


@dataclass(frozen=True)
class Margins:
    """N margins: the ``snapshot`` they belong to, their value (positive: allowed) and its derivatives, as D arrays."""

    snapshot: IntArray
    value_m: FloatArray
    slopes: tuple[FloatArray, ...]


def scene_margins(lines: Sight, *point: FloatArray) -> list[Margins]:
    """Return the margins of points (B,) about the local origins: as many, in the same order, for every point.

    Of mirrors the signed distance, of circles and spheres the heights under the reflector and above the blocker and the
    elevation of the path above its least (an angle, times the radius: it is zero at the edge of A2), of direct rows the
    height above the sensor's horizon (zero at the edge of A3). NaN where no path leads to the point, infinite where
    there is no such limit.
    """
    if isinstance(lines, SpaceLines):
        margins = [] if lines.mirrors is None else [_beside_planes(lines, lines.mirrors, *point)]
        return [*margins, *_of_spheres(lines, *point)] if isinstance(lines, SphereLines) else margins
    if not isinstance(lines, SightLines):
        return []
    x, y = point
    margins = [] if lines.mirrors is None else [_beside_mirrors(lines.mirrors, x, y)]
    for rows in lines.direct:
        margins += _above_horizon(rows, x, y)
    if lines.circles is not None:
        margins += _within_circles(lines.circles, x, y)
    return margins


def _beside_mirrors(rows: MirrorRows, x: FloatArray, y: FloatArray) -> Margins:
    measurement, snapshot = np.nonzero(np.isfinite(rows.sensor_side_m).T)
    index = (snapshot, measurement)
    angle, sensor_side = rows.angle_rad[index], rows.sensor_side_m[index]
    side = side_of_line(x[snapshot], y[snapshot], rows.point_x[index], rows.point_y[index], angle)
    sign = np.sign(sensor_side)
    clearance = _CLEARANCE * np.abs(sensor_side)
    return Margins(snapshot, sign * side - clearance, (-sign * np.sin(angle), sign * np.cos(angle)))


def _beside_planes(lines: SpaceLines, mirrors: PlaneMirrors, *point: FloatArray) -> Margins:
    measurement, snapshot = np.nonzero(np.isfinite(mirrors.sensor_side_m).T)
    index = (snapshot, measurement)
    sensor_side = mirrors.sensor_side_m[index]
    sign, clearance = np.sign(sensor_side), _CLEARANCE * np.abs(sensor_side)
    side = mirrors.side_m(*lines.whole(point))[index]
    slopes = tuple(sign * normal[index] for normal in mirrors.normal[: lines.unknowns])
    return Margins(snapshot, sign * side - clearance, slopes)


def _within_circles(rows: CircleRows, x: FloatArray, y: FloatArray) -> list[Margins]:
    source_x, source_y = rows.about_center(x, y)
    distance = np.hypot(source_x, source_y)
    up_x, up_y = source_x / distance, source_y / distance
    clearance = _CLEARANCE * rows.radius
    above = np.where(rows.has_choice, np.inf, distance - rows.blocker_radius - clearance)
    return [
        Margins(rows.snapshot, rows.radius - distance - clearance, (-up_x, -up_y)),
        Margins(rows.snapshot, above, (up_x, up_y)),
        _elevation_margin(rows, rows.paths_from(x, y), clearance),
    ]


def _elevation_margin(rows: CircleRows, path: ReflectedPath, clearance: FloatArray) -> Margins:
    height = elevation(rows.sensor_x, rows.sensor_y, path.bearing_rad) - rows.least_elevation_rad
    value = np.where(rows.has_choice, np.inf, rows.radius * height - clearance)
    turn = rows.sensor_x * np.sin(path.bearing_rad) - rows.sensor_y * np.cos(path.bearing_rad)
    slope_x, slope_y = path.bearing_gradient()
    scale = -np.sign(turn) * rows.radius
    return Margins(rows.snapshot, value, (scale * slope_x, scale * slope_y))


def _above_horizon(rows: DirectRows, x: FloatArray, y: FloatArray) -> list[Margins]:
    source_x, source_y = rows.about_center(x, y)
    sensor_r, distance = np.hypot(rows.sensor_x, rows.sensor_y), np.hypot(source_x, source_y)
    up_x, up_y = rows.sensor_x / sensor_r, rows.sensor_y / sensor_r
    cross = up_x * source_y - up_y * source_x
    along = up_x * source_x + up_y * source_y
    side = np.copysign(1.0, cross)
    horizon = horizon_elevation(sensor_r, rows.blocker_radius)
    least = np.fmax(horizon, rows.min_elevation_rad)
    normal_x = np.cos(least) * up_x + np.sin(least) * side * up_y
    normal_y = np.cos(least) * up_y - np.sin(least) * side * up_x
    clearance = _CLEARANCE * rows.blocker_radius
    height = normal_x * (source_x - rows.sensor_x) + normal_y * (source_y - rows.sensor_y) - clearance
    nearer = (np.arctan2(np.abs(cross), along) <= -horizon) & (least == horizon)
    return [
        Margins(rows.snapshot, np.where(nearer, np.inf, height), (normal_x, normal_y)),
        Margins(rows.snapshot, distance - rows.blocker_radius - clearance, (source_x / distance, source_y / distance)),
    ]


def _of_spheres(lines: SphereLines, *point: FloatArray) -> list[Margins]:
    """Return the margins of spheres in space: those of circles, with the derivatives of the unknown coordinates."""
    whole = lines.whole(point)
    margins = [margin for rows in lines.opaque for margin in _above_horizon_in_space(rows, whole)]
    margins += _within_spheres(lines.spheres, whole)
    return [Margins(margin.snapshot, margin.value_m, margin.slopes[: lines.unknowns]) for margin in margins]


def _within_spheres(rows: SphereRows, whole: Vector) -> list[Margins]:
    source = rows.about_center(*whole)
    distance = length(source)
    up = scaled(source, 1.0 / distance)
    clearance = _CLEARANCE * rows.radius
    path, vertical = rows.paths_from(*whole), scaled(rows.sensor, 1.0 / length(rows.sensor))
    height = elevation_above_horizon(rows.sensor, path.direction) - rows.least_elevation_rad
    scale = rows.radius / np.sqrt(1.0 - np.minimum(dot(vertical, path.direction) ** 2, 1.0))
    open_ = np.isnan(rows.blocker_radius)
    return [
        Margins(rows.snapshot, rows.radius - distance - clearance, scaled(up, -1.0)),
        Margins(rows.snapshot, np.where(open_, np.inf, distance - rows.blocker_radius - clearance), up),
        Margins(
            rows.snapshot,
            np.where(open_, np.inf, rows.radius * height - clearance),
            scaled(path.gradient(vertical), scale),
        ),
    ]


def _above_horizon_in_space(rows: OpaqueSphereRows, whole: Vector) -> list[Margins]:
    source = rows.about_center(*whole)
    plane, distance = central_plane(rows.sensor, source), length(source)
    horizon = horizon_elevation(plane.sensor_m, rows.blocker_radius)
    least = np.fmax(horizon, rows.min_elevation_rad)
    normal = combine(np.cos(least), plane.toward, -np.sin(least), plane.across)
    clearance = _CLEARANCE * rows.blocker_radius
    height = dot(normal, subtract(source, rows.sensor)) - clearance
    nearer = (np.arctan2(plane.source_y, plane.source_x) <= -horizon) & (least == horizon)
    return [
        Margins(rows.snapshot, np.where(nearer, np.inf, height), normal),
        Margins(rows.snapshot, distance - rows.blocker_radius - clearance, scaled(source, 1.0 / distance)),
    ]
