"""The flat geometry of Song, Willett, Zhou 2013: three sensors, each seeing the target in its own line mirror."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.contract.options import option
from nlosctl.contract.scene import LineReflector, Scene, Sensor
from nlosctl.scenarios.bearing_rows import bearing_columns
from nlosctl.scenarios.spec import Columns, ScenarioSpec

__all__ = ["SCENARIO", "SongFlatOptions", "generate", "scene"]

_TARGET_M = (10000.0, 5000.0)  # Table II
_SENSORS_M = ((-3300.0, 0.0), (0.0, 0.0), (5000.0, -2500.0))  # Table II
_SLOPES_AND_INTERCEPTS_M = ((0.5, 5000.0), (0.0, -2500.0), (1.0, -10000.0))  # equation (46)


@dataclass(frozen=True, kw_only=True)
class SongFlatOptions:
    """Parameters of ``song-flat``."""

    bearing_std_deg: float = option(
        1.0, unit="deg", minimum=0.0, maximum=180.0, exclusive=True, meaning="standard deviation of every bearing"
    )


def scene(options: SongFlatOptions) -> Scene:
    """Return the sensors of Table II and the mirrors of equation (46): sensor ``s1`` looks into ``surface1``."""
    sensors = tuple(Sensor(name=f"s{i}", position=position) for i, position in enumerate(_SENSORS_M, 1))
    mirrors = tuple(
        LineReflector(name=f"surface{i}", point=(0.0, intercept), direction=(1.0, slope))
        for i, (slope, intercept) in enumerate(_SLOPES_AND_INTERCEPTS_M, 1)
    )
    return Scene(sensors=sensors, reflectors=mirrors)


def generate(options: SongFlatOptions, generator: np.random.Generator, snapshots: int) -> Columns:
    """Sample snapshots of three bearings each; they differ only in their noise."""
    world = scene(options)
    positions = np.array([sensor.position for sensor in world.sensors])
    sensors = len(world.sensors)
    return bearing_columns(
        scene=world,
        generator=generator,
        names=tuple(sensor.name for sensor in world.sensors),
        sensor_xy_m=np.broadcast_to(positions, (snapshots, sensors, 2)),
        source_xy_m=np.broadcast_to(np.array(_TARGET_M), (snapshots, 2)),
        bearing_std_rad=np.full((snapshots, sensors), np.radians(options.bearing_std_deg)),
        reflector=np.broadcast_to(np.arange(sensors), (snapshots, sensors)),
    )


SCENARIO = ScenarioSpec(
    name="song-flat",
    kind="bearings",
    summary="three sensors, each seeing one fixed target in its own flat mirror, no direct path",
    reference="Song, Willett, Zhou 2013, Section 5.1, Table II and equation (46)",
    options=SongFlatOptions,
    scene=scene,
    generate=generate,
)
