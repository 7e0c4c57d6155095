"""Ranges as circles around sensors: residual, information, and a local origin.

A slant range from a sensor at a height h over the targets' plane reads sqrt(d^2 + h^2) at a distance d in the plane.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import FloatArray, ignoring_division
from nlosctl.contract.batches import RangeBatch
from nlosctl.geometry.blocks import RowBlock, sum_measurements
from nlosctl.geometry.symmetric import SymmetricMatrix

__all__ = ["RangeCircles", "predict_ranges", "range_circles"]


@dataclass(frozen=True)
class RangeCircles(RowBlock):
    """Ranges (B, K) about a local origin (B,), the mean of the sensors. All in metres.

    ``height`` is None where every range is measured in the plane.
    """

    center_x: FloatArray
    center_y: FloatArray
    sensor_x: FloatArray
    sensor_y: FloatArray
    range_m: FloatArray
    std_m: FloatArray
    height: FloatArray | None

    def horizontal_m(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the distance (B, K) in the plane of points (B,), about the local origin, from the sensors."""
        return np.hypot(x[:, None] - self.sensor_x, y[:, None] - self.sensor_y)

    def residual_m(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return measured minus predicted range (B, K) at points (B,) about the local origin."""
        distance = self.horizontal_m(x, y)
        return self.range_m - (distance if self.height is None else np.hypot(distance, self.height))

    def information(self, x: FloatArray, y: FloatArray) -> SymmetricMatrix:
        """Return the Fisher information (B,) of the position at points (B,): sum of u u' / std^2.

        u is the gradient of a range, the unit vector from the sensor (shorter for slant ranges); not finite
        where a point lies on a sensor.
        """
        dx, dy = x[:, None] - self.sensor_x, y[:, None] - self.sensor_y
        squared = dx * dx + dy * dy
        if self.height is not None:
            squared += self.height * self.height
        with ignoring_division():
            weight = 1.0 / (self.std_m * np.sqrt(squared))
            dx *= weight
            dy *= weight
        return SymmetricMatrix.gram(dx, dy)

    def squared_in_plane(self) -> FloatArray:
        """Return the squared ranges (B, K) less the squared heights: negative where noise made a range too short."""
        squared = self.range_m * self.range_m
        return squared if self.height is None else squared - self.height * self.height


def range_circles(batch: RangeBatch) -> RangeCircles:
    """Return the circles of a batch, about the mean of each snapshot's sensor positions."""
    x, y = batch.sensor_xy_m[..., 0], batch.sensor_xy_m[..., 1]
    center_x = sum_measurements(x) / x.shape[1]
    center_y = sum_measurements(y) / y.shape[1]
    return RangeCircles(
        center_x=center_x,
        center_y=center_y,
        sensor_x=x - center_x[:, None],
        sensor_y=y - center_y[:, None],
        range_m=batch.range_m,
        std_m=batch.range_std_m,
        height=batch.sensor_height_m if batch.sensor_height_m.any() else None,
    )


def predict_ranges(sensor_xy_m: FloatArray, sensor_height_m: FloatArray, source_xy_m: FloatArray) -> FloatArray:
    """Return the noise-free ranges (...) of sources (..., 2) from sensors (..., 2) at heights (...), in metres."""
    dx, dy = source_xy_m[..., 0] - sensor_xy_m[..., 0], source_xy_m[..., 1] - sensor_xy_m[..., 1]
    return np.hypot(np.hypot(dx, dy), sensor_height_m)
