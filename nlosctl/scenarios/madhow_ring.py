"""Receivers around a disc with the bearing models of Ananthasubramaniam and Madhow: blocked, narrowband, wideband."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray
from nlosctl.contract.options import option
from nlosctl.contract.scene import Scene, Sensor
from nlosctl.errors import UsageError
from nlosctl.geometry.angles import wrap_angle
from nlosctl.scenarios.bearing_rows import bearing_errors, sensor_names
from nlosctl.scenarios.spec import Columns, ScenarioSpec

__all__ = ["SCENARIO", "MadhowRingOptions", "generate", "scene"]

_GRID = (-0.6, -0.3, 0.0, 0.3, 0.6)
"""Coordinates of the 25 sources, in radii; the paper does not give the positions of its 25."""


@dataclass(frozen=True, kw_only=True)
class MadhowRingOptions:
    """Parameters of ``madhow-ring``."""

    sensors: int = option(8, minimum=2, maximum=10_000, meaning="receivers")
    layout: Literal["ring", "random"] = option(
        "ring", meaning="ring: evenly on the circle; random: anywhere in the disc, new in each snapshot"
    )
    radius_m: float = option(1.0, unit="m", minimum=0.0, exclusive=True, meaning="radius of the disc")
    sources: Literal["grid", "disc"] = option(
        "grid", meaning="grid: 25 positions in turn, up to 0.6 radii in x and y; disc: uniform up to source_share"
    )
    source_share: float = option(
        0.8, minimum=0.0, maximum=1.0, meaning="radius of the disc of sources, in radii of the disc of receivers"
    )
    bearing_std_deg: float = option(
        4.0, unit="deg", minimum=0.0, maximum=90.0, exclusive=True, meaning="standard deviation of direct bearings"
    )
    noise: Literal["gaussian", "laplace", "cauchy"] = option(
        "gaussian", meaning="error of direct bearings: models (1), (2), or Cauchy with bearing_std_deg as half width"
    )
    nlos_receivers: int = option(
        0, minimum=0, maximum=10_000, meaning="receivers with a blocked direct path, new in each snapshot: model (3)"
    )
    alpha: float = option(
        0.0, minimum=0.0, maximum=1.0, meaning="probability that each other receiver is blocked too: model (4)"
    )
    paths: int = option(
        1, minimum=1, maximum=100, meaning="paths per receiver, the direct one at a random position: model (5)"
    )
    nlos_span_deg: float = option(
        180.0,
        unit="deg",
        minimum=1.0,
        maximum=360.0,
        meaning="width of the sector about the inward normal over which outliers are uniform",
    )
    range_std_share: float = option(
        0.0, minimum=0.0, maximum=1.0, meaning="standard deviation of the logarithm of log-normal ranges; 0: no ranges"
    )

    def __post_init__(self) -> None:
        if self.nlos_receivers > self.sensors:
            raise UsageError(
                f"The 'nlos_receivers' parameter of madhow-ring must not exceed the number of sensors, {self.sensors}. "
                f"Got {self.nlos_receivers} instead."
            )


def scene(options: MadhowRingOptions) -> Scene:
    """Return the receivers on the circle, the first on the +x axis; an empty scene if they are random."""
    if options.layout == "random":
        return Scene()
    angle = 2.0 * np.pi * np.arange(options.sensors) / options.sensors
    return Scene(
        sensors=tuple(
            Sensor(name=name, position=(float(options.radius_m * np.cos(a)), float(options.radius_m * np.sin(a))))
            for name, a in zip(sensor_names(options.sensors), angle, strict=True)
        )
    )


def generate(options: MadhowRingOptions, generator: np.random.Generator, snapshots: int) -> Columns:
    """Sample snapshots: sources in turn or at random, blocked receivers, then errors and outliers."""
    shape = (snapshots, options.sensors, options.paths)
    sensor_xy = _receivers(options, generator, snapshots)
    source_xy = _sources(options, generator, snapshots)
    offset = source_xy[:, None] - sensor_xy
    true_bearing = np.arctan2(offset[..., 1], offset[..., 0])
    std = np.full(shape, np.radians(options.bearing_std_deg))
    direct = ~_blocked(options, generator, snapshots)[..., None] & _direct_path(generator, shape)
    inward = np.arctan2(-sensor_xy[..., 1], -sensor_xy[..., 0])
    span = np.radians(options.nlos_span_deg)
    outlier = inward[..., None] + generator.uniform(-0.5 * span, 0.5 * span, shape)
    bearing = np.where(direct, true_bearing[..., None] + bearing_errors(generator, options.noise, std), outlier)
    rows = options.sensors * options.paths
    return {
        "snapshot": np.repeat(np.arange(snapshots, dtype=np.int64), rows),
        "sensor": np.tile(np.repeat(np.array(sensor_names(options.sensors), dtype=object), options.paths), snapshots),
        "sensor_x_m": np.repeat(sensor_xy[..., 0].ravel(), options.paths),
        "sensor_y_m": np.repeat(sensor_xy[..., 1].ravel(), options.paths),
        "bearing_rad": wrap_angle(bearing).ravel(),
        "bearing_std_rad": std.ravel(),
        "path": np.tile(np.arange(options.paths, dtype=np.int64), snapshots * options.sensors),
        **_ranges(options, generator, np.hypot(offset[..., 0], offset[..., 1]), direct),
        "truth_x_m": np.repeat(source_xy[:, 0], rows),
        "truth_y_m": np.repeat(source_xy[:, 1], rows),
        "truth_los": direct.ravel(),
    }


def _receivers(options: MadhowRingOptions, generator: np.random.Generator, snapshots: int) -> FloatArray:
    shape = (snapshots, options.sensors)
    if options.layout == "ring":
        positions = np.array([sensor.position for sensor in scene(options).sensors])
        return np.broadcast_to(positions, (*shape, 2))
    return _in_disc(generator, shape, options.radius_m)


def _sources(options: MadhowRingOptions, generator: np.random.Generator, snapshots: int) -> FloatArray:
    if options.sources == "disc":
        return _in_disc(generator, (snapshots,), options.source_share * options.radius_m)
    grid = options.radius_m * np.array([(x, y) for x in _GRID for y in _GRID])
    return np.asarray(grid[np.arange(snapshots) % grid.shape[0]])


def _in_disc(generator: np.random.Generator, shape: tuple[int, ...], radius_m: float) -> FloatArray:
    radius = radius_m * np.sqrt(generator.random(shape))
    angle = generator.uniform(-np.pi, np.pi, shape)
    return np.asarray(np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1))


def _blocked(options: MadhowRingOptions, generator: np.random.Generator, snapshots: int) -> BoolArray:
    order = generator.random((snapshots, options.sensors)).argsort(axis=1)
    blocked: BoolArray = (order < options.nlos_receivers) | (generator.random(order.shape) < options.alpha)
    return blocked


def _direct_path(generator: np.random.Generator, shape: tuple[int, ...]) -> BoolArray:
    """Return a mask (B, K, L) of each receiver's direct path, if it is not blocked."""
    index = generator.integers(0, shape[2], shape[:2])
    return np.asarray(index[..., None] == np.arange(shape[2]))


def _ranges(
    options: MadhowRingOptions, generator: np.random.Generator, true_range_m: FloatArray, direct: BoolArray
) -> dict[str, FloatArray]:
    """Return log-normal ranges; the path of an outlier is up to three times as long as the direct one."""
    if options.range_std_share == 0.0:
        return {}
    noise = np.exp(options.range_std_share * generator.standard_normal(direct.shape))
    path_m = true_range_m[..., None] * np.where(direct, 1.0, generator.uniform(1.0, 3.0, direct.shape))
    range_m = path_m * noise
    return {"range_m": range_m.ravel(), "range_std_m": (options.range_std_share * range_m).ravel()}


SCENARIO = ScenarioSpec(
    name="madhow-ring",
    kind="bearings",
    summary="receivers around a disc: direct, Laplacian, Cauchy, blocked, narrowband and wideband bearings, and ranges",
    reference="Ananthasubramaniam, Madhow, Section II, equations (1)-(5), Section V",
    options=MadhowRingOptions,
    scene=scene,
    generate=generate,
)
