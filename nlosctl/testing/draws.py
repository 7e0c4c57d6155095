"""Random batches for the laws: one function and one line in `DRAWS` for each kind of measurement and job."""

from __future__ import annotations

import dataclasses

import numpy as np

from nlosctl.arrays import FloatArray, IntArray
from nlosctl.contract.batches import BearingBatch, RangeBatch, TripletBatch
from nlosctl.contract.fields import CircleField
from nlosctl.contract.scene import LineReflector, Scene
from nlosctl.geometry.angles import wrap_angle
from nlosctl.models.bearing_predictions import predict_bearings
from nlosctl.models.ranges.predictions import predict_ranges
from nlosctl.models.triplets import predict_triplets
from nlosctl.testing.arrival_draws import ARRIVAL_DRAW
from nlosctl.testing.trials import Draw, Trial

__all__ = [
    "DRAWS",
    "Draw",
    "Trial",
    "bearing_batch",
    "draw_bearings",
    "draw_echoes",
    "draw_ranges",
    "draw_triplets",
    "draw_unlabelled_bearings",
    "mirror_scene",
    "range_batch",
]


_SCALES_M = (1e-2, 1.0, 1e3, 1e6)
_ECHO_SENSORS = 4


def draw_ranges(generator: np.random.Generator, snapshots: int, measurements: int, fault: str | None) -> Trial:
    """Draw ranges of one source per snapshot, each from a different sensor; unequal stds of 0.01 % to 1 % of the size.

    Half of the batches have sensors above the plane of the sources.
    """
    shape = (snapshots, measurements)
    scale = float(generator.choice(_SCALES_M))
    sensor_xy = generator.uniform(-scale, scale, (*shape, 2))
    source_xy = generator.uniform(-scale, scale, (snapshots, 1, 2))
    if fault == "one point":
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
    return Trial(batch=range_batch(generator, sensor, sensor_xy, range_m, std, height, field), size_m=3.0 * scale)


def draw_echoes(generator: np.random.Generator, snapshots: int, measurements: int, fault: str | None) -> Trial:
    """Draw echoes of up to three targets and clutter at four sensors in a round field; equal stds."""
    shape = (snapshots, measurements)
    scale = float(generator.choice((100.0, 400.0)))
    station_xy = generator.uniform(-scale, scale, (snapshots, _ECHO_SENSORS, 2))
    if fault == "one point":
        station_xy[:] = station_xy[:, :1]
    if fault == "on one line":
        station_xy[..., 1] = 0.5 * station_xy[..., 0]
    sensor = np.tile(np.arange(measurements) % _ECHO_SENSORS, (snapshots, 1))
    target = np.arange(measurements) // _ECHO_SENSORS
    targets = generator.uniform(-0.5 * scale, 0.5 * scale, (snapshots, int(target.max(initial=0)) + 1, 2))
    sensor_xy = np.take_along_axis(station_xy, sensor[:, :, None], axis=1)
    height = np.zeros(shape)
    std = np.full(shape, 1e-3 * scale)
    range_m = np.abs(predict_ranges(sensor_xy, height, targets[:, target]) + std * generator.normal(size=shape))
    clutter = (target >= 2) | (fault == "clutter alone")
    range_m = np.where(clutter, generator.uniform(0.1 * scale, 3.0 * scale, shape), range_m)
    field = CircleField(x_m=0.0, y_m=0.0, radius_m=2.0 * scale)
    batch = range_batch(generator, sensor, sensor_xy, range_m, std, height, field)
    return Trial(batch=batch, size_m=3.0 * scale)


def range_batch(
    generator: np.random.Generator,
    sensor: IntArray,
    sensor_xy: FloatArray,
    range_m: FloatArray,
    std: FloatArray,
    height: FloatArray,
    field: CircleField,
) -> RangeBatch:
    """Return a batch of direct ranges with new seeds, without path numbers."""
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


_TRIPLET_SCALES_M = (1.0, 1e3, 1e5)


