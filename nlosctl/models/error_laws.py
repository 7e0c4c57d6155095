"""Distributions of measurement errors, and the exceedance probability of a weighted sum of three errors.

A decision variable is linear in the errors of DOA, DOD and path length (equation (19) of Shen, Molisch 2012): three
independent errors of one law, each with standard deviation 1, weighted by w1, w2, w3 (metres). Its distribution is
the convolution (20)-(23). Each law evaluates it by a quadrature of its choice, for all rows at once, with an error
below 1e-6.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.special import gammaln, kve, ndtr, ndtri

from nlosctl.arrays import FloatArray, IntArray, ignoring_division, ignoring_invalid
from nlosctl.errors import UsageError

__all__ = [
    "ErrorLaw",
    "GaussianErrors",
    "LaplaceErrors",
    "StudentErrors",
    "UniformErrors",
    "exceedance",
    "parse_error_law",
    "quantile",
]

Weights = tuple[FloatArray | float, FloatArray | float, FloatArray | float]


class ErrorLaw(Protocol):
    """A symmetric error distribution with standard deviation 1."""

    def draw(self, generator: np.random.Generator, count: int) -> FloatArray:
        """Return ``count`` errors."""
        ...

    def survival(self, scaled: FloatArray, weights: Weights) -> FloatArray:
        """Return P(w1 e1 + w2 e2 + w3 e3 > scaled * sqrt(w1^2 + w2^2 + w3^2)), elementwise; NaN in, NaN out."""
        ...


@dataclass(frozen=True)
class GaussianErrors:
    """Normal errors: their sum is normal, equation (24)."""

    def draw(self, generator: np.random.Generator, count: int) -> FloatArray:
        """Return ``count`` errors."""
        return generator.standard_normal(count)

    def survival(self, scaled: FloatArray, weights: Weights) -> FloatArray:
        """Return the normal survival function, for any weights; equation (26)."""
        return np.asarray(ndtr(-scaled))


@dataclass(frozen=True)
class UniformErrors:
    """Errors uniform between -sqrt(3) and sqrt(3)."""

    def draw(self, generator: np.random.Generator, count: int) -> FloatArray:
        """Return ``count`` errors."""
        return generator.uniform(-math.sqrt(3.0), math.sqrt(3.0), count)

    def survival(self, scaled: FloatArray, weights: Weights) -> FloatArray:
        """Return the integral of the density of the sum of three uniform errors, a box spline.

        The averages over the two smaller half-widths are in a form that stays accurate when these vanish.
        """
        large, middle, small = (math.sqrt(3.0) * weight for weight in _unit_weights(weights))

        def averaged(z: FloatArray) -> FloatArray:
            """Return the mean of max(z + small e, 0)^2 / 2 over uniform e in [-1, 1]."""
            inside = (z + small) ** 3 / np.where(small > 0.0, 12.0 * small, 1.0)
            outside = np.where(z > 0.0, 0.5 * z * z + small * small / 6.0, 0.0)
            return np.where(np.abs(z) < small, inside, outside)

        def averaged_slope(z: FloatArray) -> FloatArray:
            """Return the derivative of ``averaged``."""
            inside = (z + small) ** 2 / np.where(small > 0.0, 4.0 * small, 1.0)
            return np.where(np.abs(z) < small, inside, np.maximum(z, 0.0))

        def over_middle(z: FloatArray) -> FloatArray:
            """Return the mean of the slope over the middle half-width: a difference quotient, or its limit."""
            wide = middle > 1e-8
            width = np.where(wide, middle, 1.0)
            quotient = (averaged(z + width) - averaged(z - width)) / (2.0 * width)
            return np.where(wide, quotient, averaged_slope(z))

        below = (over_middle(large - scaled) - over_middle(-large - scaled)) / (2.0 * large)
        return np.where(np.isnan(scaled + large), np.nan, np.clip(below, 0.0, 1.0))


@dataclass(frozen=True)
class LaplaceErrors:
    """Errors with a Laplace (two-sided exponential) distribution."""

    def draw(self, generator: np.random.Generator, count: int) -> FloatArray:
        """Return ``count`` errors."""
        return generator.laplace(0.0, math.sqrt(0.5), count)

    def survival(self, scaled: FloatArray, weights: Weights) -> FloatArray:
        """Return the survival as a divided difference, by quadrature over a simplex (Hermite-Genocchi).

        With s the squared scale parameter of each error, P(|sum| > z) is the second divided difference of
        s^2 exp(-z / sqrt s) over the three s. Partial fractions would lose all digits where two are nearly equal.
        """
        return _by_rows(self._integrate, scaled, weights)

    def _integrate(self, scaled: FloatArray, weights: list[FloatArray]) -> FloatArray:
        s1, s2, s3 = (0.5 * weight[:, None] ** 2 for weight in weights)
        share2, share3, quadrature = _SIMPLEX
        q = np.abs(scaled)[:, None] / np.sqrt(s1 + share2 * (s2 - s1) + share3 * (s3 - s1))
        total = np.sum(quadrature * (2.0 + 1.25 * q + 0.25 * q * q) * np.exp(-q), axis=1)
        tail = 0.5 * np.minimum(total, 1.0)
        return np.where(scaled >= 0.0, tail, np.where(np.isnan(scaled), np.nan, 1.0 - tail))


@dataclass(frozen=True)
class StudentErrors:
    """Errors with Student's t distribution, ``degrees_of_freedom`` > 2, scaled to standard deviation 1."""

    degrees_of_freedom: float

    def draw(self, generator: np.random.Generator, count: int) -> FloatArray:
        """Return ``count`` errors."""
        nu = self.degrees_of_freedom
        return generator.standard_t(nu, count) * math.sqrt((nu - 2.0) / nu)

    def survival(self, scaled: FloatArray, weights: Weights) -> FloatArray:
        """Return the survival from the product of characteristic functions (Gil-Pelaez), by the trapezoidal rule.

        The step makes the distribution periodic; the period is long enough that the tails of its copies are negligible.
        """
        return _by_rows(self._invert, scaled, weights)

    def _invert(self, scaled: FloatArray, weights: list[FloatArray]) -> FloatArray:
        t, step, characteristic = _student_characteristic(self.degrees_of_freedom)
        product = np.sin(np.where(np.isnan(scaled), 0.0, scaled)[:, None] * t) / t
        for weight in weights:
            product *= characteristic(np.where(np.isnan(weight), 0.0, weight)[:, None] * t)
        with ignoring_invalid():
            survival = 0.5 - (0.5 * scaled + np.sum(product, axis=1)) * step / math.pi
        unknown = np.isnan(scaled) | np.isnan(weights[0])
        return np.where(unknown, np.nan, np.clip(survival, 0.0, 1.0))


