"""Least squares where rows have errors in common: offsets, places of sensors, mirrors that are not exactly known.

Over the stds of the rows the covariance of the residuals is R = I + S, S that of the shared errors. With R = L L' the
rows L^-1 A, L^-1 r are those of ordinary least squares. R depends on the position, but is not differentiated: the fix
is where A'R^-1 r = 0 with R there, its covariance (A'R^-1 A)^-1. An unknown that is no coordinate (the offset of
arrivals) is eliminated.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ignoring_division
from nlosctl.geometry.blocks import sum_measurements
from nlosctl.models.shared_causes.joint_rows import JointRows

__all__ = [
    "correlated_equations",
    "covariance_by_gain",
    "covariance_of_fix",
    "inverse_or_nan",
    "least_square",
    "linear_fix",
    "refine_positions",
    "rescaled_covariance",
    "sandwich_of_weights",
]

Model = Callable[[IntArray, FloatArray], JointRows]
"""The scalars of some snapshots (N,) at positions (N, D)."""

_MOST_STEPS = 30
_SETTLED = 1e-10
"""A step whose square over the covariance is less than this is the last."""


def correlated_equations(rows: JointRows) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return A'R^-1 A (B, D, D), A'R^-1 r (B, D) and r'R^-1 r (B,) of the coordinates of the position.

    Of an unknown that is no coordinate they are those at its likeliest value.
    """
    product = _products(_whitened(rows, _root(rows)))
    for _ in range(rows.nuisances):
        product = _without(product, product.shape[1] - 2)
    return product[:, :-1, :-1], product[:, :-1, -1], product[:, -1, -1]


def covariance_of_fix(rows: JointRows) -> tuple[FloatArray, FloatArray]:
    """Return (A'R^-1 A)^-1 (B, N, N) of all N unknowns, NaN where it is singular, and the step (B,) of the last one.

    By that the likeliest value of an unknown that is no coordinate exceeds the one in the residuals.
    """
    product = _products(_whitened(rows, _root(rows)))
    with ignoring_division():
        step = -product[:, -2, -1] / product[:, -2, -2]
    return inverse_or_nan(product[:, :-1, :-1]), step


def least_square(rows: JointRows) -> FloatArray:
    """Return r'R^-1 r (B,) after a Gauss-Newton step of all unknowns, NaN where that is singular."""
    information, gradient, square = correlated_equations(rows)
    step = sum_measurements(inverse_or_nan(information) * gradient[:, None, :])
    return np.asarray(square - sum_measurements(gradient * step))


def _root(rows: JointRows) -> FloatArray:
    """Return L (B, S, S)."""
    return np.asarray(np.linalg.cholesky(np.eye(rows.shared.shape[1]) + rows.shared))


def _whitened(rows: JointRows, root: FloatArray) -> FloatArray:
    """Return L^-1 [A r] (B, S, D + 1)."""
    return np.asarray(np.linalg.solve(root, np.stack([*rows.slopes, rows.residual], axis=2)))


def _products(columns: FloatArray) -> FloatArray:
    """Return the sums (B, N, N) of products of columns (B, S, N) over the rows, one after the other."""
    total = np.zeros((columns.shape[0], columns.shape[2], columns.shape[2]))
    for k in range(columns.shape[1]):
        total += columns[:, k, :, None] * columns[:, k, None, :]
    return total


def _without(product: FloatArray, index: int) -> FloatArray:
    """Return a symmetric matrix (B, N, N) without one of its unknowns, by the Schur complement."""
    kept = [other for other in range(product.shape[1]) if other != index]
    across = product[:, kept, index]
    with ignoring_division():
        share = across / product[:, index, index, None]
    return np.asarray(product[:, kept][:, :, kept] - share[:, :, None] * across[:, None, :])


