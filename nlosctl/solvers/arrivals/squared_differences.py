"""Squared range differences to a reference sensor, solved to the global minimum (Beck, Stoica, Li 2008, part III).

With the reference at the origin, d_i = t_i - t_ref and y = (x, |x|), the rows -2 a_i.x - 2 d_i |x| = d_i^2 - |a_i|^2
are B y = g. Stationary points of |B y - g|^2 on the cone y'Cy = 0, C = diag(1, .., 1, -1), are (B'B + l C) y = B'g.
With V'(B'B)V = 1 and V'CV = diag(e), f = V'B'g, the multiplier l solves

    sum of e_k f_k^2 / (1 + l e_k)^2 = -h^2        h: the reference's height over the plane of the source, else 0

a polynomial of degree 2 (D + 1) or two less: all its real roots are candidates, as the minimum is not always that of
the greatest multiplier.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import comb

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ignoring_overflow
from nlosctl.geometry.blocks import sum_measurements
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.arrivals import ArrivalRows
from nlosctl.solvers.arrivals.likelihood import SquaredDifferenceProblem

__all__ = ["DifferenceFit", "squared_differences"]

_LEAST_EIGENVALUE = 1e-14
"""Eigenvalues of B'B below this share of the largest are rounding: few sensors, or sensors in a plane."""

_SHIFT = 0.37
"""Multipliers are counted from minus this; the nearest poles are at a distance of 1 from 0."""

_REAL = 1e-4
"""A root is real if its imaginary part is at most this share of its size: double roots split in rounding."""


@dataclass(frozen=True)
class DifferenceFit:
    """The problem of snapshots (B,), its reference row (B,), and the stationary points on the cone (C, B) per axis."""

    problem: SquaredDifferenceProblem
    reference: IntArray
    scale_m: FloatArray
    points: tuple[FloatArray, ...]


def squared_differences(rows: ArrivalRows) -> DifferenceFit:
    """Return the squared differences to the row of the smallest std (the first of equals), and their stationary points.

    The rows are divided by twice the array size times the mean std, about the error of a squared difference, so that a
    measured height is one more row.
    """
    every = np.arange(rows.arrival_m.shape[0])
    reference = np.argmin(rows.std_m, axis=1)
    origin = tuple(part[every, reference] for part in rows.sensor)
    height = np.zeros(every.shape) if rows.height is None else rows.height[every, reference]
    difference = rows.arrival_m - rows.arrival_m[every, reference][:, None]
    away = [part - own[:, None] for part, own in zip(rows.sensor, origin, strict=True)]
    right = difference * difference - np.sum([part * part for part in away], axis=0)
    if rows.height is not None:
        right = right - rows.height * rows.height + (height * height)[:, None]
    columns = [-2.0 * part for part in (*away, difference)]
    size = rows.size_m()
    scale = 2.0 * size * sum_measurements(rows.std_m) / rows.std_m.shape[1]
    columns, right = [part / scale[:, None] for part in columns], right / scale[:, None]
    if rows.level is not None:
        share = rows.level.inverse_std
        zero = np.zeros(every.shape)
        level = [zero] * (len(columns) - 2) + [share, zero]
        columns = [np.column_stack([part, extra]) for part, extra in zip(columns, level, strict=True)]
        right = np.column_stack([right, share * (rows.level.z_m - origin[-1])])
    columns, right = [np.asfortranarray(part) for part in columns], np.asfortranarray(right)
    problem = SquaredDifferenceProblem(tuple(columns), right, origin, height, 1e6 * size)
    return DifferenceFit(problem, reference, scale, _stationary(problem, size))


