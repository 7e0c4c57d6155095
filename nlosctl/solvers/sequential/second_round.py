"""A second round through the rows, which relinearizes about the estimate of the first one.

The polar updates linearize each row about the estimate that it receives, which is far from the last one for early
rows. In the second round each row adds its information about the estimate of the first, in the information form of
the same filter: J = sum g g^T / s^2 and J (X - X_1) = sum g r / s^2, with g the gradient of a bearing or a range, r
its residual and s its standard deviation. That is one step of Gauss and Newton towards maximum likelihood.
"""

from __future__ import annotations

import numpy as np

from nlosctl.arrays import FloatArray, IntArray, ignoring_overflow
from nlosctl.geometry.blocks import sum_measurements
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.solvers.bearings.fix_status import nearly_singular
from nlosctl.solvers.bearings.line_fits import inflate_near_sensors
from nlosctl.solvers.bearings.row_terms import tube_width_m
from nlosctl.solvers.sequential.orders import RangedLines
from nlosctl.solvers.sequential.polar_updates import SourceState

__all__ = ["second_round"]


def second_round(ranged: RangedLines, states: list[SourceState], order: IntArray) -> list[SourceState]:
    """Return the states (B, 1) after the rows of ``order`` (B, K) in a second round about the last of ``states``.

    As many as ``states``: those after all K rows, or the last one alone. A state is not alive while the rows so far
    do not determine a position. The last one has the covariance at its own position, inflated near a sensor
    (`inflate_near_sensors`). Snapshots whose misfit the second round increases keep the states of the first.
    """
    first = states[-1]
    x, y = first.x[:, 0], first.y[:, 0]
    information, slope_x, slope_y = _terms(ranged, x, y)
    start, pull_x, pull_y = _prior_terms(ranged, x, y)

    def add_in_order(terms: FloatArray, initial: FloatArray) -> FloatArray:
        ordered = np.take_along_axis(terms, order, axis=1)
        ordered[:, 0] += initial
        return np.add.accumulate(ordered, axis=1)

    matrix = SymmetricMatrix(*map(add_in_order, information.parts, start.parts))
    with ignoring_overflow():
        shift_x, shift_y = matrix.solve(add_in_order(slope_x, pull_x), add_in_order(slope_y, pull_y))
        alive = first.alive & ~nearly_singular(matrix)
        again = SourceState(first.x + shift_x, first.y + shift_y, matrix.inverse(), alive)
        fits = ranged.misfit(again.x[:, -1:], again.y[:, -1:]) <= ranged.misfit(first.x, first.y)
    better = fits & alive[:, -1:]
    rows = range(order.shape[1])[-len(states) :]
    result = [_column(again, k).where(better, state) for k, state in zip(rows, states, strict=True)]
    result[-1] = _with_covariance(ranged, result[-1])
    return result


def _column(states: SourceState, k: int) -> SourceState:
    """Return column ``k`` (B, 1) of states (B, K)."""
    index = (slice(None), slice(k, k + 1))
    return SourceState(states.x[index], states.y[index], states.covariance.at(*index), states.alive[index])


def _with_covariance(ranged: RangedLines, state: SourceState) -> SourceState:
    """Return the states (B, 1) with the inverse information at their positions as covariance."""
    x, y = state.x[:, 0], state.y[:, 0]

    def inflated(rows: IntArray, extra_m2: FloatArray) -> SymmetricMatrix:
        return _information(ranged.take(rows), x[rows], y[rows], extra_m2).inverse()

    nearest_m = ranged.lines.ray_residuals(x, y).nearest_m
    covariance = inflate_near_sensors(_information(ranged, x, y).inverse(), nearest_m, inflated)
    return SourceState(state.x, state.y, covariance.at(slice(None), None), state.alive)


def _information(
    ranged: RangedLines, x: FloatArray, y: FloatArray, extra_m2: FloatArray | None = None
) -> SymmetricMatrix:
    """Return the information (B,) of all rows and of the prior at points (B,)."""
    terms = _terms(ranged, x, y, extra_m2)[0].map(sum_measurements)
    return terms if ranged.prior is None else terms + ranged.prior.information()


def _terms(
    ranged: RangedLines, x: FloatArray, y: FloatArray, extra_m2: FloatArray | None = None
) -> tuple[SymmetricMatrix, FloatArray, FloatArray]:
    """Return g g^T / s^2 and g r / s^2 (B, K) of each row at points (B,) about the local origin.

    The width of a ray tube that a circle focuses replaces the range of a bearing's error; ``extra_m2`` (B,) is added
    to the squared widths.
    """
    lines = ranged.lines
    with ignoring_overflow():
        dx, dy = x[:, None] - lines.origin_x, y[:, None] - lines.origin_y
        range_m = np.sqrt(dx * dx + dy * dy)
        along_x, along_y = dx / range_m, dy / range_m
        residual = np.arctan2(lines.sine * dx - lines.cosine * dy, lines.cosine * dx + lines.sine * dy)
        width_m = range_m
        if lines.focusing is not None:
            width_m = tube_width_m(range_m, lines.focusing.first_leg_m, lines.focusing.strength)
        squared_m2 = width_m * width_m
        if extra_m2 is not None:
            squared_m2 += extra_m2[:, None]
        weight = 1.0 / (lines.std_rad * lines.std_rad * squared_m2)
        information = SymmetricMatrix.outer(-along_y, along_x, weight=weight)
        scaled = weight * range_m * residual
        slope_x, slope_y = -along_y * scaled, along_x * scaled
        if ranged.measured_m is None or ranged.range_std_m is None:
            return information, slope_x, slope_y
        difference, std_m = ranged.measured_m - range_m, ranged.range_std_m
        if ranged.lognormal:
            difference = range_m * np.log(ranged.measured_m / range_m)
            std_m = std_m * range_m / ranged.measured_m
        known = np.isfinite(ranged.measured_m)
        weight = np.where(known, 1.0 / (std_m * std_m), 0.0)
        scaled = np.where(known, weight * difference, 0.0)
        information += SymmetricMatrix.outer(along_x, along_y, weight=weight)
        return information, slope_x + along_x * scaled, slope_y + along_y * scaled


def _prior_terms(ranged: RangedLines, x: FloatArray, y: FloatArray) -> tuple[SymmetricMatrix, FloatArray, FloatArray]:
    """Return P^-1 and P^-1 (X_0 - X) (B,) of the prior, zero without one."""
    nothing = np.zeros(x.shape)
    if ranged.prior is None:
        return SymmetricMatrix(nothing, nothing, nothing), nothing, nothing
    inverse, known = ranged.prior.information(), ranged.prior.known
    dx, dy = np.where(known, ranged.prior.x - x, 0.0), np.where(known, ranged.prior.y - y, 0.0)
    return inverse, inverse.xx * dx + inverse.xy * dy, inverse.xy * dx + inverse.yy * dy
