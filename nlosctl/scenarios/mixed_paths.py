"""Direct rows, rows via a flat mirror and rows via a circle together: sensors in a valley under a curved layer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import FloatArray, IntArray
from nlosctl.contract.options import option
from nlosctl.contract.scene import CircleReflector, LineReflector, Scene, Sensor
from nlosctl.scenarios.bearing_rows import bearing_columns, sensor_names
from nlosctl.scenarios.spec import Columns, ScenarioSpec

__all__ = ["SCENARIO", "MixedPathsOptions", "draw_paths", "generate", "scene", "valley"]

_GROUND_SHARE, _LAYER_SHARE = 40.0, 41.5
"""Radii of the ground and of the layer above it, in baselines."""


@dataclass(frozen=True, kw_only=True)
class MixedPathsOptions:
    """Parameters of ``mixed``."""

    sensors: int = option(6, minimum=1, maximum=1000, meaning="sensors, evenly along the ground")
    baseline_m: float = option(
        10e3, unit="m", minimum=0.0, exclusive=True, meaning="distance along the ground from first to last sensor"
    )
    shares: tuple[float, float, float] = option(
        (0.4, 0.3, 0.3), minimum=0.0, maximum=1.0, meaning="shares of direct rows, rows via the mirror, via the circle"
    )
    bearing_std_deg: float = option(
        1.0, unit="deg", minimum=0.0, maximum=180.0, exclusive=True, meaning="standard deviation of every bearing"
    )
    outlier_fraction: float = option(
        0.0, minimum=0.0, maximum=1.0, meaning="share of the rows whose bearing is uniform over the circle"
    )


def scene(options: MixedPathsOptions) -> Scene:
    """Return the scene of `valley`."""
    return valley(options.sensors, options.baseline_m)


def valley(sensors: int, baseline_m: float) -> Scene:
    """Return sensors on ground with a radius of 40 baselines, a ``layer`` 1.5 baselines above it, a steep ``cliff``."""
    ground = _GROUND_SHARE * baseline_m
    angle = np.linspace(-0.5, 0.5, sensors) / _GROUND_SHARE if sensors > 1 else np.zeros(1)
    on_ground = (
        Sensor(name=name, position=(float(ground * np.sin(a)), float(ground * np.cos(a)) - ground))
        for name, a in zip(sensor_names(sensors), angle, strict=True)
    )
    return Scene(
        sensors=tuple(on_ground),
        reflectors=(
            LineReflector(name="cliff", point=(0.8 * baseline_m, 0.0), direction=(0.1, 1.0)),
            CircleReflector(
                name="layer", center=(0.0, -ground), radius=_LAYER_SHARE * baseline_m, blocker_radius=ground
            ),
        ),
    )


def draw_paths(
    generator: np.random.Generator, shape: tuple[int, int], baseline_m: float, shares: tuple[float, float, float]
) -> tuple[FloatArray, IntArray]:
    """Return sources (B, 2) above the ground of `valley`, and the reflector (B, K) of each row, -1 for direct rows."""
    x = generator.uniform(-0.5, 0.5, shape[0])
    y = generator.uniform(0.2, 0.8, shape[0])
    limits = np.cumsum(shares) / max(np.sum(shares), np.finfo(float).tiny)
    path = np.minimum(np.searchsorted(limits, generator.random(shape), side="right"), 2) - 1
    return baseline_m * np.stack([x, y], axis=1), path


def generate(options: MixedPathsOptions, generator: np.random.Generator, snapshots: int) -> Columns:
    """Sample snapshots, each with its own source above the ground: every sensor sees it along every path."""
    world = scene(options)
    positions = np.array([sensor.position for sensor in world.sensors])
    shape = (snapshots, options.sensors)
    source, path = draw_paths(generator, shape, options.baseline_m, options.shares)
    return bearing_columns(
        scene=world,
        generator=generator,
        names=tuple(sensor.name for sensor in world.sensors),
        sensor_xy_m=np.broadcast_to(positions, (*shape, 2)),
        source_xy_m=source,
        bearing_std_rad=np.full(shape, np.radians(options.bearing_std_deg)),
        reflector=path,
        outlier_fraction=options.outlier_fraction,
    )


SCENARIO = ScenarioSpec(
    name="mixed",
    kind="bearings",
    summary="direct rows, rows via a flat mirror and rows via a circle over opaque ground, in one snapshot",
    reference="generic",
    options=MixedPathsOptions,
    scene=scene,
    generate=generate,
)
