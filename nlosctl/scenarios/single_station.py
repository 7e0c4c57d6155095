"""One station that measures azimuth and elevation of a source whose height is known, directly or by a flat layer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.contract.options import option
from nlosctl.contract.scene import PlaneReflector, Scene, Sensor
from nlosctl.scenarios.space_rows import direction_columns, in_table_order, measured_heights
from nlosctl.scenarios.spec import Columns, ScenarioSpec

__all__ = ["SCENARIO", "SingleStationOptions", "generate", "scene"]


@dataclass(frozen=True, kw_only=True)
class SingleStationOptions:
    """Parameters of ``single-station``."""

    sensor_height_m: float = option(50.0, unit="m", meaning="height of the station")
    layer_height_m: float | None = option(
        None,
        unit="m",
        minimum=0.0,
        exclusive=True,
        meaning="height of a flat layer that reflects; default: none, direct",
    )
    distances_m: tuple[float, float] = option(
        (200.0, 600.0), unit="m", minimum=0.0, exclusive=True, meaning="least and largest horizontal distance"
    )
    source_height_m: float = option(1.5, unit="m", meaning="mean height of the source")
    height_std_m: float = option(0.5, unit="m", minimum=0.0, meaning="standard deviation of the measured height")
    angle_std_deg: float = option(
        0.5,
        unit="deg",
        minimum=0.0,
        maximum=90.0,
        exclusive=True,
        meaning="standard deviation of azimuth and elevation",
    )


def scene(options: SingleStationOptions) -> Scene:
    """Return the station above the origin, and the layer if there is one."""
    layers = () if options.layer_height_m is None else (_layer(options.layer_height_m),)
    return Scene(sensors=(Sensor(name="s1", position=(0.0, 0.0), z_m=options.sensor_height_m),), reflectors=layers)


def generate(options: SingleStationOptions, generator: np.random.Generator, snapshots: int) -> Columns:
    """Sample snapshots of one row, with the measured height in ``target_z_m``."""
    nearest, farthest = sorted(options.distances_m)
    distance, turn = (generator.uniform(nearest, farthest, snapshots), generator.uniform(-np.pi, np.pi, snapshots))
    height = np.full(snapshots, options.source_height_m)
    std = np.full((snapshots, 1), np.radians(options.angle_std_deg))
    columns = direction_columns(
        scene=scene(options),
        generator=generator,
        source_m=np.stack([distance * np.cos(turn), distance * np.sin(turn), height], axis=1),
        reflector=np.full((snapshots, 1), -1 if options.layer_height_m is None else 0, dtype=np.int64),
        stds_rad=(std, std),
    )
    return in_table_order("bearings", {**columns, **measured_heights(generator, height, options.height_std_m, 1)})


def _layer(height_m: float) -> PlaneReflector:
    return PlaneReflector(name="layer", point=(0.0, 0.0, height_m), normal=(0.0, 0.0, 1.0))


SCENARIO = ScenarioSpec(
    name="single-station",
    kind="bearings",
    summary="three dimensions: one azimuth and elevation and a measured height, directly or by a flat layer",
    reference="generic",
    options=SingleStationOptions,
    scene=scene,
    generate=generate,
)
