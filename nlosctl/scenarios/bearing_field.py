"""Several sources in a square, heard by sensors around it: unlabelled bearings, with misses and clutter."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray
from nlosctl.contract.options import option
from nlosctl.contract.scene import Scene
from nlosctl.errors import UsageError
from nlosctl.geometry.angles import wrap_angle
from nlosctl.scenarios.bearing_rows import sensor_names
from nlosctl.scenarios.space_rows import in_table_order, within_zenith
from nlosctl.scenarios.spec import Columns, ScenarioSpec

__all__ = ["SCENARIO", "BearingFieldOptions", "generate"]

_ROUNDS = 1000
"""So often sources that are too near to each other are drawn again."""

_INNER, _NEAREST, _FARTHEST = 0.8, 0.45, 0.6
"""The side of the square of the sources, and the distances of sensors from its centre, in units of the field's side."""


@dataclass(frozen=True, kw_only=True)
class BearingFieldOptions:
    """Parameters of ``bearing-field``; the heights matter with ``dimensions=3``."""

    dimensions: Literal[2, 3] = option(2, meaning="2: bearings in the plane; 3: azimuths and elevations")
    sensors: int = option(6, minimum=1, maximum=10_000, meaning="sensors")
    targets: int = option(3, minimum=0, maximum=1000, meaning="sources in each snapshot")
    least_targets: int | None = option(
        None, minimum=0, meaning="least number of sources, uniform up to targets; default: targets"
    )
    width_m: float = option(
        1000.0, unit="m", minimum=0.0, exclusive=True, meaning="side of the field, from 0 in x and y"
    )
    apart_m: float = option(80.0, unit="m", minimum=0.0, meaning="least distance of two sources in the plane")
    height_m: float = option(200.0, unit="m", minimum=0.0, meaning="largest height of the sources")
    sensor_height_m: float = option(60.0, unit="m", minimum=0.0, meaning="largest height of the sensors")
    angle_std_deg: float = option(
        1.0,
        unit="deg",
        minimum=0.0,
        maximum=90.0,
        exclusive=True,
        meaning="standard deviation of every bearing, and of every elevation",
    )
    detection_probability: float = option(
        1.0, minimum=0.0, maximum=1.0, meaning="probability that a sensor gives a bearing of a source"
    )
    false_bearings: float = option(
        0.0,
        minimum=0.0,
        maximum=1000.0,
        meaning="mean number of false bearings per sensor, uniform over the half circle towards the centre",
    )

    def __post_init__(self) -> None:
        if self.least_targets is not None and self.least_targets > self.targets:
            raise UsageError(
                f"The 'least_targets' parameter must be at most {self.targets}, targets. Got {self.least_targets}."
            )


def scene(options: BearingFieldOptions) -> Scene:
    """Return an empty scene: each snapshot has sensors of its own."""
    return Scene()


def generate(options: BearingFieldOptions, generator: np.random.Generator, snapshots: int) -> Columns:
    """Sample snapshots, each with its own sensors and sources, and its rows in random order."""
    sensor = _draw_sensors(options, generator, snapshots)
    source = _draw_sources(options, generator, snapshots)
    least = options.targets if options.least_targets is None else options.least_targets
    count = generator.integers(least, options.targets + 1, snapshots)
    detected = generator.random((snapshots, options.sensors, options.targets)) < options.detection_probability
    detected &= (np.arange(options.targets) < count[:, None])[:, None]
    false_count = generator.poisson(options.false_bearings, (snapshots, options.sensors))
    most_false = int(false_count.max(initial=0))
    present = np.concatenate([detected, np.arange(most_false) < false_count[..., None]], axis=2)
    azimuth, elevation = _angles(options, generator, sensor, source, most_false)
    return _shuffled(options, generator, sensor, source, azimuth, elevation, present)


def _draw_sensors(options: BearingFieldOptions, generator: np.random.Generator, snapshots: int) -> FloatArray:
    """Return sensors (B, N, 3) around the field, counter-clockwise, in sectors of equal size."""
    shape = (snapshots, options.sensors)
    angle = 2.0 * np.pi / options.sensors * (np.arange(options.sensors) + generator.uniform(-0.25, 0.25, shape))
    distance = options.width_m * generator.uniform(_NEAREST, _FARTHEST, shape)
    x, y = (0.5 * options.width_m + distance * part for part in (np.cos(angle), np.sin(angle)))
    return np.stack([x, y, generator.uniform(0.0, options.sensor_height_m, shape)], axis=2)


