"""Triplets in the frame of their baseline: crossings of the two rays and the ellipse of a path.

The baseline frame has the transmitter at (-d/2, 0) and the receiver at (d/2, 0). Angles are stored as cosines and
sines, so that no direction is singular. With mu1 the direction of arrival (at the receiver, towards the origin of the
wave), mu2 that of departure and l the path length, in the notation of Shen, Molisch 2012:

- point 1 is the crossing of the two lines, point 2 that of the departing ray and the ellipse of equal path length,
  point 3 that of the arriving ray and the ellipse (equations (1)-(3), solved in polar form about the foci);
- every coordinate has its exact derivatives with respect to mu1, mu2 and l; their differences are the rows of the
  matrix W of equation (14), its misprints corrected, for any triplet.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, ignoring_division, ignoring_overflow
from nlosctl.geometry.angles import cosine_sine
from nlosctl.geometry.symmetric import SymmetricMatrix

__all__ = ["AXES", "DIFFERENCES", "BaselineFrame", "Quantity", "TripletRays", "baseline_frames"]


Axis = Literal["x", "y"]
AXES: tuple[Axis, Axis] = ("x", "y")

DIFFERENCES: dict[int, tuple[int, int, Axis]] = {
    1: (1, 2, "x"),
    2: (1, 2, "y"),
    3: (1, 3, "x"),
    4: (1, 3, "y"),
    5: (2, 3, "x"),
    6: (2, 3, "y"),
}
"""The two points and the coordinate that each of lambda 1 to 6 of equation (5) compares."""


@dataclass(frozen=True)
class BaselineFrame:
    """Frames about the midpoint of each baseline, x from transmitter to receiver. Any shape, metres.

    Where transmitter and receiver coincide (monostatic), ``length_m`` is 0 and the axes are the global ones.
    """

    center_x: FloatArray
    center_y: FloatArray
    cosine: FloatArray
    sine: FloatArray
    length_m: FloatArray

    def to_global(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return points of the frame in global coordinates."""
        return (self.center_x + self.cosine * x - self.sine * y, self.center_y + self.sine * x + self.cosine * y)

    def matrix_to_global(self, matrix: SymmetricMatrix) -> SymmetricMatrix:
        """Return covariances of the frame in global axes; undefined where they are not finite."""
        cosine2, sine2, both = self.cosine * self.cosine, self.sine * self.sine, self.cosine * self.sine
        with ignoring_overflow():
            return SymmetricMatrix(
                cosine2 * matrix.xx - 2.0 * both * matrix.xy + sine2 * matrix.yy,
                both * (matrix.xx - matrix.yy) + (cosine2 - sine2) * matrix.xy,
                sine2 * matrix.xx + 2.0 * both * matrix.xy + cosine2 * matrix.yy,
            )

    def rays(self, dod_rad: FloatArray, doa_rad: FloatArray, path_length_m: FloatArray) -> TripletRays:
        """Return triplets, their angles in the global frame, as rays in this one."""
        departing, arriving = cosine_sine(dod_rad), cosine_sine(doa_rad)
        return TripletRays(
            baseline_m=self.length_m,
            dod_cosine=departing[0] * self.cosine + departing[1] * self.sine,
            dod_sine=departing[1] * self.cosine - departing[0] * self.sine,
            doa_cosine=arriving[0] * self.cosine + arriving[1] * self.sine,
            doa_sine=arriving[1] * self.cosine - arriving[0] * self.sine,
            path_length_m=path_length_m,
        )


def baseline_frames(tx_x: FloatArray, tx_y: FloatArray, rx_x: FloatArray, rx_y: FloatArray) -> BaselineFrame:
    """Return the frames of baselines from transmitters to receivers; all shapes alike, metres."""
    along_x, along_y = rx_x - tx_x, rx_y - tx_y
    length = np.sqrt(along_x * along_x + along_y * along_y)
    apart = length > 0.0
    scale = 1.0 / np.where(apart, length, 1.0)
    return BaselineFrame(
        center_x=tx_x + 0.5 * along_x,
        center_y=tx_y + 0.5 * along_y,
        cosine=np.where(apart, along_x * scale, 1.0),
        sine=along_y * scale,
        length_m=length,
    )


