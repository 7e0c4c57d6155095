"""What the laws do to a batch: copy it, take some of its snapshots, permute its measurements, move its frame.

All of it goes by the contract of batches: arrays have the snapshots in front, then the measurements.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from nlosctl.arrays import FloatArray, IntArray
from nlosctl.contract.fields import CircleField, Field
from nlosctl.contract.scene import (
    CircleReflector,
    LineReflector,
    PlaneReflector,
    Reflector,
    Scene,
    SegmentReflector,
    Sensor,
    SphereReflector,
)
from nlosctl.geometry.angles import wrap_angle

__all__ = ["Motion", "copy_batch", "move_batch", "permute_measurements", "replace_rows", "take_rows"]


@dataclass(frozen=True, kw_only=True)
class Motion:
    """A turn of the frame about its origin, counter-clockwise, and then a shift in metres; in space about z."""

    angle_rad: float
    shift_m: tuple[float, float]
    lift_m: float = 0.0

    def point(self, xy: tuple[float, float]) -> tuple[float, float]:
        """Return the image of a point."""
        x, y = self.direction(xy)
        return x + self.shift_m[0], y + self.shift_m[1]

    def direction(self, xy: tuple[float, float]) -> tuple[float, float]:
        """Return the image of a direction."""
        cosine, sine = float(np.cos(self.angle_rad)), float(np.sin(self.angle_rad))
        return cosine * xy[0] - sine * xy[1], sine * xy[0] + cosine * xy[1]

    def points(self, points: FloatArray) -> FloatArray:
        """Return the images of points (..., 2), or (..., 3)."""
        cosine, sine = np.cos(self.angle_rad), np.sin(self.angle_rad)
        x, y = points[..., 0], points[..., 1]
        turned = np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=-1) + np.array(self.shift_m)
        return np.asfortranarray(np.concatenate([turned, points[..., 2:] + self.lift_m], axis=-1))

    def covariances(self, parts: FloatArray) -> FloatArray:
        """Return what covariances (E, 3), or (E, 6) in space, become."""
        cosine, sine = np.cos(self.angle_rad), np.sin(self.angle_rad)
        xx, xy, yy, *upright = parts.T
        if upright:
            xz, yz, zz = upright
            upright = [cosine * xz - sine * yz, sine * xz + cosine * yz, zz]
        return np.stack(
            [
                cosine**2 * xx - 2.0 * cosine * sine * xy + sine**2 * yy,
                cosine * sine * (xx - yy) + (cosine**2 - sine**2) * xy,
                sine**2 * xx + 2.0 * cosine * sine * xy + cosine**2 * yy,
                *upright,
            ],
            axis=1,
        )


def copy_batch(batch: Any, *, writeable: bool) -> Any:
    """Return a copy whose arrays are copied, in Fortran order."""

    def copy(_: str, array: Any) -> Any:
        copied = array.copy(order="F")
        copied.flags.writeable = writeable
        return copied

    return _with_arrays(batch, copy)


def take_rows(batch: Any, rows: IntArray) -> Any:
    """Return a batch of some snapshots, in the order of ``rows``."""
    return _with_arrays(batch, lambda _, array: np.asfortranarray(array[rows]))


def replace_rows(batch: Any, rows: IntArray, other: Any) -> Any:
    """Return a batch whose snapshots ``rows`` are the first of ``other``'s; the scene is unchanged."""

    def replace(name: str, array: Any) -> Any:
        replaced = array.copy(order="F")
        replaced[rows] = getattr(other, name)[: len(rows)]
        return replaced

    return _with_arrays(batch, replace)


def permute_measurements(batch: Any, order: IntArray) -> Any:
    """Return the batch with its measurements in another order, the same for every snapshot."""

    def permute(_: str, array: Any) -> Any:
        return np.asfortranarray(array[:, order]) if array.ndim > 1 else array.copy()

    return _with_arrays(batch, permute)


def move_batch(batch: Any, motion: Motion, directions: tuple[str, ...]) -> Any:
    """Return the batch in a moved frame: positions, the arrays named ``directions``, scene, round field."""

    def move(name: str, array: Any) -> Any:
        if name.endswith("_xy_m"):
            return motion.points(array)
        if name.endswith("_z_m"):
            return array + motion.lift_m
        return wrap_angle(array + motion.angle_rad) if name in directions else array.copy(order="F")

    return dataclasses.replace(
        _with_arrays(batch, move), scene=_move_scene(batch.scene, motion), field=_move_field(batch.field, motion)
    )


def _move_field(field: Field, motion: Motion) -> Field:
    """Return a round field moved; other fields are unchanged, so methods that use them must not be tested with one."""
    if not isinstance(field, CircleField):
        return field
    x, y = motion.point((field.x_m, field.y_m))
    return dataclasses.replace(field, x_m=x, y_m=y)


def _move_scene(scene: Scene, motion: Motion) -> Scene:
    return dataclasses.replace(
        scene,
        sensors=tuple(_move_sensor(sensor, motion) for sensor in scene.sensors),
        reflectors=tuple(_move_reflector(reflector, motion) for reflector in scene.reflectors),
    )


def _move_sensor(sensor: Sensor, motion: Motion) -> Sensor:
    heading = None if sensor.heading_deg is None else sensor.heading_deg - float(np.degrees(motion.angle_rad))
    return dataclasses.replace(sensor, position=motion.point(sensor.position), heading_deg=heading)


def _move_reflector(reflector: Reflector, motion: Motion) -> Reflector:
    match reflector:
        case LineReflector():
            point, direction = motion.point(reflector.point), motion.direction(reflector.direction)
            return dataclasses.replace(reflector, point=point, direction=direction)
        case SegmentReflector():
            start, end = motion.point(reflector.start), motion.point(reflector.end)
            return dataclasses.replace(reflector, start=start, end=end)
        case CircleReflector():
            return dataclasses.replace(reflector, center=motion.point(reflector.center))
        case PlaneReflector():
            foot = (*motion.point(reflector.point[:2]), reflector.point[2] + motion.lift_m)
            normal = (*motion.direction(reflector.normal[:2]), reflector.normal[2])
            return dataclasses.replace(reflector, point=foot, normal=normal)
        case SphereReflector():
            return dataclasses.replace(
                reflector, center=(*motion.point(reflector.center[:2]), reflector.center[2] + motion.lift_m)
            )


def _with_arrays(batch: Any, change: Callable[[str, Any], Any]) -> Any:
    """Return the batch with each of its arrays changed."""
    changed = {
        field.name: change(field.name, getattr(batch, field.name))
        for field in dataclasses.fields(batch)
        if isinstance(getattr(batch, field.name), np.ndarray)
    }
    return dataclasses.replace(batch, **changed)
