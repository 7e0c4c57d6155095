"""The map of one source that all snapshots of an input measure: the sum of their log-likelihoods."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import FloatArray
from nlosctl.errors import DataError
from nlosctl.pipeline.posterior.cell_grids import CellGrid
from nlosctl.pipeline.posterior.snapshot_maps import BatchCost
from nlosctl.solvers.sequential.priors import Prior

__all__ = ["CombinedCosts"]

_UNIT_NATS = 2.0**-24
_MOST_NATS = 2.0**24
_IMPOSSIBLE = np.int64(1) << np.int64(60)
_COSTS_AT_ONCE = 1 << 21


@dataclass
class CombinedCosts:
    """Sums of costs of cells over snapshots, as integers, so that neither order nor cut of the input matters.

    The unit is 6e-8 nats. Each snapshot's costs are those above its least. A cell that is impossible in one snapshot
    stays so.
    """

    grid: CellGrid
    snapshots: int = 0
    prior: Prior | None = None
    _total: npt.NDArray[np.int64] = field(init=False)

    def __post_init__(self) -> None:
        self._total = np.zeros(self.grid.count, dtype=np.int64)

    def add(self, cost: BatchCost, priors: Prior | None) -> None:
        """Add the snapshots of a batch; ``cost`` is without the prior, which counts once and must be one for all."""
        self._take_priors(priors)
        x, y = self.grid.centers()
        step = max(1, _COSTS_AT_ONCE // self.grid.count)
        for first in range(0, cost.batch.size, step):
            rows = np.arange(first, min(first + step, cost.batch.size))
            points = tuple(np.broadcast_to(part, (rows.shape[0], part.shape[0])) for part in (x, y))
            for costs in cost(rows, points, 0.0):
                self._add_snapshot(costs)
        self.snapshots += cost.batch.size

    def _add_snapshot(self, costs: FloatArray) -> None:
        possible = np.isfinite(costs)
        if not possible.any():
            self._total[:] = _IMPOSSIBLE
            return
        costs = np.where(possible, np.minimum(costs - costs[possible].min(), _MOST_NATS), 0.0)
        self._total += np.rint(costs / _UNIT_NATS).astype(np.int64)
        self._total[~possible] = _IMPOSSIBLE
        np.minimum(self._total, _IMPOSSIBLE, out=self._total)

    def _take_priors(self, priors: Prior | None) -> None:
        if priors is None or not priors.known.size:
            return
        one = priors.take(np.zeros(1, dtype=np.int64))
        if priors.known.size > 1 or (self.prior is not None and _numbers(one) != _numbers(self.prior)):
            raise DataError("the snapshots have different priors, and a combined map is of one source; give one prior")
        self.prior = one

    def probability(self, share: FloatArray | None) -> FloatArray | None:
        """Return the probabilities (P,) of the cells; None if no cell is possible.

        ``share`` (P,) is the share of each cell that counts; None: all of it.
        """
        costs = np.where(self._total < _IMPOSSIBLE, (self._total - self._total.min()) * _UNIT_NATS, np.inf)
        if self.prior is not None:
            costs += self.prior.half_chi_square(*(part[None] for part in self.grid.centers()))[0]
        if share is not None:
            costs = np.where(share > 0.0, costs, np.inf)
        if not np.isfinite(costs).any():
            return None
        mass = np.exp(costs.min() - costs)
        if share is not None:
            mass *= share
        return np.asarray(mass / mass.sum())


def _numbers(prior: Prior) -> list[float]:
    return [float(part[0]) for part in (prior.x, prior.y, *prior.covariance.parts)]
