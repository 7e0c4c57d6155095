"""Causes of errors that rows share: offsets, positions and headings of sensors, and the scene's reflectors."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from nlosctl.arrays import FloatArray, IntArray
from nlosctl.contract.scene import Scene
from nlosctl.geometry.blocks import RowBlock

__all__ = ["SensorCauses", "SharedCauses", "has_uncertain_reflectors", "uncertain_reflectors"]


@dataclass(frozen=True)
class SensorCauses(RowBlock):
    """What is not exactly known of the sensors of rows (B, K): standard deviations, each of one error per sensor.

    ``sensor`` numbers the sensors. ``position_std_m`` is that of each coordinate, ``offset_std`` that of what the
    measurement is too large by (radians of bearings, metres of ranges and arrivals), ``range_offset_std_m`` that of
    ranges beside bearings. ``entry`` are indices into the covariance of calibrated offsets, -1 for none.
    """

    sensor: IntArray
    position_std_m: FloatArray
    offset_std: FloatArray
    range_offset_std_m: FloatArray
    entry: IntArray

    @classmethod
    def exact(cls, sensor: IntArray) -> Self:
        """Return sensors (B, K) that are exactly known."""
        nothing = np.zeros(sensor.shape)
        return cls(sensor, nothing, nothing, nothing, np.full(sensor.shape, -1, dtype=np.int64))

    @property
    def any_position(self) -> bool:
        """Whether a position is not exactly known."""
        return bool(self.position_std_m.any())


@dataclass(frozen=True)
class SharedCauses:
    """What is not exactly known in B snapshots of K rows.

    ``covariance`` (E, E) is that of calibrated offsets, in squares of the unit of the measurements. ``reference`` are
    the second sensors of independent differences of arrivals, None without. ``mirrors`` is whether a row is by a
    reflector of the scene that is not exactly known.
    """

    sensors: SensorCauses
    covariance: FloatArray
    reference: SensorCauses | None = None
    mirrors: bool = False

    def take(self, rows: IntArray) -> Self:
        """Return the given snapshots, in any order and with repetitions."""
        reference = None if self.reference is None else self.reference.take(rows)
        return replace(self, sensors=self.sensors.take(rows), reference=reference)

    @property
    def depend_on_position(self) -> bool:
        """Whether the errors depend on the position of the source."""
        nodes = [self.sensors, *([] if self.reference is None else [self.reference])]
        return self.mirrors or any(node.any_position for node in nodes)

    @property
    def any_error(self) -> bool:
        """Whether anything is not exactly known."""
        nodes = [self.sensors, *([] if self.reference is None else [self.reference])]
        stds = [part.any() for node in nodes for part in (node.offset_std, node.range_offset_std_m)]
        calibrated = self.covariance.any() and any((node.entry >= 0).any() for node in nodes)
        return self.depend_on_position or bool(calibrated) or any(stds)


def uncertain_reflectors(scene: Scene) -> list[str]:
    """Return the names of the reflectors that are not exactly known."""
    return [reflector.name for reflector in scene.reflectors if reflector.is_uncertain]


def has_uncertain_reflectors(scene: Scene, reflector: IntArray | None) -> bool:
    """Return whether rows by the reflectors (B, K), -1 for none, are by one that is not exactly known."""
    uncertain = np.array([*(one.is_uncertain for one in scene.reflectors), False])
    return reflector is not None and bool(uncertain[reflector].any())
