"""Random batches of ranges for the laws: of one source to be located, and of several among unlabelled echoes."""

from __future__ import annotations

import numpy as np

from nlosctl.arrays import FloatArray, IntArray
from nlosctl.contract.batches import RangeBatch
from nlosctl.contract.fields import CircleField
from nlosctl.models.ranges import predict_ranges
from nlosctl.testing.trials import Draw, Trial

__all__ = ["RANGE_DRAWS", "draw_echoes", "draw_ranges"]

_SCALES_M = (1e-2, 1.0, 1e3, 1e6)
_ECHO_SENSORS = 4


def draw_ranges(generator: np.random.Generator, snapshots: int, measurements: int, fault: str | None) -> Trial:
    """Draw ranges of one source per snapshot, each from a sensor of its own; unequal stds of 0.01 % to 1 % of the size.

    Half of the batches have sensors above the plane of the sources.
    """
    shape = (snapshots, measurements)
    scale = float(generator.choice(_SCALES_M))
    sensor_xy = generator.uniform(-scale, scale, (*shape, 2))
    source_xy = generator.uniform(-scale, scale, (snapshots, 1, 2))
    if fault == "one place":
        sensor_xy[:] = sensor_xy[:, :1]
    if fault == "on one line":
        sensor_xy[..., 1] = 0.5 * sensor_xy[..., 0]
    if fault == "on a sensor":
        source_xy[:] = sensor_xy[:, :1]
    height = np.full(shape, 0.1 * scale * float(generator.integers(0, 2)))
    std = scale * 10.0 ** generator.uniform(-4.0, -2.0, shape)
    noise = (0.0 if fault == "on a sensor" else 1.0) * std * generator.normal(size=shape)
    range_m = np.abs(predict_ranges(sensor_xy, height, source_xy) + noise) + 1e-12 * scale
    if fault == "do not meet":
        range_m *= 0.1
    sensor = np.tile(np.arange(measurements), (snapshots, 1))
    field = CircleField(x_m=0.0, y_m=0.0, radius_m=6.0 * scale)
    return Trial(batch=_batch(generator, sensor, sensor_xy, range_m, std, height, field), size_m=3.0 * scale)


def draw_echoes(generator: np.random.Generator, snapshots: int, measurements: int, fault: str | None) -> Trial:
    """Draw echoes of up to three targets and clutter at four sensors in a round field; equal stds."""
    shape = (snapshots, measurements)
    scale = float(generator.choice((100.0, 400.0)))
    place = generator.uniform(-scale, scale, (snapshots, _ECHO_SENSORS, 2))
    if fault == "one place":
        place[:] = place[:, :1]
    if fault == "on one line":
        place[..., 1] = 0.5 * place[..., 0]
    sensor = np.tile(np.arange(measurements) % _ECHO_SENSORS, (snapshots, 1))
    target = np.arange(measurements) // _ECHO_SENSORS
    targets = generator.uniform(-0.5 * scale, 0.5 * scale, (snapshots, int(target.max(initial=0)) + 1, 2))
    sensor_xy = np.take_along_axis(place, sensor[:, :, None], axis=1)
    height = np.zeros(shape)
    std = np.full(shape, 1e-3 * scale)
    range_m = np.abs(predict_ranges(sensor_xy, height, targets[:, target]) + std * generator.normal(size=shape))
    clutter = (target >= 2) | (fault == "clutter alone")
    range_m = np.where(clutter, generator.uniform(0.1 * scale, 3.0 * scale, shape), range_m)
    field = CircleField(x_m=0.0, y_m=0.0, radius_m=2.0 * scale)
    batch = _batch(generator, sensor, sensor_xy, range_m, std, height, field)
    return Trial(batch=batch, size_m=3.0 * scale)


def _batch(
    generator: np.random.Generator,
    sensor: IntArray,
    sensor_xy: FloatArray,
    range_m: FloatArray,
    std: FloatArray,
    height: FloatArray,
    field: CircleField,
) -> RangeBatch:
    return RangeBatch(
        field=field,
        seed=np.asarray(generator.integers(0, 2**63, range_m.shape[0]), dtype=np.uint64),
        sensor=np.asfortranarray(sensor, dtype=np.int64),
        sensor_xy_m=np.asfortranarray(sensor_xy),
        range_m=np.asfortranarray(range_m),
        range_std_m=np.asfortranarray(std),
        path=np.full(range_m.shape, -1, dtype=np.int64, order="F"),
        sensor_height_m=np.asfortranarray(height),
    )


RANGE_DRAWS: dict[tuple[str, str], Draw] = {
    ("ranges", "localize"): Draw(
        trial=draw_ranges, faults=("one place", "on one line", "on a sensor", "do not meet"), directions=()
    ),
    ("ranges", "identify-los"): Draw(
        trial=draw_echoes, faults=("one place", "on one line", "clutter alone"), directions=()
    ),
}
"""How batches of ranges are drawn, by job."""
