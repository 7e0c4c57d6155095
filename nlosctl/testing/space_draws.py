"""Random batches in three dimensions for the laws: as `nlosctl.testing.draws`, with heights and elevations."""

from __future__ import annotations

import dataclasses
from functools import partial
from typing import Any

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.contract.batches import ArrivalBatch
from nlosctl.contract.fields import CircleField
from nlosctl.contract.methods import MethodSpec
from nlosctl.contract.scene import LineReflector, PlaneReflector, Scene
from nlosctl.models.space.paths import predict_directions, predict_path_vectors
from nlosctl.testing.draws import Draw, Trial, bearing_batch, range_batch

__all__ = ["space_draws_of"]

_SCALES_M = (1.0, 1e3, 1e5)


def draw_directions(
    generator: np.random.Generator, snapshots: int, measurements: int, fault: str | None, *, with_height: bool
) -> Trial:
    """Draw azimuths and elevations of one source per snapshot, direct or by a floor or wall; a quarter azimuths alone.

    Unequal stds of 0.03 to 1 degree; with a measured height, or without.
    """
    shape = (snapshots, measurements)
    scale = float(generator.choice(_SCALES_M))
    scene = _mirrors(scale)
    sensor, source = _places(generator, shape, scale)
    reflector = generator.choice([-1, -1, -1, 0, 1], size=shape)
    if fault == "one point":
        sensor[:], reflector[:] = sensor[:, :1], -1
    std, rise = np.radians(10.0 ** generator.uniform(-1.5, 0.0, (2, *shape)))
    azimuth, elevation = predict_directions(
        _parts(sensor), _parts(np.broadcast_to(source, sensor.shape)), reflector, scene
    )
    noise = generator.normal(size=(2, *shape))
    azimuth, elevation = azimuth + std * noise[0], elevation + rise * noise[1]
    elevation = np.clip(elevation, -0.5 * np.pi, 0.5 * np.pi)
    elevation[generator.random(shape) < 0.25] = np.nan
    if fault == "azimuths alone":
        elevation[:] = np.nan
    if fault == "behind":
        azimuth, elevation = azimuth + np.pi, -elevation
    if fault == "parallel":
        reflector[:], azimuth, elevation = -1, np.full(shape, 0.75), np.full(shape, 0.2)
    number = np.tile(np.arange(measurements), (snapshots, 1))
    plain = bearing_batch(generator, scene, number, sensor[..., :2], azimuth, std, reflector)
    batch = dataclasses.replace(
        plain,
        dimension=3,
        field=CircleField(x_m=0.0, y_m=0.0, radius_m=6.0 * scale),
        sensor_z_m=np.asfortranarray(sensor[..., 2]),
        elevation_rad=np.asfortranarray(elevation),
        elevation_std_rad=np.asfortranarray(np.where(np.isnan(elevation), np.nan, rise)),
        **(_height(generator, source, scale) if with_height else {}),
    )
    return Trial(batch=batch, size_m=3.0 * scale)


def draw_space_ranges(generator: np.random.Generator, snapshots: int, measurements: int, fault: str | None) -> Trial:
    """Draw ranges of one source per snapshot in space, each from another sensor, and a measured height.

    Unequal stds of 0.01 % to 0.1 % of the size. Without the height three sensors have two fixes of the same cost.
    """
    shape = (snapshots, measurements)
    scale = float(generator.choice(_SCALES_M))
    sensor, source = _places(generator, shape, scale)
    if fault == "one point":
        sensor[:] = sensor[:, :1]
    if fault == "on one line":
        sensor[..., 1], sensor[..., 2] = 0.5 * sensor[..., 0], 0.2 * sensor[..., 0]
    std = scale * 10.0 ** generator.uniform(-4.0, -3.0, shape)
    none = np.full(shape, -1, dtype=np.int64)
    everywhere = _parts(np.broadcast_to(source, sensor.shape))
    away = np.stack(predict_path_vectors(_parts(sensor), everywhere, none, Scene()))
    range_m = np.abs(np.linalg.norm(away, axis=0) + std * generator.normal(size=shape)) + 1e-12 * scale
    if fault == "do not meet":
        range_m *= 0.1
    number = np.tile(np.arange(measurements), (snapshots, 1))
    field = CircleField(x_m=0.0, y_m=0.0, radius_m=6.0 * scale)
    plain = range_batch(generator, number, sensor[..., :2], range_m, std, np.zeros(shape), field)
    height = _height(generator, source, scale)
    batch = dataclasses.replace(plain, dimension=3, sensor_z_m=np.asfortranarray(sensor[..., 2]), **height)
    return Trial(batch=batch, size_m=3.0 * scale)


