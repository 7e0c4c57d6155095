"""The circular geometry of Song, Willett, Zhou 2013: sensors on the earth receive the target via the ionosphere."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from nlosctl.contract.options import option
from nlosctl.contract.scene import CircleReflector, Scene, Sensor
from nlosctl.scenarios.bearing_rows import bearing_columns, sensor_names
from nlosctl.scenarios.spec import Columns, ScenarioSpec

__all__ = ["SCENARIO", "SongCircleOptions", "generate", "scene"]

_EARTH_M = 6371e3  # Section 5.2
_ANGLES_OVER_PI = {"a": (0.10, 0.08, -0.09, -0.06), "b": (0.11, -0.07, -0.12)}  # Tables III and IV


@dataclass(frozen=True, kw_only=True)
class SongCircleOptions:
    """Parameters of ``song-circle``."""

    parameter_set: Literal["a", "b"] = option(
        "a", meaning="the paper's parameter set: a has four sensors (Table III), b three (Table IV)"
    )
    bearing_std_deg: float = option(
        1.0, unit="deg", minimum=0.0, maximum=180.0, exclusive=True, meaning="standard deviation of every bearing"
    )
    layer_height_m: float = option(
        300e3, unit="m", minimum=60e3, maximum=2000e3, meaning="height of the ionosphere above the earth"
    )
    target_height_m: float = option(
        50e3, unit="m", minimum=0.0, maximum=59e3, meaning="height of the target above the earth"
    )


def scene(options: SongCircleOptions) -> Scene:
    """Return the sensors of Table III or IV on the earth, and the concentric ``ionosphere``."""
    angles = np.pi * np.array(_ANGLES_OVER_PI[options.parameter_set])
    positions = _EARTH_M * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    sensors = (
        Sensor(name=name, position=(float(x), float(y)))
        for name, (x, y) in zip(sensor_names(len(positions)), positions, strict=True)
    )
    radius = _EARTH_M + options.layer_height_m
    ionosphere = CircleReflector(name="ionosphere", center=(0.0, 0.0), radius=radius, blocker_radius=_EARTH_M)
    return Scene(sensors=tuple(sensors), reflectors=(ionosphere,))


def generate(options: SongCircleOptions, generator: np.random.Generator, snapshots: int) -> Columns:
    """Sample snapshots with one bearing from each sensor; they differ only in their noise."""
    world = scene(options)
    positions = np.array([sensor.position for sensor in world.sensors])
    shape = (snapshots, positions.shape[0])
    return bearing_columns(
        scene=world,
        generator=generator,
        names=tuple(sensor.name for sensor in world.sensors),
        sensor_xy_m=np.broadcast_to(positions, (*shape, 2)),
        source_xy_m=np.broadcast_to(np.array([_EARTH_M + options.target_height_m, 0.0]), (snapshots, 2)),
        bearing_std_rad=np.full(shape, np.radians(options.bearing_std_deg)),
        reflector=np.zeros(shape, dtype=np.int64),
    )


SCENARIO = ScenarioSpec(
    name="song-circle",
    kind="bearings",
    summary="three or four sensors on the earth receive one fixed target, 50 km up, via the ionosphere",
    reference="Song, Willett, Zhou 2013, Section 5.2, Tables III and IV",
    options=SongCircleOptions,
    scene=scene,
    generate=generate,
)
