"""Arrivals of one source, some of them late, as rows of a mixture of D + 1 unknowns: position and offset.

With z = (t - |x - a| - c) / s the excess of an arrival in standard deviations, Phi the normal distribution and h its
inverse Mills ratio, the density of a late row is, per standard deviation,

    uniform over L metres:             Phi(z) s / L
    over an unknown number of metres:  Phi(z) / ((z + h(z) + b) log(1 + L / (b s)))        b = 1

after the direct arrival, an edge that the noise blurs: no row is early. The second is the first averaged over its
length, alike for all magnitudes up to L; z + h(z) is the mean of a delay that is only known to be positive.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from math import pi, sqrt

import numpy as np
from scipy.special import erfcx

from nlosctl.arrays import FloatArray, IntArray, Point
from nlosctl.geometry.blocks import RowBlock
from nlosctl.geometry.regions import Ball
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.arrivals import ArrivalRows
from nlosctl.solvers.mixture.late_ranges import ExcessTerms, mills_ratio
from nlosctl.solvers.mixture.proposal import unit_vectors
from nlosctl.solvers.optimization.problem import RowDerivatives

__all__ = ["LateArrivals"]

_LEAST_DELAY = 1.0
"""Where the magnitude of the delays is unknown: b, in standard deviations."""

_SURELY_LATE = 8.0
"""From this excess on Phi is 1."""


@dataclass(frozen=True)
class LateArrivals(RowBlock):
    """Rows (B, K) of arrivals, Gaussian about distance plus offset if direct, later if not.

    Points are D coordinates about the local origin and the offset. As rows of a mixture they are compared with their
    own density as an outlier, in units of 1 / L: ``half_chi_square`` is the negative logarithm of the ratio of the two,
    apart from ``log_direct``. ``peak`` (B, K) is s L / (s log(1 + L / (b s))); None: uniform delays.
    """

    arrivals: ArrivalRows
    peak: FloatArray | None

    @classmethod
    def of(cls, arrivals: ArrivalRows, late_m: FloatArray, *, uniform: bool) -> LateArrivals:
        """Return the rows with delays up to ``late_m`` (B,); ``uniform`` or of unknown magnitude."""
        if uniform:
            return cls(arrivals, None)
        ratio = late_m[:, None] / arrivals.std_m
        return cls(arrivals, np.asfortranarray(ratio / np.log1p(ratio / _LEAST_DELAY)))

    @property
    def dimension(self) -> int:
        """The number of unknowns: the coordinates and the offset."""
        return len(self.arrivals.sensor) + 1

    def scalars(self) -> IntArray:
        """Return the number of scalars (B, K) of each row: one."""
        return np.ones(self.arrivals.std_m.shape, dtype=np.int64)

    def half_chi_square(self, k: int, *point: FloatArray) -> FloatArray:
        """Return the negative logarithm of the ratio of row ``k`` at points (B, P)."""
        return self._ratio(k, self._scaled(k, *point))

    def scores(self, *point: FloatArray) -> tuple[list[FloatArray], FloatArray]:
        """Return that of every row, and the negative logarithm (B, P) of the product of the densities of outliers."""
        ratios: list[FloatArray] = []
        total = np.zeros_like(point[0])
        for k in range(self.arrivals.std_m.shape[1]):
            scaled = self._scaled(k, *point)
            ratio = self._ratio(k, scaled)
            scaled *= scaled
            scaled *= 0.5
            total += scaled
            total -= ratio
            ratios.append(ratio)
        return ratios, total

    def derivatives(self, k: int, *point: FloatArray) -> RowDerivatives:
        """Return the same as ``half_chi_square`` at points (B,), and its derivatives, with those of the outlier."""
        rows, precision = self.arrivals, 1.0 / self.arrivals.std_m[:, k]
        away = [part - own[:, k] for part, own in zip(point, rows.sensor, strict=False)]
        squared = np.sum([part * part for part in away], axis=0)
        if rows.height is not None:
            squared += rows.height[:, k] ** 2
        distance = np.sqrt(squared)
        along = [part / distance for part in away]
        scaled = (rows.arrival_m[:, k] - distance - point[-1]) * precision
        mills, half = mills_ratio(scaled), 0.5 * scaled * scaled
        mean = scaled + mills
        least = bend = np.maximum(mills * mean, 0.0)  # minus the derivative of mills
        slope = -mills
        if self.peak is not None:
            inverse = 1.0 / (mean + _LEAST_DELAY)
            relative = (1.0 - bend) * inverse
            slope = relative - mills
            least = bend + np.maximum(slope, 0.0) ** 2
            bend = bend + (bend * (mean + mills) - mills) * inverse - relative * relative
        ratio = self._ratio(k, scaled)

        def terms(value: FloatArray, slope: FloatArray, bend: FloatArray, least: FloatArray) -> RowDerivatives:
            gain = precision * precision
            return _with_offset(ExcessTerms(value, slope * precision, bend * gain, least * gain), distance, along)

        outlier = terms(half - ratio, slope, bend, least)
        return dataclasses.replace(terms(ratio, scaled - slope, 1.0 - bend, 1.0 - least), outlier=outlier)

    def ridges(self, ball: Ball) -> FloatArray:
        """Return the density (B, K) of the points of `sample_ridge` where the row is exact."""
        volume = Ball(ball.center[:-1], ball.radius).volume
        return np.asarray(1.0 / (self.arrivals.std_m * sqrt(2.0 * pi) * volume[:, None]))

    def on_ridge(self, k: int, ratio: FloatArray, *point: FloatArray) -> FloatArray:
        """Return the density over that (B, P), that of a direct row."""
        scaled = self._scaled(k, *point)
        return np.exp(-0.5 * scaled * scaled)

    def sample_ridge(self, ball: Ball, snapshot: IntArray, k: IntArray, normal: Point, uniform: Point) -> Point:
        """Return points (N,) uniform over the ball's positions, with the offset of row ``k`` as its error has it."""
        at, rows = (snapshot, k), self.arrivals
        middle = [part[snapshot] for part in ball.center[:-1]]
        pole = tuple(own[at] - part for own, part in zip(rows.sensor, middle, strict=True))
        radius = ball.radius[snapshot] * uniform[1] ** (1.0 / len(middle))
        turned = unit_vectors(uniform[2:], pole)
        position = [part + radius * cosine for part, cosine in zip(middle, turned, strict=True)]
        squared = np.sum([(part - own[at]) ** 2 for part, own in zip(position, rows.sensor, strict=True)], axis=0)
        if rows.height is not None:
            squared = squared + rows.height[at] ** 2
        offset = rows.arrival_m[at] - np.sqrt(squared) - rows.std_m[at] * normal[0]
        return (*position, offset)

    def _scaled(self, k: int, *point: FloatArray) -> FloatArray:
        """Return the excess of row ``k`` over distance and offset of points (B, P), in standard deviations."""
        rows = self.arrivals
        squared = np.zeros_like(point[0])
        for part, own in zip(point, rows.sensor, strict=False):
            away = part - own[:, k, None]
            away *= away
            squared += away
        if rows.height is not None:
            squared += (rows.height[:, k] ** 2)[:, None]
        excess = np.sqrt(squared, out=squared)
        excess += point[-1]
        np.subtract(rows.arrival_m[:, k, None], excess, out=excess)
        excess *= (1.0 / rows.std_m[:, k])[:, None]
        return excess

    def _ratio(self, k: int, scaled: FloatArray) -> FloatArray:
        """Return z^2 / 2 + log Phi(z), less log(z + h(z) + b) unless ``uniform``; erfcx(-z / sqrt 2) has both."""
        limited = np.minimum(scaled, _SURELY_LATE)
        scaled_tail = erfcx(limited * -sqrt(0.5))
        ratio = 0.5 * scaled_tail
        if self.peak is not None:
            mean = sqrt(2.0 / pi) / scaled_tail
            mean += scaled
            mean += _LEAST_DELAY
            ratio /= mean
            ratio *= self.peak[:, k] if scaled.ndim == 1 else self.peak[:, k, None]
        np.log(ratio, out=ratio)
        late = 0.5 * (scaled * scaled - limited * limited)
        ratio += late
        return ratio


def _with_offset(terms: ExcessTerms, distance: FloatArray, along: list[FloatArray]) -> RowDerivatives:
    """Return derivatives by position and offset; the excess falls by one metre per metre of the offset."""
    at = terms.by_position(distance, *along)
    return RowDerivatives(
        at.half_chi_square,
        (*at.gradient, -terms.slope),
        SymmetricMatrix(*at.gauss, *(terms.least_bend * part for part in along), terms.least_bend),
        SymmetricMatrix(*at.hessian, *(terms.bend * part for part in along), terms.bend),
    )
