"""Squared-range least squares, solved to the global minimum (Beck, Stoica, Li 2008; equation (9) of Liang et al.).

The problem min |A z - b|^2 over z = (p, |p|^2) is a generalized trust region subproblem: its minimum is the one
root of a decreasing function. About the weighted mean of the sensors and along their principal axes that function is

    phi(m) = sum of c_k^2 / (g_k + m)^2 - alpha - m / 2,    m > 0,    p_k = c_k / (g_k + m)

with g = 0 for the last axis, the one of the least moment (m is the multiplier, counted from its lower end; the weights
sum to 1). It is also convex. Sensors on a line in the plane, or in a plane in space, have c = 0 there: where phi has no
root, |p|^2 = alpha fixes the last coordinate up to its sign, and the two images are minima of equal cost.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np

from nlosctl.arrays import FloatArray, ignoring_division, ignoring_overflow
from nlosctl.geometry.blocks import sum_measurements
from nlosctl.geometry.eigensystems import eigensystem
from nlosctl.geometry.symmetric import SymmetricMatrix

__all__ = ["HeightPenalty", "SquaredRangeFit", "fit_squared_ranges", "principal_axes"]


_BISECTIONS = 16
_NEWTON_STEPS = 6
_FLOOR = 1e-18
"""Smallest multiplier, relative to its upper bound: at less the sensors are collinear (coplanar) to rounding."""


@dataclass(frozen=True)
class SquaredRangeFit:
    """The global minima (B,), and their images in the line (plane) through the mean across the unit ``normal``.

    The normal is the principal axis of the least moment. D arrays each, metres.
    """

    point: tuple[FloatArray, ...]
    mirror: tuple[FloatArray, ...]
    normal: tuple[FloatArray, ...]


@dataclass(frozen=True)
class HeightPenalty:
    """A term ``weight * (z - z_m)^2`` (B,) beside the squared ranges, in their units (m^4)."""

    z_m: FloatArray
    weight: FloatArray


@dataclass(frozen=True)
class _Secular:
    squares: tuple[FloatArray, ...]
    gaps: tuple[FloatArray, ...]
    alpha: FloatArray

    def value(self, m: FloatArray) -> FloatArray:
        total = self.squares[0] / (self.gaps[0] + m) ** 2
        for square, gap in zip(self.squares[1:-1], self.gaps[1:], strict=True):
            total += square / (gap + m) ** 2
        return total + self.squares[-1] / (m * m) - self.alpha - 0.5 * m

    def slope(self, m: FloatArray) -> FloatArray:
        total = self.squares[0] / (self.gaps[0] + m) ** 3
        for square, gap in zip(self.squares[1:-1], self.gaps[1:], strict=True):
            total += square / (gap + m) ** 3
        return -2.0 * (total + self.squares[-1] / (m * m * m)) - 0.5

    def bracket(self) -> tuple[FloatArray, FloatArray]:
        """Return a lower end, where phi >= 0 unless it is the floor, and an upper end, where phi <= 0."""
        total, last = _add(self.squares), self.squares[-1]
        high = np.maximum(np.cbrt(4.0 * total), 4.0 * np.abs(self.alpha))
        with ignoring_division():
            low = np.cbrt(last)
            steep = np.sqrt(last / (2.0 * self.alpha))
            low = np.where(self.alpha > 0.0, np.minimum(low, steep), low)
        return np.maximum(low, _FLOOR * high), high


def fit_squared_ranges(
    sensor: tuple[FloatArray, ...], squared_range: FloatArray, weight: FloatArray, penalty: HeightPenalty | None = None
) -> SquaredRangeFit:
    """Return the points with the least sum of ``weight * (squared_range - |p - a|^2)^2``, equation (9).

    ``sensor`` has D arrays (B, K), D = 2 or 3, in metres; squared ranges (B, K) in square metres (any sign), weights
    positive. In space a ``penalty`` may be added. Sensors on one line (in one plane) have two minima, p and its mirror
    image. NaN where all sensors of a snapshot coincide.
    """
    total = sum_measurements(weight)
    weight = weight / total[:, None]
    mean = [sum_measurements(weight * part) for part in sensor]
    away = [part - middle[:, None] for part, middle in zip(sensor, mean, strict=True)]
    moment = SymmetricMatrix.gram(*away, weight=weight)
    squared = away[0] * away[0]
    for part in away[1:]:
        squared += part * part
    right = squared_range - squared
    right_mean = sum_measurements(weight * right)
    right = weight * (right - right_mean[:, None])
    pull = [-2.0 * sum_measurements(right * part) for part in away]
    if penalty is not None:
        share = penalty.weight / total
        moment.diagonal[-1][:] += 0.25 * share
        pull[-1] += share * (penalty.z_m - mean[-1])
    axes, moments = principal_axes(moment)
    pulls = tuple(_add([part * along for part, along in zip(axis, pull, strict=True)]) for axis in axes)
    smallest = moments[-1]
    gaps = tuple(4.0 * (value - smallest) for value in moments[:-1])
    coordinates = _solve(pulls, gaps, right_mean - 2.0 * smallest)
    lost = ~(moments[0] > 0.0) | ~np.logical_and.reduce([np.isfinite(part) for part in coordinates])
    for part in coordinates:
        part[lost] = np.nan  # sensors that coincide up to rounding
    mirrored = [*coordinates[:-1], -coordinates[-1]]
    return SquaredRangeFit(_place(mean, axes, coordinates), _place(mean, axes, mirrored), tuple(axes[-1]))


def principal_axes(moment: SymmetricMatrix) -> tuple[list[list[FloatArray]], list[FloatArray]]:
    """Return the unit axes of moments (B,) as coordinates, and the moments about them (>= 0), the largest first."""
    (largest, *others), axes = eigensystem(moment)
    return [list(axis) for axis in axes], [largest, *(np.maximum(value, 0.0) for value in others)]


def _place(mean: list[FloatArray], axes: list[list[FloatArray]], along: list[FloatArray]) -> tuple[FloatArray, ...]:
    """Return the points with coordinates ``along`` the axes through the mean."""
    return tuple(
        _add([middle, *(axis[i] * part for axis, part in zip(axes, along, strict=True))])
        for i, middle in enumerate(mean)
    )


def _add(terms: Sequence[FloatArray]) -> FloatArray:
    """Return the sum of the terms, added one by one in order."""
    return reduce(np.add, terms)


def _solve(c: tuple[FloatArray, ...], gaps: tuple[FloatArray, ...], alpha: FloatArray) -> list[FloatArray]:
    """Return p along the axes: bisection of phi, then Newton from where phi is positive."""
    secular = _Secular(tuple(part * part for part in c), gaps, alpha)
    with ignoring_overflow():
        low, high = secular.bracket()
        flat = secular.value(low) < 0.0
        for _ in range(_BISECTIONS):
            middle = np.sqrt(low * high)
            positive = secular.value(middle) >= 0.0
            low, high = np.where(positive, middle, low), np.where(positive, high, middle)
        root = low
        for _ in range(_NEWTON_STEPS):
            root = np.minimum(np.maximum(root - secular.value(root) / secular.slope(root), low), high)
        # Sensors on one line (in one plane): the multiplier is at its lower end, |p|^2 = alpha fixes the rest.
        limits = [part / gap for part, gap in zip(c, gaps, strict=False)]
        rest = alpha
        for limit in limits:
            rest = rest - limit**2
        across = np.where(flat, np.copysign(np.sqrt(np.maximum(rest, 0.0)), c[-1]), c[-1] / root)
        along = [part / (gap + root) for part, gap in zip(c, gaps, strict=False)]
        return [*(np.where(flat, limit, part) for limit, part in zip(limits, along, strict=True)), across]
