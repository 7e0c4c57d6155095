"""Covariances of fixes in a curved valley: where circles nearly touch, the information at the optimum is not enough.

Along the circle of the surest range the likelihood may be much wider, or narrower, than its second derivatives
predict: two circles that nearly touch agree along an arc whose width is the root of std times radius. There the second
moment of the likelihood about the fix replaces the inverse information: a quadrature along the arc, Gaussian across.
"""

from __future__ import annotations

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, ignoring_overflow
from nlosctl.geometry.angles import cosine_sine
from nlosctl.geometry.blocks import max_measurements, sum_measurements
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.ranges.circles import RangeCircles
from nlosctl.solvers.optimization.polar_coordinates import Pole

__all__ = ["valley_covariance"]

_STRAIGHT = 0.05
"""Arcs shorter than the root of this share of range times std are straight to a fraction of the std."""

_PROBE = 2.0
"""The likelihood is compared with its quadratic model at so many standard deviations to either side."""

_QUADRATIC = (0.8, 1.25)
"""It counts as quadratic if the cost there is within these factors of the model's."""

_NODES = 24
"""Nodes to either side, from a quarter of a standard deviation to half a circle, in about equal ratios."""

_NEWTON_STEPS = 1
_FALL = 1.0
"""Where the cost falls by more than this many nats again, another optimum's part of the arc begins."""

_POINTS = 8192
"""Number of points at once: temporaries stay in cache."""


