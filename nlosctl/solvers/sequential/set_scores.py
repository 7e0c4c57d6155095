"""Scores of many sets of rows, a point each: equation (23) with a constant number of NumPy calls."""

from __future__ import annotations

from dataclasses import dataclass, fields, is_dataclass
from typing import Any

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.solvers.mixture.likelihood import FACTORS, Mixture
from nlosctl.solvers.mixture.mixture_rows import MixtureRows

__all__ = ["SetScores"]

_PLANE = 2


@dataclass(frozen=True)
class SetScores:
    """The mixtures of N snapshots, whose scores at one point each are computed for all K rows at once.

    `Mixture.score` takes row after row, which is slow for few points of many rows. The bits are the same.
    ``apart`` has every row as a snapshot of its own (N K, 1); None where groups have several rows, or densities of
    outliers depend on the point: `Mixture.score` then does the work.
    """

    mixture: Mixture
    apart: MixtureRows | None
    log_direct: FloatArray

    @classmethod
    def of(cls, mixture: Mixture) -> SetScores:
        """Return the scores of a block."""
        single = mixture.last is None and mixture.outliers is None and mixture.dimension == _PLANE
        apart = _rows_apart(mixture.rows, mixture.count) if single else None
        return cls(mixture, apart, np.ascontiguousarray(mixture.log_direct))

    def at(self, *point: FloatArray) -> FloatArray:
        """Return the cost (N, 1) of points (N, 1), as `Mixture.score` does."""
        if self.apart is None:
            return self.mixture.score(*point)
        shape = self.log_direct.shape
        each = [np.repeat(part, shape[1], axis=0) for part in point]
        direct = self.log_direct - self.apart.half_chi_square(0, *each).reshape(shape)
        np.exp(direct, out=direct)
        direct += self.mixture.obstructed[:, None]
        product = direct[:, ::FACTORS].copy()
        for k in range(1, min(FACTORS, shape[1])):
            factor = direct[:, k::FACTORS]
            product[:, : factor.shape[1]] *= factor
        logarithm = np.add.accumulate(np.log(product), axis=1)[:, -1:]
        return -logarithm - self.mixture.log_nlos[:, None]


def _rows_apart(block: Any, count: int) -> Any:
    """Return rows (N, K) as N K snapshots of one row each."""
    if isinstance(block, np.ndarray):
        return block.reshape(-1, 1) if block.ndim > 1 else np.repeat(block, count)
    if is_dataclass(block) and not isinstance(block, type):
        parts = {field.name: _rows_apart(getattr(block, field.name), count) for field in fields(block)}
        return type(block)(**parts)
    return block
