"""True worlds of a scene that is not exactly known: sensors, headings, offsets and reflectors with errors of their own.

The rows of a file have the positions that the scene states; what was measured is that of the true world.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.contract.scene import (
    CircleReflector,
    PlaneReflector,
    Reflector,
    Scene,
    SegmentReflector,
    Sensor,
    SphereReflector,
)
from nlosctl.errors import UsageError
from nlosctl.geometry.angles import wrap_angle
from nlosctl.scenarios.spec import SNAPSHOTS_PER_BLOCK, Columns

__all__ = ["generate_in_worlds"]

_OF_FILE = 1 << 31
"""The spawn key of the random numbers of a world that all snapshots of a file share."""


def generate_in_worlds(
    options: Any, generator: np.random.Generator, snapshots: int, *, generate: Callable[..., Columns], scene: Scene
) -> Columns:
    """Return the columns of snapshots, each in a true world of its own, or all in one (``worlds`` of the options).

    ``generate(options, generator, snapshots, scene=)`` samples snapshots in a scene that is exactly known. Rows have
    the positions that ``scene`` states. Raises UsageError for triplets, whose methods take a scene as exactly known.
    """
    if hasattr(options, "transmitters"):
        raise UsageError(
            "triplets take sensors and reflectors as exactly known; leave the standard deviations out of the scene"
        )
    if options.worlds == "file":
        sequence: Any = generator.bit_generator.seed_seq
        of_file = np.random.SeedSequence(entropy=sequence.entropy, spawn_key=(_OF_FILE,))
        world = _World.of(scene, np.random.Generator(np.random.Philox(of_file)))
        columns = world.measured(generate(options, generator, SNAPSHOTS_PER_BLOCK, scene=world.scene), scene)
        return {name: column[columns["snapshot"] < snapshots] for name, column in columns.items()}
    parts: list[dict[str, Any]] = []
    for number in range(snapshots):
        world = _World.of(scene, generator)
        columns = dict(world.measured(generate(options, generator, 1, scene=world.scene), scene))
        columns["snapshot"] = columns["snapshot"] + np.int64(number)
        parts.append(columns)
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


@dataclass(frozen=True)
class _World:
    """A true scene, and the errors of the sensors' headings (rad), ranges and arrivals (m)."""

    scene: Scene
    heading_rad: FloatArray
    range_m: FloatArray
    arrival_m: FloatArray

    @classmethod
    def of(cls, scene: Scene, generator: np.random.Generator) -> _World:
        """Return a world at random: with the errors whose standard deviations the scene states."""
        count = len(scene.sensors)
        moves = generator.standard_normal((count, 3))
        offsets = generator.standard_normal((3, count))
        turns = generator.standard_normal((len(scene.reflectors), 3))
        sensors = tuple(_moved(sensor, move) for sensor, move in zip(scene.sensors, moves, strict=True))
        reflectors = tuple(_turned(one, errors) for one, errors in zip(scene.reflectors, turns, strict=True))
        stds = [
            [np.radians(sensor.heading_std_deg or 0.0) for sensor in scene.sensors],
            [sensor.range_offset_std_m or 0.0 for sensor in scene.sensors],
            [sensor.arrival_offset_std_m or 0.0 for sensor in scene.sensors],
        ]
        return cls(replace(scene, sensors=sensors, reflectors=reflectors), *(offsets * np.array(stds)))

    def measured(self, columns: Columns, stated: Scene) -> Columns:
        """Return the columns of rows in this world as its sensors measure them, with their stated positions."""
        numbers = {sensor.name: number for number, sensor in enumerate(stated.sensors)}
        row = np.array([numbers[name] for name in columns["sensor"]], dtype=np.int64)
        changed = dict(columns)
        for axis, name in enumerate(("sensor_x_m", "sensor_y_m")):
            changed[name] = np.array([sensor.position[axis] for sensor in stated.sensors])[row]
        if "sensor_z_m" in columns:
            changed["sensor_z_m"] = np.array([sensor.z_m for sensor in stated.sensors], dtype=np.float64)[row]
        if "bearing_rad" in columns:
            changed["bearing_rad"] = wrap_angle(columns["bearing_rad"] + self.heading_rad[row])
        if "range_m" in columns:
            longer = columns["range_m"] + self.range_m[row]
            changed["range_m"] = np.maximum(np.abs(longer), np.finfo(np.float64).tiny)
        if "arrival_m" in columns:
            changed["arrival_m"] = columns["arrival_m"] + self.arrival_m[row]
        return changed


def _moved(sensor: Sensor, move: FloatArray) -> Sensor:
    std = sensor.position_std_m or 0.0
    x, y = (part + std * by for part, by in zip(sensor.position, move, strict=False))
    return replace(sensor, position=(x, y), z_m=None if sensor.z_m is None else sensor.z_m + std * move[2])


def _turned(mirror: Reflector, errors: FloatArray) -> Reflector:
    """Return a reflector with three standard normal errors: of its place or radius, and of its directions."""
    if isinstance(mirror, CircleReflector | SphereReflector):
        return replace(mirror, radius=mirror.radius + (mirror.radius_std_m or 0.0) * errors[0])
    shift = (mirror.offset_std_m or 0.0) * errors[0]
    angle = np.radians(mirror.direction_std_deg or 0.0) * errors[1:]
    if isinstance(mirror, PlaneReflector):
        normal = np.array(mirror.normal) / np.linalg.norm(mirror.normal)
        first = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
        first /= np.linalg.norm(first)
        tilted = normal + angle[0] * first + angle[1] * np.cross(normal, first)
        x, y, z = (np.array(mirror.point) + shift * normal).tolist()
        nx, ny, nz = tilted.tolist()
        return replace(mirror, point=(x, y, z), normal=(nx, ny, nz))
    along = np.array(mirror.direction) / np.hypot(*mirror.direction)
    across = shift * np.array([-along[1], along[0]])
    turn = np.array([[np.cos(angle[0]), -np.sin(angle[0])], [np.sin(angle[0]), np.cos(angle[0])]])
    point, direction = np.array(mirror.point) + across, turn @ np.array(mirror.direction)
    (x, y), (dx, dy) = point.tolist(), direction.tolist()
    if isinstance(mirror, SegmentReflector):
        return replace(mirror, start=(x, y), end=(x + dx, y + dy))
    return replace(mirror, point=(x, y), direction=(dx, dy))
