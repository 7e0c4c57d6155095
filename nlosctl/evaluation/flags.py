"""Scores of line-of-sight flags, accumulated chunk by chunk."""

from __future__ import annotations

from collections.abc import Hashable, Sequence

import numpy as np

from nlosctl.arrays import IntArray, ThreeValuedArray
from nlosctl.evaluation.error_statistics import ratio, rows_by_group
from nlosctl.evaluation.summaries import FlagSummary

__all__ = ["UNKNOWN", "FlagScores"]

UNKNOWN = -1
"""Neither true (1) nor false (0): a null in the file."""


class FlagScores:
    """``los`` against ``truth_los``, by group, in one pass, with nine counts per group."""

    def __init__(self) -> None:
        self._groups: dict[Hashable, IntArray] = {}

    def add(
        self,
        los: ThreeValuedArray,
        truth_los: ThreeValuedArray,
        group: IntArray | None = None,
        keys: Sequence[Hashable] = ("",),
    ) -> None:
        """Add rows (N,): 1 true, 0 false, -1 unknown. ``group`` and ``keys`` as in `EstimateScores.add`."""
        cell = 3 * (truth_los.astype(np.int64) + 1) + los + 1
        if group is None:
            group = np.zeros(cell.shape, dtype=np.int64)
        for key, mask in rows_by_group(group, keys):
            counts = np.bincount(cell[mask], minlength=9).reshape(3, 3)
            self._groups[key] = self._groups.get(key, 0) + counts

    def result(self) -> dict[Hashable, FlagSummary]:
        """Return the summary of each group, in order of first appearance."""
        return {key: _summary(table) for key, table in self._groups.items()}

    def overall(self) -> FlagSummary:
        """Return the summary of all rows of all groups."""
        return _summary(sum(self._groups.values(), np.zeros((3, 3), dtype=np.int64)))


def _summary(table: IntArray) -> FlagSummary:
    """Summarize counts (3, 3) by truth, then flag: unknown, false, true."""
    (nlos_nlos, nlos_los), (los_nlos, los_los) = ((int(n) for n in row) for row in table[1:, 1:])
    rows = nlos_nlos + nlos_los + los_nlos + los_los
    return FlagSummary(
        rows=rows,
        without_flag=int(table[1:, 0].sum()),
        without_truth=int(table[0].sum()),
        los_called_los=los_los,
        los_called_nlos=los_nlos,
        nlos_called_los=nlos_los,
        nlos_called_nlos=nlos_nlos,
        precision=ratio(los_los, los_los + nlos_los),
        recall=ratio(los_los, los_los + los_nlos),
        false_alarm=ratio(nlos_los, nlos_los + nlos_nlos),
        accuracy=ratio(los_los + nlos_nlos, rows),
    )
