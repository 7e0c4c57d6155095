"""Sensors and sources anywhere in a square field, unequal standard deviations, some rows via line mirrors around it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.contract.options import option
from nlosctl.contract.scene import LineReflector, Scene, Sensor
from nlosctl.errors import UsageError
from nlosctl.scenarios.bearing_rows import bearing_columns, sensor_names
from nlosctl.scenarios.spec import Columns, ScenarioSpec

__all__ = ["SCENARIO", "RandomFieldOptions", "generate", "scene"]

_REDRAWS = 200
_MIRROR_DISTANCE = (0.75, 1.5)
"""Distance of the mirrors from the field's centre, in sides of the field: beyond its corners, at 0.708."""


@dataclass(frozen=True, kw_only=True)
class RandomFieldOptions:
    """Parameters of ``random``."""

    sensors: int = option(6, minimum=1, maximum=100_000, meaning="sensors")
    layout: Literal["fresh", "fixed"] = option(
        "fresh", meaning="fresh: new sensor positions in each snapshot; fixed: the scene's, drawn from layout_seed"
    )
    layout_seed: int = option(0, minimum=0, meaning="seed of the mirrors, and of fixed sensors")
    field_m: float = option(1000.0, unit="m", minimum=0.0, exclusive=True, meaning="side of the square field")
    min_range_m: float = option(20.0, unit="m", minimum=0.0, meaning="smallest distance of a source from a sensor")
    bearing_std_deg: tuple[float, float] = option(
        (0.5, 4.0),
        unit="deg",
        minimum=0.0,
        maximum=180.0,
        exclusive=True,
        meaning="smallest and largest standard deviation; log-uniform over the rows",
    )
    mirrors: int = option(3, minimum=0, maximum=10_000, meaning="line mirrors around the field")
    reflected_fraction: float = option(
        0.5, minimum=0.0, maximum=1.0, meaning="share of the rows seen in a mirror, if there are mirrors"
    )
    outlier_fraction: float = option(
        0.0, minimum=0.0, maximum=1.0, meaning="share of the rows whose bearing is uniform over the circle"
    )

    def __post_init__(self) -> None:
        if self.bearing_std_deg[0] > self.bearing_std_deg[1]:
            raise UsageError(
                "The 'bearing_std_deg' parameter of random must be smallest,largest. "
                f"Got {self.bearing_std_deg[0]:g},{self.bearing_std_deg[1]:g} instead."
            )


def scene(options: RandomFieldOptions) -> Scene:
    """Return mirrors of random direction, all beyond the corners of the field, and the sensors of a fixed layout.

    The field is centred on (0, 0): every source and sensor is on the same side of every mirror, so that every mirror
    path exists. Mirrors and sensors use separate random streams: the number of one does not change the other.
    """
    mirror_stream, sensor_stream = np.random.default_rng(options.layout_seed).spawn(2)
    normal = mirror_stream.uniform(-np.pi, np.pi, options.mirrors)
    distance = options.field_m * mirror_stream.uniform(*_MIRROR_DISTANCE, options.mirrors)
    mirrors = tuple(
        LineReflector(
            name=f"mirror{i}",
            point=(float(d * np.cos(a)), float(d * np.sin(a))),
            direction=(float(-np.sin(a)), float(np.cos(a))),
        )
        for i, (a, d) in enumerate(zip(normal, distance, strict=True), 1)
    )
    if options.layout == "fresh":
        return Scene(reflectors=mirrors)
    positions = _uniform(sensor_stream, (options.sensors, 2), options.field_m)
    sensors = (
        Sensor(name=name, position=(float(x), float(y)))
        for name, (x, y) in zip(sensor_names(options.sensors), positions, strict=True)
    )
    return Scene(sensors=tuple(sensors), reflectors=mirrors)


def generate(options: RandomFieldOptions, generator: np.random.Generator, snapshots: int) -> Columns:
    """Sample snapshots, each with its own source, uniform over the field.

    Raises UsageError if the sensors leave no room for a source at ``min_range_m``.
    """
    world = scene(options)
    shape = (snapshots, options.sensors)
    if options.layout == "fixed":
        sensors = np.broadcast_to(np.array([sensor.position for sensor in world.sensors]), (*shape, 2))
    else:
        sensors = _uniform(generator, (*shape, 2), options.field_m)
    low, high = np.log(np.radians(options.bearing_std_deg))
    reflector = np.full(shape, -1, dtype=np.int64)
    if options.mirrors:
        reflected = generator.random(shape) < options.reflected_fraction
        reflector = np.where(reflected, generator.integers(0, options.mirrors, shape), -1)
    return bearing_columns(
        scene=world,
        generator=generator,
        names=sensor_names(options.sensors),
        sensor_xy_m=sensors,
        source_xy_m=_sources(generator, sensors, options),
        bearing_std_rad=np.exp(generator.uniform(low, high, shape)),
        reflector=reflector,
        outlier_fraction=options.outlier_fraction,
    )


def _uniform(generator: np.random.Generator, shape: tuple[int, ...], field_m: float) -> FloatArray:
    return generator.uniform(-0.5 * field_m, 0.5 * field_m, shape)


def _sources(generator: np.random.Generator, sensors: FloatArray, options: RandomFieldOptions) -> FloatArray:
    """Return sources (B, 2), redrawn until none is closer to a sensor (B, K, 2) than ``min_range_m``."""
    sources = np.empty((sensors.shape[0], 2))
    pending = np.arange(sensors.shape[0])
    for _ in range(_REDRAWS):
        sources[pending] = _uniform(generator, (pending.size, 2), options.field_m)
        offset = sensors[pending] - sources[pending, None, :]
        nearest = np.hypot(offset[..., 0], offset[..., 1]).min(axis=1)
        pending = pending[nearest < options.min_range_m]
        if not pending.size:
            return sources
    raise UsageError(
        f"The 'min_range_m' parameter of random leaves no room for a source among {options.sensors} sensors "
        f"in a field of {options.field_m:g} m. Got {options.min_range_m:g}; use a smaller distance."
    )


SCENARIO = ScenarioSpec(
    name="random",
    kind="bearings",
    summary="sensors and sources anywhere in a square field, unequal standard deviations, some rows via mirrors",
    reference="generic",
    options=RandomFieldOptions,
    scene=scene,
    generate=generate,
)
