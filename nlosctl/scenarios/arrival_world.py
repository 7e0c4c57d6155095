"""Arrival times of one source at microphones around a meadow, or at receivers of an aircraft's signals in space."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray
from nlosctl.contract.options import option
from nlosctl.contract.scene import Scene, Sensor
from nlosctl.errors import UsageError
from nlosctl.scenarios.bearing_rows import sensor_names
from nlosctl.scenarios.scene_arrivals import IN_SCENE
from nlosctl.scenarios.spec import Columns, ScenarioSpec

__all__ = ["SCENARIO", "ArrivalOptions", "generate", "scene"]


@dataclass(frozen=True, kw_only=True)
class ArrivalOptions:
    """Parameters of ``arrivals``; the heights matter with ``dimensions=3``."""

    sensors: int = option(8, minimum=1, maximum=100_000, meaning="sensors on the circle")
    radius_m: float = option(500.0, unit="m", minimum=0.0, exclusive=True, meaning="radius of the sensors' circle")
    source_radius_m: float = option(
        400.0, unit="m", minimum=0.0, meaning="radius of the concentric disc that contains the source"
    )
    dimensions: Literal[2, 3] = option(2, meaning="2: a plane; 3: sensors and source have heights")
    sensor_height_m: float = option(
        100.0, unit="m", minimum=0.0, meaning="sensors are at every other height of 0 and this"
    )
    source_height_m: tuple[float, float] = option(
        (0.0, 300.0), unit="m", meaning="lowest and highest height of the source; uniform between them"
    )
    arrival_std_m: float = option(
        1.0, unit="m", minimum=0.0, exclusive=True, meaning="standard deviation of every arrival, or difference"
    )
    outlier_fraction: float = option(
        0.0, minimum=0.0, maximum=1.0, meaning="share of the rows that are late by an exponential delay"
    )
    delay_mean_m: float = option(60.0, unit="m", minimum=0.0, exclusive=True, meaning="mean delay of such a row")
    speed_std: float = option(
        0.0,
        minimum=0.0,
        maximum=0.25,
        meaning="standard deviation of the speed of the wave, as a share of it, in each snapshot",
    )
    pairs: int = option(
        0, minimum=0, maximum=100_000, meaning="independent differences of so many pairs of sensors; 0: arrivals"
    )
    offset_m: float = option(1e5, unit="m", minimum=0.0, meaning="offsets are uniform within this on either side of 0")


def scene(options: ArrivalOptions) -> Scene:
    """Return the sensors, the first on the +x axis, counter-clockwise."""
    angle = 2.0 * np.pi * np.arange(options.sensors) / options.sensors
    x, y = options.radius_m * np.cos(angle), options.radius_m * np.sin(angle)
    heights = [options.sensor_height_m * (number % 2) for number in range(options.sensors)]
    return Scene(
        sensors=tuple(
            Sensor(name=name, position=(float(x[k]), float(y[k])), z_m=heights[k] if options.dimensions == 3 else None)
            for k, name in enumerate(sensor_names(options.sensors))
        )
    )


def generate(options: ArrivalOptions, generator: np.random.Generator, snapshots: int) -> Columns:
    """Sample snapshots, each with its own source, uniform over the disc, and its own offset or pairs of sensors."""
    world, dimension = scene(options), int(options.dimensions)
    radius = options.source_radius_m * np.sqrt(generator.random(snapshots))
    angle = generator.uniform(-np.pi, np.pi, snapshots)
    source = [radius * np.cos(angle), radius * np.sin(angle), generator.uniform(*options.source_height_m, snapshots)]
    sensors = [np.array([(*sensor.position, sensor.z_m or 0.0)[axis] for sensor in world.sensors]) for axis in range(3)]
    offset = options.offset_m * generator.uniform(-1.0, 1.0, snapshots)
    squares = [(part[:, None] - own) ** 2 for part, own in zip(source[:dimension], sensors, strict=False)]
    distance = np.sqrt(np.sum(squares, axis=0))
    names = np.array([sensor.name for sensor in world.sensors], dtype=object)
    number = np.broadcast_to(np.arange(options.sensors), distance.shape)
    if options.pairs:
        number, other = _pairs(options, generator, snapshots)
        exact = np.take_along_axis(distance, number, axis=1) - np.take_along_axis(distance, other, axis=1)
        of_rows = {"reference": names[other.ravel()]}
        of_rows |= {
            f"reference_{axis}_m": own[other.ravel()] for axis, own in zip("xyz"[:dimension], sensors, strict=False)
        }
    else:
        exact = distance + offset[:, None]
        of_rows = {"truth_offset_m": np.repeat(offset, options.sensors)}
    measured, is_direct = _measured(options, generator, exact)
    if options.speed_std:
        ranges = exact if options.pairs else distance
        error = options.speed_std * generator.standard_normal(snapshots)
        measured = measured - (error / (1.0 + error))[:, None] * ranges
    return {
        "snapshot": np.repeat(np.arange(snapshots, dtype=np.int64), number.shape[1]),
        "sensor": names[number.ravel()],
        **{f"sensor_{axis}_m": own[number.ravel()] for axis, own in zip("xyz"[:dimension], sensors, strict=False)},
        "tdoa_m" if options.pairs else "arrival_m": measured.ravel(),
        "arrival_std_m": np.full(measured.size, options.arrival_std_m),
        **{
            f"truth_{axis}_m": np.repeat(part, number.shape[1])
            for axis, part in zip("xyz"[:dimension], source, strict=False)
        },
        "truth_los": is_direct.ravel(),
        **of_rows,
    }


def _pairs(options: ArrivalOptions, generator: np.random.Generator, snapshots: int) -> tuple[IntArray, IntArray]:
    """Return the sensors and references (B, pairs) of different pairs, random in each snapshot and of random sign."""
    one, other = np.triu_indices(options.sensors, 1)
    if options.pairs > one.size:
        raise UsageError(
            f"{options.sensors} sensors have {one.size} pairs. Got pairs={options.pairs}; set it to at most that."
        )
    chosen = np.argsort(generator.random((snapshots, one.size)), axis=1)[:, : options.pairs]
    turned = generator.random(chosen.shape) < 0.5
    return np.where(turned, other[chosen], one[chosen]), np.where(turned, one[chosen], other[chosen])


def _measured(
    options: ArrivalOptions, generator: np.random.Generator, exact: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Return what is measured of exact arrivals or differences (B, K), and which of them are direct."""
    measured = exact + options.arrival_std_m * generator.standard_normal(exact.shape)
    is_direct = generator.random(exact.shape) >= options.outlier_fraction
    late = generator.exponential(options.delay_mean_m, exact.shape)
    return np.where(is_direct, measured, measured + late), is_direct


SCENARIO = ScenarioSpec(
    name="arrivals",
    kind="arrivals",
    summary="arrival times of a source in a ring of sensors, in the plane or in space, some late; unknown offset; or "
    "in a scene of your own (--scene FILE)",
    reference="generic",
    options=ArrivalOptions,
    scene=scene,
    generate=generate,
    of_scene=IN_SCENE.of_scene,
)
