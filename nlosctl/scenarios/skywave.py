"""Over the horizon in three dimensions: stations on a globe receive a source by the ionosphere around it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.contract.options import option
from nlosctl.contract.scene import Scene, Sensor, SphereReflector
from nlosctl.scenarios.bearing_rows import sensor_names
from nlosctl.scenarios.space_rows import direction_columns, spread_stds
from nlosctl.scenarios.spec import Columns, ScenarioSpec

__all__ = ["SCENARIO", "SkywaveOptions", "generate", "scene"]

_EARTH_M = 6371e3


@dataclass(frozen=True, kw_only=True)
class SkywaveOptions:
    """Parameters of ``skywave``."""

    sensors: int = option(4, minimum=1, maximum=1000, meaning="stations on the ground, around the region of the source")
    distance_m: float = option(
        700e3, unit="m", minimum=1e3, maximum=1500e3, meaning="distance of the stations along the ground"
    )
    source_radius_m: float = option(
        150e3, unit="m", minimum=0.0, maximum=300e3, meaning="radius of the region of the source"
    )
    source_height_m: float = option(
        30e3, unit="m", minimum=0.0, maximum=59e3, meaning="largest height of the source, uniform from 0"
    )
    layer_height_m: float = option(300e3, unit="m", minimum=200e3, maximum=2000e3, meaning="height of the ionosphere")
    angle_std_deg: float = option(
        0.5,
        unit="deg",
        minimum=0.0,
        maximum=90.0,
        exclusive=True,
        meaning="standard deviation of azimuths and elevations; each has its own, from half to twice this one",
    )
    outlier_fraction: float = option(
        0.0, minimum=0.0, maximum=1.0, meaning="share of the rows with an azimuth and an elevation anywhere"
    )


def scene(options: SkywaveOptions) -> Scene:
    """Return the stations and the ionosphere: the origin is on the ground, the z axis up there."""
    turn = 2.0 * np.pi * (np.arange(options.sensors) + 0.25) / options.sensors
    place = _on_globe(np.full(options.sensors, options.distance_m), turn, np.zeros(options.sensors))
    layer = SphereReflector(
        name="ionosphere",
        center=(0.0, 0.0, -_EARTH_M),
        radius=_EARTH_M + options.layer_height_m,
        blocker_radius=_EARTH_M,
    )
    rows = zip(sensor_names(options.sensors), place.tolist(), strict=True)
    return Scene(
        sensors=tuple(Sensor(name=name, position=(x, y), z_m=z) for name, (x, y, z) in rows), reflectors=(layer,)
    )


def generate(options: SkywaveOptions, generator: np.random.Generator, snapshots: int) -> Columns:
    """Sample snapshots, each with its own source, seen by every station by the ionosphere."""
    shape = (snapshots, options.sensors)
    along = options.source_radius_m * np.sqrt(generator.random(snapshots))
    turn = generator.uniform(-np.pi, np.pi, snapshots)
    height = generator.uniform(0.0, options.source_height_m, snapshots)
    std = np.radians(options.angle_std_deg)
    return direction_columns(
        scene=scene(options),
        generator=generator,
        source_m=_on_globe(along, turn, height),
        reflector=np.zeros(shape, dtype=np.int64),
        stds_rad=(spread_stds(generator, std, shape), spread_stds(generator, std, shape)),
        wrong=options.outlier_fraction,
    )


def _on_globe(along_m: np.ndarray, turn: np.ndarray, height_m: np.ndarray) -> np.ndarray:
    """Return coordinates (N, 3) of places at distances along the ground from the origin and heights above it."""
    angle, radius = along_m / _EARTH_M, _EARTH_M + height_m
    return np.stack(
        [
            radius * np.sin(angle) * np.cos(turn),
            radius * np.sin(angle) * np.sin(turn),
            height_m * np.cos(angle) - 2.0 * _EARTH_M * np.sin(0.5 * angle) ** 2,
        ],
        axis=1,
    )


SCENARIO = ScenarioSpec(
    name="skywave",
    kind="bearings",
    summary="three dimensions: stations on a globe receive a source by the ionosphere, azimuth and elevation",
    reference="generic",
    options=SkywaveOptions,
    scene=scene,
    generate=generate,
)