def draw_triplets(generator: np.random.Generator, snapshots: int, measurements: int, fault: str | None) -> Trial:
    """Draw paths over one target per snapshot, a third of them indirect: longer, and with other directions.

    Every path has its own transmitter and receiver, and unequal stds of 0.1 to 2 degrees and 0.01 to 1 % of the size.
    """
    shape = (snapshots, measurements)
    scale = float(generator.choice(_TRIPLET_SCALES_M))
    tx, rx = generator.uniform(-scale, scale, (2, *shape, 2))
    target = generator.uniform(-scale, scale, (snapshots, 1, 2))
    if fault == "one point":
        rx = tx.copy()
    if fault == "on the baseline":
        target = 0.5 * (tx + rx)
    if fault == "on a transmitter":
        target = tx.copy()
    dod, doa, length = predict_triplets(tx, rx, np.broadcast_to(target, (*shape, 2)))
    indirect = generator.random(shape) < 1.0 / 3.0
    dod_std, doa_std = np.radians(10.0 ** generator.uniform(-1.0, 0.3, (2, *shape)))
    length_std = scale * 10.0 ** generator.uniform(-4.0, -2.0, shape)
    noise = generator.normal(size=(3, *shape))
    dod = np.where(indirect, generator.uniform(-np.pi, np.pi, shape), dod + dod_std * noise[0])
    doa = doa + doa_std * noise[1]
    length = np.abs(length + length_std * noise[2]) * np.where(indirect, generator.uniform(1.0, 3.0, shape), 1.0)
    length += 1e-12 * scale
    if fault == "parallel":
        doa = dod.copy()
    if fault == "no ellipse":
        length = 0.5 * np.hypot(*np.moveaxis(rx - tx, -1, 0))
    batch = TripletBatch(
        seed=np.asarray(generator.integers(0, 2**63, snapshots), dtype=np.uint64),
        tx_xy_m=np.asfortranarray(tx),
        rx_xy_m=np.asfortranarray(rx),
        dod_rad=np.asfortranarray(wrap_angle(dod)),
        doa_rad=np.asfortranarray(wrap_angle(doa)),
        path_length_m=np.asfortranarray(length),
        dod_std_rad=np.asfortranarray(dod_std),
        doa_std_rad=np.asfortranarray(doa_std),
        path_length_std_m=np.asfortranarray(length_std),
    )
    return Trial(batch=batch, size_m=3.0 * scale)


_WRAPS = 2.0 * np.pi * np.array([-1.0, 0.0, 1.0])


def draw_bearings(generator: np.random.Generator, snapshots: int, measurements: int, fault: str | None) -> Trial:
    """Draw bearings of one source per snapshot in a round field, direct or by one of three mirrors (one in the field).

    A third of the snapshots has direct rows alone. Unequal stds of 0.1 to 3 degrees, sensors that hear several paths,
    bearings up to a turn off.
    """
    shape = (snapshots, measurements)
    scale = float(generator.choice(_SCALES_M))
    scene = mirror_scene(generator, scale)
    sensor = generator.integers(0, max(2, measurements), shape)
    station_xy = generator.uniform(-scale, scale, (snapshots, max(2, measurements), 2))
    sensor_xy = np.take_along_axis(station_xy, sensor[:, :, None], axis=1)
    source_xy = generator.uniform(-0.7 * scale, 0.7 * scale, (snapshots, 1, 2))
    reflector = generator.choice([-1, -1, -1, 0, 1, 0, 1, 2], size=shape)
    reflector[generator.random(snapshots) < 0.3] = -1
    std = np.radians(10.0 ** generator.uniform(-1.0, 0.5, shape))
    if fault in ("one point", "on a sensor"):
        reflector[:] = -1
    if fault == "one point":
        sensor_xy[:] = sensor_xy[:, :1]
    if fault == "on a sensor":
        source_xy[:] = sensor_xy[:, :1]
    bearing = predict_bearings(sensor_xy, reflector, scene, np.broadcast_to(source_xy, sensor_xy.shape))
    bearing = bearing + (0.0 if fault == "on a sensor" else 1.0) * std * generator.normal(size=shape)
    if fault == "parallel":
        reflector[:], bearing[:] = -1, 0.75
    if fault == "behind":
        bearing += np.pi
    wrapped = wrap_angle(bearing)
    turned = wrapped + generator.choice(_WRAPS, size=shape)
    bearing = np.where(np.abs(turned) <= 2.0 * np.pi, turned, wrapped)
    batch = bearing_batch(generator, scene, sensor, sensor_xy, bearing, std, reflector)
    field = CircleField(x_m=0.0, y_m=0.0, radius_m=2.0 * scale)
    return Trial(batch=dataclasses.replace(batch, field=field), size_m=3.0 * scale)


