"""Many small minimization problems at once, over a state of D unknowns: the interface for a solver."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import chain
from typing import NamedTuple, Protocol, Self

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, Point, ignoring_overflow
from nlosctl.geometry.blocks import add_measurements
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.sight import Expansion

__all__ = ["Evaluation", "ExpandedRows", "LeastSquaresProblem", "Problem", "RowDerivatives", "least_chi_square"]

_LEAST_SHARE = 0.1
"""Exact second derivatives are trusted if their determinant is at least this share of the substitute's."""


class Evaluation(NamedTuple):
    """Cost (B,), gradient (D arrays) and a positive definite matrix of second derivatives, at one point per problem.

    ``exact`` (B,) marks where the matrix holds the exact second derivatives; None: no matrix is exact.
    """

    cost: FloatArray
    gradient: tuple[FloatArray, ...]
    hessian: SymmetricMatrix
    exact: BoolArray | None = None

    @property
    def gradient_x(self) -> FloatArray:
        """The derivative by the first coordinate."""
        return self.gradient[0]

    @property
    def gradient_y(self) -> FloatArray:
        """The derivative by the second coordinate."""
        return self.gradient[1]

    @classmethod
    def of_newton(
        cls,
        cost: FloatArray,
        gradient: tuple[FloatArray, ...],
        exact: SymmetricMatrix,
        substitute: SymmetricMatrix,
        least_share: float = _LEAST_SHARE,
    ) -> Evaluation:
        """Return the evaluation with exact second derivatives, or a substitute where those are not positive definite.

        The substitute is the Gauss-Newton matrix or that of the EM algorithm; ``least_share`` refers to its
        determinant.
        """
        positive = (exact.xx > 0.0) & (exact.determinant > least_share * substitute.determinant)
        if np.count_nonzero(positive) < positive.size:
            exact = exact.where(positive, substitute)
        return cls(cost, gradient, exact, positive)

    def where(self, condition: BoolArray, other: Evaluation) -> Evaluation:
        """Return this evaluation where ``condition`` (B,), the other elsewhere."""
        count = np.count_nonzero(condition)
        if count in (0, condition.size):
            return self if count else other
        exact = None
        if self.exact is not None and other.exact is not None:
            exact = np.where(condition, self.exact, other.exact)
        return Evaluation(
            np.where(condition, self.cost, other.cost),
            tuple(np.where(condition, *pair) for pair in zip(self.gradient, other.gradient, strict=True)),
            self.hessian.where(condition, other.hessian),
            exact,
        )


class Problem(Protocol):
    """B problems. ``cost`` is half a sum of squares of residuals, each divided by its standard deviation."""

    @property
    def evaluate(self) -> Callable[..., Evaluation]:
        """Return the evaluation at points, given as D arrays (B,)."""
        ...

    def take(self, rows: IntArray) -> Self:
        """Return the problems of some rows."""
        ...


class ExpandedRows(Protocol):
    """Rows of B snapshots with Gaussian errors."""

    @property
    def expanded(self) -> Callable[..., Iterator[Expansion]]:
        """Yield the expansions of some rows at a time, at points given as D arrays (B,)."""
        ...

    def take(self, rows: IntArray) -> Self:
        """Return the rows of some snapshots."""
        ...


@dataclass(frozen=True)
class LeastSquaresProblem:
    """Half the chi-square of rows, for a state of D unknowns."""

    rows: ExpandedRows

    def take(self, rows: IntArray) -> LeastSquaresProblem:
        """Return the problems of some rows."""
        return LeastSquaresProblem(self.rows.take(rows))

    def evaluate(self, *point: FloatArray) -> Evaluation:
        """Return cost, gradient and exact second derivatives, or Gauss-Newton's where those are not positive definite.

        Some rows at a time, so that temporaries stay in the caches.
        """
        shape, dimension = point[0].shape, len(point)
        cost, gradient = np.zeros(shape), tuple(np.zeros(shape) for _ in point)
        gauss, curvature = (SymmetricMatrix.full(shape, 0.0, dimension) for _ in range(2))
        with ignoring_overflow():
            for half, slopes, outer, bend in self.rows.expanded(*point):
                add_measurements(cost, half)
                for total, part in chain(
                    zip(gradient, slopes, strict=True),
                    zip(gauss, outer, strict=True),
                    () if bend is None else zip(curvature, bend, strict=True),
                ):
                    add_measurements(total, part)
            return Evaluation.of_newton(cost, gradient, gauss + curvature, gauss)


@dataclass(frozen=True)
class RowDerivatives:
    """Half the chi-square of one measurement at points (N,), its gradient, Gauss-Newton and second-derivative matrices.

    ``half_chi_square`` is infinite where the measurement can't be direct; everything else is finite. If the density of
    an outlier depends on the point too, the numbers are those of the negative logarithm of the ratio of the two
    densities, and ``outlier`` has those of the negative logarithm of the outlier's.
    """

    half_chi_square: FloatArray
    gradient: tuple[FloatArray, ...]
    gauss: SymmetricMatrix
    hessian: SymmetricMatrix
    outlier: RowDerivatives | None = None

    def direct(self) -> RowDerivatives:
        """Return those of half the chi-square itself."""
        other = self.outlier
        if other is None:
            return self
        gradient = tuple(map(np.add, self.gradient, other.gradient))
        half = self.half_chi_square + other.half_chi_square
        return RowDerivatives(half, gradient, self.gauss + other.gauss, self.hessian + other.hessian)


class MeasuredRows(Protocol):
    """Rows (B, K) of measurements that are compared with points (B,)."""

    def derivatives(self, k: int, *point: FloatArray) -> RowDerivatives:
        """Return half the chi-square of row ``k`` and its derivatives."""
        ...

    def scalars(self) -> IntArray:
        """Return the number of scalars (B, K) that each row measures."""
        ...


def least_chi_square(
    rows: MeasuredRows,
    point: Point,
    used: BoolArray,
    further: RowDerivatives | None = None,
    derivatives: Sequence[RowDerivatives] | None = None,
) -> tuple[FloatArray, IntArray]:
    """Return the chi-square (B,) of the ``used`` rows (B, K) at the optimum near points (B,), and their scalars.

    It is that of the linearized residuals after a Gauss-Newton step on these rows: the points need not minimize it.
    NaN where a used row is impossible there. ``further`` is added to the rows, such as a prior; ``derivatives`` are
    those of the rows at the points, if already computed.
    """
    shape = used.shape[:1]
    half, *slope = (np.zeros(shape) for _ in range(1 + len(point)))
    information = SymmetricMatrix.full(shape, 0.0, len(point))
    with ignoring_overflow():
        known = derivatives or (rows.derivatives(k, *point) for k in range(used.shape[1]))
        terms = ((row.direct(), used[:, k]) for k, row in enumerate(known))
        for row, mine in chain(terms, () if further is None else [(further, np.ones(shape, dtype=bool))]):
            share = mine.astype(np.float64)
            half += np.where(mine, row.half_chi_square, 0.0)
            for total, part in zip(slope, row.gradient, strict=True):
                total += share * part
            information.add_scaled(row.gauss, share)
        step = information.solve(*slope)
        chi_square = 2.0 * half - reduce(np.add, [part * move for part, move in zip(slope, step, strict=True)])
    chi_square = np.where(np.isfinite(chi_square), chi_square, np.nan)
    return chi_square, np.asarray(np.where(used, rows.scalars(), 0).sum(axis=1))
