"""Sensors evenly spaced on a circle, a source in a concentric disc: a well-conditioned world of direct paths."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.contract.options import option
from nlosctl.contract.scene import Scene, Sensor
from nlosctl.scenarios.bearing_rows import bearing_columns, sensor_names
from nlosctl.scenarios.spec import Columns, ScenarioSpec

__all__ = ["SCENARIO", "RingOptions", "generate", "scene"]


@dataclass(frozen=True, kw_only=True)
class RingOptions:
    """Parameters of ``ring``."""

    sensors: int = option(8, minimum=1, maximum=100_000, meaning="sensors on the circle")
    radius_m: float = option(500.0, unit="m", minimum=0.0, exclusive=True, meaning="radius of the sensors' circle")
    source_radius_m: float = option(
        400.0, unit="m", minimum=0.0, meaning="radius of the concentric disc that contains the source"
    )
    bearing_std_deg: float = option(
        1.0, unit="deg", minimum=0.0, maximum=180.0, exclusive=True, meaning="standard deviation of every bearing"
    )
    outlier_fraction: float = option(
        0.0, minimum=0.0, maximum=1.0, meaning="share of the rows whose bearing is uniform over the circle"
    )


def scene(options: RingOptions) -> Scene:
    """Return the sensors, the first on the +x axis, counter-clockwise."""
    angle = 2.0 * np.pi * np.arange(options.sensors) / options.sensors
    positions = options.radius_m * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    names = sensor_names(options.sensors)
    return Scene(
        sensors=tuple(
            Sensor(name=name, position=(float(x), float(y))) for name, (x, y) in zip(names, positions, strict=True)
        )
    )


def generate(options: RingOptions, generator: np.random.Generator, snapshots: int) -> Columns:
    """Sample snapshots, each with its own source, uniform over the disc."""
    world = scene(options)
    positions = np.array([sensor.position for sensor in world.sensors])
    radius = options.source_radius_m * np.sqrt(generator.random(snapshots))
    angle = generator.uniform(-np.pi, np.pi, snapshots)
    return bearing_columns(
        scene=world,
        generator=generator,
        names=sensor_names(options.sensors),
        sensor_xy_m=np.broadcast_to(positions, (snapshots, options.sensors, 2)),
        source_xy_m=np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1),
        bearing_std_rad=np.full((snapshots, options.sensors), np.radians(options.bearing_std_deg)),
        outlier_fraction=options.outlier_fraction,
    )


SCENARIO = ScenarioSpec(
    name="ring",
    kind="bearings",
    summary="sensors evenly spaced on a circle, a source uniform in a concentric disc, direct paths",
    reference="generic",
    options=RingOptions,
    scene=scene,
    generate=generate,
)
