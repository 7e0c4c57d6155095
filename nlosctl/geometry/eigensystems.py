"""Eigenvalues and eigenvectors of small symmetric matrices."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, Point, ignoring_overflow

if TYPE_CHECKING:
    from nlosctl.geometry.symmetric import SymmetricMatrix

__all__ = ["eigensystem", "extreme_eigenvalues"]

_PLANE, _SPACE = 2, 3

_SWEEPS = 5
"""Four sweeps of rotations leave no more than rounding, whatever the matrix."""


def eigensystem(matrix: SymmetricMatrix) -> tuple[Point, tuple[Point, ...]]:
    """Return the D eigenvalues of matrices, the largest first, and their D unit vectors, each of D arrays.

    In the plane the second vector is a quarter turn from the first. In space eigenvalues of matrices that are not
    finite are NaN.
    """
    if matrix.dimension == _PLANE:
        smaller, larger = matrix.eigenvalues()
        turn = 0.5 * np.arctan2(2.0 * matrix.xy, matrix.xx - matrix.yy)
        cosine, sine = np.cos(turn), np.sin(turn)
        return (larger, smaller), ((cosine, sine), (-sine, cosine))
    if matrix.dimension == _SPACE:
        return _by_rotations(matrix)
    dense = matrix.dense()
    finite: BoolArray = np.all(np.isfinite(dense), axis=(-2, -1))
    values, vectors = np.linalg.eigh(np.where(finite[..., None, None], dense, 0.0))
    order = range(matrix.dimension - 1, -1, -1)
    return (
        tuple(np.where(finite, values[..., i], np.nan) for i in order),
        tuple(tuple(vectors[..., j, i] for j in range(matrix.dimension)) for i in order),
    )


def _by_rotations(matrix: SymmetricMatrix) -> tuple[Point, tuple[Point, ...]]:
    """Return that for D = 3 by Jacobi's rotations, of all matrices at once."""
    finite = np.logical_and.reduce([np.isfinite(part) for part in matrix])
    xx, yx, yy, zx, zy, zz = (np.where(finite, part, 0.0) for part in matrix)
    values, opposite = [xx, yy, zz], [zy, zx, yx]  # opposite an axis: the entry of the other two
    vectors = [[np.full(xx.shape, float(i == j)) for j in range(_SPACE)] for i in range(_SPACE)]
    pairs = ((0, 1, 2), (0, 2, 1), (1, 2, 0))
    for p, q, r in _SWEEPS * pairs:
        entry, gap = opposite[r], values[q] - values[p]
        reach = np.abs(gap) + np.sqrt(gap * gap + 4.0 * entry * entry)
        tangent = np.copysign(2.0, gap) * entry / np.where(reach > 0.0, reach, 1.0)
        cosine = 1.0 / np.sqrt(1.0 + tangent * tangent)
        sine = tangent * cosine
        values[p], values[q] = values[p] - tangent * entry, values[q] + tangent * entry
        opposite[r] = np.zeros(xx.shape)
        opposite[q], opposite[p] = (
            cosine * opposite[q] - sine * opposite[p],
            sine * opposite[q] + cosine * opposite[p],
        )
        both = list(zip(vectors[p], vectors[q], strict=True))
        vectors[p] = [cosine * one - sine * other for one, other in both]
        vectors[q] = [sine * one + cosine * other for one, other in both]
    for p, q, _ in pairs:
        swap = values[p] < values[q]
        columns = zip((values[p], *vectors[p]), (values[q], *vectors[q]), strict=True)
        (values[p], *vectors[p]), (values[q], *vectors[q]) = zip(
            *((np.where(swap, other, one), np.where(swap, one, other)) for one, other in columns), strict=True
        )
    return tuple(np.where(finite, value, np.nan) for value in values), tuple(map(tuple, vectors))


def extreme_eigenvalues(matrix: SymmetricMatrix) -> tuple[FloatArray, FloatArray]:
    """Return the smallest and the largest eigenvalues of matrices of more than two rows that are not negative.

    For D = 3 the largest by the cubic's trigonometric solution. The others have the product determinant / largest, and
    their sum follows from the principal minors, so that the smallest keeps its digits; 0 in singular matrices.
    """
    if matrix.dimension != _SPACE:
        values, _ = eigensystem(matrix)
        return values[-1], values[0]
    xx, yx, yy, zx, zy, zz = matrix.parts
    with ignoring_overflow():
        mean = matrix.trace / 3.0
        x, y, z = xx - mean, yy - mean, zz - mean
        spread = np.sqrt((x * x + y * y + z * z + 2.0 * (yx * yx + zx * zx + zy * zy)) / 6.0)
        cubic = x * (y * z - zy * zy) - yx * (yx * z - zy * zx) + zx * (yx * zy - y * zx)
        cosine = np.where(spread > 0.0, cubic / (2.0 * spread * spread * spread), 1.0)
        largest = mean + 2.0 * spread * np.cos(np.arccos(np.clip(cosine, -1.0, 1.0)) / 3.0)
        minors = (xx * yy - yx * yx) + (xx * zz - zx * zx) + (yy * zz - zy * zy)
        product = matrix.determinant / largest
        half = 0.5 * (minors - product) / largest
        other = half + np.sqrt(np.maximum(half * half - product, 0.0))
        smallest = np.where(product > 0.0, product / other, 0.0)
    return np.where(np.isfinite(largest), smallest, np.nan), largest
