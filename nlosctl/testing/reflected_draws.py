"""Random ranges by mirrors, for the methods that read ``reflector``; and how batches for a method are drawn."""

from __future__ import annotations

import dataclasses

import numpy as np

from nlosctl.contract.fields import CircleField
from nlosctl.contract.methods import MethodSpec
from nlosctl.models.ranges.predictions import predict_ranges
from nlosctl.testing.arrival_draws import PAIR_DRAW
from nlosctl.testing.draws import DRAWS, Draw, Trial, mirror_scene, range_batch

__all__ = ["draws_of"]

_SCALES_M = (1e-2, 1.0, 1e3, 1e6)


def draw_reflected_ranges(
    generator: np.random.Generator, snapshots: int, measurements: int, fault: str | None
) -> Trial:
    """Draw ranges as `draw_ranges` does, in one plane, direct or by one of three mirrors: the length of the path."""
    shape = (snapshots, measurements)
    scale = float(generator.choice(_SCALES_M))
    scene = mirror_scene(generator, scale)
    sensor_xy = generator.uniform(-scale, scale, (*shape, 2))
    source_xy = generator.uniform(-0.7 * scale, 0.7 * scale, (snapshots, 1, 2))
    reflector = generator.choice([-1, -1, -1, 0, 1, 2], size=shape)
    if fault == "one point":
        sensor_xy[:], reflector[:] = sensor_xy[:, :1], -1
    height, std = np.zeros(shape), scale * 10.0 ** generator.uniform(-4.0, -2.0, shape)
    source_xy = np.broadcast_to(source_xy, sensor_xy.shape)
    exact = predict_ranges(sensor_xy, height, source_xy, reflector, scene)
    range_m = np.abs(exact + std * generator.normal(size=shape)) + 1e-12 * scale
    if fault == "do not meet":
        range_m *= 0.1
    sensor = np.tile(np.arange(measurements), (snapshots, 1))
    field = CircleField(x_m=0.0, y_m=0.0, radius_m=2.0 * scale)
    batch = range_batch(generator, sensor, sensor_xy, range_m, std, height, field)
    batch = dataclasses.replace(batch, scene=scene, reflector=np.asfortranarray(reflector, dtype=np.int64))
    return Trial(batch=batch, size_m=3.0 * scale)


_READ = {
    ("ranges", "reflector"): Draw(trial=draw_reflected_ranges, faults=("one point", "do not meet"), directions=()),
    ("arrivals", "reference"): PAIR_DRAW,
}
"""How further batches are drawn for methods that read a column, by its kind and name."""


def draws_of(spec: MethodSpec) -> list[Draw]:
    """Return how batches for a method are drawn, also those of what it reads beside the usual; empty if unknown.

    That are ranges by reflectors, and independent differences of arrivals.
    """
    draws = [DRAWS[spec.kind, spec.job]] if (spec.kind, spec.job) in DRAWS else []
    for (kind, column), draw in _READ.items():
        if spec.kind == kind and spec.job == "localize" and column in spec.reads:
            draws.append(draw)
    return draws
