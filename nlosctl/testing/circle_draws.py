"""Random batches with rows by circles, for the methods that solve them."""

from __future__ import annotations

import numpy as np

from nlosctl.contract.scene import CircleReflector, LineReflector, Scene
from nlosctl.geometry.angles import wrap_angle
from nlosctl.models.bearing_predictions import predict_bearings
from nlosctl.testing.draws import Draw, Trial, bearing_batch

__all__ = ["CIRCLES"]

_SCALES_M = (1.0, 1e3, 1e6)


def _draw(generator: np.random.Generator, snapshots: int, measurements: int, fault: str | None) -> Trial:
    """Draw bearings of one source per snapshot: direct, by a mirror, by two layers over ground, or by an open circle.

    Sensors are on the ground or above it. A third of the snapshots has no row by the open circle.
    """
    shape = (snapshots, measurements)
    scale = float(generator.choice(_SCALES_M))
    radius, turn = 6.0 * scale, generator.uniform(-np.pi, np.pi)
    center = generator.uniform(-10.0 * scale, 10.0 * scale, 2)
    scene = _layers(radius, turn, center, scale)
    height = generator.choice([0.0, 0.0, 0.3], size=shape) * generator.uniform(0.0, scale, shape)
    angle = turn + generator.uniform(-0.3, 0.3, shape)
    sensor_xy = center + np.stack([(radius + height) * np.cos(angle), (radius + height) * np.sin(angle)], axis=-1)
    source_height = generator.uniform(0.1 * scale, 0.8 * scale, (snapshots, 1))
    bearing_of_source = turn + generator.uniform(-0.1, 0.1, (snapshots, 1))
    direction = np.stack([np.cos(bearing_of_source), np.sin(bearing_of_source)], axis=-1)
    source_xy = center + (radius + source_height)[..., None] * direction
    reflector = generator.choice([-1, 0, 1, 2, 2, 3], size=shape)
    reflector[generator.random(snapshots) < 0.3] = 2
    std = np.radians(10.0 ** generator.uniform(-1.0, 0.3, shape))
    if fault == "outside its circle":
        reflector[:] = 1
        sensor_xy += 20.0 * scale * direction
    bearing = predict_bearings(sensor_xy, reflector, scene, np.broadcast_to(source_xy, sensor_xy.shape))
    bearing = wrap_angle(np.nan_to_num(bearing) + std * generator.normal(size=shape))
    if fault == "under the horizon":
        reflector[:] = 1
        bearing = wrap_angle(angle + np.pi)
    sensor = np.broadcast_to(np.arange(measurements), shape)
    batch = bearing_batch(generator, scene, sensor, sensor_xy, bearing, std, reflector)
    return Trial(batch=batch, size_m=20.0 * scale)


def _layers(radius: float, turn: float, center: np.ndarray[tuple[int], np.dtype[np.float64]], scale: float) -> Scene:
    """A mirror far above the field, two layers about the ground, and an open circle about another centre."""
    up = np.array([np.cos(turn), np.sin(turn)])
    above = center + 9.0 * scale * up
    beside = center + radius * up
    return Scene(
        reflectors=(
            LineReflector(name="above", point=(above[0], above[1]), direction=(-up[1], up[0])),
            CircleReflector(name="layer", center=(center[0], center[1]), radius=7.5 * scale, blocker_radius=radius),
            CircleReflector(
                name="high layer",
                center=(center[0], center[1]),
                radius=8.0 * scale,
                blocker_radius=radius,
                min_elevation_deg=1.0,
            ),
            CircleReflector(name="open", center=(beside[0], beside[1]), radius=5.0 * scale),
        )
    )


CIRCLES = Draw(trial=_draw, faults=("outside its circle", "under the horizon"), directions=("bearing_rad",))
"""Bearings, most of them by circles. No method is required to solve them: `check_method` does not draw them."""
