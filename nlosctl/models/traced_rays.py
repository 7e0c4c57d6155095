"""Rays traced back from a sensor over its reflector, along a bearing or as far as a range. Only pictures use them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import FloatArray, ignoring_division
from nlosctl.contract.scene import CircleReflector, PlaneReflector, Reflector, Scene, SegmentReflector, SphereReflector
from nlosctl.geometry.circles import leave_circle
from nlosctl.geometry.lines import crosses_segment, reflect_direction
from nlosctl.models.ranges.predictions import predict_ranges

__all__ = [
    "TracedRays",
    "path_points_in_space",
    "path_spheroid",
    "points_at_range",
    "ray_paths",
    "trace_back",
    "trace_in_space",
]

_DIRECTIONS = 2881
_SAME_LENGTH = 1e-6
_BEYOND = 1.12
_AWAY = 0.25


@dataclass(frozen=True)
class TracedRays:
    """N rays: ``hit_m`` (N, 2) is where they meet the reflector, ``direction_rad`` (N,) their direction from there.

    Rays without a reflector have their sensor as ``hit_m``; NaN where a ray never meets its reflector.
    """

    hit_m: FloatArray
    direction_rad: FloatArray

    def points_at(self, distance_m: FloatArray | float) -> FloatArray:
        """Return the points (N, 2) that far beyond the hit."""
        along = np.stack([np.cos(self.direction_rad), np.sin(self.direction_rad)], axis=-1)
        return np.asarray(self.hit_m + np.asarray(distance_m)[..., None] * along)


def trace_back(sensor_m: FloatArray, bearing_rad: FloatArray, reflector: Reflector | None) -> TracedRays:
    """Return the rays from sensors (N, 2) along bearings (N,), reflected once by ``reflector`` where there is one.

    A segment reflects along its whole line, as the models of its rows have it; a circle at its inner side.
    """
    if reflector is None:
        return TracedRays(sensor_m, bearing_rad)
    cosine, sine = np.cos(bearing_rad), np.sin(bearing_rad)
    if isinstance(reflector, CircleReflector):
        center = np.array(reflector.center)
        x, y = (sensor_m - center).T
        leaving = leave_circle(x, y, cosine, sine, np.array(reflector.radius))
        tangent = np.arctan2(leaving.y, leaving.x) + 0.5 * np.pi
        hit = np.stack([leaving.x, leaving.y], axis=-1) + center
        return TracedRays(hit, reflect_direction(bearing_rad, tangent))
    if isinstance(reflector, PlaneReflector | SphereReflector):
        raise ValueError(f"rays are traced in the plane. Got the reflector {reflector.name!r} of space instead.")
    along_x, along_y = reflector.direction
    offset = np.array(reflector.point) - sensor_m
    with ignoring_division():
        distance = (offset[:, 0] * along_y - offset[:, 1] * along_x) / (cosine * along_y - sine * along_x)
    distance = np.where(np.isfinite(distance) & (distance > 0.0), distance, np.nan)
    hit = sensor_m + distance[:, None] * np.stack([cosine, sine], axis=-1)
    direction = reflect_direction(bearing_rad, np.arctan2(along_y, along_x))
    return TracedRays(hit, np.where(np.isnan(distance), np.nan, direction))


def ray_paths(
    sensor_m: FloatArray, bearing_rad: FloatArray, reflector: Reflector | None, low_m: FloatArray, high_m: FloatArray
) -> FloatArray:
    """Return the corners (N, 3, 2) of rays: sensor, reflection point (or sensor again), end a little beyond a box.

    The box has the corners ``low_m`` and ``high_m`` (2,). A ray that leads away from it ends after a quarter of its
    span; one that misses its mirror is straight.
    """
    rays = trace_back(sensor_m, bearing_rad, reflector)
    missed = np.asarray(~np.isfinite(rays.hit_m).all(axis=1))
    hit = np.where(missed[:, None], sensor_m, rays.hit_m)
    direction = np.where(missed, bearing_rad, rays.direction_rad)
    along = np.stack([np.cos(direction), np.sin(direction)], axis=-1)
    corners = np.array(np.meshgrid(*zip(low_m, high_m, strict=True))).reshape(2, -1).T
    offset = corners[:, None] - hit
    reach = np.max(offset[..., 0] * along[:, 0] + offset[..., 1] * along[:, 1], axis=0, initial=0.0)
    distance = np.hypot(*(0.5 * (low_m + high_m) - hit).T)
    span = float(np.max(high_m - low_m))
    away = _AWAY * (span if np.isfinite(span) and span > 0.0 else 1.0)
    length = _BEYOND * np.maximum(reach, np.maximum(0.5 * distance, away))
    return np.stack([sensor_m, hit, hit + length[:, None] * along], axis=1)


def trace_in_space(sensor: FloatArray, along: FloatArray, reflector: Reflector | None) -> tuple[FloatArray, FloatArray]:
    """Return where the ray from a sensor (3,) along a unit vector (3,) meets its mirror, and its direction from there.

    The sensor and the direction themselves without a mirror, or if the ray misses it.
    """
    if reflector is None:
        return sensor, along
    if isinstance(reflector, SphereReflector | CircleReflector):
        offset = sensor - np.append(reflector.center, 0.0)[:3]
        half = float(offset @ along)
        distance = -half + np.sqrt(half * half - float(offset @ offset) + reflector.radius**2)
        normal = (offset + distance * along) / reflector.radius
    else:
        point = np.append(reflector.point, 0.0)[:3]
        if isinstance(reflector, PlaneReflector):
            normal = np.array(reflector.normal)
        else:
            normal = np.array([-reflector.direction[1], reflector.direction[0], 0.0])
        normal = normal / np.linalg.norm(normal)
        with ignoring_division():
            distance = np.divide((point - sensor) @ normal, along @ normal)
    if not (np.isfinite(distance) and distance > 0.0):
        return sensor, along
    return sensor + distance * along, along - 2.0 * (along @ normal) * normal


def path_points_in_space(
    tx_m: FloatArray, rx_m: FloatArray, departing: FloatArray, arriving: FloatArray, path_length_m: float
) -> FloatArray:
    """Return the three points (3, 3) of a triplet in space by its unit vectors (3,) from transmitter and receiver.

    1: the middle of the shortest connection of the two lines; 2 and 3: where the departing and the arriving ray meet
    the spheroid of equal path length, in polar form about its foci. NaN for parallel lines, and where the path is not
    longer than the baseline.
    """
    baseline = rx_m - tx_m
    across, excess = float(departing @ arriving), path_length_m**2 - float(baseline @ baseline)
    with ignoring_division():
        scale = 1.0 / np.float64(1.0 - across * across)
        along_tx = scale * (departing - across * arriving) @ baseline
        along_rx = scale * (across * departing - arriving) @ baseline
    points = [0.5 * (tx_m + along_tx * departing + rx_m + along_rx * arriving)]
    for focus, ray, other in ((tx_m, departing, baseline), (rx_m, arriving, -baseline)):
        reach = 0.5 * excess / (path_length_m - float(ray @ other)) if excess > 0.0 else np.nan
        points.append(focus + reach * ray)
    return np.array(points)


def path_spheroid(tx_m: FloatArray, rx_m: FloatArray, path_length_m: float) -> FloatArray:
    """Return the matrix (3, 3) of the spheroid of equal path length, x' M^-1 x = 1 about the middle of the baseline.

    Its outline in a view is the ellipse of the part of M in the two coordinates. NaN where the path is not longer than
    the baseline.
    """
    baseline = rx_m - tx_m
    minor2 = 0.25 * (path_length_m**2 - float(baseline @ baseline))
    if minor2 <= 0.0:
        return np.full((3, 3), np.nan)
    return np.asarray(minor2 * np.eye(3) + 0.25 * np.outer(baseline, baseline))


def points_at_range(sensor_m: FloatArray, range_m: float, reflector: Reflector) -> FloatArray:
    """Return the points (N, 2) whose path by ``reflector`` to the sensor (2,) has the length of the range, in order.

    NaN between parts of the curve: where no ray meets the reflector (a segment: between its ends) before that length,
    or where a shorter path leads to the point.
    """
    bearing = np.linspace(-np.pi, np.pi, _DIRECTIONS)
    sensor = np.broadcast_to(sensor_m, (_DIRECTIONS, 2))
    rays = trace_back(sensor, bearing, reflector)
    rest = range_m - np.hypot(*(rays.hit_m - sensor).T)
    points = rays.points_at(rest)
    there = rest > 0.0
    if isinstance(reflector, CircleReflector):
        scene = Scene(reflectors=(reflector,))
        shortest = predict_ranges(sensor, np.zeros(_DIRECTIONS), points, np.zeros(_DIRECTIONS, dtype=np.int64), scene)
        there &= np.abs(shortest - range_m) <= _SAME_LENGTH * range_m
    if isinstance(reflector, SegmentReflector):
        beyond = 2.0 * rays.hit_m - sensor
        ends = (np.array(part) for part in (*reflector.start, *reflector.end))
        there &= crosses_segment(sensor[:, 0], sensor[:, 1], beyond[:, 0], beyond[:, 1], *ends)
    return np.where(there[:, None], points, np.nan)