def _stationary(problem: SquaredDifferenceProblem, size: FloatArray) -> tuple[FloatArray, ...]:
    """Return the points of all real roots with a positive distance, as D arrays (C, B); NaN elsewhere."""
    with ignoring_overflow():
        matrix = SymmetricMatrix.gram(*(part * size[:, None] for part in problem.coefficients)).dense()
        pulls = [sum_measurements(part * problem.right) * size for part in problem.coefficients]
        pull = np.stack(pulls, axis=1)
    matrix, pull = np.nan_to_num(matrix, posinf=0.0, neginf=0.0), np.nan_to_num(pull, posinf=0.0, neginf=0.0)
    values, vectors = np.linalg.eigh(matrix)
    values = np.maximum(values, _LEAST_EIGENVALUE * np.maximum(values[:, -1:], np.finfo(np.float64).tiny))
    half = vectors / np.sqrt(values)[:, None, :]
    signs = np.ones(matrix.shape[1])
    signs[-1] = -1.0
    e, turn = np.linalg.eigh(np.einsum("bki,k,bkj->bij", half, signs, half))
    basis = half @ turn
    f = np.einsum("bki,bk->bi", basis, pull)
    h = problem.height / size
    unit = np.abs(e).max(axis=1)
    relative = e / unit[:, None]
    roots = _roots(_polynomial(relative, relative * f * f * unit[:, None], h * h))
    with ignoring_overflow():
        z = f[:, None, :] / (1.0 + roots[:, :, None] * relative[:, None, :])
    y = np.einsum("bij,bcj->bci", basis, z)
    place = np.where((y[..., -1] >= 0.0)[..., None], y, np.nan)
    return tuple(place[..., i].T * size + problem.reference[i] for i in range(len(problem.reference)))


def _polynomial(e: FloatArray, weight: FloatArray, constant: FloatArray) -> FloatArray:
    """Return the coefficients (B, 2 n + 1), the lowest power first, of the equation times the squared denominators."""
    count = e.shape[1]
    squares = [np.stack([np.ones(e.shape[0]), 2.0 * e[:, k], e[:, k] ** 2], axis=1) for k in range(count)]
    total = np.zeros((e.shape[0], 2 * count + 1))
    for skipped in range(count):
        product = weight[:, skipped, None]
        for k in range(count):
            if k != skipped:
                product = _multiply(product, squares[k])
        total[:, : product.shape[1]] += product
    product = constant[:, None]
    for square in squares:
        product = _multiply(product, square)
    return np.asarray(total + product)


def _multiply(left: FloatArray, right: FloatArray) -> FloatArray:
    """Return the coefficients of products of polynomials (B, n) and (B, m)."""
    product = np.zeros((left.shape[0], left.shape[1] + right.shape[1] - 1))
    for power in range(right.shape[1]):
        product[:, power : power + left.shape[1]] += left * right[:, power, None]
    return product


def _roots(coefficients: FloatArray) -> FloatArray:
    """Return the real roots (B, n) of polynomials (B, n + 1), the lowest power first; NaN for complex ones.

    They are the inverse eigenvalues of the companion matrix of the reversed polynomial about a point that is not a
    root, which the multiplier 0 of exact arrivals may be. Vanishing leading coefficients are roots at infinity.
    """
    degree = coefficients.shape[1] - 1
    shift = np.array(
        [[comb(k, j) * (-_SHIFT) ** (k - j) if k >= j else 0.0 for j in range(degree + 1)] for k in range(degree + 1)]
    )
    shifted = np.einsum("bk,kj->bj", coefficients, shift)
    with ignoring_overflow():
        monic = np.nan_to_num(shifted[:, 1:] / shifted[:, :1], posinf=0.0, neginf=0.0)
    companion = np.zeros((coefficients.shape[0], degree, degree))
    companion[:, 0, :] = -monic
    companion[:, np.arange(1, degree), np.arange(degree - 1)] = 1.0
    inverse = np.linalg.eigvals(companion)
    real: BoolArray = np.abs(inverse.imag) <= _REAL * np.abs(inverse)
    with ignoring_overflow():
        return np.where(real, 1.0 / inverse.real - _SHIFT, np.nan)
