"""Sensors along the ground receive sources beyond their horizon via one of two ionospheric layers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.contract.options import option
from nlosctl.contract.scene import CircleReflector, Scene, Sensor
from nlosctl.errors import UsageError
from nlosctl.geometry.visibility import reach_by_reflection
from nlosctl.scenarios.bearing_rows import bearing_columns, sensor_names
from nlosctl.scenarios.spec import Columns, ScenarioSpec

__all__ = ["SCENARIO", "OverTheHorizonOptions", "generate", "scene"]


@dataclass(frozen=True, kw_only=True)
class OverTheHorizonOptions:
    """Parameters of ``over-the-horizon``."""

    sensors: int = option(5, minimum=1, maximum=1000, meaning="sensors, evenly along the ground")
    baseline_m: float = option(
        2400e3, unit="m", minimum=0.0, exclusive=True, meaning="distance along the ground from first to last sensor"
    )
    ground_radius_m: float = option(6371e3, unit="m", minimum=0.0, exclusive=True, meaning="radius of the earth")
    layer_heights_m: tuple[float, float] = option(
        (110e3, 300e3), unit="m", minimum=0.0, exclusive=True, meaning="heights of the E and the F layer"
    )
    far_layer_fraction: float = option(
        0.5, minimum=0.0, maximum=1.0, meaning="share of rows via the F layer, of those that the E layer reaches too"
    )
    source_heights_m: tuple[float, float] = option(
        (1e3, 60e3), unit="m", minimum=0.0, exclusive=True, meaning="smallest and largest height of the sources"
    )
    min_elevation_deg: float = option(
        0.0, unit="deg", minimum=0.0, maximum=89.0, meaning="smallest elevation at which the sensors receive"
    )
    bearing_std_deg: float = option(
        1.0, unit="deg", minimum=0.0, maximum=180.0, exclusive=True, meaning="standard deviation of every bearing"
    )
    outlier_fraction: float = option(
        0.0, minimum=0.0, maximum=1.0, meaning="share of the rows whose bearing is uniform over the circle"
    )

    def __post_init__(self) -> None:
        low, high = self.source_heights_m
        near, far = self.layer_heights_m
        if not low <= high < near < far:
            raise UsageError(
                "The 'source_heights_m' and 'layer_heights_m' parameters of over-the-horizon must be ascending, with "
                f"sources below layers. Got {low:g},{high:g} and {near:g},{far:g} instead."
            )


def scene(options: OverTheHorizonOptions) -> Scene:
    """Return the sensors, the middle one above the centre of the earth, and the layers ``E`` and ``F``."""
    half = 0.5 * options.baseline_m / options.ground_radius_m
    angle = np.linspace(-half, half, options.sensors) if options.sensors > 1 else np.zeros(1)
    positions = options.ground_radius_m * np.stack([np.sin(angle), np.cos(angle)], axis=1)
    layers = tuple(
        CircleReflector(
            name=name,
            center=(0.0, 0.0),
            radius=options.ground_radius_m + height,
            blocker_radius=options.ground_radius_m,
            min_elevation_deg=options.min_elevation_deg or None,
        )
        for name, height in zip(("E", "F"), options.layer_heights_m, strict=True)
    )
    sensors = (
        Sensor(name=name, position=(float(x), float(y)))
        for name, (x, y) in zip(sensor_names(options.sensors), positions, strict=True)
    )
    return Scene(sensors=tuple(sensors), reflectors=layers)


def generate(options: OverTheHorizonOptions, generator: np.random.Generator, snapshots: int) -> Columns:
    """Sample snapshots, each with its own source that every sensor receives via the F layer.

    Rows that the E layer reaches too are via the E layer, except a ``far_layer_fraction`` of them. Raises UsageError
    if the sensors are too far apart to receive the same source.
    """
    world = scene(options)
    positions = np.array([sensor.position for sensor in world.sensors])
    shape = (snapshots, options.sensors)
    height = generator.uniform(*options.source_heights_m, snapshots)
    radius = options.ground_radius_m + height
    reach = [_reach(options, radius, layer) for layer in options.layer_heights_m]
    half = 0.5 * options.baseline_m / options.ground_radius_m if options.sensors > 1 else 0.0
    room = reach[1] - half
    if (room <= 0.0).any():
        raise UsageError(
            "The 'baseline_m' parameter of over-the-horizon leaves no source that all sensors receive: the F layer "
            f"reaches {float(reach[1].min()) * options.ground_radius_m:.4g} m. Got {options.baseline_m:g} instead."
        )
    angle = generator.uniform(-room, room)
    source = radius[:, None] * np.stack([np.sin(angle), np.cos(angle)], axis=1)
    between = np.abs(angle[:, None] - np.arctan2(positions[:, 0], positions[:, 1]))
    near_layer = (between <= reach[0][:, None]) & (generator.random(shape) >= options.far_layer_fraction)
    return bearing_columns(
        scene=world,
        generator=generator,
        names=tuple(sensor.name for sensor in world.sensors),
        sensor_xy_m=np.broadcast_to(positions, (*shape, 2)),
        source_xy_m=source,
        bearing_std_rad=np.full(shape, np.radians(options.bearing_std_deg)),
        reflector=np.where(near_layer, 0, 1),
        outlier_fraction=options.outlier_fraction,
    )


def _reach(options: OverTheHorizonOptions, source_radius: FloatArray, layer_height_m: float) -> FloatArray:
    """Return the largest angle at the earth's centre from a sensor to a source that it receives via the layer."""
    ground = np.full(source_radius.shape, options.ground_radius_m)
    least = np.full(source_radius.shape, np.radians(options.min_elevation_deg))
    return reach_by_reflection(source_radius, ground + layer_height_m, ground, least)


SCENARIO = ScenarioSpec(
    name="over-the-horizon",
    kind="bearings",
    summary="sensors along the ground receive sources beyond their horizon via the E or the F layer of the ionosphere",
    reference="Song, Willett, Zhou 2013, Section 3.4 (geometry)",
    options=OverTheHorizonOptions,
    scene=scene,
    generate=generate,
)
