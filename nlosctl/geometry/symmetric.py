"""Batches of small symmetric matrices, for a state of D unknowns: products, solutions, inverses, eigenvalues.

For D = 2 every operation has a closed form; for larger D it is a factorization L d L^T, written as loops over D.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import reduce
from math import isqrt
from typing import Any, Self

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ignoring_overflow
from nlosctl.geometry.blocks import add_measurements, column_blocks
from nlosctl.geometry.eigensystems import extreme_eigenvalues

__all__ = ["Symmetric2x2", "SymmetricMatrix", "dot"]

_LEAST_PIVOT = 1e-12
"""A Cholesky pivot below this share of its diagonal entry is rounding: the matrix is singular."""


class SymmetricMatrix:
    """A batch of symmetric D x D matrices as ``parts``: the lower triangle row by row, D (D + 1) / 2 arrays.

    Each array has the shape of the batch. For D = 2 the parts are xx, xy and yy.
    """

    __slots__ = ("parts",)

    def __init__(self, *parts: FloatArray) -> None:
        self.parts = parts

    @classmethod
    def outer(cls, *vector: FloatArray, weight: FloatArray | None = None) -> SymmetricMatrix:
        """Return ``weight * v v^T`` for the vectors v, given as D arrays."""
        return cls(*_products(vector, weight))

    @classmethod
    def symmetrized(cls, left: Sequence[FloatArray], right: Sequence[FloatArray]) -> SymmetricMatrix:
        """Return ``u v^T + v u^T`` for the vectors u and v, given as D arrays."""
        return cls(*(left[i] * right[j] + left[j] * right[i] for i in range(len(left)) for j in range(i + 1)))

    @classmethod
    def gram(cls, *vector: FloatArray, weight: FloatArray | None = None) -> SymmetricMatrix:
        """Return the sums (B,) of ``weight * v v^T`` over the measurements, for vectors v given as D arrays (B, K)."""
        total = cls.full(vector[0].shape[:-1], 0.0, len(vector))
        for at in column_blocks(vector[0].shape):
            total.add_gram(*(part[..., at] for part in vector), weight=None if weight is None else weight[..., at])
        return total

    @classmethod
    def full(cls, shape: int | tuple[int, ...], value: float, dimension: int = 2) -> SymmetricMatrix:
        """Return matrices whose entries are all ``value``, each part a new array."""
        return cls(*(np.full(shape, value) for _ in range(dimension * (dimension + 1) // 2)))

    def __iter__(self) -> Iterator[FloatArray]:
        return iter(self.parts)

    def __add__(self, other: SymmetricMatrix) -> SymmetricMatrix:
        return SymmetricMatrix(*(mine + theirs for mine, theirs in zip(self.parts, other.parts, strict=True)))

    def __iadd__(self, other: SymmetricMatrix) -> Self:
        """Add matrices in place, those of fewer coordinates to the part of the first ones."""
        for mine, theirs in zip(self.parts, other.parts, strict=False):
            mine += theirs
        return self

    def __sub__(self, other: SymmetricMatrix) -> SymmetricMatrix:
        return SymmetricMatrix(*(mine - theirs for mine, theirs in zip(self.parts, other.parts, strict=True)))

    def __mul__(self, factor: FloatArray) -> SymmetricMatrix:
        return SymmetricMatrix(*(part * factor for part in self.parts))

    def add_scaled(self, other: SymmetricMatrix, factor: FloatArray) -> None:
        """Add other matrices times a factor in place, part by part, which keeps temporaries in the near caches."""
        for mine, theirs in zip(self.parts, other.parts, strict=True):
            mine += theirs * factor

    def add_gram(self, *vector: FloatArray, weight: FloatArray | None = None) -> None:
        """Add the sums of ``weight * v v^T`` over measurements (B, K) in place; v may lack the last coordinates: 0."""
        for total, product in zip(self.parts, _products(vector, weight), strict=False):
            add_measurements(total, product)

    @property
    def dimension(self) -> int:
        """The number of rows, D."""
        return (isqrt(8 * len(self.parts) + 1) - 1) // 2

    @property
    def xx(self) -> FloatArray:
        """The first entry of the diagonal."""
        return self.parts[0]

    @property
    def xy(self) -> FloatArray:
        """The entry of x and y."""
        return self.parts[1]

    @property
    def yy(self) -> FloatArray:
        """The second entry of the diagonal."""
        return self.parts[2]

    def entry(self, row: int, column: int) -> FloatArray:
        """Return the entries at a row and a column."""
        row, column = max(row, column), min(row, column)
        return self.parts[row * (row + 1) // 2 + column]

    @property
    def diagonal(self) -> tuple[FloatArray, ...]:
        """The D entries of the diagonal."""
        return tuple(self.entry(i, i) for i in range(self.dimension))

    @property
    def trace(self) -> FloatArray:
        """The traces."""
        return reduce(np.add, self.diagonal)

    @property
    def determinant(self) -> FloatArray:
        """The determinants; for D > 2, NaN where the matrix is not positive definite."""
        if len(self.parts) == 3:
            xx, xy, yy = self.parts
            return xx * yy - xy * xy
        return reduce(np.multiply, self._factors()[1])

    def at(self, *index: Any) -> SymmetricMatrix:
        """Return the matrices at an index, as in ``part[index]``: some rows, a column, a new axis."""
        return SymmetricMatrix(*(part[index] for part in self.parts))

    def take(self, rows: IntArray) -> SymmetricMatrix:
        """Return the matrices of some rows."""
        return self.at(rows)

    def put(self, index: Any, values: SymmetricMatrix) -> None:
        """Write matrices at an index, as in ``part[index] = value``."""
        for part, value in zip(self.parts, values.parts, strict=True):
            part[index] = value

    def map(self, change: Callable[[FloatArray], FloatArray]) -> SymmetricMatrix:
        """Return the matrices with a function applied to each part."""
        return SymmetricMatrix(*map(change, self.parts))

    def leading(self, dimension: int) -> SymmetricMatrix:
        """Return the leading blocks of ``dimension`` rows and columns."""
        return SymmetricMatrix(*self.parts[: dimension * (dimension + 1) // 2])

    def where(self, condition: BoolArray, other: SymmetricMatrix) -> SymmetricMatrix:
        """Return these matrices where ``condition``, the others elsewhere."""
        return SymmetricMatrix(*(np.where(condition, *pair) for pair in zip(self.parts, other.parts, strict=True)))

    def stack(self) -> FloatArray:
        """Return the parts as columns (B, D (D + 1) / 2), in the order of the result tables."""
        return np.stack(self.parts, axis=1)

    def add_to_diagonal(self, ridge: FloatArray) -> SymmetricMatrix:
        """Return the matrices with ``ridge`` added to each entry of the diagonal."""
        on_diagonal = {i * (i + 3) // 2 for i in range(self.dimension)}
        return SymmetricMatrix(*(part + ridge if k in on_diagonal else part for k, part in enumerate(self.parts)))

    def quadratic_form(self, *vector: FloatArray) -> FloatArray:
        """Return ``v^T self v`` for vectors v, given as D arrays."""
        with ignoring_overflow():
            total = self.xx * vector[0] * vector[0]
            for i, right in enumerate(vector[1:], 1):
                for j, left in enumerate(vector[:i]):
                    total += 2.0 * self.entry(i, j) * left * right
                total += self.entry(i, i) * right * right
        return total

    def eigenvalues(self) -> tuple[FloatArray, FloatArray]:
        """Return the smallest and the largest eigenvalues, for matrices that are not negative.

        For D = 2 the smaller is determinant / larger, so that it keeps its digits in nearly singular matrices.
        """
        if len(self.parts) != 3:
            return extreme_eigenvalues(self)
        half_difference = 0.5 * (self.xx - self.yy)
        with ignoring_overflow():
            larger = 0.5 * self.trace + np.sqrt(half_difference * half_difference + self.xy * self.xy)
            smaller = np.where(larger > 0.0, self.determinant / larger, 0.0)
        return smaller, larger

    def dense(self) -> FloatArray:
        """Return the matrices as an array (B, D, D)."""
        indices = range(self.dimension)
        return np.stack([np.stack([self.entry(i, j) for j in indices], axis=-1) for i in indices], axis=-2)

    def cholesky(self) -> list[list[FloatArray]]:
        """Return the rows of the Cholesky factor L, ``self = L L^T``; NaN where a matrix is not positive definite."""
        lower, pivots = self._factors()
        roots = [np.sqrt(pivot) for pivot in pivots]
        return [[*map(np.multiply, row, roots), root] for row, root in zip(lower, roots, strict=True)]

    def _factors(self) -> tuple[list[list[FloatArray]], list[FloatArray]]:
        """Return the rows of the unit lower triangle L without its diagonal, and the pivots d of ``self = L d L^T``.

        Pivots are NaN where a matrix is not positive definite.
        """
        lower: list[list[FloatArray]] = []
        pivots: list[FloatArray] = []
        with ignoring_overflow():
            for i in range(self.dimension):
                scaled: list[FloatArray] = []  # the row times the pivots
                for j, row in enumerate(lower):
                    scaled.append(reduce(np.subtract, map(np.multiply, scaled, row), self.entry(i, j)))
                lower.append([part / pivot for part, pivot in zip(scaled, pivots, strict=True)])
                pivot = reduce(np.subtract, map(np.multiply, scaled, lower[i]), self.entry(i, i))
                definite = pivot > _LEAST_PIVOT * self.entry(i, i)
                pivots.append(pivot if definite.all() else np.where(definite, pivot, np.nan))
        return lower, pivots

    def solve(self, *right: FloatArray) -> tuple[FloatArray, ...]:
        """Return the solutions x of ``self x = right``, as D arrays; not finite where a matrix is singular."""
        if len(self.parts) == 3:
            xx, xy, yy = self.parts
            right_x, right_y = right
            with ignoring_overflow():
                scale = 1.0 / self.determinant
                return (yy * right_x - xy * right_y) * scale, (xx * right_y - xy * right_x) * scale
        rows, pivots = self._inverse_factors()
        with ignoring_overflow():
            forward = [reduce(np.add, [part * side for part, side in zip(row, right, strict=False)]) for row in rows]
            forward = [part / pivot for part, pivot in zip(forward, pivots, strict=True)]
            size = len(pivots)
            return tuple(reduce(np.add, [rows[k][i] * forward[k] for k in range(i, size)]) for i in range(size))

    def inverse(self) -> SymmetricMatrix:
        """Return the inverses; not finite where a matrix is singular."""
        if len(self.parts) == 3:
            xx, xy, yy = self.parts
            with ignoring_overflow():
                scale = 1.0 / self.determinant
                return SymmetricMatrix(yy * scale, -xy * scale, xx * scale)
        rows, pivots = self._inverse_factors()
        with ignoring_overflow():
            weighed = [[part / pivot for part in row] for row, pivot in zip(rows, pivots, strict=True)]
            size = len(pivots)
            sums = (
                reduce(np.add, [weighed[k][i] * rows[k][j] for k in range(i, size)])
                for i in range(size)
                for j in range(i + 1)
            )
            return SymmetricMatrix(*sums)

    def _inverse_factors(self) -> tuple[list[list[Any]], list[FloatArray]]:
        """Return the rows of the inverse of the triangle L of `_factors`, the ones of its diagonal included, and d."""
        lower, pivots = self._factors()
        rows: list[list[Any]] = []
        with ignoring_overflow():
            for i, row in enumerate(lower):
                rows.append([-reduce(np.add, [row[k] * rows[k][j] for k in range(j, i)]) for j in range(i)] + [1.0])
        return rows, pivots

    def congruence(self, middle: SymmetricMatrix) -> SymmetricMatrix:
        """Return ``self @ middle @ self``, the sandwich of a covariance."""
        indices = range(self.dimension)
        with ignoring_overflow():
            left = [
                [reduce(np.add, [self.entry(i, k) * middle.entry(k, j) for k in indices]) for j in indices]
                for i in indices
            ]
            return SymmetricMatrix(
                *(
                    reduce(np.add, [left[j][k] * self.entry(k, i) for k in indices])
                    for i in indices
                    for j in range(i + 1)
                )
            )


Symmetric2x2 = SymmetricMatrix
"""The same class, by the name of its two-dimensional case: ``Symmetric2x2(xx, xy, yy)``."""


def dot(left: Sequence[FloatArray], right: Sequence[FloatArray]) -> FloatArray:
    """Return the scalar products of vectors, given as D arrays each; D > 1."""
    return reduce(np.add, [one * other for one, other in zip(left, right, strict=True)])


def _products(vector: Sequence[FloatArray], weight: FloatArray | None) -> Iterator[FloatArray]:
    """Yield the entries of ``weight * v v^T``, the lower triangle row by row."""
    for i, right in enumerate(vector):
        for left in vector[: i + 1]:
            yield left * right if weight is None else weight * left * right
