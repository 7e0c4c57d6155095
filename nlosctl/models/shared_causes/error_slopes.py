"""Derivatives of residuals by what is not exactly known of sensors and mirrors, by those by the source.

A row that sees the source x, or its image, from its sensor p depends on their difference alone: moved with the sensor
the residual changes by minus its derivative by the source, mirrored where the row is. Rows by circles and spheres, and
a height that is held, by central differences of the residuals.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, ignoring_division
from nlosctl.models.arrivals import arrival_rows
from nlosctl.models.scaled_residuals import SCALED_RESIDUALS, ScaledResiduals
from nlosctl.models.shared_causes.causes import SharedCauses
from nlosctl.models.shared_causes.mirrors import flat_mirrors, is_round, with_radii

__all__ = ["ErrorSlopes", "mirror_errors", "sensor_slopes"]

_STEP = 1e-6
"""Central differences take steps of this share of the longest distance from a sensor, or of a radius."""

Blocks = list[FloatArray]
"""An array (B, K) for each block of scalars."""


@dataclass(frozen=True)
class ErrorSlopes:
    """Derivatives of the scalars of rows by the coordinates of a sensor, by its offset, and by that of its ranges.

    By position an entry for each coordinate; empty where it is exactly known.
    """

    by_position: list[Blocks]
    by_offset: Blocks
    by_range_offset: Blocks


def sensor_slopes(
    kind: str,
    batch: Any,
    position_m: FloatArray,
    scalars: Sequence[ScaledResiduals],
    causes: SharedCauses,
    *,
    with_ranges: bool,
) -> list[ErrorSlopes]:
    """Return the derivatives by the sensors of rows and, of independent differences, by their references."""
    of_rows = [scalar for scalar in scalars if scalar.of_rows]
    nodes = [causes.sensors, *([] if causes.reference is None else [causes.reference])]
    moved = any(node.any_position for node in nodes)
    if kind == "arrivals":
        return _arrival_slopes(batch, position_m, moved=moved)
    offset = [_or_zero(scalar.per_offset, scalar.residual) for scalar in of_rows]
    by_range = [np.zeros(scalar.residual.shape) for scalar in of_rows]
    if kind == "bearings" and with_ranges and batch.range_m is not None and batch.range_std_m is not None:
        by_range[-1] = np.where(of_rows[-1].measured > 0.0, -1.0 / batch.range_std_m, 0.0)
    if not moved:
        return [ErrorSlopes([], offset, by_range)]
    model = _Model(kind, batch, position_m, with_ranges)
    mirrors = None if batch.reflector is None else flat_mirrors(batch.scene, batch.reflector, position_m.shape[1])
    blocks = []
    for slopes in model.source_slopes(scalars):
        own = tuple(-slope for slope in slopes) if mirrors is None else mirrors.by_sensor(slopes)
        blocks.append([np.asarray(part) for part in own])
    by_position = [list(parts) for parts in zip(*blocks, strict=True)]
    if (bent := model.bent()) is not None:
        for axis, parts in enumerate(by_position):
            by_position[axis] = _replaced(parts, model.by_sensor(axis), bent)
    return [ErrorSlopes(by_position, offset, by_range)]


def mirror_errors(
    batch: Any, kind: str, position_m: FloatArray, scalars: Sequence[ScaledResiduals], *, with_ranges: bool
) -> list[Blocks]:
    """Return the errors (B, K) per standard normal cause of the mirrors: offsets, directions, and radii."""
    model = _Model(kind, batch, position_m, with_ranges)
    mirrors = flat_mirrors(batch.scene, batch.reflector, position_m.shape[1])
    source = tuple(position_m.T[:, :, None])
    blocks = [mirrors.errors(slopes, source) for slopes in model.source_slopes(scalars)]
    errors = [list(parts) for parts in zip(*blocks, strict=True)]
    if (bent := model.bent()) is not None:
        std = with_radii(batch.scene, 0.0)[1][batch.reflector]
        zero = [np.zeros(std.shape) for _ in errors[0]]
        by_radius = _replaced(zero, model.by_radius(), bent)
        errors.append([block * std for block in by_radius])
    return errors


def _arrival_slopes(batch: Any, position_m: FloatArray, *, moved: bool) -> list[ErrorSlopes]:
    rows = arrival_rows(batch)
    inverse, count = 1.0 / rows.std_m, rows.std_m.shape[1]
    zero = [np.zeros(inverse.shape)]
    offsets = [[-inverse], [inverse]][: 2 if rows.of_pairs else 1]
    if not moved:
        return [ErrorSlopes([], offset, zero) for offset in offsets]
    at = rows.compare(*(position_m[:, axis] - middle for axis, middle in enumerate(rows.center)))
    along = list(at.along)
    if rows.height is not None:
        with ignoring_division():
            along.append(-rows.height / at.distance_m)
    along = [np.where(np.isfinite(part), part, 0.0) for part in along]
    return [
        ErrorSlopes([[-offset[0] * part[:, start : start + count]] for part in along], offset, zero)
        for start, offset in zip((0, count), offsets, strict=False)
    ]


@dataclass(frozen=True)
class _Model:
    """The residuals of a batch at positions (B, D), also moved."""

    kind: str
    batch: Any
    position_m: FloatArray
    with_ranges: bool

    def residuals(self, batch: Any) -> Blocks:
        scalars = SCALED_RESIDUALS[self.kind](batch, self.position_m, with_ranges=self.with_ranges, with_height=True)
        return [scalar.residual for scalar in scalars if scalar.of_rows]

    def source_slopes(self, scalars: Sequence[ScaledResiduals]) -> list[tuple[FloatArray, ...]]:
        """Return the derivatives (B, K) of each block by all D coordinates of the source."""
        slopes = [scalar.slopes for scalar in scalars if scalar.of_rows]
        if len(slopes[0]) == self.position_m.shape[1]:
            return slopes
        height = self.batch.target_z_m
        up = self._differences(lambda step: replace(self.batch, target_z_m=height + step), self._step_m())
        return [(*own, part) for own, part in zip(slopes, up, strict=True)]

    def bent(self) -> BoolArray | None:
        """Return which rows (B, K) are by circles or spheres, None without any."""
        if self.batch.reflector is None:
            return None
        bent = is_round(self.batch.scene, self.batch.reflector)
        return bent if bent.any() else None

    def by_sensor(self, axis: int) -> Blocks:
        """Return the derivatives by a coordinate of the sensors."""

        def moved(step: float) -> Any:
            if axis == 2:
                return replace(self.batch, sensor_z_m=self.batch.sensor_z_m + step)
            place = self.batch.sensor_xy_m.copy(order="F")
            place[..., axis] += step
            return replace(self.batch, sensor_xy_m=place)

        return self._differences(moved, self._step_m())

    def by_radius(self) -> Blocks:
        """Return the derivatives by the radii of circles and spheres."""
        step = _STEP * min(one.radius for one in self.batch.scene.reflectors if hasattr(one, "radius"))
        return self._differences(lambda by: replace(self.batch, scene=with_radii(self.batch.scene, by)[0]), step)

    def _step_m(self) -> float:
        radii = [one.radius for one in self.batch.scene.reflectors if hasattr(one, "radius")]
        return _STEP * min(radii, default=1e3)

    def _differences(self, moved: Callable[[float], Any], step: float) -> Blocks:
        after, before = self.residuals(moved(step)), self.residuals(moved(-step))
        blocks = [(one - other) / (2.0 * step) for one, other in zip(after, before, strict=True)]
        if self.kind == "bearings":
            std = self.batch.bearing_std_rad if self.batch.direction_std_rad is None else self.batch.direction_std_rad
            turn = 2.0 * np.pi / (std * 2.0 * step)
            blocks[0] = blocks[0] - turn * np.round(blocks[0] / turn)
        return blocks


def _replaced(blocks: Blocks, others: Blocks, where: BoolArray) -> Blocks:
    return [np.where(where, other, own) for own, other in zip(blocks, others, strict=True)]


def _or_zero(values: FloatArray | None, like: FloatArray) -> FloatArray:
    return np.zeros(like.shape) if values is None else values
