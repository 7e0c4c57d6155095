"""Rows of a result put back into the order of the input, where snapshots are windows of time."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pyarrow as pa

from nlosctl.arrays import IntArray
from nlosctl.io.measurements.windows.chunk_windows import WindowRows

__all__ = ["InputOrder", "row_indices"]


def row_indices(windows: WindowRows, methods: int) -> IntArray:
    """Return the indices in the input of a chunk's flags, which are sorted by them: a row per method for each."""
    return np.repeat(np.sort(windows.origin), methods)


class InputOrder:
    """Holds rows until no earlier row of their input can follow."""

    def __init__(self) -> None:
        self._source = ""
        self._tables: list[Any] = []
        self._indices: list[IntArray] = []

    def add(self, table: Any, indices: IntArray, settled: int, source: str) -> Iterator[Any]:
        """Yield the rows (as tables) that are in order, given further rows (N,) of the input ``source``.

        No later row of that input has an index below ``settled``.
        """
        if source != self._source:
            yield from self.rest()
        self._source = source
        self._tables.append(table)
        self._indices.append(indices)
        if min(int(known.min(initial=settled)) for known in self._indices) >= settled:
            return
        ordered, index = self._ordered()
        count = int(np.searchsorted(index, settled))
        self._tables, self._indices = [ordered.slice(count)], [index[count:]]
        yield ordered.slice(0, count)

    def rest(self) -> Iterator[Any]:
        """Yield the rows that are left, in order."""
        if self._tables:
            yield self._ordered()[0]
        self._tables, self._indices = [], []

    def _ordered(self) -> tuple[Any, IntArray]:
        index = np.concatenate(self._indices)
        order = np.argsort(index, kind="stable")
        return pa.concat_tables(self._tables).take(pa.array(order)), index[order]
