"""What windows of time add to a chunk."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray

__all__ = ["WindowRows"]


@dataclass(frozen=True, kw_only=True)
class WindowRows:
    """The rows (N,) of S snapshots that are windows of time.

    ``origin`` (N,) are the indices of the rows among those of the input; no later chunk has a row with an index below
    ``settled``; ``source`` names the input.
    ``time_s`` (S,) are the mean times of the rows kept. ``leader`` (N,) is the row whose measurement
    stands for a row: itself, the first row of those that were merged, or -1 for a row that is not kept.
    """

    origin: IntArray
    settled: int
    source: str
    time_s: FloatArray
    leader: IntArray

    @property
    def leads(self) -> BoolArray:
        """The rows (N,) that are measurements: kept, and merged ones once."""
        return np.asarray(self.leader == np.arange(self.leader.shape[0]))

    def measurements(self, offsets: IntArray) -> IntArray:
        """Return the number (S,) of measurements of each snapshot; its rows are at ``offsets`` (S+1,)."""
        return np.add.reduceat(self.leads, offsets[:-1], dtype=np.int64)
