"""Bearings in the user's own scene: sensors, mirrors, walls and circles of a scene file."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.contract.options import option
from nlosctl.contract.scene import Scene
from nlosctl.geometry.angles import wrap_angle
from nlosctl.scenarios.bearing_rows import ErrorModel, bearing_errors
from nlosctl.scenarios.scene_paths import SceneOptions, row_columns, scenario_in_scene, scene_paths
from nlosctl.scenarios.spec import Columns

__all__ = ["SCENARIO", "SceneBearingsOptions", "generate"]


@dataclass(frozen=True, kw_only=True)
class SceneBearingsOptions(SceneOptions):
    """Parameters of ``bearings``."""

    bearing_std_deg: float = option(
        1.0, unit="deg", minimum=0.0, maximum=90.0, exclusive=True, meaning="standard deviation of every bearing"
    )
    errors: ErrorModel = option(  # noqa: RUF009 - the name looks like that of a class
        "gaussian", meaning="distribution of the errors"
    )
    outlier_fraction: float = option(
        0.0, minimum=0.0, maximum=1.0, meaning="share of the rows whose bearing is uniform over the circle"
    )


def generate(options: SceneBearingsOptions, generator: np.random.Generator, snapshots: int, scene: Scene) -> Columns:
    """Sample snapshots in ``scene``, each with its target and a row for every path that exists."""
    paths = scene_paths(options, scene, generator, snapshots)
    std = np.full(paths.exists.shape, np.radians(options.bearing_std_deg))
    bearing = paths.bearing_rad + bearing_errors(generator, options.errors, std)
    follows_path = generator.random(std.shape) >= options.outlier_fraction
    bearing = np.where(follows_path, bearing, generator.uniform(-np.pi, np.pi, std.shape))
    values = {"bearing_rad": wrap_angle(bearing), "bearing_std_rad": std, "truth_los": follows_path}
    return row_columns(paths, values)


SCENARIO = scenario_in_scene(name="bearings", options=SceneBearingsOptions, generate=generate)
