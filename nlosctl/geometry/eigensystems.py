"""Eigenvalues and eigenvectors of small symmetric matrices."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, Point, ignoring_overflow

if TYPE_CHECKING:
    from nlosctl.geometry.symmetric import SymmetricMatrix

__all__ = ["eigensystem", "extreme_eigenvalues"]

_PLANE, _SPACE = 2, 3


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
    dense = matrix.dense()
    finite: BoolArray = np.all(np.isfinite(dense), axis=(-2, -1))
    values, vectors = np.linalg.eigh(np.where(finite[..., None, None], dense, 0.0))
    order = range(matrix.dimension - 1, -1, -1)
    return (
        tuple(np.where(finite, values[..., i], np.nan) for i in order),
        tuple(tuple(vectors[..., j, i] for j in range(matrix.dimension)) for i in order),
    )


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
