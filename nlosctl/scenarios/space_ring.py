"""Azimuths and elevations from sensors on a ring at rising heights, a source in the air above."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.contract.options import option
from nlosctl.contract.scene import Scene, Sensor
from nlosctl.scenarios.bearing_rows import sensor_names
from nlosctl.scenarios.space_rows import direction_columns, spread_stds
from nlosctl.scenarios.spec import Columns, ScenarioSpec

__all__ = ["SCENARIO", "SpaceRingOptions", "generate", "scene"]


@dataclass(frozen=True, kw_only=True)
class SpaceRingOptions:
    """Parameters of ``space-ring``."""

    sensors: int = option(8, minimum=2, maximum=100_000, meaning="sensors on the ring")
    radius_m: float = option(500.0, unit="m", minimum=0.0, exclusive=True, meaning="radius of the ring")
    sensor_height_m: float = option(
        60.0, unit="m", minimum=0.0, meaning="height of the last sensor; those of the others rise evenly to it from 0"
    )
    source_radius_m: float = option(400.0, unit="m", minimum=0.0, meaning="radius of the disc that the source is above")
    source_height_m: float = option(
        200.0, unit="m", minimum=0.0, meaning="largest height of the source, uniform from 0"
    )
    angle_std_deg: float = option(
        1.0,
        unit="deg",
        minimum=0.0,
        maximum=90.0,
        exclusive=True,
        meaning="standard deviation of azimuths and elevations; each has its own, from half to twice this one",
    )
    azimuth_only: float = option(0.0, minimum=0.0, maximum=1.0, meaning="share of the rows without an elevation")
    outlier_fraction: float = option(
        0.0, minimum=0.0, maximum=1.0, meaning="share of the rows with an azimuth and an elevation anywhere"
    )


def scene(options: SpaceRingOptions) -> Scene:
    """Return the sensors, the first on the +x axis at height 0, counter-clockwise."""
    angle = 2.0 * np.pi * np.arange(options.sensors) / options.sensors
    height = np.linspace(0.0, options.sensor_height_m, options.sensors)
    x, y = options.radius_m * np.cos(angle), options.radius_m * np.sin(angle)
    rows = zip(sensor_names(options.sensors), x.tolist(), y.tolist(), height.tolist(), strict=True)
    return Scene(sensors=tuple(Sensor(name=name, position=(x, y), z_m=z) for name, x, y, z in rows))


def generate(options: SpaceRingOptions, generator: np.random.Generator, snapshots: int) -> Columns:
    """Sample snapshots, each with its own source, uniform over the cylinder."""
    shape = (snapshots, options.sensors)
    radius = options.source_radius_m * np.sqrt(generator.random(snapshots))
    angle = generator.uniform(-np.pi, np.pi, snapshots)
    height = generator.uniform(0.0, options.source_height_m, snapshots)
    std = np.radians(options.angle_std_deg)
    return direction_columns(
        scene=scene(options),
        generator=generator,
        source_m=np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=1),
        reflector=np.full(shape, -1, dtype=np.int64),
        stds_rad=(spread_stds(generator, std, shape), spread_stds(generator, std, shape)),
        wrong=options.outlier_fraction,
        without_elevation=options.azimuth_only,
    )


SCENARIO = ScenarioSpec(
    name="space-ring",
    kind="bearings",
    summary="three dimensions: azimuths and elevations from a ring of sensors at rising heights, direct paths",
    reference="generic",
    options=SpaceRingOptions,
    scene=scene,
    generate=generate,
)
