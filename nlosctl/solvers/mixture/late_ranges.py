"""Ranges whose outliers are late: most read the distance plus a positive bias plus the Gaussian error.

A law of three parts: a row is direct, late, or a stray, which reads anything: real ranges are too short as well.

With z the excess of a range over the distance in standard deviations, Phi the normal distribution and h its inverse
Mills ratio phi / Phi, the density of a late row is, per standard deviation,

    exponential bias of mean m:    r exp(-r z + r^2 / 2) Phi(z - r),    r = std / m
    bias of unknown size b:        Phi(z) / ((z + h(z) + c) log(1 + S / c))

The first is the exponentially modified Gaussian. The second falls as 1 / (b + c), alike for all magnitudes of the bias;
z + h(z) is the mean of a bias that is only known to be positive. To a quarter it is the convolution of that law with
the Gaussian.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from math import log, log1p, pi, sqrt
from typing import NamedTuple

import numpy as np
from scipy.special import erfcx, log_ndtr

from nlosctl.arrays import FloatArray, IntArray, Point
from nlosctl.geometry.blocks import RowBlock
from nlosctl.geometry.regions import Ball
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.ranges.spheres import RangeRows
from nlosctl.solvers.optimization.problem import RowDerivatives
from nlosctl.solvers.ranges.rings import ring_density, sample_ring

__all__ = ["ExcessTerms", "LateRanges", "mills_ratio"]

_LEAST_BIAS = 0.5
_LARGEST_BIAS = 25.0
"""Where the magnitude of the bias is unknown: c and S, in standard deviations. With these the probabilities are about
equally good for mean biases of 3 and 20 standard deviations. Larger biases have the same density as if S were larger,
up to a factor."""

_STRAY_SHARE = 0.05
"""The share of outliers that read anything."""

_LOG_LATE = 0.5 * log(2.0 * pi) + log(1.0 - _STRAY_SHARE)
_LOG_UNKNOWN = _LOG_LATE - log(log1p(_LARGEST_BIAS / _LEAST_BIAS))


class ExcessTerms(NamedTuple):
    """A function (B,) of the excess of a range, its first two derivatives, and a scale for steps that is positive.

    The last is that part of the second derivative that is never negative, plus the squared slope of late ranges.
    """

    value: FloatArray
    slope: FloatArray
    bend: FloatArray
    least_bend: FloatArray

    def by_position(self, radius_m: FloatArray, *along: FloatArray) -> RowDerivatives:
        """Return the derivatives by the position; u = ``along`` is the gradient of the distance.

        (I - u u') / radius are its second derivatives.
        """
        around = -self.slope / radius_m
        hessian = SymmetricMatrix.outer(*along, weight=self.bend - around).add_to_diagonal(around)
        gradient = tuple(-self.slope * part for part in along)
        return RowDerivatives(self.value, gradient, SymmetricMatrix.outer(*along, weight=self.least_bend), hessian)


@dataclass(frozen=True)
class LateRanges(RowBlock):
    """Rows (B, K) of ranges: Gaussian about the distance if direct, late or stray if not.

    ``mean_m`` is that of the bias, None if unknown; ``stray`` (B, K) the density of a stray, times its share of the
    outliers, std and sqrt(2 pi).

    As rows of a mixture they are compared with their own density as an outlier, which is in units of that of a stray:
    ``half_chi_square`` is the negative logarithm of the ratio of the two, apart from ``log_direct``.
    """

    circles: RangeRows
    mean_m: float | None
    stray: FloatArray

    @classmethod
    def of(cls, circles: RangeRows, mean_m: float | None, log_density: FloatArray) -> LateRanges:
        """Return the rows, with the logarithm of a stray's density per metre (B,)."""
        share = _STRAY_SHARE * np.exp(log_density)[:, None]
        return cls(circles, mean_m, np.asfortranarray(share * circles.std_m * sqrt(2.0 * pi)))

    def half_chi_square(self, k: int, *point: FloatArray) -> FloatArray:
        """Return the negative logarithm of the ratio of row ``k`` at points (B, P)."""
        scaled = self._scaled(k, *point)
        return 0.5 * scaled * scaled + self._log_outlier(k, scaled)

    @property
    def dimension(self) -> int:
        """The number of coordinates of a point."""
        return len(self.circles.sensor)

    def scalars(self) -> IntArray:
        """Return the number of scalars (B, K) of each row: one."""
        return np.ones(self.circles.std_m.shape, dtype=np.int64)

    def ridges(self, ball: Ball) -> FloatArray:
        """Return the density (B, K) on the circle of the points of `sample_ridge`."""
        return ring_density(self.circles)

    def on_ridge(self, k: int, ratio: FloatArray, *point: FloatArray) -> FloatArray:
        """Return the density over that (B, P), that of a direct row."""
        scaled = self._scaled(k, *point)
        return np.exp(-0.5 * scaled * scaled)

    def sample_ridge(self, ball: Ball, snapshot: IntArray, k: IntArray, normal: Point, uniform: Point) -> Point:
        """Return points (N,) about the circle of row ``k`` of a snapshot, as the range's error is distributed."""
        return sample_ring(self.circles, ball, snapshot, k, normal, uniform)

    def scores(self, *point: FloatArray) -> tuple[list[FloatArray], FloatArray]:
        """Return that of every row, and the negative logarithm (B, P) of the product of the densities of outliers."""
        ratios: list[FloatArray] = []
        total = np.zeros_like(point[0])
        for k in range(self.circles.std_m.shape[1]):
            ratio = self._scaled(k, *point)
            outlier = self._log_outlier(k, ratio)
            total -= outlier
            ratio *= ratio
            ratio *= 0.5
            ratio += outlier
            ratios.append(ratio)
        return ratios, total

    def derivatives(self, k: int, *point: FloatArray) -> RowDerivatives:
        """Return the same as ``half_chi_square`` at points (B,), and its derivatives, with those of the outlier."""
        circles, precision = self.circles, 1.0 / self.circles.std_m[:, k]
        path = circles.path(k, *point)
        radius, along = path.radius_m, path.along
        scaled = (circles.range_m[:, k] - path.length_m) * precision
        value, slope, bend, least_bend = self._outlier(k, scaled)
        squared = precision * precision
        outlier = ExcessTerms(value, slope * precision, bend * squared, least_bend * squared)
        ratio = ExcessTerms(
            0.5 * scaled * scaled - value,
            (scaled - slope) * precision,
            (1.0 - bend) * squared,
            (1.0 - least_bend) * squared,
        )
        return dataclasses.replace(ratio.by_position(radius, *along), outlier=outlier.by_position(radius, *along))

    def late_bias(self, k: int, *point: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return which share of row ``k`` as an outlier is late at points (B, P), and the mean of its bias in metres.

        Where the mean of all biases is unknown, the bias is only known to be positive.
        """
        scaled, std = self._scaled(k, *point), self.circles.std_m[:, k, None]
        share: FloatArray = -np.expm1(-self._log_outlier(k, scaled))
        if self.mean_m is not None:
            scaled -= std / self.mean_m
        return share, std * np.maximum(scaled + mills_ratio(scaled), 0.0)

    def _scaled(self, k: int, *point: FloatArray) -> FloatArray:
        """Return the excess of row ``k`` over the distance of points (B, P), in standard deviations."""
        circles = self.circles
        return (circles.range_m[:, k, None] - circles.length_m(k, *point)) / circles.std_m[:, k, None]

    def _log_outlier(self, k: int, scaled: FloatArray) -> FloatArray:
        """Return the logarithm (B, P) of the density of row ``k`` as an outlier, in units of a stray's."""
        if self.mean_m is None:
            late = log_ndtr(scaled) + _LOG_UNKNOWN - np.log(scaled + mills_ratio(scaled) + _LEAST_BIAS)
        else:
            ratio = self.circles.std_m[:, k, None] / self.mean_m
            late = log_ndtr(scaled - ratio) + np.log(ratio) + _LOG_LATE - ratio * (scaled - 0.5 * ratio)
        np.exp(late, out=late)
        late /= self.stray[:, k, None]
        logarithm: FloatArray = np.log1p(late, out=late)
        return logarithm

    def _outlier(self, k: int, scaled: FloatArray) -> ExcessTerms:
        """Return the negative logarithm (B,) of that density, and its derivatives by ``scaled``."""
        late = self._late(k, scaled)
        density = np.exp(-late.value)
        share = density / (density + self.stray[:, k])
        slope = share * late.slope
        bend = share * (late.bend - late.slope * late.slope) + slope * slope
        return ExcessTerms(-np.log1p(density / self.stray[:, k]), slope, bend, share * late.least_bend)

    def _late(self, k: int, scaled: FloatArray) -> ExcessTerms:
        """Return the same for the density of a late row, times std sqrt(2 pi)."""
        ratio = np.zeros_like(scaled) if self.mean_m is None else self.circles.std_m[:, k] / self.mean_m
        shifted = scaled - ratio
        log_below, mills = log_ndtr(shifted), mills_ratio(shifted)
        mean = shifted + mills
        bend = np.maximum(mills * mean, 0.0)  # minus the derivative of mills
        if self.mean_m is not None:
            value, slope = ratio * (scaled - 0.5 * ratio) - log_below - np.log(ratio) - _LOG_LATE, ratio - mills
            exact = bend
        else:
            inverse = 1.0 / (mean + _LEAST_BIAS)
            relative = (1.0 - bend) * inverse
            value, slope = np.log(mean + _LEAST_BIAS) - log_below - _LOG_UNKNOWN, relative - mills
            exact = bend + (bend * (mean + mills) - mills) * inverse - relative * relative
        return ExcessTerms(value, slope, exact, bend + np.maximum(slope, 0.0) ** 2)


def mills_ratio(scaled: FloatArray) -> FloatArray:
    """Return the inverse Mills ratio phi / Phi."""
    mills: FloatArray = sqrt(2.0 / pi) / erfcx(-sqrt(0.5) * scaled)
    return mills
