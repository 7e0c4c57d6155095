"""The rows of measured tracks at their paths: costs, rows used, flags."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import BoolArray, FloatArray, IntArray
from nlosctl.contract.results import Flags
from nlosctl.solvers.tracking.tracks_of_rows import TracksOfRows

__all__ = ["RowResults", "row_results"]


@dataclass(frozen=True)
class RowResults:
    """Cost (S,) of each snapshot's rows and numbers of rows used and of residuals (S,); probability to be direct and
    residuals (N,).

    ``part`` (N,) marks rows that take part. Of trusted rows the probability is NaN.
    """

    NAMES: ClassVar[frozenset[str]] = frozenset(
        ("los", "los_probability", "residual_rad", "residual_elevation_rad", "residual_m")
    )

    cost: FloatArray
    n_used: IntArray
    n_residuals: IntArray
    part: BoolArray
    probability: FloatArray
    residuals: Mapping[str, FloatArray]

    def flags(self, rows: IntArray, answered: BoolArray) -> Flags:
        """Return the flags of some rows, null in those without a state (``answered`` is false)."""
        part = self.part[rows] & answered
        probability = np.where(part, self.probability[rows], np.nan)
        mixed = np.isfinite(probability)
        los = np.full(part.shape, None, dtype=object)
        los[mixed] = probability[mixed] > 0.5
        columns: dict[str, npt.NDArray[np.generic]] = {"los": los, "los_probability": probability}
        columns |= {name: np.where(part, values[rows], np.nan) for name, values in self.residuals.items()}
        return Flags(used=part & (~mixed | (probability > 0.5)), columns=columns)


def row_results(
    paths: TracksOfRows, rows_of: Sequence[IntArray], snapshots: Sequence[IntArray], rows: int
) -> RowResults:
    """Return the results of all blocks, whose rows (B, K) have the indices ``rows_of`` of ``rows`` in all."""
    size = paths.of.of_snapshot.shape[0]
    cost, used = np.zeros(size), np.zeros(size, dtype=np.int64)
    part, probability = np.zeros(rows, dtype=bool), np.full(rows, np.nan)
    residuals: dict[str, FloatArray] = {}
    for block, row, snapshot in zip(paths.at, rows_of, snapshots, strict=True):
        found = block.compare(paths.path)
        cost[snapshot], part[row] = found.cost, True
        weight = block.rows.in_file_order(found.weight)[:, : row.shape[1]]  # one without a row of its own is last
        used[snapshot] = np.count_nonzero(weight > 0.5, axis=1)
        if block.rows.mixture is not None:
            probability[row] = weight
        for name, values in (found.residuals or {}).items():
            residuals.setdefault(name, np.full(rows, np.nan))[row] = values[:, : row.shape[1]]
        if block.rows.residuals is None:
            continue
        for k in range(block.rows.count):
            for name, values in block.rows.residuals(*block.point(paths.path, k)).items():
                mine = row[:, k] if block.rows.order is None else row[np.arange(row.shape[0]), block.rows.order[:, k]]
                residuals.setdefault(name, np.full(rows, np.nan))[mine] = values[:, k]
    counted = np.zeros(size, dtype=np.int64)
    for row, snapshot in zip(rows_of, snapshots, strict=True):
        counted[snapshot] = sum(np.isfinite(values[row]).sum(axis=1) for values in residuals.values())
    return RowResults(cost, used, counted, part, probability, residuals)