@lru_cache(maxsize=8)
def _student_characteristic(nu: float) -> tuple[FloatArray, float, CubicSpline]:
    """Return the nodes t, their step, and the characteristic function of Student's t with std 1."""
    step = 2.0 * math.pi / min(max(2.0 * 10.0 ** (8.0 / nu), 60.0), 400.0)
    t = np.arange(1, math.ceil(max(9.0, 36.0 / math.sqrt(nu - 2.0)) / step) + 1) * step
    knots = np.linspace(0.0, float(t[-1]), 6001)
    x = math.sqrt(nu - 2.0) * knots[1:]
    log_value = np.log(kve(0.5 * nu, x)) - x + 0.5 * nu * np.log(x)
    log_value -= gammaln(0.5 * nu) + (0.5 * nu - 1.0) * math.log(2.0)
    return t, step, CubicSpline(knots, np.concatenate([[1.0], np.exp(log_value)]))


def _by_rows(
    survival: Callable[[FloatArray, list[FloatArray]], FloatArray], scaled: FloatArray, weights: Weights
) -> FloatArray:
    """Return ``survival`` of flat rows with unit weights, in blocks: each row needs all nodes of the quadrature."""
    arrays = np.broadcast_arrays(np.asarray(scaled, dtype=np.float64), *_unit_weights(weights))
    flat = [array.ravel() for array in arrays]
    result = np.empty(flat[0].shape)
    for first in range(0, result.size, _ROWS):
        rows = slice(first, first + _ROWS)
        result[rows] = survival(flat[0][rows], [weight[rows] for weight in flat[1:]])
    return result.reshape(arrays[0].shape)


def parse_error_law(text: str) -> ErrorLaw:
    """Return the law that ``gaussian``, ``uniform``, ``laplace`` or ``student-t:NU`` names; else raise UsageError."""
    if text in _PLAIN:
        return _PLAIN[text]
    name, _, parameter = text.partition(":")
    if name == "student-t":
        try:
            degrees_of_freedom = float(parameter)
        except ValueError:
            degrees_of_freedom = math.nan
        if 2.0 < degrees_of_freedom < math.inf:
            return StudentErrors(degrees_of_freedom)
        raise UsageError(
            "The 'noise' parameter 'student-t:NU' needs degrees of freedom NU over 2 (below, errors have no standard "
            f"deviation). Got {text!r} instead."
        )
    raise UsageError(
        f"The 'noise' parameter must be one of gaussian, uniform, laplace, student-t:NU. Got {text!r} instead."
    )