@dataclass(frozen=True)
class Quantity:
    """A length in metres, and its derivatives with respect to the two angles (m/rad) and the path length (m/m)."""

    value_m: FloatArray
    by_doa: FloatArray | float
    by_dod: FloatArray | float
    by_length: FloatArray | float

    def __sub__(self, other: Quantity) -> Quantity:
        return Quantity(
            self.value_m - other.value_m,
            self.by_doa - other.by_doa,
            self.by_dod - other.by_dod,
            self.by_length - other.by_length,
        )

    def __add__(self, other: Quantity) -> Quantity:
        return Quantity(
            self.value_m + other.value_m,
            self.by_doa + other.by_doa,
            self.by_dod + other.by_dod,
            self.by_length + other.by_length,
        )

    def weights_m(
        self, doa_std_rad: FloatArray, dod_std_rad: FloatArray, path_length_std_m: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the change of the quantity per standard deviation of DOA, DOD and path length, in metres."""
        return self.by_doa * doa_std_rad, self.by_dod * dod_std_rad, self.by_length * path_length_std_m


@dataclass(frozen=True)
class TripletRays:
    """Triplets in their baseline frames, any one shape: cosine and sine of both directions, lengths in metres.

    Points that do not exist are NaN: 2 and 3 where the path is not longer than the baseline (no ellipse), 1 where
    the lines are exactly parallel.
    """

    baseline_m: FloatArray
    dod_cosine: FloatArray
    dod_sine: FloatArray
    doa_cosine: FloatArray
    doa_sine: FloatArray
    path_length_m: FloatArray

    def moved(self, doa_rad: FloatArray, dod_rad: FloatArray, length_m: FloatArray) -> TripletRays:
        """Return the triplets with these changes of the three measured values."""
        doa_turn, dod_turn = cosine_sine(doa_rad), cosine_sine(dod_rad)
        return TripletRays(
            baseline_m=self.baseline_m,
            dod_cosine=self.dod_cosine * dod_turn[0] - self.dod_sine * dod_turn[1],
            dod_sine=self.dod_sine * dod_turn[0] + self.dod_cosine * dod_turn[1],
            doa_cosine=self.doa_cosine * doa_turn[0] - self.doa_sine * doa_turn[1],
            doa_sine=self.doa_sine * doa_turn[0] + self.doa_cosine * doa_turn[1],
            path_length_m=self.path_length_m + length_m,
        )

    @cached_property
    def has_ellipse(self) -> BoolArray:
        """Whether the path is longer than the baseline."""
        return self.path_length_m > self.baseline_m

    @cached_property
    def crossing_sine(self) -> FloatArray:
        """Return sin(mu1 - mu2): zero where the rays are parallel."""
        return self.doa_sine * self.dod_cosine - self.doa_cosine * self.dod_sine

    @cached_property
    def crossing_cosine(self) -> FloatArray:
        """Return cos(mu1 - mu2)."""
        return self.doa_cosine * self.dod_cosine + self.doa_sine * self.dod_sine

    @cached_property
    def dod_range_to_crossing_m(self) -> FloatArray:
        """Return the distance of point 1 along the departing ray; negative behind the transmitter."""
        return self._over_crossing_sine(self.baseline_m * self.doa_sine)

    @cached_property
    def doa_range_to_crossing_m(self) -> FloatArray:
        """Return the distance of point 1 along the arriving ray; negative behind the receiver."""
        return self._over_crossing_sine(self.baseline_m * self.dod_sine)

    @cached_property
    def meets_behind(self) -> BoolArray:
        """Whether the lines meet behind the transmitter or the receiver, so that the rays do not meet."""
        return (self.dod_range_to_crossing_m < 0.0) | (self.doa_range_to_crossing_m < 0.0)

    @cached_property
    def _squares(self) -> FloatArray:
        length, baseline = self.path_length_m, self.baseline_m
        return np.where(self.has_ellipse, (length - baseline) * (length + baseline), np.nan)

    @cached_property
    def _dod_denominator(self) -> FloatArray:
        return self.path_length_m - self.baseline_m * self.dod_cosine

    @cached_property
    def _doa_denominator(self) -> FloatArray:
        return self.path_length_m + self.baseline_m * self.doa_cosine

    @cached_property
    def dod_range_to_ellipse_m(self) -> FloatArray:
        """Return the distance of point 2 along the departing ray: (l^2 - d^2) / (2 (l - d cos mu2))."""
        return 0.5 * self._squares / self._dod_denominator

    @cached_property
    def doa_range_to_ellipse_m(self) -> FloatArray:
        """Return the distance of point 3 along the arriving ray: (l^2 - d^2) / (2 (l + d cos mu1))."""
        return 0.5 * self._squares / self._doa_denominator

    def coordinate(self, point: int, axis: Axis) -> Quantity:
        """Return a coordinate of point 1, 2 or 3 in the baseline frame, with its derivatives."""
        return (self._crossing, self._dod_on_ellipse, self._doa_on_ellipse)[point - 1](axis)

    def difference(self, which: int) -> Quantity:
        """Return lambda 1 to 6 of equation (5); its derivatives are a row of W, equation (14) corrected."""
        first, second, axis = DIFFERENCES[which]
        return self.coordinate(first, axis) - self.coordinate(second, axis)

    def _over_crossing_sine(self, numerator: FloatArray) -> FloatArray:
        with ignoring_overflow():
            return np.where(self.crossing_sine != 0.0, numerator / self.crossing_sine, np.nan)

    def _crossing(self, axis: Axis) -> Quantity:
        """Return point 1 = tx + r2 u(mu2) = rx + r1 u(mu1): each angle moves it along the line of the other."""
        along_dod, along_doa = self.dod_range_to_crossing_m, self.doa_range_to_crossing_m
        dod = self.dod_cosine if axis == "x" else self.dod_sine
        doa = self.doa_cosine if axis == "x" else self.doa_sine
        value = along_dod * dod
        if axis == "x":
            value = value - 0.5 * self.baseline_m
        return Quantity(
            value, -self._over_crossing_sine(along_doa * dod), self._over_crossing_sine(along_dod * doa), 0.0
        )

    def _dod_on_ellipse(self, axis: Axis) -> Quantity:
        reach, (along, by_length) = self.dod_range_to_ellipse_m, self._dod_ellipse_slopes
        if axis == "x":
            value = reach * self.dod_cosine - 0.5 * self.baseline_m
            return Quantity(value, 0.0, -along * self.path_length_m * self.dod_sine, by_length * self.dod_cosine)
        by_dod = along * (self.path_length_m * self.dod_cosine - self.baseline_m)
        return Quantity(reach * self.dod_sine, 0.0, by_dod, by_length * self.dod_sine)

    def _doa_on_ellipse(self, axis: Axis) -> Quantity:
        reach, (along, by_length) = self.doa_range_to_ellipse_m, self._doa_ellipse_slopes
        if axis == "x":
            value = reach * self.doa_cosine + 0.5 * self.baseline_m
            return Quantity(value, -along * self.path_length_m * self.doa_sine, 0.0, by_length * self.doa_cosine)
        by_doa = along * (self.path_length_m * self.doa_cosine + self.baseline_m)
        return Quantity(reach * self.doa_sine, by_doa, 0.0, by_length * self.doa_sine)

    @cached_property
    def _dod_ellipse_slopes(self) -> tuple[FloatArray, FloatArray]:
        along = self.dod_range_to_ellipse_m / self._dod_denominator
        return along, self._range_by_length(self._dod_denominator, -self.dod_cosine)

    @cached_property
    def _doa_ellipse_slopes(self) -> tuple[FloatArray, FloatArray]:
        along = self.doa_range_to_ellipse_m / self._doa_denominator
        return along, self._range_by_length(self._doa_denominator, self.doa_cosine)

    def _range_by_length(self, denominator: FloatArray, cosine: FloatArray) -> FloatArray:
        """Return d range / d l of a range to the ellipse: (l^2 + 2 l d cos + d^2) / (2 (l + d cos)^2)."""
        length, baseline = self.path_length_m, self.baseline_m
        numerator = length * length + 2.0 * length * baseline * cosine + baseline * baseline
        with ignoring_division():
            return 0.5 * numerator / (denominator * denominator)
