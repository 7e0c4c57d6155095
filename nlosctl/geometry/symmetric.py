"""Batches of small symmetric matrices, for a state of D unknowns: products, solutions, inverses, eigenvalues.

For D = 2 every operation has a closed form; for larger D it is a Cholesky factorization, written as loops over D.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from math import isqrt
from typing import Any, Self

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ignoring_overflow
from nlosctl.geometry.blocks import sum_measurements

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
        return cls(*(sum_measurements(product) for product in _products(vector, weight)))

    @classmethod
    def full(cls, shape: int | tuple[int, ...], value: float, dimension: int = 2) -> SymmetricMatrix:
        """Return matrices whose entries are all ``value``, each part a new array."""
        return cls(*(np.full(shape, value) for _ in range(dimension * (dimension + 1) // 2)))

    def __iter__(self) -> Iterator[FloatArray]:
        return iter(self.parts)

    def __add__(self, other: SymmetricMatrix) -> SymmetricMatrix:
        return SymmetricMatrix(*(mine + theirs for mine, theirs in zip(self.parts, other.parts, strict=True)))

    def __iadd__(self, other: SymmetricMatrix) -> Self:
        for mine, theirs in zip(self.parts, other.parts, strict=True):
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
        return _add(self.diagonal)

    @property
    def determinant(self) -> FloatArray:
        """The determinants; for D > 2, NaN where the matrix is not positive definite."""
        if len(self.parts) == 3:
            xx, xy, yy = self.parts
            return xx * yy - xy * xy
        determinant = np.ones(self.xx.shape)
        for i, row in enumerate(self.cholesky()):
            determinant = determinant * (row[i] * row[i])
        return determinant

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

    def where(self, condition: BoolArray, other: SymmetricMatrix) -> SymmetricMatrix:
        """Return these matrices where ``condition``, the others elsewhere."""
        pairs = zip(self.parts, other.parts, strict=True)
        return SymmetricMatrix(*(np.where(condition, mine, theirs) for mine, theirs in pairs))

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
        if len(self.parts) == 6:
            return self._eigenvalues_in_space()
        if len(self.parts) != 3:
            dense = self.dense()
            finite = np.asarray(np.isfinite(dense).all(axis=(-2, -1)))
            values = np.asarray(np.linalg.eigvalsh(np.where(finite[..., None, None], dense, 0.0)), dtype=np.float64)
            return np.where(finite, values[..., 0], np.nan), np.where(finite, values[..., -1], np.nan)
        half_difference = 0.5 * (self.xx - self.yy)
        with ignoring_overflow():
            larger = 0.5 * self.trace + np.sqrt(half_difference * half_difference + self.xy * self.xy)
            smaller = np.where(larger > 0.0, self.determinant / larger, 0.0)
        return smaller, larger

    def _eigenvalues_in_space(self) -> tuple[FloatArray, FloatArray]:
        """Return the smallest and the largest eigenvalues for D = 3, the largest by the cubic's trigonometric solution.

        The others have the product determinant / largest, and their sum follows from the principal minors, so that the
        smallest keeps its digits; 0 in singular matrices.
        """
        xx, yx, yy, zx, zy, zz = self.parts
        with ignoring_overflow():
            mean = self.trace / 3.0
            x, y, z = xx - mean, yy - mean, zz - mean
            spread = np.sqrt((x * x + y * y + z * z + 2.0 * (yx * yx + zx * zx + zy * zy)) / 6.0)
            cubic = x * (y * z - zy * zy) - yx * (yx * z - zy * zx) + zx * (yx * zy - y * zx)
            cosine = np.where(spread > 0.0, cubic / (2.0 * spread * spread * spread), 1.0)
            largest = mean + 2.0 * spread * np.cos(np.arccos(np.clip(cosine, -1.0, 1.0)) / 3.0)
            minors = (xx * yy - yx * yx) + (xx * zz - zx * zx) + (yy * zz - zy * zy)
            product = self.determinant / largest
            half = 0.5 * (minors - product) / largest
            other = half + np.sqrt(np.maximum(half * half - product, 0.0))
            smallest = np.where(product > 0.0, product / other, 0.0)
        return np.where(np.isfinite(largest), smallest, np.nan), largest

    def dense(self) -> FloatArray:
        """Return the matrices as an array (B, D, D)."""
        indices = range(self.dimension)
        return np.stack([np.stack([self.entry(i, j) for j in indices], axis=-1) for i in indices], axis=-2)

    def cholesky(self) -> list[list[FloatArray]]:
        """Return the rows of the Cholesky factor L, ``self = L L^T``; NaN where a matrix is not positive definite."""
        rows: list[list[FloatArray]] = []
        with ignoring_overflow():
            for i in range(self.dimension):
                row: list[FloatArray] = []
                for j in range(i):
                    row.append(_subtract_products(self.entry(i, j), row, rows[j][:j]) / rows[j][j])
                diagonal = self.entry(i, i)
                pivot = _subtract_products(diagonal, row, row)
                row.append(np.sqrt(np.where(pivot > _LEAST_PIVOT * diagonal, pivot, np.nan)))
                rows.append(row)
        return rows

    def solve(self, *right: FloatArray) -> tuple[FloatArray, ...]:
        """Return the solutions x of ``self x = right``, as D arrays; not finite where a matrix is singular."""
        if len(self.parts) == 3:
            xx, xy, yy = self.parts
            right_x, right_y = right
            with ignoring_overflow():
                scale = 1.0 / self.determinant
                return (yy * right_x - xy * right_y) * scale, (xx * right_y - xy * right_x) * scale
        return _solve_factored(self.cholesky(), right)

    def inverse(self) -> SymmetricMatrix:
        """Return the inverses; not finite where a matrix is singular."""
        if len(self.parts) == 3:
            xx, xy, yy = self.parts
            with ignoring_overflow():
                scale = 1.0 / self.determinant
                return SymmetricMatrix(yy * scale, -xy * scale, xx * scale)
        factor, size = self.cholesky(), self.dimension
        zero, one = np.zeros(self.xx.shape), np.ones(self.xx.shape)
        columns = [_solve_factored(factor, [one if i == j else zero for i in range(size)]) for j in range(size)]
        return SymmetricMatrix(*(columns[j][i] for i in range(size) for j in range(i + 1)))

    def congruence(self, middle: SymmetricMatrix) -> SymmetricMatrix:
        """Return ``self @ middle @ self``, the sandwich of a covariance."""
        indices = range(self.dimension)
        with ignoring_overflow():
            left = [[_add([self.entry(i, k) * middle.entry(k, j) for k in indices]) for j in indices] for i in indices]
            return SymmetricMatrix(
                *(_add([left[j][k] * self.entry(k, i) for k in indices]) for i in indices for j in range(i + 1))
            )


Symmetric2x2 = SymmetricMatrix
"""The same class, by the name of its two-dimensional case: ``Symmetric2x2(xx, xy, yy)``."""


def dot(left: Sequence[FloatArray], right: Sequence[FloatArray]) -> FloatArray:
    """Return the scalar products of vectors, given as D arrays each; D > 1."""
    return _add([one * other for one, other in zip(left, right, strict=True)])


def _products(vector: tuple[FloatArray, ...], weight: FloatArray | None) -> Iterator[FloatArray]:
    """Yield the entries of ``weight * v v^T``, the lower triangle row by row."""
    for i, right in enumerate(vector):
        for left in vector[: i + 1]:
            yield left * right if weight is None else weight * left * right


def _add(terms: Sequence[FloatArray]) -> FloatArray:
    """Return the sum of the terms, added one by one in order."""
    total = terms[0] + terms[1]
    for term in terms[2:]:
        total += term
    return total


def _subtract_products(value: FloatArray, left: list[FloatArray], right: list[FloatArray]) -> FloatArray:
    """Return the value minus the products of two lists, one by one."""
    for one, other in zip(left, right, strict=True):
        value = value - one * other
    return value


def _solve_factored(
    factor: list[list[FloatArray]], right: tuple[FloatArray, ...] | list[FloatArray]
) -> tuple[FloatArray, ...]:
    """Return the solutions of ``L L^T x = right`` by forward and back substitution."""
    size = len(factor)
    with ignoring_overflow():
        forward: list[FloatArray] = []
        for i, row in enumerate(factor):
            forward.append(_subtract_products(right[i], row[:i], forward) / row[i])
        solution: list[FloatArray] = []  # the last unknown first
        for i in range(size - 1, -1, -1):
            below = [factor[k][i] for k in range(size - 1, i, -1)]
            solution.append(_subtract_products(forward[i], below, solution) / factor[i][i])
    return tuple(reversed(solution))