def draw_space_arrivals(
    generator: np.random.Generator, snapshots: int, measurements: int, fault: str | None, *, with_height: bool
) -> Trial:
    """Draw arrivals of one source per snapshot in space, each at another sensor; with a measured height, or without.

    Unequal stds of 0.01 % to 0.1 % of the size, offsets of up to a hundred sizes.
    """
    shape = (snapshots, measurements)
    scale = float(generator.choice(_SCALES_M))
    sensor, source = _places(generator, shape, scale)
    if fault == "one point":
        sensor[:] = sensor[:, :1]
    if fault == "on one line":
        sensor[..., 1], sensor[..., 2] = 0.5 * sensor[..., 0], 0.2 * sensor[..., 0]
    if fault == "far away":
        source = source * 1e5
    std = scale * 10.0 ** generator.uniform(-4.0, -3.0, shape)
    arrival = np.linalg.norm(source - sensor, axis=2) + std * generator.normal(size=shape)
    batch = ArrivalBatch(
        dimension=3,
        field=CircleField(x_m=0.0, y_m=0.0, radius_m=6.0 * scale),
        seed=np.asarray(generator.integers(0, 2**63, snapshots), dtype=np.uint64),
        sensor=np.asfortranarray(np.tile(np.arange(measurements), (snapshots, 1)), dtype=np.int64),
        sensor_xy_m=np.asfortranarray(sensor[..., :2]),
        sensor_z_m=np.asfortranarray(sensor[..., 2]),
        arrival_m=np.asfortranarray(arrival - arrival.min(axis=1, initial=np.inf)[:, None]),
        arrival_std_m=np.asfortranarray(std),
        origin_m=100.0 * scale * generator.normal(size=snapshots),
        **(_height(generator, source, scale) if with_height else {}),
    )
    return Trial(batch=batch, size_m=3.0 * scale)


def _places(generator: np.random.Generator, shape: tuple[int, int], scale: float) -> tuple[FloatArray, FloatArray]:
    """Return sensors (B, K, 3) and sources (B, 1, 3) in a box that is half as high as wide."""
    half = np.array([scale, scale, 0.5 * scale])
    return generator.uniform(-half, half, (*shape, 3)), generator.uniform(-0.7 * half, 0.7 * half, (shape[0], 1, 3))


def _mirrors(scale: float) -> Scene:
    """Return a sloping floor under everything and a wall beside it."""
    return Scene(
        reflectors=(
            PlaneReflector(name="floor", point=(0.0, 0.0, -1.2 * scale), normal=(0.1, 0.05, 1.0)),
            LineReflector(name="wall", point=(1.3 * scale, 0.0), direction=(0.1, 2.0)),
        )
    )


def _height(generator: np.random.Generator, source: FloatArray, scale: float) -> dict[str, Any]:
    """Return the measured heights of sources (B, 1, 3), with a standard deviation of 5 % of the size."""
    std = 0.05 * scale
    measured = source[:, 0, 2] + std * generator.normal(size=source.shape[0])
    return {"target_z_m": measured, "target_z_std_m": np.full(source.shape[0], std)}


def _parts(points: FloatArray) -> tuple[FloatArray, ...]:
    return points[..., 0], points[..., 1], points[..., 2]


_SPACE_DRAWS: dict[tuple[str, str], tuple[Draw, ...]] = {
    ("bearings", "localize"): tuple(
        Draw(
            trial=partial(draw_directions, with_height=with_height),
            faults=("one point", "azimuths alone", "behind", "parallel"),
            directions=("bearing_rad",),
        )
        for with_height in (False, True)
    ),
    ("bearings", "identify-los"): (
        Draw(
            trial=partial(draw_directions, with_height=False),
            faults=("one point", "azimuths alone", "behind", "parallel"),
            directions=("bearing_rad",),
        ),
    ),
    ("ranges", "localize"): (
        Draw(trial=draw_space_ranges, faults=("one point", "on one line", "do not meet"), directions=()),
    ),
    ("arrivals", "localize"): tuple(
        Draw(
            trial=partial(draw_space_arrivals, with_height=with_height),
            faults=("one point", "on one line", "far away"),
            directions=(),
        )
        for with_height in (False, True)
    ),
}
"""How batches in three dimensions are drawn, by kind of measurement and job."""


def space_draws_of(spec: MethodSpec) -> tuple[Draw, ...]:
    """Return how batches in space for a method are drawn; empty if it does not solve in three dimensions."""
    return _SPACE_DRAWS.get((spec.kind, spec.job), ()) if 3 in spec.dimensions else ()
