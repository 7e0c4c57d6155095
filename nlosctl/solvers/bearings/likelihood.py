"""The likelihood of bearings as a batched least-squares problem."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import FloatArray, ignoring_overflow
from nlosctl.geometry.blocks import RowBlock
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.bearings import SightLines
from nlosctl.solvers.optimization.problem import Evaluation

__all__ = ["BearingProblem"]


_TERMS = 8

_SMALL_BLOCK = 128
"""Below this many rows the cost of a NumPy call outweighs the cost of temporaries that leave the cache."""


@dataclass(frozen=True)
class BearingProblem(RowBlock):
    """Half the chi-square of the residuals of rays (B, K), as a function of a point about the local origin."""

    origin_x: FloatArray
    origin_y: FloatArray
    cosine: FloatArray
    sine: FloatArray
    inverse_std: FloatArray

    @classmethod
    def of_lines(cls, lines: SightLines) -> BearingProblem:
        """Return the problem of a block of sight lines."""
        return cls(lines.origin_x, lines.origin_y, lines.cosine, lines.sine, 1.0 / lines.std_rad)

    def evaluate(self, x: FloatArray, y: FloatArray) -> Evaluation:
        """Return cost, gradient (from (23) of Song et al.) and the exact second derivatives.

        Where those are not positive definite, far from the minimum, the Gauss-Newton matrix replaces them.
        Large blocks are evaluated one measurement after the other, so that all temporaries stay in the near caches;
        small blocks at once. Both add the same terms in the same order, so the bits do not depend on the block.
        """
        with ignoring_overflow():
            if x.shape[0] < _SMALL_BLOCK:
                terms = np.concatenate(self._terms(slice(None), x[:, None], y[:, None]))
                totals = np.add.accumulate(terms, axis=1)[:, -1].reshape(_TERMS, -1)
            else:
                totals = np.zeros((_TERMS, x.shape[0]))
                for k in range(self.origin_x.shape[1]):
                    for total, term in zip(totals, self._terms(k, x, y), strict=True):
                        total += term
            cost, gradient_x, gradient_y, xx, xy, yy, bend, twist = totals
            gauss = SymmetricMatrix(xx, -xy, yy)
            twice = bend + bend
            exact = SymmetricMatrix(xx - twice, gauss.xy - twist, yy + twice)
            return Evaluation.of_newton(0.5 * cost, (gradient_x, -gradient_y), exact, gauss)

    def _terms(self, k: int | slice, x: FloatArray, y: FloatArray) -> tuple[FloatArray, ...]:
        """Return what measurement ``k`` (or all) adds to cost, gradient, Gauss-Newton matrix and curvature."""
        cosine, sine, inverse_std = self.cosine[:, k], self.sine[:, k], self.inverse_std[:, k]
        dx, dy = x - self.origin_x[:, k], y - self.origin_y[:, k]
        residual = np.arctan2(sine * dx - cosine * dy, cosine * dx + sine * dy)
        scaled = residual * inverse_std
        weight = inverse_std / (dx * dx + dy * dy)
        across, along = dy * weight, dx * weight
        product, across_squared, along_squared = across * along, across * across, along * along
        return (
            scaled * scaled,
            scaled * across,
            scaled * along,
            across_squared,
            product,
            along_squared,
            residual * product,
            residual * (across_squared - along_squared),
        )
