"""Random batches for the laws: one function and one line in `DRAWS` for each kind of measurement and job."""

from __future__ import annotations

import dataclasses

import numpy as np

from nlosctl.arrays import FloatArray, IntArray
from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.fields import CircleField
from nlosctl.contract.scene import LineReflector, Scene
from nlosctl.geometry.angles import wrap_angle
from nlosctl.models.bearings import predict_bearings
from nlosctl.testing.range_draws import RANGE_DRAWS
from nlosctl.testing.trials import Draw, Trial
from nlosctl.testing.triplet_draws import TRIPLET_DRAWS

__all__ = ["DRAWS", "Draw", "Trial", "bearing_batch", "draw_bearings"]

_SCALES_M = (1e-2, 1.0, 1e3, 1e6)
_WRAPS = 2.0 * np.pi * np.array([-1.0, 0.0, 1.0])


def draw_bearings(generator: np.random.Generator, snapshots: int, measurements: int, fault: str | None) -> Trial:
    """Draw bearings of one source per snapshot in a round field, direct or by one of three mirrors (one in the field).

    A third of the snapshots has direct rows alone. Unequal stds of 0.1 to 3 degrees, sensors that hear several paths,
    bearings up to a turn off.
    """
    shape = (snapshots, measurements)
    scale = float(generator.choice(_SCALES_M))
    scene = _mirror_scene(generator, scale)
    sensor = generator.integers(0, max(2, measurements), shape)
    place = generator.uniform(-scale, scale, (snapshots, max(2, measurements), 2))
    sensor_xy = np.take_along_axis(place, sensor[:, :, None], axis=1)
    source_xy = generator.uniform(-0.7 * scale, 0.7 * scale, (snapshots, 1, 2))
    reflector = generator.choice([-1, -1, -1, 0, 1, 0, 1, 2], size=shape)
    reflector[generator.random(snapshots) < 0.3] = -1
    std = np.radians(10.0 ** generator.uniform(-1.0, 0.5, shape))
    if fault in ("one place", "on a sensor"):
        reflector[:] = -1
    if fault == "one place":
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


def _mirror_scene(generator: np.random.Generator, scale: float) -> Scene:
    """Two mirrors that all of the field lies to one side of, one of them vertical, and one across the field."""
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
    """Return a batch that wants flags, with seeds of its own and the paths of each sensor numbered."""
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


DRAWS: dict[tuple[str, str], Draw] = {
    ("bearings", "localize"): Draw(
        trial=draw_bearings,
        faults=("parallel", "one place", "on a sensor", "behind"),
        directions=("bearing_rad",),
    ),
    **RANGE_DRAWS,
    **TRIPLET_DRAWS,
}
"""How batches are drawn, by kind of measurement and job."""
