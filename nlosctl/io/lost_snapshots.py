"""Snapshots of which every row is bad: they leave no trace among the good rows, so they are counted here."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow.compute as pc

from nlosctl.contract.batches import BoolArray
from nlosctl.io.runs import run_starts

__all__ = ["LostSnapshots"]


class LostSnapshots:
    """Counts the runs of one snapshot id that have no good row; ``begun`` has one already, before the first row."""

    def __init__(self, begun: Any = None) -> None:
        self._whole = 0
        self._last: Any = begun
        self._last_is_good = True

    @property
    def count(self) -> int:
        """How many there are so far, the rows that came last being the last of their snapshot."""
        return self._whole + (not self._last_is_good)

    def add(self, ids: Any, bad: BoolArray | None) -> None:
        """Take the ids (N,) of all rows of a batch, and which rows are bad (None: none)."""
        good = np.ones(len(ids), dtype=np.bool_) if bad is None else ~bad
        if ids.null_count:
            there = np.asarray(pc.is_valid(ids).to_numpy(zero_copy_only=False), dtype=np.bool_)
            ids, good = ids.drop_null(), good[there]
        if len(ids) == 0:
            return
        first = ids[0].as_py()
        good_runs = good[:1] if bad is None else np.logical_or.reduceat(good, run_starts(ids, None))
        if first == self._last:
            good_runs[0] |= self._last_is_good
        else:
            self._whole += not self._last_is_good
        self._whole += int((~good_runs[:-1]).sum())
        self._last, self._last_is_good = ids[len(ids) - 1].as_py(), bool(good_runs[-1])
