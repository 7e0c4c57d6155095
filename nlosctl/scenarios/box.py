"""Ranges from anchors in a hall, on its ceiling or between floor and ceiling, in three dimensions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from nlosctl.contract.options import option
from nlosctl.contract.scene import Scene, Sensor
from nlosctl.scenarios.bearing_rows import sensor_names
from nlosctl.scenarios.space_rows import in_table_order, measured_heights, sensor_coordinates
from nlosctl.scenarios.spec import Columns, ScenarioSpec

__all__ = ["SCENARIO", "BoxOptions", "generate", "scene"]


@dataclass(frozen=True, kw_only=True)
class BoxOptions:
    """Parameters of ``box``."""

    anchors: int = option(6, minimum=3, maximum=1000, meaning="anchors, evenly around the hall")
    width_m: float = option(20.0, unit="m", minimum=0.0, exclusive=True, meaning="width and depth of the hall")
    height_m: float = option(6.0, unit="m", minimum=0.0, exclusive=True, meaning="height of the ceiling")
    lowest_anchor_m: float = option(
        0.0,
        unit="m",
        meaning="height of every second anchor; the others are on the ceiling; height_m: all are, in one plane",
    )
    range_std_m: float = option(0.1, unit="m", minimum=0.0, exclusive=True, meaning="standard deviation of every range")
    outlier_fraction: float = option(
        0.0, minimum=0.0, maximum=1.0, meaning="share of the rows whose range is too long by an exponential bias"
    )
    bias_mean_m: float = option(5.0, unit="m", minimum=0.0, exclusive=True, meaning="mean bias of such a row")
    height_std_m: float | None = option(
        None, unit="m", minimum=0.0, meaning="standard deviation of a measured height; default: no height is measured"
    )


def scene(options: BoxOptions) -> Scene:
    """Return the anchors around the hall, whose floor is at height 0 and whose middle is above the origin."""
    turn = 2.0 * np.pi * (np.arange(options.anchors) + 0.5) / options.anchors
    across = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    place = 0.5 * options.width_m * across / np.abs(across).max(axis=1, keepdims=True)
    names = sensor_names(options.anchors)
    return Scene(
        sensors=tuple(
            Sensor(name=name, position=(x, y), z_m=options.lowest_anchor_m if number % 2 else options.height_m)
            for number, (name, (x, y)) in enumerate(zip(names, place.tolist(), strict=True))
        )
    )


def generate(options: BoxOptions, generator: np.random.Generator, snapshots: int) -> Columns:
    """Sample snapshots, each with its own target, uniform in the middle of the hall, up to half its height."""
    world = scene(options)
    shape = (snapshots, options.anchors)
    half = 0.4 * options.width_m
    target = np.stack(
        [
            generator.uniform(-half, half, snapshots),
            generator.uniform(-half, half, snapshots),
            generator.uniform(0.0, 0.5 * options.height_m, snapshots),
        ],
        axis=1,
    )
    anchor = np.broadcast_to(sensor_coordinates(world), (*shape, 3))
    noisy = np.linalg.norm(target[:, None] - anchor, axis=2) + options.range_std_m * generator.standard_normal(shape)
    follows_path = generator.random(shape) >= options.outlier_fraction
    noisy = np.where(follows_path, noisy, noisy + generator.exponential(options.bias_mean_m, shape))
    columns: dict[str, Any] = {
        "snapshot": np.repeat(np.arange(snapshots, dtype=np.int64), options.anchors),
        "sensor": np.tile(np.array([sensor.name for sensor in world.sensors], dtype=object), snapshots),
        "sensor_x_m": anchor[..., 0].ravel(),
        "sensor_y_m": anchor[..., 1].ravel(),
        "sensor_z_m": anchor[..., 2].ravel(),
        "range_m": np.maximum(np.abs(noisy), np.finfo(np.float64).tiny).ravel(),
        "range_std_m": np.full(noisy.size, options.range_std_m),
        "truth_x_m": np.repeat(target[:, 0], options.anchors),
        "truth_y_m": np.repeat(target[:, 1], options.anchors),
        "truth_z_m": np.repeat(target[:, 2], options.anchors),
        "truth_los": follows_path.ravel(),
    }
    if options.height_std_m is not None:
        columns |= measured_heights(generator, target[:, 2], options.height_std_m, options.anchors)
    return in_table_order("ranges", columns)


SCENARIO = ScenarioSpec(
    name="box",
    kind="ranges",
    summary="three dimensions: ranges from anchors in a hall, on its ceiling or between floor and ceiling",
    reference="generic",
    options=BoxOptions,
    scene=scene,
    generate=generate,
)
