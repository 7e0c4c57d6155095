"""Ranges in the user's own scene: sensors, mirrors, walls, circles and spheres of a scene file."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.contract.options import option
from nlosctl.contract.scene import Scene
from nlosctl.scenarios.scene_paths import SceneOptions, row_columns, scenario_in_scene, scene_paths
from nlosctl.scenarios.spec import Columns

__all__ = ["SCENARIO", "SceneRangesOptions", "generate"]


@dataclass(frozen=True, kw_only=True)
class SceneRangesOptions(SceneOptions):
    """Parameters of ``ranges``."""

    range_std_m: float = option(1.0, unit="m", minimum=0.0, exclusive=True, meaning="standard deviation of every range")
    outlier_fraction: float = option(
        0.0, minimum=0.0, maximum=1.0, meaning="share of the rows whose range is too long by an exponential bias"
    )
    bias_mean_m: float = option(10.0, unit="m", minimum=0.0, exclusive=True, meaning="mean bias of such a row")


def generate(options: SceneRangesOptions, generator: np.random.Generator, snapshots: int, scene: Scene) -> Columns:
    """Sample snapshots in ``scene``, each with its target and a row for every path that exists."""
    paths = scene_paths(options, scene, generator, snapshots)
    shape = paths.exists.shape
    noisy = paths.length_m + options.range_std_m * generator.standard_normal(shape)
    follows_path = generator.random(shape) >= options.outlier_fraction
    noisy = np.where(follows_path, noisy, noisy + generator.exponential(options.bias_mean_m, shape))
    values = {
        "range_m": np.maximum(np.abs(noisy), np.finfo(np.float64).tiny),
        "range_std_m": np.full(shape, options.range_std_m),
        "truth_los": follows_path,
    }
    return row_columns("ranges", paths, values)


SCENARIO = scenario_in_scene(name="ranges", options=SceneRangesOptions, generate=generate)