def refine_positions(model: Model, position_m: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return the positions (B, D) with A'R^-1 r = 0 next to given ones, and which of them (B,) settled.

    Gauss-Newton steps with the R of each position, halved where they do not lower r'R^-1 r with that R. A position
    whose equations are singular stays. Coordinates that are no unknowns stay.
    """
    point, active = position_m.copy(), np.arange(position_m.shape[0])
    length = np.ones(active.shape)
    settled = np.zeros(active.shape, dtype=bool)
    for _ in range(_MOST_STEPS):
        rows = model(active, point[active])
        root = _root(rows)
        product = _products(_whitened(rows, root))
        for _ in range(rows.nuisances):
            product = _without(product, product.shape[1] - 2)
        information, gradient = product[:, :-1, :-1], product[:, :-1, -1]
        step = _steps(information, gradient)
        moved = sum_measurements(sum_measurements(information * step[:, None, :]) * step)
        small = ~(moved * length[active] ** 2 >= _SETTLED)
        settled[active[small]] = True
        active, root, before = active[~small], root[~small], product[~small, -1, -1]
        if not active.size:
            break
        trial = point[active]
        trial[:, : step.shape[1]] += length[active, None] * step[~small]
        there = model(active, trial)
        better = _square(there, root) <= before
        point[active[better]] = trial[better]
        length[active] = np.where(better, 1.0, 0.5 * length[active])
    return point, settled


def _square(rows: JointRows, root: FloatArray) -> FloatArray:
    """Return r'R^-1 r (B,) with R = L L' of another position."""
    product = _products(_whitened(rows, root))
    for _ in range(rows.nuisances):
        product = _without(product, product.shape[1] - 2)
    return product[:, -1, -1]


def linear_fix(rows: JointRows, position_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the positions (B, D) where A'R^-1 r = 0 for residuals that are linear from given ones, and their gain.

    The gain (B, N, S) is (A'R^-1 A)^-1 A'R^-1, NaN where that is singular.
    """
    root = _root(rows)
    whitened = _whitened(rows, root)
    slopes = whitened[:, :, :-1]
    inverse = inverse_or_nan(_products(slopes))
    back = np.linalg.solve(np.swapaxes(root, 1, 2), slopes)
    gain = np.zeros((inverse.shape[0], inverse.shape[1], root.shape[1]))
    for k in range(inverse.shape[1]):
        gain += inverse[:, :, k, None] * back[:, None, :, k]
    point = position_m.copy()
    step = sum_measurements(gain * rows.residual[:, None, :])
    point[:, : step.shape[1]] -= step
    return point, gain


def covariance_by_gain(rows: JointRows, gain: FloatArray, spread: FloatArray) -> FloatArray:
    """Return the covariance (B, N, N) G R G' of a linear fit by its gain G (B, N, S), errors times a spread (B, S)."""
    gain = gain * spread[:, None, :]
    size = gain.shape[1]
    covariance = np.empty((gain.shape[0], size, size))
    for i in range(size):
        across = gain[:, i] + _rows_times(rows.shared, gain[:, i])
        for j in range(size):
            covariance[:, i, j] = sum_measurements(across * gain[:, j])
    return covariance


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


def sandwich_of_weights(rows: JointRows, weight: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return (A'WA)^-1 (B, N, N) of scalars with weights (B, S), and the covariance of their fix, of all N unknowns.

    The covariance is (A'WA)^-1 A'W R W A (A'WA)^-1, NaN where A'WA is singular.
    """
    pulls = [weight * slope for slope in rows.slopes]
    size = len(pulls)
    information, middle = (np.zeros((weight.shape[0], size, size)) for _ in range(2))
    for i in range(size):
        across = pulls[i] + _rows_times(rows.shared, pulls[i])
        for j in range(size):
            information[:, i, j] = sum_measurements(pulls[i] * rows.slopes[j])
            middle[:, i, j] = sum_measurements(across * pulls[j])
    inverse = inverse_or_nan(information)
    return inverse, _product(_product(inverse, middle), inverse)


def _rows_times(matrix: FloatArray, vector: FloatArray) -> FloatArray:
    """Return the products (B, S) of matrices (B, S, S) and vectors, term by term in order."""
    total = np.zeros(vector.shape)
    for k in range(vector.shape[1]):
        total += matrix[:, :, k] * vector[:, k, None]
    return total


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
