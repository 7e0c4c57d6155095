"""Eigenvalues and eigenvectors of small symmetric matrices."""

from __future__ import annotations

import numpy as np

from nlosctl.arrays import BoolArray, Point
from nlosctl.geometry.symmetric import SymmetricMatrix

__all__ = ["eigensystem"]

_PLANE = 2


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
