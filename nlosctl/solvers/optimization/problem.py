"""Many small minimization problems at once, over a state of D unknowns: the interface for a solver."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol, Self

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray
from nlosctl.geometry.symmetric import SymmetricMatrix

__all__ = ["Evaluation", "Problem", "RowDerivatives"]

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


@dataclass(frozen=True)
class RowDerivatives:
    """Half the chi-square of one measurement at points (N,), its gradient, Gauss-Newton and second-derivative matrices.

    ``half_chi_square`` is infinite where the measurement can't be direct; everything else is finite.
    """

    half_chi_square: FloatArray
    gradient: tuple[FloatArray, ...]
    gauss: SymmetricMatrix
    hessian: SymmetricMatrix
