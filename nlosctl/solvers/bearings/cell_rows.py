"""Rows of bearings on a map: their exact density, averaged over cells.

A point that is uniform in a square of side h has the variance h^2 / 12 by each coordinate, and so it has along every
direction. Seen from a row's origin at a range r it blurs the bearing by h / (sqrt(12) r): the mean of a Gaussian
density over the cell is nearly that of the variance s^2 + h^2 / (12 r^2).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.geometry.blocks import RowBlock
from nlosctl.solvers.bearings.row_terms import DirectBearings, squared_tube_ratio

__all__ = ["CellBearings"]

_DEGREE = 5
_HALF = 0.5

_SQUARED_ANGLE = np.polynomial.Chebyshev.interpolate(
    lambda u: np.where(u > 0.0, (2.0 * np.arcsin(np.sqrt(np.maximum(u, 0.0)))) ** 2 / np.maximum(u, 1e-300), 4.0),
    _DEGREE,
    domain=[0.0, _HALF],
).convert(kind=np.polynomial.Polynomial)
"""The squared angle over u = sin^2(angle / 2), up to a right angle: within 3e-6."""


@dataclass(frozen=True)
class CellBearings(RowBlock):
    """`DirectBearings` at the centres of cells; ``spread_m`` is the std by each coordinate of a point in a cell.

    ``anywhere``: a row may be seen from behind its origin too, with its angle in (-pi, pi].
    """

    rows: DirectBearings
    spread_m: float
    anywhere: bool
    range_blur: FloatArray | None

    @classmethod
    def of(cls, rows: DirectBearings, spread_m: float, *, anywhere: bool) -> CellBearings:
        """Return the rows; the ranges of the rows are blurred too, by the factors exp(``range_blur``) (B, K)."""
        if rows.precision is None or rows.measured_m is None or spread_m == 0.0:
            return cls(rows, spread_m, anywhere, None)
        scaled = rows.precision * spread_m / (rows.measured_m if rows.lognormal else 1.0)
        blur = 0.5 * np.log1p(scaled * scaled)
        return cls(replace(rows, precision=rows.precision * np.exp(-blur)), spread_m, anywhere, blur)

    @property
    def dimension(self) -> int:
        """The number of coordinates of a point: two."""
        return 2

    def half_chi_square(self, k: int, *point: FloatArray) -> FloatArray:
        """Return half the chi-square of row ``k`` at points (B, P), and the logarithm of how much the cell blurs it."""
        rows, lines = self.rows, self.rows.lines
        dx, dy = (part - own[:, k, None] for part, own in zip(point, (lines.origin_x, lines.origin_y), strict=True))
        cosine, sine = lines.cosine[:, k, None], lines.sine[:, k, None]
        along = cosine * dx
        along += sine * dy
        dx *= sine
        dy *= cosine
        dx -= dy
        dx *= dx
        squared = along * along
        squared += dx
        impossible = None if self.anywhere else (along <= 0.0) | (squared < rows.squared_minimum[:, None])
        np.maximum(squared, np.finfo(np.float64).tiny, out=squared)
        range_m = np.sqrt(squared)
        total = self._squared_angle(dx, along, squared, range_m)
        total *= self._weight(k, squared, range_m)
        if self.spread_m > 0.0:
            total += 0.5 * np.log1p(2.0 * rows.weight[:, k, None] * self.spread_m**2 / squared)
        if rows.precision is not None and rows.measured_m is not None:
            scaled = self._scaled_range(k, range_m)
            total += 0.5 * scaled * scaled
            if self.range_blur is not None:
                total += self.range_blur[:, k, None]
        if impossible is not None:
            if lines.mirrors is not None:
                impossible |= lines.mirrors.row_beyond(k, *point)
            np.copyto(total, np.inf, where=impossible)
        return total

    def half_chi_squares(self, *point: FloatArray) -> FloatArray:
        """Return the sum of that (B, P) over the rows."""
        total = np.zeros_like(point[0])
        for k in range(self.rows.weight.shape[1]):
            total += self.half_chi_square(k, *point)
        return total

    def _squared_angle(
        self, squared_across: FloatArray, along: FloatArray, squared: FloatArray, range_m: FloatArray
    ) -> FloatArray:
        """Return the squared angle between ray and point, from sin^2(angle / 2) = across^2 / (2 (r^2 + r along))."""
        ahead = np.abs(along) if self.anywhere else along
        ahead = ahead * range_m
        ahead += squared
        half_sine = squared_across
        half_sine /= ahead
        half_sine *= 0.5
        angle: FloatArray = half_sine * _SQUARED_ANGLE.coef[-1]
        for coefficient in _SQUARED_ANGLE.coef[-2:0:-1]:
            angle += coefficient
            angle *= half_sine
        angle += _SQUARED_ANGLE.coef[0]
        angle *= half_sine
        if self.anywhere:
            behind = along < 0.0
            if behind.any():
                angle = np.where(behind, (np.pi - np.sqrt(angle)) ** 2, angle)
        return angle

    def _weight(self, k: int, squared: FloatArray, range_m: FloatArray) -> FloatArray:
        """Return 1 / (2 variance) of the bearing at points, the error across the ray being std times tube width."""
        weight = self.rows.weight[:, k, None]
        if self.rows.lines.focusing is not None:
            weight = weight * squared_tube_ratio(self.rows.lines.focusing, k, range_m)
        if self.spread_m == 0.0:
            return weight
        return np.asarray(weight / (1.0 + 2.0 * weight * self.spread_m**2 / squared))

    def _scaled_range(self, k: int, range_m: FloatArray) -> FloatArray:
        rows = self.rows
        assert rows.measured_m is not None  # noqa: S101 - asked for where rows have ranges
        assert rows.precision is not None  # noqa: S101
        measured, precision = rows.measured_m[:, k, None], rows.precision[:, k, None]
        if rows.lognormal:
            return np.asarray(np.log(measured / range_m) * precision)
        return np.asarray((measured - range_m) * precision)
