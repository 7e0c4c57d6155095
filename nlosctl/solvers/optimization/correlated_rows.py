"""Least squares where rows have errors in common: offsets that are not exactly known, for example.

Over the stds of the rows the covariance of the residuals is R = I + H H', H (K, M) the shared errors of standard normal
causes. With M = I + H'H the inverse is R^-1 = I - H M^-1 H', so that the normal equations A'R^-1 A and A'R^-1 r need
sums over the rows alone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, ignoring_division
from nlosctl.geometry.blocks import sum_measurements
from nlosctl.models.scaled_residuals import ScaledResiduals

__all__ = ["correlated_equations", "refine_positions", "rescaled_covariance", "sandwich_of_weights"]

Model = Callable[[FloatArray], Sequence[ScaledResiduals]]
"""The scalars of rows at positions (B, D)."""

_MOST_STEPS = 30
_SETTLED = 1e-10
"""A step whose square over the covariance is less than this is the last."""


def correlated_equations(
    scalars: Sequence[ScaledResiduals], shared: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return A'R^-1 A (B, D, D), A'R^-1 r (B, D) and r'R^-1 r (B,), with the shared errors (B, K, M) of offsets."""
    own = next(scalar for scalar in scalars if scalar.per_offset is not None)
    assert own.per_offset is not None  # noqa: S101 - chosen so
    errors = own.per_offset[:, :, None] * shared
    inner = np.linalg.inv(np.eye(shared.shape[2]) + _over_rows(errors[:, :, :, None] * errors[:, :, None, :]))
    columns = [*own.slopes, own.residual]
    across = [_over_rows(errors * column[:, :, None]) for column in columns]
    back = [sum_measurements(inner * part[:, None, :]) for part in across]
    size = len(columns)
    product = np.empty((shared.shape[0], size, size))
    for i in range(size):
        for j in range(i + 1):
            direct = [sum_measurements(_column(scalar, i) * _column(scalar, j)) for scalar in scalars]
            product[:, i, j] = sum(direct[1:], direct[0]) - sum_measurements(across[i] * back[j])
            product[:, j, i] = product[:, i, j]
    return product[:, :-1, :-1], product[:, :-1, -1], product[:, -1, -1]


def _column(scalar: ScaledResiduals, index: int) -> FloatArray:
    return scalar.slopes[index] if index < len(scalar.slopes) else scalar.residual


def _over_rows(values: FloatArray) -> FloatArray:
    """Return the sum (B, ...) over the rows of values (B, K, ...), one after the other."""
    total = np.zeros((values.shape[0], *values.shape[2:]))
    for k in range(values.shape[1]):
        total += values[:, k]
    return total


def refine_positions(model: Model, position_m: FloatArray, shared: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the positions (B, D) with A'R^-1 r = 0 next to given ones, and r'R^-1 r (B,) there.

    Gauss-Newton steps, halved where they do not lower r'R^-1 r. A position whose equations are singular stays.
    """
    point = position_m.copy()
    information, gradient, cost = correlated_equations(model(point), shared)
    step = _steps(information, gradient)
    length = np.ones(point.shape[0])
    for _ in range(_MOST_STEPS):
        small = sum_measurements(sum_measurements(information * step[:, None, :]) * step) * length * length < _SETTLED
        if small.all():
            break
        trial = point + np.where(small, 0.0, length)[:, None] * step
        there = correlated_equations(model(trial), shared)
        better = ~small & (there[2] <= cost)
        point = np.where(better[:, None], trial, point)
        information = np.where(better[:, None, None], there[0], information)
        gradient = np.where(better[:, None], there[1], gradient)
        cost = np.where(better, there[2], cost)
        length = np.where(better, 1.0, 0.5 * length)
        step = _steps(information, gradient)
    return point, cost


def _steps(information: FloatArray, gradient: FloatArray) -> FloatArray:
    """Return the Gauss-Newton steps (B, D), zero where the information is singular."""
    inverse = inverse_or_nan(information)
    with ignoring_division():
        step = -sum_measurements(inverse * gradient[:, None, :])
    finite = np.asarray(np.isfinite(step).all(axis=1))
    return np.where(finite[:, None], step, 0.0)


def inverse_or_nan(matrix: FloatArray) -> FloatArray:
    """Return the inverses (B, D, D) of matrices that are positive definite, NaN for the others."""
    regular = _is_definite(matrix)
    inverse = np.linalg.inv(np.where(regular[:, None, None], matrix, np.eye(matrix.shape[1])))
    return np.where(regular[:, None, None], inverse, np.nan)


def _is_definite(matrix: FloatArray) -> BoolArray:
    """Return which symmetric matrices (B, D, D) are positive definite, well above rounding."""
    diagonal = np.diagonal(matrix, axis1=1, axis2=2)
    finite = np.asarray(np.isfinite(matrix).all(axis=(1, 2)))
    finite = np.asarray(finite & (diagonal > 0.0).all(axis=1))
    scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    relative = np.where(
        finite.reshape(-1, 1, 1), matrix * scale[:, :, None] * scale[:, None, :], np.eye(matrix.shape[1])
    )
    return np.asarray(finite & (np.linalg.eigvalsh(relative)[:, 0] > 1e-12))


def sandwich_of_weights(
    scalars: Sequence[ScaledResiduals], weight: FloatArray, own_share: FloatArray, shared: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the information A'WA (B, D, D) of rows with weights (B, K), and the covariance (B, D, D) of their fix.

    ``own_share`` (B, K) is the part of a row's variance that it does not share. The covariance is
    (A'WA)^-1 A'W R W A (A'WA)^-1, NaN where the information is singular.
    """
    size = len(scalars[0].slopes)
    information, middle = (np.zeros((weight.shape[0], size, size)) for _ in range(2))
    for scalar in scalars:
        share = own_share if scalar.per_offset is not None else np.ones(weight.shape)
        for i in range(size):
            for j in range(size):
                product = weight * scalar.slopes[i] * scalar.slopes[j]
                information[:, i, j] += sum_measurements(product)
                middle[:, i, j] += sum_measurements(product * share)
        if scalar.per_offset is not None:
            errors = (weight * scalar.per_offset)[:, :, None] * shared
            across = [_over_rows(errors * slope[:, :, None]) for slope in scalar.slopes]
            for i in range(size):
                for j in range(size):
                    middle[:, i, j] += sum_measurements(across[i] * across[j])
    inverse = inverse_or_nan(information)
    return information, _product(_product(inverse, middle), inverse)


def rescaled_covariance(covariance: FloatArray, before: FloatArray, after: FloatArray) -> FloatArray:
    """Return covariances (B, D, D) as ``before`` becomes ``after``: T C T', T = L_after L_before^-1, L L' either.

    A covariance that equals ``before`` becomes ``after``; one that a method widens stays as much wider. NaN where one
    of them is not positive definite.
    """
    regular = _is_definite(before) & _is_definite(after)
    one = np.eye(before.shape[1])
    safe = [np.linalg.cholesky(np.where(regular[:, None, None], matrix, one)) for matrix in (before, after)]
    transform = _product(safe[1], np.asarray(np.linalg.inv(safe[0]), dtype=np.float64))
    changed = _product(_product(transform, covariance), np.swapaxes(transform, 1, 2))
    return np.where(regular[:, None, None], changed, np.nan)


def _product(left: FloatArray, right: FloatArray) -> FloatArray:
    """Return the products (B, D, D) of matrices, term by term in order."""
    total = np.zeros(left.shape)
    for k in range(left.shape[2]):
        total += left[:, :, k, None] * right[:, None, k, :]
    return total
