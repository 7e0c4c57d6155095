"""Arrival times: ranges plus an offset that the arrivals of a snapshot have in common.

With arrivals t_i = |x - a_i| + c + n_i (metres) of std s_i and weights w_i = 1 / s_i^2 the likeliest offset at a point
x is the weighted mean c(x) of t_i - |x - a_i|. Eliminated in this way it leaves D unknowns, and the likelihood of all
differences to any reference with their full covariance:

    r_i = (t_i - |x - a_i| - c(x)) / s_i,    dr_i/dx = -(u_i - m) / s_i,    m the weighted mean of u_i
    C_xx = (sum of w_i (u_i - m)(u_i - m)')^-1,    C_xc = -C_xx m,    C_cc = 1 / sum of w + m' C_xx m

Independent differences of pairs of sensors i, j, each with a std s of its own, have no offset:

    r = (t - |x - a_i| + |x - a_j|) / s,    dr/dx = -(u_i - u_j) / s        (uncertain speed: `uncertain_speed`)
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, reduce
from typing import NamedTuple

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ignoring_division, ignoring_overflow
from nlosctl.contract.batches import ArrivalBatch
from nlosctl.geometry.blocks import (
    RowBlock,
    column_blocks,
    max_measurements,
    side_by_side,
    sum_measurements,
    sum_products,
)
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.measured_height import MeasuredHeight
from nlosctl.models.uncertain_speed import UncertainSpeed

__all__ = ["ArrivalRows", "Compared", "arrival_rows"]

_MANY_STDS = 6.0
"""A difference longer than its baseline by so many standard deviations is not that of direct arrivals."""


class Compared(NamedTuple):
    """Arrivals compared with points: residuals r (B, K) over their std and their D derivatives.

    ``offset_m`` (B,) is the likeliest offset, ``pull`` its D derivatives with the opposite sign, m; 0 for differences.
    ``distance_m`` and ``along``, the D derivatives u of the distances, are (B, K), or (B, 2 K) for differences.
    Residuals and derivatives are whitened if the speed of the wave is uncertain.
    """

    residual: FloatArray
    slopes: tuple[FloatArray, ...]
    offset_m: FloatArray
    pull: tuple[FloatArray, ...]
    distance_m: FloatArray
    along: tuple[FloatArray, ...]


@dataclass(frozen=True)
class ArrivalRows(RowBlock):
    """Arrivals (B, K) about a local origin (B,), the mean of the sensors; points and sensors are D arrays. Metres.

    ``origin_m`` (B,) was subtracted from the arrivals. ``level`` is a measured height in space. Where the height of
    the source is exactly known D is 2: ``held_z_m`` (B,) is that height, ``height`` (B, K) are the sensors' over it.
    Of independent differences ``sensor`` and ``height`` are (B, 2 K): the sensors, then the references.
    """

    center: tuple[FloatArray, ...]
    sensor: tuple[FloatArray, ...]
    arrival_m: FloatArray
    std_m: FloatArray
    origin_m: FloatArray
    height: FloatArray | None = None
    level: MeasuredHeight | None = None
    held_z_m: FloatArray | None = None
    speed: UncertainSpeed | None = None

    @property
    def of_pairs(self) -> bool:
        """Whether the arrivals are independent differences of pairs of sensors, without a common offset."""
        return bool(self.sensor[0].shape[1] > self.arrival_m.shape[1])

    @property
    def degrees_of_freedom(self) -> IntArray:
        """The number (B,) of measured scalars minus that of the unknowns, a common offset among them."""
        heights = 0 if self.level is None else self.level.known
        scalars: IntArray = np.full(self.origin_m.shape, self.arrival_m.shape[1] - (not self.of_pairs), dtype=np.int64)
        return np.asarray(scalars - len(self.center) + heights)

    @property
    def restricted(self) -> bool:
        """Whether the scene hides any point from any row: no."""
        return False

    def unseen(self, *point: FloatArray) -> BoolArray:
        """Return to which rows (B, K) points can't be visible: all are visible."""
        return np.zeros(self.arrival_m.shape, dtype=bool)

    def absolute(self, *point: FloatArray) -> tuple[FloatArray, ...]:
        """Return points (B,), given about the local origins, in the frame, with a height that is exactly known."""
        place = tuple(part + middle for part, middle in zip(point, self.center, strict=True))
        return place if self.held_z_m is None else (*place, self.held_z_m)

    def whole_covariance(self, covariance: SymmetricMatrix, *point: FloatArray) -> SymmetricMatrix:
        """Return the covariances of all coordinates; zeros for a height that is exactly known."""
        if self.held_z_m is None:
            return covariance
        return SymmetricMatrix(*covariance, *(np.zeros(covariance.xx.shape) for _ in range(3)))

    def size_m(self) -> FloatArray:
        """Return the distance (B,) of the farthest sensor from the local origin; 1 if all are at a single point."""
        size = np.sqrt(max_measurements(np.sum([part * part for part in self.sensor], axis=0)))
        return np.where(size > 0.0, size, 1.0)

    def distance_m(self, *point: FloatArray) -> FloatArray:
        """Return the distances (B, K) of points (B,) from the sensors, (B, 2 K) from sensors and references."""
        distance = np.empty(self.sensor[0].shape, order="F")
        for at in column_blocks(distance.shape):
            away = [part[:, None] - own[:, at] for part, own in zip(point, self.sensor, strict=True)]
            squared = reduce(np.add, [part * part for part in away])
            if self.height is not None:
                squared += self.height[:, at] * self.height[:, at]
            np.sqrt(squared, out=distance[:, at])
        return distance

    def residual_m(self, *point: FloatArray) -> FloatArray:
        """Return the arrivals minus distance and offset (B, K) at points (B,), or the differences minus theirs.

        If the speed of the wave is uncertain, the arrivals are those of the likeliest speed.
        """
        excess = self.arrival_m - self.measured(self.distance_m(*point))
        with ignoring_division():
            residual = np.asarray(excess - self.common(excess)[:, None])
        return residual if self.speed is None else self.speed.corrected(residual / self.std_m) * self.std_m

    def compare(self, *point: FloatArray) -> Compared:
        """Return residuals and derivatives at points (B,); not finite on a sensor."""
        distance = self.distance_m(*point)
        inverse_std = 1.0 / self.std_m
        with ignoring_division():
            along = tuple(part[:, None] - own for part, own in zip(point, self.sensor, strict=True))
            for part in along:
                part /= distance
            excess = self.arrival_m - self.measured(distance)
            offset = self.common(excess)
            excess -= offset[:, None]
            excess *= inverse_std
            measured = tuple(map(self.measured, along))
            pull = tuple(map(self.common, measured))
            slopes = tuple(mean[:, None] - part for part, mean in zip(measured, pull, strict=True))
            for slope in slopes:
                slope *= inverse_std
        if self.speed is not None:
            excess, slopes = self.speed.whitened(excess), tuple(map(self.speed.whitened, slopes))
        return Compared(excess, slopes, offset, pull, distance, along)

    def bending(self, at: Compared) -> FloatArray:
        """Return residuals over std and distance by sensor (B, K), or by sensor and reference (B, 2 K).

        With the projector P across the ray, the sum of these times -P is that of the residuals times their second
        derivatives: the offset has no part in it, since the residuals over std sum to zero.
        """
        residual = at.residual if self.speed is None else self.speed.whitened(at.residual)
        if not self.of_pairs:
            return np.asarray(residual / (self.std_m * at.distance_m))
        scaled = residual / self.std_m
        return np.asarray(side_by_side(scaled, -scaled) / at.distance_m)

    def information(self, *point: FloatArray) -> SymmetricMatrix:
        """Return the Fisher information (B,) of the position at points (B,), the offset eliminated."""
        total = SymmetricMatrix.gram(*self.compare(*point).slopes)
        if self.level is not None:
            total.diagonal[-1][:] += self.level.inverse_std * self.level.inverse_std
        return total

    def half_chi_squares(self, *point: FloatArray) -> FloatArray:
        """Return half the chi-square (B, P) at points (B, P), the measured height included."""
        cost = np.empty(point[0].shape, order="F")
        with ignoring_overflow():
            for at in column_blocks(cost.shape):
                cost[:, at] = self._half_chi_squares(tuple(part[:, at] for part in point))
        return cost

    def _half_chi_squares(self, point: tuple[FloatArray, ...]) -> FloatArray:
        count, excess = self.arrival_m.shape[1], []
        total, mean, along = (np.zeros(point[0].shape) for _ in range(3))
        for k in range(count):
            away = self._distances_m(k, point)
            if self.of_pairs:
                away -= self._distances_m(count + k, point)
            excess.append(self.arrival_m[:, k, None] - away)
            if not self.of_pairs:
                mean += self._share[:, k, None] * excess[k]
        for k, part in enumerate(excess):
            part -= mean
            part /= self.std_m[:, k, None]
            if self.speed is not None:
                along += self.speed.effect[:, k, None] * part
            part *= part
            total += part
        if self.speed is not None:
            total -= self.speed.gain(along)
        if self.level is not None:
            total += self.level.scaled_residual(point[-1]) ** 2
        total *= 0.5
        return total

    def contradictory(self, half_chi_square: FloatArray) -> BoolArray:
        """Return which snapshots (B,) have two arrivals farther apart than their sensors, by many stds.

        Only those are examined whose fix is as bad as that makes any fix.
        """
        found = np.zeros(self.origin_m.shape, dtype=bool)
        bad = np.flatnonzero(~(half_chi_square < 0.49 * _MANY_STDS * _MANY_STDS))
        found[bad] = self.take(bad).far_apart()
        return found

    def far_apart(self) -> BoolArray:
        """Return that of all snapshots."""
        found = np.zeros(self.origin_m.shape, dtype=bool)
        count = self.arrival_m.shape[1]
        if self.of_pairs:
            for k in range(count):
                found |= self._is_longer(self.arrival_m[:, k], self.std_m[:, k], self._baseline_m(k, count + k))
            return found
        for i in range(count):
            for k in range(i):
                difference = self.arrival_m[:, i] - self.arrival_m[:, k]
                spread = np.hypot(self.std_m[:, i], self.std_m[:, k])
                found |= self._is_longer(difference, spread, self._baseline_m(i, k))
        return found

    def _is_longer(self, difference: FloatArray, std: FloatArray, baseline: FloatArray) -> BoolArray:
        spread = std if self.speed is None else np.hypot(std, self.speed.std * difference)
        return np.asarray(np.abs(difference) > baseline + _MANY_STDS * spread)

    def _baseline_m(self, i: int, k: int) -> FloatArray:
        """Return the distances (B,) between two sensors or references."""
        squared = np.zeros(self.origin_m.shape) if self.height is None else (self.height[:, i] - self.height[:, k]) ** 2
        for part in self.sensor:
            squared = squared + (part[:, i] - part[:, k]) ** 2
        return np.sqrt(squared)

    def single_origin(self) -> BoolArray:
        """Return which snapshots (B,) have all their sensors at a single point."""
        away = np.sum([(part - part[:, :1]) ** 2 for part in self.sensor], axis=0)
        single: BoolArray = max_measurements(away) == 0.0
        return single

    def _distances_m(self, k: int, point: tuple[FloatArray, ...]) -> FloatArray:
        """Return the distances (B, P) of points (B, P) from one sensor or reference."""
        away = [part - own[:, k, None] for part, own in zip(point, self.sensor, strict=True)]
        squared = reduce(np.add, [part * part for part in away])
        if self.height is not None:
            squared += self.height[:, k, None] ** 2
        return np.sqrt(squared)

    def measured(self, values: FloatArray) -> FloatArray:
        """Return values by sensor (B, K), or by sensor and reference (B, 2 K) their differences (B, K)."""
        count = self.arrival_m.shape[1]
        return values[:, :count] - values[:, count:] if self.of_pairs else values

    def common(self, values: FloatArray) -> FloatArray:
        """Return what the offset takes off values (B, K): their weighted means (B,), 0 from independent differences."""
        if self.of_pairs:
            return np.zeros(values.shape[0])
        return sum_products(self._share, values)

    @cached_property
    def _share(self) -> FloatArray:
        """The weights (B, K) of means: they sum to 1."""
        weight = 1.0 / (self.std_m * self.std_m)
        weight /= sum_measurements(weight)[:, None]
        return weight


