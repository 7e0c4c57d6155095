"""A street in three dimensions: arrays on lamp posts receive a phone directly, or first by a facade or the ground."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.contract.options import option
from nlosctl.contract.scene import LineReflector, PlaneReflector, Scene, Sensor
from nlosctl.scenarios.bearing_rows import sensor_names
from nlosctl.scenarios.space_rows import direction_columns, spread_stds
from nlosctl.scenarios.spec import Columns, ScenarioSpec

__all__ = ["SCENARIO", "StreetOptions", "generate", "scene"]


@dataclass(frozen=True, kw_only=True)
class StreetOptions:
    """Parameters of ``street``."""

    sensors: int = option(8, minimum=2, maximum=10_000, meaning="arrays, on both sides of the street in turn")
    length_m: float = option(200.0, unit="m", minimum=0.0, exclusive=True, meaning="length of the street, along x")
    width_m: float = option(24.0, unit="m", minimum=0.0, exclusive=True, meaning="width between the facades")
    sensor_height_m: float = option(8.0, unit="m", minimum=0.0, exclusive=True, meaning="height of the arrays")
    source_height_m: float = option(1.5, unit="m", minimum=0.0, exclusive=True, meaning="height of the source")
    angle_std_deg: float = option(
        1.0,
        unit="deg",
        minimum=0.0,
        maximum=90.0,
        exclusive=True,
        meaning="standard deviation of azimuths and elevations; each has its own, from half to twice this one",
    )
    direct_share: float = option(
        0.7, minimum=0.0, maximum=1.0, meaning="share of the direct rows; others are by the facades or the ground"
    )


def scene(options: StreetOptions) -> Scene:
    """Return the arrays, a metre in front of two facades along x, and the ground."""
    side = 0.5 * options.width_m
    x = np.linspace(0.0, options.length_m, options.sensors)
    y = 0.9 * side * np.where(np.arange(options.sensors) % 2 == 0, 1.0, -1.0)
    names = sensor_names(options.sensors)
    return Scene(
        sensors=tuple(
            Sensor(name=name, position=place, z_m=options.sensor_height_m)
            for name, place in zip(names, zip(x.tolist(), y.tolist(), strict=True), strict=True)
        ),
        reflectors=(
            LineReflector(name="north", point=(0.0, side), direction=(1.0, 0.0)),
            LineReflector(name="south", point=(0.0, -side), direction=(1.0, 0.0)),
            PlaneReflector(name="ground", point=(0.0, 0.0, 0.0), normal=(0.0, 0.0, 1.0)),
        ),
    )


def generate(options: StreetOptions, generator: np.random.Generator, snapshots: int) -> Columns:
    """Sample snapshots, each with a source in the street; rows by facade or ground do not state it."""
    shape = (snapshots, options.sensors)
    world = scene(options)
    side = 0.45 * options.width_m
    source = np.stack(
        [
            generator.uniform(0.0, options.length_m, snapshots),
            generator.uniform(-side, side, snapshots),
            np.full(snapshots, options.source_height_m),
        ],
        axis=1,
    )
    direct = generator.random(shape) < options.direct_share
    reflector = np.where(direct, -1, generator.integers(0, len(world.reflectors), shape))
    std = np.radians(options.angle_std_deg)
    return direction_columns(
        scene=world,
        generator=generator,
        source_m=source,
        reflector=reflector,
        stds_rad=(spread_stds(generator, std, shape), spread_stds(generator, std, shape)),
        stated=False,
        follows_path=direct,
    )


SCENARIO = ScenarioSpec(
    name="street",
    kind="bearings",
    summary="three dimensions: arrays on lamp posts see a phone directly, or unknowingly by a facade or the ground",
    reference="generic",
    options=StreetOptions,
    scene=scene,
    generate=generate,
)