def quantile(law: ErrorLaw, probability: float, weights: Weights, shift: FloatArray | float = 0.0) -> FloatArray:
    """Return the threshold, in standard deviations, that |shift + sum| exceeds with ``probability``; elementwise.

    ``shift`` >= 0 is the mean in standard deviations: 0 for direct paths, equations (25), (27). Computed by the
    Illinois variant of false position to 1e-12 in probability; converged rows do not change.
    """
    arrays = np.broadcast_arrays(*(np.asarray(value, dtype=np.float64) for value in (shift, *weights)))
    if isinstance(law, GaussianErrors) and not np.any(arrays[0]):
        return np.where(np.isnan(arrays[1]), np.nan, -float(ndtri(0.5 * probability)))
    flat = [array.ravel() for array in arrays]
    result = np.full(flat[0].shape, np.nan)
    rows = np.flatnonzero(~np.isnan(flat[0] + flat[1] + flat[2] + flat[3]))
    result[rows] = _find_threshold(law, probability, *(array[rows] for array in flat))
    return result.reshape(arrays[0].shape)


def _find_threshold(
    law: ErrorLaw, probability: float, shift: FloatArray, w1: FloatArray, w2: FloatArray, w3: FloatArray
) -> FloatArray:
    def excess(z: FloatArray, rows: IntArray) -> FloatArray:
        return exceedance(law, z, (w1[rows], w2[rows], w3[rows]), shift[rows]) - probability

    rows = np.arange(shift.shape[0])
    low, high = np.zeros(shift.shape), 2.0 + shift
    over, under = np.full(shift.shape, 1.0 - probability), excess(high, rows)
    for _ in range(40):
        short = np.flatnonzero(under > 0.0)
        if not short.size:
            break
        low[short], over[short] = high[short], under[short]
        high[short] *= 2.0
        under[short] = excess(high[short], short)
    rows = np.arange(shift.shape[0])
    for _ in range(100):
        share = over[rows] / (over[rows] - under[rows])
        guess = low[rows] + (high - low)[rows] * np.clip(share, 1e-12, 1.0 - 1e-12)
        value = excess(guess, rows)
        above = value > 0.0
        up, down = rows[above], rows[~above]
        low[up], over[up] = guess[above], value[above]
        under[up] *= 0.5
        high[down], under[down] = guess[~above], value[~above]
        over[down] *= 0.5
        done = np.abs(value) <= 1e-12
        low[rows[done]] = high[rows[done]] = guess[done]
        rows = rows[high[rows] - low[rows] > 1e-12 * high[rows]]
        if not rows.size:
            break
    return 0.5 * (low + high)


def exceedance(law: ErrorLaw, scaled: FloatArray, weights: Weights, shift: FloatArray | float = 0.0) -> FloatArray:
    """Return P(|shift + sum| > scaled), all in standard deviations of the sum, elementwise; scaled >= 0."""
    if np.ndim(shift) == 0 and shift == 0.0:
        return 2.0 * law.survival(scaled, weights)
    return law.survival(scaled - shift, weights) + law.survival(scaled + shift, weights)


def _unit_weights(weights: Weights) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return |w| / sqrt(w1^2 + w2^2 + w3^2), the largest first."""
    w1, w2, w3 = (np.abs(np.asarray(weight, dtype=np.float64)) for weight in weights)
    largest = np.maximum(np.maximum(w1, w2), w3)
    smallest = np.minimum(np.minimum(w1, w2), w3)
    middle = np.maximum(np.minimum(w1, w2), np.minimum(np.maximum(w1, w2), w3))
    with ignoring_division():
        middle, smallest = middle / largest, smallest / largest
        scale = 1.0 / np.sqrt(1.0 + middle * middle + smallest * smallest)
    return scale, middle * scale, smallest * scale


def _simplex_rule(nodes_u: int, nodes_v: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the shares of corners 2 and 3, and the weights, of a quadrature rule over a triangle of area 1/2.

    A Gauss-Legendre rule whose nodes concentrate at the corner of the smallest weights, where the integrand may drop
    abruptly.
    """
    point_u, weight_u = np.polynomial.legendre.leggauss(nodes_u)
    point_v, weight_v = np.polynomial.legendre.leggauss(nodes_v)
    t, r = 0.5 * (point_u + 1.0), 0.5 * (point_v + 1.0)
    u, wu = 1.0 - t**4, 2.0 * weight_u * t**3
    v, wv = r**2, weight_v * r
    return (np.outer(u, v).ravel(), np.outer(u, 1.0 - v).ravel(), np.outer(wu * u, wv).ravel())


_SIMPLEX = _simplex_rule(32, 16)
_ROWS = 256
_PLAIN: dict[str, ErrorLaw] = {"gaussian": GaussianErrors(), "uniform": UniformErrors(), "laplace": LaplaceErrors()}
