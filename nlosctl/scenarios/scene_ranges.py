"""Ranges in the user's own scene: sensors, mirrors, walls and circles of a scene file."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.contract.options import option
from nlosctl.contract.scene import Scene
from nlosctl.models.ranges.predictions import predict_ranges
from nlosctl.scenarios.scene_paths import SceneOptions, row_columns, scenario_in_scene, scene_paths
from nlosctl.scenarios.spec import Columns

__all__ = ["SCENARIO", "SceneRangesOptions", "generate"]


@dataclass(frozen=True, kw_only=True)
class SceneRangesOptions(SceneOptions):
    """Parameters of ``ranges``."""

    range_std_m: float = option(1.0, unit="m", minimum=0.0, exclusive=True, meaning="standard deviation of every range")
    target_z_m: float = option(0.0, unit="m", meaning="height of the target, if the sensors of the scene have heights")
    outlier_fraction: float = option(
        0.0, minimum=0.0, maximum=1.0, meaning="share of the rows whose range is too long by an exponential bias"
    )
    bias_mean_m: float = option(10.0, unit="m", minimum=0.0, exclusive=True, meaning="mean bias of such a row")


def generate(options: SceneRangesOptions, generator: np.random.Generator, snapshots: int, scene: Scene) -> Columns:
    """Sample snapshots in ``scene``, each with its target and a row for every path that exists."""
    paths = scene_paths(options, scene, generator, snapshots)
    shape = paths.exists.shape
    target = np.broadcast_to(paths.target_xy_m[:, None], (*shape, 2))
    reflector = np.broadcast_to(paths.reflector, shape)
    heights = np.array([sensor.z_m or 0.0 for sensor in scene.sensors])[paths.sensor]
    above = np.broadcast_to(heights - options.target_z_m * scene.has_heights, shape)
    length = predict_ranges(paths.sensor_xy_m, above, target, reflector, scene)
    noisy = length + options.range_std_m * generator.standard_normal(shape)
    follows_path = generator.random(shape) >= options.outlier_fraction
    noisy = np.where(follows_path, noisy, noisy + generator.exponential(options.bias_mean_m, shape))
    values = {
        "range_m": np.maximum(np.abs(noisy), np.finfo(np.float64).tiny),
        "range_std_m": np.full(shape, options.range_std_m),
        "truth_los": follows_path,
    }
    if scene.has_heights:
        values["sensor_z_m"] = np.broadcast_to(heights, shape)
    return row_columns(paths, values)


SCENARIO = scenario_in_scene(name="ranges", options=SceneRangesOptions, generate=generate)
