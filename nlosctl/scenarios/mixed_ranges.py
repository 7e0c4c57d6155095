"""Ranges by direct paths, a flat mirror and a circle together, in the valley of ``mixed``."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.contract.options import option
from nlosctl.contract.scene import Scene
from nlosctl.models.ranges.predictions import predict_ranges
from nlosctl.scenarios.mixed_paths import draw_paths, valley
from nlosctl.scenarios.spec import Columns, ScenarioSpec

__all__ = ["SCENARIO", "MixedRangesOptions", "generate", "scene"]


@dataclass(frozen=True, kw_only=True)
class MixedRangesOptions:
    """Parameters of ``mixed-ranges``."""

    sensors: int = option(6, minimum=1, maximum=1000, meaning="sensors, evenly along the ground")
    baseline_m: float = option(
        10e3, unit="m", minimum=0.0, exclusive=True, meaning="distance along the ground from first to last sensor"
    )
    shares: tuple[float, float, float] = option(
        (0.4, 0.3, 0.3), minimum=0.0, maximum=1.0, meaning="shares of direct rows, rows via the mirror, via the circle"
    )
    range_std_m: float = option(
        30.0, unit="m", minimum=0.0, exclusive=True, meaning="standard deviation of every range"
    )
    outlier_fraction: float = option(
        0.0, minimum=0.0, maximum=1.0, meaning="share of the rows whose range is too long, by up to the baseline"
    )


def scene(options: MixedRangesOptions) -> Scene:
    """Return the scene of ``mixed``: sensors on round ground, a ``layer`` above it, a steep ``cliff``."""
    return valley(options.sensors, options.baseline_m)


def generate(options: MixedRangesOptions, generator: np.random.Generator, snapshots: int) -> Columns:
    """Sample snapshots, each with its own source above the ground: every sensor sees it along every path."""
    world = scene(options)
    sensors = len(world.sensors)
    shape = (snapshots, sensors)
    position = np.broadcast_to(np.array([sensor.position for sensor in world.sensors]), (*shape, 2))
    source, reflector = draw_paths(generator, shape, options.baseline_m, options.shares)
    everywhere = np.broadcast_to(source[:, None], position.shape)
    exact = predict_ranges(position, np.zeros(shape), everywhere, reflector, world)
    noisy = np.abs(exact + options.range_std_m * generator.standard_normal(shape))
    follows_path = generator.random(shape) >= options.outlier_fraction
    late = generator.uniform(0.0, options.baseline_m, shape)
    names = np.array([*world.reflector_names, None], dtype=object)
    return {
        "snapshot": np.repeat(np.arange(snapshots, dtype=np.int64), sensors),
        "sensor": np.tile(np.array([sensor.name for sensor in world.sensors], dtype=object), snapshots),
        "sensor_x_m": position[..., 0].ravel(),
        "sensor_y_m": position[..., 1].ravel(),
        "range_m": (noisy + np.where(follows_path, 0.0, late)).ravel(),
        "range_std_m": np.full(noisy.size, options.range_std_m),
        "reflector": names[reflector.ravel()],
        "truth_x_m": np.repeat(source[:, 0], sensors),
        "truth_y_m": np.repeat(source[:, 1], sensors),
        "truth_los": follows_path.ravel(),
    }


SCENARIO = ScenarioSpec(
    name="mixed-ranges",
    kind="ranges",
    summary="ranges by direct paths, a flat mirror and a circle over opaque ground, in one snapshot",
    reference="generic",
    options=MixedRangesOptions,
    scene=scene,
    generate=generate,
)