def _draw_sources(options: BearingFieldOptions, generator: np.random.Generator, snapshots: int) -> FloatArray:
    """Return sources (B, T, 3), none nearer to another in the plane than ``apart_m``; raises UsageError if none fit."""
    inner = _INNER * options.width_m
    shape = (snapshots, options.targets, 2)
    source = generator.uniform(0.0, inner, shape)
    for _ in range(_ROUNDS):
        near = _too_near(source, options.apart_m)
        if not near.any():
            break
        source = np.where(near[..., None], generator.uniform(0.0, inner, shape), source)
    else:
        raise UsageError(
            f"The 'apart_m' parameter is too large for {options.targets} sources on {inner:g} m. Got {options.apart_m}."
        )
    height = generator.uniform(0.0, options.height_m, (*shape[:2], 1))
    return np.concatenate([source + 0.5 * (options.width_m - inner), height], axis=2)


def _too_near(source: FloatArray, apart_m: float) -> BoolArray:
    """Return which sources (B, T, 2) are too near to one before them."""
    distance = np.hypot(*(np.moveaxis(source[:, :, None] - source[:, None], -1, 0)))
    before = np.tri(source.shape[1], k=-1, dtype=bool)
    near: BoolArray = ((distance < apart_m) & before).any(axis=2)
    return near


def _angles(
    options: BearingFieldOptions, generator: np.random.Generator, sensor: FloatArray, source: FloatArray, false: int
) -> tuple[FloatArray, FloatArray]:
    """Return azimuths and elevations (B, N, T + F) of sources and of F false bearings."""
    away = source[:, None] - sensor[:, :, None]
    level = np.hypot(away[..., 0], away[..., 1])
    true = np.stack([np.arctan2(away[..., 1], away[..., 0]), np.arctan2(away[..., 2], level)])
    true += np.radians(options.angle_std_deg) * generator.standard_normal(true.shape)
    inward = np.arctan2(*np.moveaxis(0.5 * options.width_m - sensor[..., 1::-1], -1, 0))
    clutter = generator.uniform(-0.5 * np.pi, 0.5 * np.pi, (2, *sensor.shape[:2], false))
    clutter[0] += inward[..., None]
    azimuth, elevation = np.concatenate([true, clutter], axis=3)
    azimuth, elevation = within_zenith(azimuth, elevation)
    return wrap_angle(azimuth), elevation


def _shuffled(
    options: BearingFieldOptions,
    generator: np.random.Generator,
    sensor: FloatArray,
    source: FloatArray,
    azimuth: FloatArray,
    elevation: FloatArray,
    present: BoolArray,
) -> Columns:
    """Return the columns of the angles (B, N, M) that are ``present``, in random order within each snapshot."""
    snapshot, owner, row = np.nonzero(present)
    order = np.lexsort((generator.random(snapshot.shape[0]), snapshot))
    snapshot, owner, row = snapshot[order], owner[order], row[order]
    direct = row < options.targets
    truth = np.full((row.shape[0], 3), np.nan)
    truth[direct] = source[snapshot[direct], row[direct]]
    std = np.full(row.shape, np.radians(options.angle_std_deg))
    columns = {
        "snapshot": snapshot.astype(np.int64),
        "sensor": np.array(sensor_names(options.sensors), dtype=object)[owner],
        "bearing_rad": azimuth[snapshot, owner, row],
        "bearing_std_rad": std,
        "truth_los": direct,
        "truth_target": np.where(direct, row, np.nan),
    }
    columns |= {f"sensor_{axis}_m": sensor[snapshot, owner, i] for i, axis in enumerate("xyz"[: options.dimensions])}
    columns |= {f"truth_{axis}_m": truth[:, i] for i, axis in enumerate("xyz"[: options.dimensions])}
    if options.dimensions == 3:
        columns |= {"elevation_rad": elevation[snapshot, owner, row], "elevation_std_rad": std}
    return in_table_order("bearings", columns)


SCENARIO = ScenarioSpec(
    name="bearing-field",
    kind="bearings",
    summary="several sources in a square, sensors around it: unlabelled bearings, misses and clutter; 2-D or 3-D",
    reference="generic",
    options=BearingFieldOptions,
    scene=scene,
    generate=generate,
)
