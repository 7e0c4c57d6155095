"""Bearings in the user's own scene: sensors, mirrors, walls, circles and spheres of a scene file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from nlosctl.contract.options import option
from nlosctl.contract.scene import Scene
from nlosctl.geometry.angles import wrap_angle
from nlosctl.scenarios.bearing_rows import ErrorModel, bearing_errors
from nlosctl.scenarios.scene_paths import SceneOptions, row_columns, scenario_in_scene, scene_paths
from nlosctl.scenarios.space_rows import within_zenith
from nlosctl.scenarios.spec import Columns

__all__ = ["SCENARIO", "SceneBearingsOptions", "generate"]


@dataclass(frozen=True, kw_only=True)
class SceneBearingsOptions(SceneOptions):
    """Parameters of ``bearings``."""

    OF_SPACE: ClassVar[tuple[str, ...]] = (*SceneOptions.OF_SPACE, "elevation_std_deg", "azimuth_only")

    bearing_std_deg: float = option(
        1.0, unit="deg", minimum=0.0, maximum=90.0, exclusive=True, meaning="standard deviation of every bearing"
    )
    elevation_std_deg: float | None = option(
        None,
        unit="deg",
        minimum=0.0,
        maximum=90.0,
        exclusive=True,
        meaning="standard deviation of every elevation, if the sensors of the scene have heights; default: that of "
        "bearings",
    )
    azimuth_only: float = option(0.0, minimum=0.0, maximum=1.0, meaning="share of the rows without an elevation")
    errors: ErrorModel = option(  # noqa: RUF009 - the name looks like that of a class
        "gaussian", meaning="distribution of the errors"
    )
    outlier_fraction: float = option(
        0.0, minimum=0.0, maximum=1.0, meaning="share of the rows with a bearing (and an elevation) anywhere"
    )


def generate(options: SceneBearingsOptions, generator: np.random.Generator, snapshots: int, scene: Scene) -> Columns:
    """Sample snapshots in ``scene``, each with its target and a row for every path that exists."""
    paths = scene_paths(options, scene, generator, snapshots)
    std = np.full(paths.exists.shape, np.radians(options.bearing_std_deg))
    bearing = paths.bearing_rad + bearing_errors(generator, options.errors, std)
    follows_path = generator.random(std.shape) >= options.outlier_fraction
    bearing = np.where(follows_path, bearing, generator.uniform(-np.pi, np.pi, std.shape))
    values = {"bearing_std_rad": std, "truth_los": follows_path}
    if paths.elevation_rad is not None:
        degrees = options.bearing_std_deg if options.elevation_std_deg is None else options.elevation_std_deg
        rise_std = np.full(std.shape, np.radians(degrees))
        rise = paths.elevation_rad + bearing_errors(generator, options.errors, rise_std)
        rise = np.where(follows_path, rise, generator.uniform(-0.5 * np.pi, 0.5 * np.pi, std.shape))
        bearing, rise = within_zenith(bearing, rise)
        alone = generator.random(std.shape) < options.azimuth_only
        values["elevation_rad"] = np.where(alone, np.nan, rise)
        values["elevation_std_rad"] = np.where(alone, np.nan, rise_std)
    return row_columns("bearings", paths, {**values, "bearing_rad": wrap_angle(bearing)})


SCENARIO = scenario_in_scene(name="bearings", options=SceneBearingsOptions, generate=generate)