def valley_covariance(
    circles: RangeCircles, pole: Pole, x: FloatArray, y: FloatArray, covariance: SymmetricMatrix
) -> SymmetricMatrix:
    """Return the covariances (B,) of optima x, y (B,), replaced where the likelihood is not quadratic along the arc.

    ``covariance`` (B,) is the inverse information; where that is singular it stays. ``pole`` is that of the surest
    range.
    """
    distance, _ = pole.polar(x, y)
    with ignoring_overflow():
        out_x, out_y = (x - pole.x) / distance, (y - pole.y) / distance
        variance = covariance.quadratic_form(-out_y, out_x)
        bends = (variance > _STRAIGHT * _least_bend(circles)) & np.isfinite(variance) & (distance > 0.0)
        rows = np.flatnonzero(bends)
        rows = rows[_is_curved(circles.take(rows), pole.take(rows), x[rows], y[rows], covariance.take(rows))]
    result = covariance.map(np.copy)
    section = max(1, _POINTS // (2 * _NODES + 1))
    for start in range(0, rows.size, section):
        part = rows[start : start + section]
        std = np.sqrt(variance[part])
        moment = _second_moment(circles.take(part), pole.take(part), x[part], y[part], std)
        with ignoring_overflow():
            sound = np.flatnonzero((moment.determinant > 0.0) & (moment.xx > 0.0) & np.isfinite(moment.trace))
        result.put(part[sound], moment.take(sound))
    return result


def _least_bend(circles: RangeCircles) -> FloatArray:
    """Return the least product (B,) of range and std of all rows except the surest: by so much circles bend away."""
    product = circles.range_m * circles.std_m
    product[np.arange(product.shape[0]), np.argmin(circles.std_m, axis=1)] = np.inf
    return -max_measurements(-product)


def _is_curved(
    circles: RangeCircles, pole: Pole, x: FloatArray, y: FloatArray, covariance: SymmetricMatrix
) -> BoolArray:
    """Return where the costs (B,) two standard deviations along the arc are not those of the quadratic model."""
    distance, arc = pole.polar(x, y)
    out_x, out_y = (x - pole.x) / distance, (y - pole.y) / distance
    variance = covariance.quadratic_form(-out_y, out_x)
    mixed = (covariance.yy - covariance.xx) * out_x * out_y + covariance.xy * (out_x * out_x - out_y * out_y)
    along = np.sqrt(variance)[:, None] * np.array([-_PROBE, _PROBE, 0.0])
    away = distance[:, None] + (mixed / variance)[:, None] * along
    cosine, sine = cosine_sine((arc / pole.radius_m)[:, None] + along / distance[:, None])
    cost = circles.half_chi_squares(pole.x[:, None] + away * cosine, pole.y[:, None] + away * sine)
    ratio = (cost[:, :2] - cost[:, 2:]) / (0.5 * _PROBE * _PROBE)
    quadratic = (ratio > _QUADRATIC[0]) & (ratio < _QUADRATIC[1])
    return ~(quadratic[:, 0] & quadratic[:, 1])


def _second_moment(circles: RangeCircles, pole: Pole, x: FloatArray, y: FloatArray, std: FloatArray) -> SymmetricMatrix:
    """Return the second moment (B,) of the likelihood about the optima x, y (B,) over their part of the arc."""
    distance, arc = pole.polar(x, y)
    least = 0.25 * np.minimum(std / distance, 1.0)
    growth = np.arcsinh(np.pi / least)
    step = np.arange(-_NODES, _NODES + 1) / _NODES
    angle = least[:, None] * np.sinh(growth[:, None] * step)
    spacing = np.cosh(growth[:, None] * step)
    cosine, sine = cosine_sine((arc / pole.radius_m)[:, None] + angle)
    every = circles.take(np.repeat(np.arange(x.shape[0]), step.size))
    away: FloatArray = np.repeat(distance, step.size)
    center_x, center_y = np.repeat(pole.x, step.size), np.repeat(pole.y, step.size)
    out_x, out_y = cosine.ravel(), sine.ravel()
    with ignoring_overflow():
        for _ in range(_NEWTON_STEPS + 1):
            cost, slope, curvature = _across(every, center_x + away * out_x, center_y + away * out_y, out_x, out_y)
            last = away
            away = np.maximum(away - slope / curvature, 0.1 * away)
        shape = angle.shape
        cost, away, spread = cost.reshape(shape), last.reshape(shape), (1.0 / curvature).reshape(shape)
        weight = np.exp(cost[:, _NODES, None] - cost) * np.sqrt(spread) * away * spacing
        weight = np.where(_own_part(cost) & np.isfinite(weight), weight, 0.0)
        dx, dy = pole.x[:, None] + away * cosine - x[:, None], pole.y[:, None] + away * sine - y[:, None]
        weight /= sum_measurements(weight)[:, None]
        return SymmetricMatrix(
            sum_measurements(weight * (dx * dx + spread * cosine * cosine)),
            sum_measurements(weight * (dx * dy + spread * cosine * sine)),
            sum_measurements(weight * (dy * dy + spread * sine * sine)),
        )


def _across(
    circles: RangeCircles, x: FloatArray, y: FloatArray, out_x: FloatArray, out_y: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return half the chi-square (N,) at points, and its first and (Gauss-Newton) second derivative along ``out``."""
    cost, slope, curvature = (np.zeros(x.shape) for _ in range(3))
    for k in range(circles.range_m.shape[1]):
        path, inverse_std = circles.path(k, x, y), 1.0 / circles.std_m[:, k]
        residual = (path.length_m - circles.range_m[:, k]) * inverse_std
        along = (path.along_x * out_x + path.along_y * out_y) * inverse_std
        cost += 0.5 * residual * residual
        slope += residual * along
        curvature += along * along
    return cost, slope, curvature


def _own_part(cost: FloatArray) -> BoolArray:
    """Return which nodes (B, N) are on the optimum's side of the barriers to other ones; the middle node is its own."""
    own = np.empty(cost.shape, dtype=bool)
    for side in (slice(_NODES, None), slice(_NODES, None, -1)):
        part = np.where(np.isnan(cost[:, side]), np.inf, cost[:, side])
        highest = np.maximum.accumulate(part, axis=1)
        own[:, side] = ~np.logical_or.accumulate(part < highest - _FALL, axis=1)
    return own