def arrival_rows(batch: ArrivalBatch) -> ArrivalRows:
    """Return the arrivals of a batch about the mean of each snapshot's sensor positions, references among them."""
    sensor: tuple[FloatArray, ...] = (batch.sensor_xy_m[..., 0], batch.sensor_xy_m[..., 1])
    if batch.dimension == 3 and batch.sensor_z_m is not None:
        sensor = (*sensor, batch.sensor_z_m)
    if batch.reference_xy_m is not None:
        reference: tuple[FloatArray, ...] = (batch.reference_xy_m[..., 0], batch.reference_xy_m[..., 1])
        if batch.dimension == 3 and batch.reference_z_m is not None:
            reference = (*reference, batch.reference_z_m)
        sensor = tuple(side_by_side(own, other) for own, other in zip(sensor, reference, strict=True))
    height = level = held = None
    target_z = batch.target_z_m if batch.dimension == 3 else None
    if target_z is not None and batch.height_held:
        held, height, sensor = target_z, np.asfortranarray(sensor[2] - target_z[:, None]), sensor[:2]
    center = tuple(sum_measurements(part) / part.shape[1] for part in sensor)
    if held is None and target_z is not None and batch.target_z_std_m is not None:
        level = MeasuredHeight.of(target_z, batch.target_z_std_m, center[2])
    local = tuple(np.asfortranarray(part - middle[:, None]) for part, middle in zip(sensor, center, strict=True))
    rows = ArrivalRows(center, local, batch.arrival_m, batch.arrival_std_m, batch.origin_m, height, level, held)
    if batch.speed_std is None:
        return rows
    centred = batch.arrival_m - rows.common(batch.arrival_m)[:, None]
    return replace(rows, speed=UncertainSpeed.of(batch.speed_std, np.asfortranarray(centred / batch.arrival_std_m)))
