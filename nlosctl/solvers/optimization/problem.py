"""What an iteration over x and y asks of many small problems at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol, TypeVar

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray
from nlosctl.geometry.symmetric import Symmetric2x2
from nlosctl.solvers.optimization.array_tuples import pick_rows

__all__ = ["Evaluation", "Problem", "RowDerivatives"]

ProblemT = TypeVar("ProblemT", bound="Problem")

_LEAST_SHARE = 0.1
"""Exact second derivatives are trusted when their determinant is at least this share of the stand-in's."""


class Evaluation(NamedTuple):
    """Cost, gradient and a positive matrix of second derivatives (B,) at one point each.

    ``exact`` (B,) tells where the matrix is that of the exact second derivatives, None that it is nowhere.
    """

    cost: FloatArray
    gradient_x: FloatArray
    gradient_y: FloatArray
    hessian: Symmetric2x2
    exact: BoolArray | None = None

    @classmethod
    def of_newton(
        cls,
        cost: FloatArray,
        gradient_x: FloatArray,
        gradient_y: FloatArray,
        exact: Symmetric2x2,
        stand_in: Symmetric2x2,
        least_share: float = _LEAST_SHARE,
    ) -> Evaluation:
        """Return the evaluation with the exact second derivatives, or a positive stand-in where those are not.

        That is Gauss-Newton's matrix, or the EM algorithm's. ``least_share`` is of the stand-in's determinant.
        """
        positive = (exact.xx > 0.0) & (exact.determinant > least_share * stand_in.determinant)
        if np.count_nonzero(positive) < positive.size:
            exact = pick_rows(positive, exact, stand_in)
        return cls(cost, gradient_x, gradient_y, exact, positive)


class Problem(Protocol):
    """B problems. ``cost`` is half a sum of squares of residuals scaled by their standard deviation."""

    def evaluate(self, x: FloatArray, y: FloatArray) -> Evaluation:
        """Return the evaluation at points (B,)."""
        ...

    def take(self: ProblemT, rows: IntArray) -> ProblemT:
        """Return the problems of some rows."""
        ...


@dataclass(frozen=True)
class RowDerivatives:
    """Half the chi-square of one row at points (N,), its gradient, Gauss-Newton matrix and second derivatives.

    ``misfit`` is infinite where the row can't be direct; the others are finite everywhere.
    """

    misfit: FloatArray
    gradient_x: FloatArray
    gradient_y: FloatArray
    gauss: Symmetric2x2
    hessian: Symmetric2x2