def draw_unlabelled_bearings(
    generator: np.random.Generator, snapshots: int, measurements: int, fault: str | None
) -> Trial:
    """Draw unlabelled bearings of up to two sources and clutter at four sensors in a round field; equal stds."""
    shape = (snapshots, measurements)
    scale = float(generator.choice((100.0, 400.0)))
    sensor = np.tile(np.arange(measurements) % _ECHO_SENSORS, (snapshots, 1))
    station_xy = generator.uniform(-scale, scale, (snapshots, _ECHO_SENSORS, 2))
    if fault == "one point":
        station_xy[:] = station_xy[:, :1]
    target = np.arange(measurements) // _ECHO_SENSORS
    source_xy = generator.uniform(-0.5 * scale, 0.5 * scale, (snapshots, int(target.max(initial=0)) + 1, 2))
    sensor_xy = np.take_along_axis(station_xy, sensor[:, :, None], axis=1)
    reflector, std = np.full(shape, -1, dtype=np.int64), np.full(shape, 0.005)
    bearing = predict_bearings(sensor_xy, reflector, Scene(), source_xy[:, target])
    bearing = bearing + std * generator.normal(size=shape) + (np.pi if fault == "behind" else 0.0)
    clutter = (target >= 2) | (fault == "clutter alone")
    bearing = np.where(clutter, generator.uniform(-np.pi, np.pi, shape), wrap_angle(bearing))
    batch = bearing_batch(generator, Scene(), sensor, sensor_xy, bearing, std, reflector)
    field = CircleField(x_m=0.0, y_m=0.0, radius_m=2.0 * scale)
    return Trial(batch=dataclasses.replace(batch, field=field), size_m=3.0 * scale)


def mirror_scene(generator: np.random.Generator, scale: float) -> Scene:
    """Two mirrors with all of the search region on one side, one of them vertical, and a third across the region."""
    angle = generator.uniform(-np.pi, np.pi)
    across = generator.uniform(-np.pi, np.pi)
    outside = (-1.5 * scale * np.sin(angle), 1.5 * scale * np.cos(angle))
    return Scene(
        reflectors=(
            LineReflector(name="outside", point=outside, direction=(np.cos(angle), np.sin(angle))),
            LineReflector(name="vertical", point=(1.25 * scale, 0.0), direction=(0.0, 2.0)),
            LineReflector(name="across", point=(0.3 * scale, 0.1 * scale), direction=(np.cos(across), np.sin(across))),
        )
    )


def bearing_batch(
    generator: np.random.Generator,
    scene: Scene,
    sensor: IntArray,
    sensor_xy: FloatArray,
    bearing: FloatArray,
    std: FloatArray,
    reflector: IntArray,
) -> BearingBatch:
    """Return a batch with flags requested, new seeds, and the paths of each sensor numbered."""
    seed = np.asarray(generator.integers(0, 2**63, bearing.shape[0]), dtype=np.uint64)
    return BearingBatch(
        scene=scene,
        seed=seed,
        want_flags=True,
        sensor=np.asfortranarray(sensor, dtype=np.int64),
        sensor_xy_m=np.asfortranarray(sensor_xy),
        bearing_rad=np.asfortranarray(bearing),
        bearing_std_rad=np.asfortranarray(std),
        path=np.asfortranarray(_number_paths(sensor)),
        reflector=np.asfortranarray(reflector, dtype=np.int64),
    )


def _number_paths(sensor: IntArray) -> IntArray:
    """Number the measurements of each sensor (B, K) from 0."""
    path = np.zeros(sensor.shape, dtype=np.int64)
    for k in range(1, sensor.shape[1]):
        path[:, k] = (sensor[:, :k] == sensor[:, k : k + 1]).sum(axis=1)
    return path


_TRIPLET_DRAW = Draw(
    trial=draw_triplets,
    faults=("one point", "on the baseline", "on a transmitter", "parallel", "no ellipse"),
    directions=("dod_rad", "doa_rad"),
)

DRAWS: dict[tuple[str, str], Draw] = {
    ("bearings", "localize"): Draw(
        trial=draw_bearings, faults=("parallel", "one point", "on a sensor", "behind"), directions=("bearing_rad",)
    ),
    ("ranges", "localize"): Draw(
        trial=draw_ranges, faults=("one point", "on one line", "on a sensor", "do not meet"), directions=()
    ),
    ("ranges", "identify-los"): Draw(
        trial=draw_echoes, faults=("one point", "on one line", "clutter alone"), directions=()
    ),
    ("bearings", "identify-los"): Draw(
        trial=draw_unlabelled_bearings, faults=("one point", "behind", "clutter alone"), directions=("bearing_rad",)
    ),
    ("arrivals", "localize"): ARRIVAL_DRAW,
    ("triplets", "localize"): _TRIPLET_DRAW,
    ("triplets", "detect-ip"): _TRIPLET_DRAW,
}
"""How batches are drawn, by kind of measurement and job."""
