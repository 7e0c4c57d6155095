"""Arrival times in the user's own scene: at each sensor that of the first path."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from nlosctl.contract.options import option
from nlosctl.contract.scene import Scene
from nlosctl.scenarios.scene_paths import SceneOptions, ScenePaths, row_columns, scenario_in_scene, scene_paths
from nlosctl.scenarios.spec import Columns

__all__ = ["IN_SCENE", "SceneArrivalsOptions", "generate"]


@dataclass(frozen=True, kw_only=True)
class SceneArrivalsOptions(SceneOptions):
    """Parameters of ``arrivals`` in a scene."""

    arrival_std_m: float = option(
        1.0, unit="m", minimum=0.0, exclusive=True, meaning="standard deviation of every arrival"
    )
    outlier_fraction: float = option(
        0.0, minimum=0.0, maximum=1.0, meaning="share of the rows that are late by an exponential delay"
    )
    delay_mean_m: float = option(60.0, unit="m", minimum=0.0, exclusive=True, meaning="mean delay of such a row")
    offset_m: float = option(1e5, unit="m", minimum=0.0, meaning="offsets are uniform within this on either side of 0")


def generate(options: SceneArrivalsOptions, generator: np.random.Generator, snapshots: int, scene: Scene) -> Columns:
    """Sample snapshots in ``scene``, each with its target and offset, and a row for every sensor that a path reaches.

    The arrival is that of the shortest path: the direct one, if it exists, else the first by a reflector.
    """
    paths = _first_paths(scene_paths(options, scene, generator, snapshots))
    shape = paths.exists.shape
    offset = np.broadcast_to(options.offset_m * generator.uniform(-1.0, 1.0, (snapshots, 1)), shape)
    arrival = paths.length_m + offset + options.arrival_std_m * generator.standard_normal(shape)
    on_time = generator.random(shape) >= options.outlier_fraction
    values = {
        "arrival_m": np.where(on_time, arrival, arrival + generator.exponential(options.delay_mean_m, shape)),
        "arrival_std_m": np.full(shape, options.arrival_std_m),
        "truth_los": on_time & (paths.reflector < 0),
        "truth_offset_m": offset,
    }
    return row_columns("arrivals", paths, values)


def _first_paths(paths: ScenePaths) -> ScenePaths:
    """Return the paths, of those of a sensor only the shortest that exists."""
    reach_m = np.where(paths.exists, paths.length_m, np.inf)
    first = np.zeros_like(paths.exists)
    for sensor in np.unique(paths.sensor):
        ways = np.flatnonzero(paths.sensor == sensor)
        shortest = ways[np.argmin(reach_m[:, ways], axis=1)]
        first[np.arange(reach_m.shape[0]), shortest] = True
    return replace(paths, exists=first & paths.exists)


IN_SCENE = scenario_in_scene(name="arrivals", options=SceneArrivalsOptions, generate=generate)
