"""How far points are from the edge of what the scene allows: signed distances with their gradients."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import FloatArray, IntArray
from nlosctl.geometry.circular_reflection import ReflectedPath
from nlosctl.geometry.lines import side_of_line
from nlosctl.geometry.visibility import elevation, horizon_elevation
from nlosctl.models.bearings import SightLines
from nlosctl.models.circle_rows import CircleRows
from nlosctl.models.mirror_rows import MirrorRows
from nlosctl.models.obstacles import DirectRows
from nlosctl.models.sight import Sight
from nlosctl.models.space.lines import SpaceLines
from nlosctl.models.space.plane_mirrors import PlaneMirrors

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

    Of mirrors the signed distance, of circles the heights under the reflector and above the blocker and the elevation
    of the path above its least (an angle, times the radius: it is zero at the edge of A2), of direct rows the height
    above the sensor's horizon (zero at the edge of A3). NaN where no path leads to the point, infinite where there is
    no such limit.
    """
    if isinstance(lines, SpaceLines):
        return [] if lines.mirrors is None else [_beside_planes(lines, lines.mirrors, *point)]
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
