"""Bearings, with or without ranges, as rows of a mixture (equations (1)-(5), (23) of Ananthasubramaniam, Madhow)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import FloatArray, IntArray, Point, ignoring_division
from nlosctl.geometry.blocks import RowBlock
from nlosctl.geometry.regions import Ball
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.bearings import SightLines
from nlosctl.models.mirror_rows import Focusing
from nlosctl.solvers.optimization.problem import RowDerivatives

__all__ = ["DirectBearings", "squared_tube_ratio", "tube_width_m"]


_LEAST_WIDTH = 0.05
"""Least width of a ray tube, in units of the unfolded range."""


@dataclass(frozen=True)
class DirectBearings(RowBlock):
    """Rows (B, K) of unfolded rays with Gaussian bearing errors, truncated to a right angle on either side.

    A row can't be direct from points behind its origin, closer to it than ``minimum_range_m`` (B,), or on another
    side of its mirror than its sensor. ``measured_m`` (B, K) is the row's range, with ``precision`` the inverse of its
    standard deviation in metres, or of the range's logarithm where ``lognormal``: 0 in rows without a range; None
    where no row has one. The weight of a row seen on a circle is that of its ray tube's width at the point, taken as
    constant in derivatives.
    """

    lines: SightLines
    offset_across: FloatArray
    offset_along: FloatArray
    weight: FloatArray
    squared_minimum: FloatArray
    measured_m: FloatArray | None
    precision: FloatArray | None
    lognormal: bool

    @classmethod
    def of(
        cls,
        lines: SightLines,
        minimum_range_m: FloatArray,
        measured_m: FloatArray | None = None,
        std_m: FloatArray | None = None,
        *,
        lognormal: bool = False,
    ) -> DirectBearings:
        """Return the rows of a block of sight lines; ``measured_m`` and ``std_m`` (B, K) are NaN in rows without."""
        precision = None
        if measured_m is not None and std_m is not None:
            known = np.isfinite(measured_m) & np.isfinite(std_m)
            precision = np.where(known, (measured_m if lognormal else 1.0) / np.where(known, std_m, 1.0), 0.0)
            measured_m = np.where(known, measured_m, 1.0)
        return cls(
            lines,
            lines.sine * lines.origin_x - lines.cosine * lines.origin_y,
            lines.cosine * lines.origin_x + lines.sine * lines.origin_y,
            0.5 / (lines.std_rad * lines.std_rad),
            minimum_range_m * minimum_range_m,
            measured_m,
            precision,
            lognormal,
        )

    @property
    def dimension(self) -> int:
        """The number of coordinates of a point: two."""
        return 2

    def scalars(self) -> IntArray:
        """Return the number of scalars (B, K) of each row: two where it has a range."""
        ranged = 0 if self.precision is None else self.precision > 0.0
        return np.ones(self.weight.shape, dtype=np.int64) + ranged

    def half_chi_square(self, k: int, *point: FloatArray) -> FloatArray:
        """Return half the chi-square of row ``k`` at points (B, P); infinite where it can't be direct.

        The squared angle is a series in its squared sine: 0.2 % short at 30 degrees, 2 % at 45.
        """
        x, y = point
        cosine, sine = self.lines.cosine[:, k, None], self.lines.sine[:, k, None]
        along = cosine * x
        along += sine * y
        along -= self.offset_along[:, k, None]
        across = sine * x
        across -= cosine * y
        across -= self.offset_across[:, k, None]
        across *= across
        squared_range = along * along
        squared_range += across
        impossible = along <= 0.0
        impossible |= squared_range < self.squared_minimum[:, None]
        half_chi_square = across
        half_chi_square /= squared_range
        series = half_chi_square * (8.0 / 45.0)
        series += 1.0 / 3.0
        series *= half_chi_square
        series += 1.0
        half_chi_square *= series
        half_chi_square *= self.weight[:, k, None]
        if self.lines.focusing is not None:
            half_chi_square *= squared_tube_ratio(self.lines.focusing, k, np.sqrt(squared_range))
        if self.precision is not None and self.measured_m is not None:
            scaled = self._scaled_range_residual(
                np.sqrt(squared_range), self.measured_m[:, k, None], self.precision[:, k, None]
            )
            half_chi_square += 0.5 * scaled * scaled
        if self.lines.mirrors is not None:
            impossible |= self.lines.mirrors.row_beyond(k, x, y)
        np.copyto(half_chi_square, np.inf, where=impossible)
        return half_chi_square

    def ridges(self, ball: Ball) -> FloatArray:
        """Return the density (B, K) on the ray of the points of `sample_ridge`; 0 for rows seen on a circle.

        The points of a row with a range are about the end of the ray.
        """
        if self.lines.focusing is not None:
            return np.zeros(self.weight.shape)
        ridge = np.sqrt(self.weight / np.pi)
        along = 2.0 / self._squared_reach(ball)
        if self.precision is not None and self.measured_m is not None:
            power = 2.0 if self.lognormal else 1.0
            end = self.precision / (np.sqrt(2.0 * np.pi) * self.measured_m**power)
            along = np.where(self.precision > 0.0, end, along)
        return ridge * along

    def on_ridge(self, k: int, ratio: FloatArray, *point: FloatArray) -> FloatArray:
        """Return the density over that (B, P), ``ratio`` itself."""
        return ratio

    def sample_ridge(self, ball: Ball, snapshot: IntArray, k: IntArray, normal: Point, uniform: Point) -> Point:
        """Return points (N,) about the ray of row ``k`` of a snapshot, as the bearing's error is distributed."""
        at = k * self.weight.shape[0] + snapshot
        angle = normal[0] * np.take(np.sqrt(0.5 / self.weight).T, at)
        range_m = np.sqrt(uniform[1] * np.take(self._squared_reach(ball).T, at))
        if self.precision is not None and self.measured_m is not None:
            precision, measured = np.take(self.precision.T, at), np.take(self.measured_m.T, at)
            with ignoring_division():
                scaled = normal[1] / precision
                end = measured * np.exp(scaled) if self.lognormal else measured + scaled
            range_m = np.where(precision > 0.0, end, range_m)
        along, across = range_m * np.cos(angle), range_m * np.sin(angle)
        cosine, sine = np.take(self.lines.cosine.T, at), np.take(self.lines.sine.T, at)
        x, y = np.take(self.lines.origin_x.T, at), np.take(self.lines.origin_y.T, at)
        return x + cosine * along - sine * across, y + sine * along + cosine * across

    def _squared_reach(self, ball: Ball) -> FloatArray:
        """Return the squared distance (B, K) of the origins from the farthest points of the discs."""
        x, y = ball.center
        reach = np.hypot(self.lines.origin_x - x[:, None], self.lines.origin_y - y[:, None])
        reach += ball.radius[:, None]
        reach *= reach
        return reach

    def derivatives(self, k: int, *point: FloatArray) -> RowDerivatives:
        """Return half the chi-square of row ``k`` at points (B,), exact, and its derivatives."""
        x, y = point
        row, along, squared_range = self._seen_from_anywhere(k, x, y)
        impossible = along <= 0.0
        impossible |= squared_range < self.squared_minimum
        if self.lines.mirrors is not None:
            impossible |= self.lines.mirrors.row_beyond(k, x, y)
        np.copyto(row.half_chi_square, np.inf, where=impossible)
        return row

    def terms(self, k: int, x: FloatArray, y: FloatArray) -> RowDerivatives:
        """Return half the chi-square of row ``k`` at points (B,) and its derivatives, from wherever the row is seen."""
        return self._seen_from_anywhere(k, x, y)[0]

    def _seen_from_anywhere(
        self, k: int, x: FloatArray, y: FloatArray
    ) -> tuple[RowDerivatives, FloatArray, FloatArray]:
        """Return that with the distance of the points along the ray, and the squared range."""
        lines = self.lines
        cosine, sine = lines.cosine[:, k], lines.sine[:, k]
        dx, dy = x - lines.origin_x[:, k], y - lines.origin_y[:, k]
        squared_range = dx * dx + dy * dy
        along = cosine * dx + sine * dy
        residual = np.arctan2(sine * dx - cosine * dy, along)
        inverse = 1.0 / np.maximum(squared_range, self.squared_minimum)
        weight = 2.0 * self.weight[:, k]
        if lines.focusing is not None:
            weight = weight * squared_tube_ratio(lines.focusing, k, np.sqrt(squared_range))
        across_x, across_y = dx * inverse, dy * inverse
        scaled = weight * residual
        xy = across_x * across_y
        gauss = SymmetricMatrix(weight * across_y * across_y, -weight * xy, weight * across_x * across_x)
        bend = 2.0 * scaled * xy
        twist = scaled * (across_y * across_y - across_x * across_x)
        row = RowDerivatives(
            0.5 * scaled * residual,
            (scaled * across_y, -scaled * across_x),
            gauss,
            SymmetricMatrix(gauss.xx - bend, gauss.xy - twist, gauss.yy + bend),
        )
        if self.precision is not None and self.measured_m is not None:
            row = self._with_range(self.measured_m[:, k], self.precision[:, k], row, dx, dy)
        return row, along, squared_range

    def values(self, k: int, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return half the chi-square of row ``k`` at points (B, P), wherever it is seen from; as `terms` has it."""
        lines = self.lines
        cosine, sine = lines.cosine[:, k, None], lines.sine[:, k, None]
        dx, dy = x - lines.origin_x[:, k, None], y - lines.origin_y[:, k, None]
        half_chi_square = np.arctan2(sine * dx - cosine * dy, cosine * dx + sine * dy)
        half_chi_square *= half_chi_square
        half_chi_square *= self.weight[:, k, None]
        range_m = np.sqrt(np.maximum(dx * dx + dy * dy, self.squared_minimum[:, None]))
        if lines.focusing is not None:
            half_chi_square *= squared_tube_ratio(lines.focusing, k, range_m)
        if self.precision is not None and self.measured_m is not None:
            scaled = self._scaled_range_residual(range_m, self.measured_m[:, k, None], self.precision[:, k, None])
            half_chi_square += 0.5 * scaled * scaled
        return half_chi_square

    def _scaled_range_residual(self, range_m: FloatArray, measured_m: FloatArray, precision: FloatArray) -> FloatArray:
        if self.lognormal:
            return np.log(measured_m / range_m) * precision
        return (measured_m - range_m) * precision

    def _with_range(
        self, measured_m: FloatArray, precision: FloatArray, row: RowDerivatives, dx: FloatArray, dy: FloatArray
    ) -> RowDerivatives:
        """Return the derivatives with those of half the range's chi-square added."""
        range_m = np.sqrt(np.maximum(dx * dx + dy * dy, self.squared_minimum))
        x, y = dx / range_m, dy / range_m
        scaled = self._scaled_range_residual(range_m, measured_m, precision)
        slope = precision / range_m if self.lognormal else precision
        # second derivatives of the range: (I - n n^T) / R, of its logarithm: (I - 2 n n^T) / R^2
        bend = -scaled * slope / range_m
        twice = 2.0 if self.lognormal else 1.0
        gain = slope * slope
        hessian = SymmetricMatrix(
            row.hessian.xx + gain * x * x + bend * (1.0 - twice * x * x),
            row.hessian.xy + gain * x * y - bend * twice * x * y,
            row.hessian.yy + gain * y * y + bend * (1.0 - twice * y * y),
        )
        return RowDerivatives(
            row.half_chi_square + 0.5 * scaled * scaled,
            (row.gradient[0] - scaled * slope * x, row.gradient[1] - scaled * slope * y),
            row.gauss + SymmetricMatrix.outer(x, y, weight=gain),
            hessian,
        )


def squared_tube_ratio(focusing: Focusing, k: int, range_m: FloatArray) -> FloatArray:
    """Return the squared ratio of range to width of the ray tube per radian: what a circle does to a row's weight.

    The width has a lower limit, a fraction of the range, as at a focus.
    """
    first_leg, strength = focusing.first_leg_m[:, k], focusing.strength[:, k]
    if range_m.ndim > 1:
        first_leg, strength = first_leg[:, None], strength[:, None]
    ratio = range_m / tube_width_m(range_m, first_leg, strength)
    return ratio * ratio


def tube_width_m(range_m: FloatArray, first_leg_m: FloatArray, strength: FloatArray) -> FloatArray:
    """Return the width of a ray tube per radian of bearing at a range, not below its limit."""
    return np.maximum(np.abs(range_m - strength * (range_m - first_leg_m)), _LEAST_WIDTH * range_m)
