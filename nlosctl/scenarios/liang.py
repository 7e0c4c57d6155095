"""The scene of Liang, Zeng, Li: sensors on a circle, targets in a square, scatterers on its edge."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.contract.options import option
from nlosctl.contract.scene import Scene, Sensor
from nlosctl.scenarios.bearing_rows import sensor_names
from nlosctl.scenarios.echo_rows import EchoOptions, echo_columns
from nlosctl.scenarios.spec import Columns, ScenarioSpec

__all__ = ["SCENARIO", "LiangOptions", "generate", "scene"]


@dataclass(frozen=True, kw_only=True)
class LiangOptions(EchoOptions):
    """Parameters of ``liang``."""

    sensors: int = option(6, minimum=1, maximum=10_000, meaning="sensors on the circle")
    radius_m: float = option(160.0, unit="m", minimum=0.0, exclusive=True, meaning="radius of the sensors' circle")
    side_m: float = option(
        400.0, unit="m", minimum=0.0, exclusive=True, meaning="side of the square, centred on (0, 0)"
    )
    scatterer_seed: int = option(0, minimum=0, meaning="seed of the scatterers, the same in all snapshots")


def scene(options: LiangOptions) -> Scene:
    """Return the sensors, the first on the +x axis, counter-clockwise."""
    names = sensor_names(options.sensors)
    return Scene(
        sensors=tuple(
            Sensor(name=name, position=(float(x), float(y)))
            for name, (x, y) in zip(names, _sensors(options), strict=True)
        )
    )


def generate(options: LiangOptions, generator: np.random.Generator, snapshots: int) -> Columns:
    """Sample snapshots, each with its own targets, uniform over the square (section IV)."""
    half = 0.5 * options.side_m
    scatterers = _edge_points(np.random.default_rng(options.scatterer_seed), options.scatterers, half)
    return echo_columns(
        options=options,
        generator=generator,
        sensor_xy_m=np.broadcast_to(_sensors(options), (snapshots, options.sensors, 2)),
        draw_targets=lambda shape: generator.uniform(-half, half, (*shape, 2)),
        scatterer_xy_m=np.broadcast_to(scatterers, (snapshots, options.scatterers, 2)),
    )


def _sensors(options: LiangOptions) -> FloatArray:
    angle = 2.0 * np.pi * np.arange(options.sensors) / options.sensors
    return options.radius_m * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _edge_points(generator: np.random.Generator, count: int, half: float) -> FloatArray:
    """Return points (count, 2) uniform on the edge of the square."""
    side, along = generator.integers(0, 4, count), generator.uniform(-half, half, count)
    across = np.where(side < 2, -half, half)
    upright = side % 2 == 0
    return np.stack([np.where(upright, across, along), np.where(upright, along, across)], axis=1)


SCENARIO = ScenarioSpec(
    name="liang",
    kind="ranges",
    summary="several passive targets, echoes unlabelled, direct or via scatterers, at sensors on a circle",
    reference="Liang, Zeng, Li, section IV, signal model (1)",
    options=LiangOptions,
    scene=scene,
    generate=generate,
)
