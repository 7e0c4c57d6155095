"""Plane sections of the surfaces in space on which single rows put their source. Only `plot` uses them."""

from __future__ import annotations

import numpy as np

from nlosctl.arrays import FloatArray, IntArray, ignoring_division, ignoring_invalid
from nlosctl.contract.scene import CircleReflector, Scene, SegmentReflector, SphereReflector
from nlosctl.geometry.lines import crosses_segment
from nlosctl.models.ranges.predictions import predict_ranges
from nlosctl.models.ranges.spheres import unfold_in_planes

__all__ = ["hyperbola_sections", "path_lengths_by_sphere", "range_sections"]

_SAMPLES, _FEWER = 961, 241
_MANY = 50
_PARABOLIC = 1e-9
"""Share of the squared baseline within which the section is that of a nearby hyperbola or ellipse, not a parabola."""


def hyperbola_sections(
    sensor_m: FloatArray, reference_m: FloatArray, difference_m: FloatArray, depth_m: float, reach_m: float
) -> FloatArray:
    """Return the points (N, P, 2), in order, by ``difference_m`` (N,) farther from a sensor than from a reference.

    ``sensor_m`` and ``reference_m`` are (N, 3): two coordinates of the section's plane, then the depth. The points are
    at ``depth_m``, as far as ``reach_m`` from the curve's vertex. NaN without such points: the difference is longer
    than the baseline, or the plane misses the surface.

    With half difference A, half baseline C, B^2 = C^2 - A^2, the baseline's unit vector e of level part h, the depth z
    over its middle, and n = h^2 C^2 - A^2, the section has its centre at -h e_z z C^2 / n along the level part, and the
    semi-axes A B sqrt(|n + z^2|) / |n| along it and B sqrt(|n + z^2| / |n|) across: a branch of a hyperbola for n > 0,
    a whole ellipse for n < 0.
    """
    along = sensor_m - reference_m
    length = np.sqrt(np.sum(along * along, axis=1))
    half_m, over_m = 0.5 * np.abs(difference_m), depth_m - 0.5 * (sensor_m + reference_m)[:, 2]
    turn = np.linspace(-1.0, 1.0, _SAMPLES if difference_m.size <= _MANY else _FEWER)
    with ignoring_division(), ignoring_invalid():
        rise = along[:, 2] / length
        level = np.hypot(along[:, 0], along[:, 1])
        ahead = np.where(level[:, None] > 0.0, along[:, :2] / level[:, None], (1.0, 0.0))
        level = level / length
        minor2 = 0.25 * length * length - half_m * half_m
        form = 0.25 * (level * length) ** 2 - half_m * half_m
        least = _PARABOLIC * length * length
        form = np.where(np.abs(form) < least, np.copysign(least, form), form)
        cut = np.sqrt(form + over_m * over_m)
        across_m = np.sqrt(minor2 / np.abs(form)) * cut
        along_m = half_m * np.sqrt(minor2) * cut / np.abs(form)
        middle = -0.25 * level * rise * over_m * length * length / form
        side = -np.sign(difference_m)
        span = np.arccosh(1.0 + reach_m / np.maximum(across_m, along_m))[:, None] * turn
        open_curve = (form > 0.0)[:, None]
        forward = np.where(open_curve, side[:, None] * np.cosh(span), np.cos(np.pi * turn))
        sideways = np.where(open_curve, np.sinh(span), np.sin(np.pi * turn))
        exists = (minor2 > 0.0) & np.where(form > 0.0, level > 0.0, np.sign(over_m * rise) == side)
        forward = np.where(exists[:, None], middle[:, None] + along_m[:, None] * forward, np.nan)
        sideways = across_m[:, None] * sideways
    center = 0.5 * (sensor_m + reference_m)[:, None, :2]
    beside = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)
    points: FloatArray = center + forward[..., None] * ahead[:, None] + sideways[..., None] * beside[:, None]
    return points


def range_sections(
    sensor_m: FloatArray, range_m: FloatArray, reflector: IntArray, scene: Scene, across: int, depth_m: float
) -> FloatArray:
    """Return the points (N, P, 2), in order, whose path to a sensor (N, 3) has the length of its range (N,).

    They have the coordinate ``depth_m`` on the axis ``across``; the two others are returned. ``reflector`` (N,) indexes
    planes, lines and segments of the scene, -1 for direct paths: then the points are those about the sensor's image
    that are on the sensor's side. NaN without such points.
    """
    seen = [axis for axis in range(3) if axis != across]
    image = np.stack(unfold_in_planes(scene, reflector, tuple(sensor_m.T))[0], axis=1)
    turn = np.linspace(0.0, 2.0 * np.pi, _SAMPLES)
    with ignoring_invalid():
        radius = np.sqrt(range_m**2 - (image[:, across] - depth_m) ** 2)
    points = np.full((range_m.size, _SAMPLES, 3), depth_m)
    points[..., seen] = image[:, None, seen] + radius[:, None, None] * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    away, beyond = (np.linalg.norm(points - end[:, None], axis=2) for end in (sensor_m, image))
    there = away <= beyond
    for number, wall in enumerate(scene.reflectors):
        if isinstance(wall, SegmentReflector):
            own = reflector == number
            x1, y1, x2, y2 = (np.array(part) for part in (*wall.start, *wall.end))
            from_x, from_y = image[own, None, 0], image[own, None, 1]
            there[own] &= crosses_segment(from_x, from_y, points[own, :, 0], points[own, :, 1], x1, y1, x2, y2)
    return np.where(there[..., None], points[..., seen], np.nan)


def path_lengths_by_sphere(sensor_m: FloatArray, sphere: SphereReflector, point_m: FloatArray) -> FloatArray:
    """Return the lengths (...) of the paths from points (..., 3) by a sphere to a sensor (3,); NaN without a path.

    By symmetry they are those by a circle, in the plane of centre, sensor and point.
    """
    center = np.array(sphere.center)
    own = float(np.linalg.norm(sensor_m - center))
    axis = (sensor_m - center) / own if own > 0.0 else np.array([1.0, 0.0, 0.0])
    along = (point_m - center) @ axis
    beside = np.linalg.norm(point_m - center - along[..., None] * axis, axis=-1)
    circle = CircleReflector(
        name=sphere.name, center=(0.0, 0.0), radius=sphere.radius, blocker_radius=sphere.blocker_radius
    )
    return predict_ranges(
        np.broadcast_to(np.array([own, 0.0]), (*along.shape, 2)),
        np.zeros(along.shape),
        np.stack([along, beside], axis=-1),
        np.zeros(along.shape, dtype=np.int64),
        Scene(reflectors=(circle,)),
    )
