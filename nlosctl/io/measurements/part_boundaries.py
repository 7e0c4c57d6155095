"""Snapshots across the parts of a table: which begin in one part, and which of them continue in the parts after it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pyarrow.compute as pc

from nlosctl.io.measurements.row_batch import RowBatch
from nlosctl.io.paths.inputs import Part
from nlosctl.io.paths.locations import FileFormat
from nlosctl.io.readers.parquet_arrow import parquet_metadata

__all__ = ["PartBoundaries"]


@dataclass(frozen=True, kw_only=True)
class PartBoundaries:
    """Finds the snapshots that begin in ``parts[index]``: those whose first good row is there.

    ``read`` returns the good rows of another part and logs nothing. ``end_id`` returns the snapshot id of the first (0)
    or last (-1) row of a part as an Arrow scalar, or None if the part has to be read for it.
    """

    parts: Sequence[Part]
    index: int
    read: Callable[[Part], Iterator[RowBatch]]
    end_id: Callable[[Part, int], Any]

    def preceding_id(self) -> Any:
        """Return the snapshot id of the last good row before the part as an Arrow scalar, or None without one."""
        for part in reversed(self.parts[: self.index]):
            for tail in _tails(part):
                last = self.end_id(tail, -1)
                if last is None:
                    for rows in self.read(tail):
                        last = rows.ids[len(rows) - 1]
                if last is not None:
                    return last
        return None

    def rows(self, own: Iterator[RowBatch], preceding: Any) -> Iterator[RowBatch]:
        """Yield the good rows of the snapshots, given the part's ``own`` rows (all are read) and its `preceding_id`."""
        last = None
        for rows in own:
            if preceding is not None:
                head = _leading(rows, preceding)
                if head == len(rows):
                    continue
                rows, preceding = rows.slice(head, len(rows)), None
            last = rows.ids[len(rows) - 1]
            yield rows
        if last is not None:
            yield from self._following(last)

    def _following(self, last: Any) -> Iterator[RowBatch]:
        for part in self.parts[self.index + 1 :]:
            first = self.end_id(part, 0)
            if first is not None and first != last:
                return
            with closing(self.read(part)) as batches:  # type: ignore[type-var]
                for rows in batches:
                    count = _leading(rows, last)
                    if count:
                        yield rows.slice(0, count)
                    if count < len(rows):
                        return


def _leading(rows: RowBatch, identity: Any) -> int:
    """Return the number of rows at the beginning that belong to the snapshot ``identity``."""
    differs = np.asarray(pc.not_equal(rows.ids, identity).to_numpy(zero_copy_only=False), dtype=np.bool_)
    return int(np.argmax(differs)) if differs.any() else differs.shape[0]


def _tails(part: Part) -> Iterator[Part]:
    """Yield the row groups of a Parquet file from its end, any other file as it is."""
    if part.format is not FileFormat.PARQUET or part.path is None:
        yield part
        return
    start, stop = part.row_groups or (0, parquet_metadata(part.path).num_row_groups)
    for index in reversed(range(start, stop)):
        yield replace(part, row_groups=(index, index + 1))
