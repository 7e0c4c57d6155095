"""Squared-range least squares, solved to the global minimum (Beck, Stoica, Li 2008; equation (9) of Liang et al.).

The problem min |A z - b|^2 over z = (p, |p|^2) is a generalized trust region subproblem: its minimum is the one
root of a decreasing function. About the weighted mean of the sensors and along their principal axes that function is

    phi(m) = c1^2 / (g + m)^2 + c2^2 / m^2 - alpha - m / 2,    m > 0,    p = (c1 / (g + m), c2 / m)

(m is the multiplier, counted from its lower end; the weights sum to 1). It is also convex.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import FloatArray, ignoring_division, ignoring_overflow
from nlosctl.geometry.blocks import sum_measurements
from nlosctl.geometry.symmetric import SymmetricMatrix

__all__ = ["SquaredRangeFit", "fit_squared_ranges"]


_BISECTIONS = 16
_NEWTON_STEPS = 6
_FLOOR = 1e-18
"""Smallest multiplier, relative to its upper bound: at less the sensors are collinear to rounding."""


@dataclass(frozen=True)
class SquaredRangeFit:
    """The global minima (B,), and their images in the sensors' principal axis. Metres."""

    x: FloatArray
    y: FloatArray
    mirror_x: FloatArray
    mirror_y: FloatArray


@dataclass(frozen=True)
class _Secular:
    c1_squared: FloatArray
    c2_squared: FloatArray
    gap: FloatArray
    alpha: FloatArray

    def value(self, m: FloatArray) -> FloatArray:
        return self.c1_squared / (self.gap + m) ** 2 + self.c2_squared / (m * m) - self.alpha - 0.5 * m

    def slope(self, m: FloatArray) -> FloatArray:
        return -2.0 * (self.c1_squared / (self.gap + m) ** 3 + self.c2_squared / (m * m * m)) - 0.5

    def bracket(self) -> tuple[FloatArray, FloatArray]:
        """Return a lower end, where phi >= 0 unless it is the floor, and an upper end, where phi <= 0."""
        total = self.c1_squared + self.c2_squared
        high = np.maximum(np.cbrt(4.0 * total), 4.0 * np.abs(self.alpha))
        with ignoring_division():
            low = np.cbrt(self.c2_squared)
            steep = np.sqrt(self.c2_squared / (2.0 * self.alpha))
            low = np.where(self.alpha > 0.0, np.minimum(low, steep), low)
        return np.maximum(low, _FLOOR * high), high


def fit_squared_ranges(
    sensor_x: FloatArray, sensor_y: FloatArray, squared_range: FloatArray, weight: FloatArray
) -> SquaredRangeFit:
    """Return the points with the least sum of ``weight * (squared_range - |p - a|^2)^2``, equation (9).

    All arguments (B, K): sensors in metres, squared ranges in square metres (any sign), weights positive. Sensors
    on one line have two minima, p and its mirror image. NaN where all sensors of a snapshot coincide.
    """
    weight = weight / sum_measurements(weight)[:, None]
    mean_x, mean_y = sum_measurements(weight * sensor_x), sum_measurements(weight * sensor_y)
    dx, dy = sensor_x - mean_x[:, None], sensor_y - mean_y[:, None]
    moment = SymmetricMatrix.gram(dx, dy, weight=weight)
    smaller, larger = moment.eigenvalues()
    smaller = np.maximum(smaller, 0.0)
    angle = 0.5 * np.arctan2(2.0 * moment.xy, moment.xx - moment.yy)
    cosine, sine = np.cos(angle), np.sin(angle)
    right = squared_range - (dx * dx + dy * dy)
    right_mean = sum_measurements(weight * right)
    right = weight * (right - right_mean[:, None])
    pull_x, pull_y = -2.0 * sum_measurements(right * dx), -2.0 * sum_measurements(right * dy)
    c1, c2 = cosine * pull_x + sine * pull_y, cosine * pull_y - sine * pull_x
    along, across = _solve(c1, c2, 4.0 * (larger - smaller), right_mean - 2.0 * smaller)
    lost = ~(larger > 0.0) | ~np.isfinite(along) | ~np.isfinite(across)  # sensors that coincide up to rounding
    along[lost] = across[lost] = np.nan
    return SquaredRangeFit(
        x=mean_x + cosine * along - sine * across,
        y=mean_y + sine * along + cosine * across,
        mirror_x=mean_x + cosine * along + sine * across,
        mirror_y=mean_y + sine * along - cosine * across,
    )


def _solve(c1: FloatArray, c2: FloatArray, gap: FloatArray, alpha: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return p along the major and the minor axis: bisection of phi, then Newton from where phi is positive."""
    secular = _Secular(c1 * c1, c2 * c2, gap, alpha)
    with ignoring_overflow():
        low, high = secular.bracket()
        collinear = secular.value(low) < 0.0
        for _ in range(_BISECTIONS):
            middle = np.sqrt(low * high)
            positive = secular.value(middle) >= 0.0
            low, high = np.where(positive, middle, low), np.where(positive, high, middle)
        root = low
        for _ in range(_NEWTON_STEPS):
            root = np.minimum(np.maximum(root - secular.value(root) / secular.slope(root), low), high)
        along = c1 / (gap + root)
        # Sensors on one line: the multiplier is at its lower end, and |p|^2 = alpha fixes the other coordinate.
        free = np.sqrt(np.maximum(alpha - (c1 / gap) ** 2, 0.0))
        across = np.where(collinear, np.copysign(free, c2), c2 / root)
        return np.where(collinear, c1 / gap, along), across
