"""Rays traced back from a sensor along its bearing and over its reflector. Only `plot` uses them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import FloatArray, ignoring_division
from nlosctl.contract.scene import CircleReflector, Reflector
from nlosctl.geometry.circles import leave_circle
from nlosctl.geometry.lines import reflect_direction

__all__ = ["TracedRays", "trace_back"]


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
    along_x, along_y = reflector.direction
    offset = np.array(reflector.point) - sensor_m
    with ignoring_division():
        distance = (offset[:, 0] * along_y - offset[:, 1] * along_x) / (cosine * along_y - sine * along_x)
    distance = np.where(np.isfinite(distance) & (distance > 0.0), distance, np.nan)
    hit = sensor_m + distance[:, None] * np.stack([cosine, sine], axis=-1)
    direction = reflect_direction(bearing_rad, np.arctan2(along_y, along_x))
    return TracedRays(hit, np.where(np.isnan(distance), np.nan, direction))
