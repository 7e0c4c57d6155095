"""The rows of snapshots as one row each: what the states of a track carry of their measurements."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from nlosctl.arrays import FloatArray, IntArray
from nlosctl.contract.windows import TICKS_PER_SECOND
from nlosctl.errors import DataError
from nlosctl.io.measurements.reader import Chunk
from nlosctl.io.measurements.row_checks import TICKS
from nlosctl.io.results.evaluation_arrays import numbers

__all__ = ["SnapshotNumbers", "elapsed_times", "mean_ticks", "mean_times", "mean_truth", "one_row_each"]

_MEAN = ("truth_x_m", "truth_y_m", "truth_z_m", "truth_lat_deg", "truth_lon_deg")


class SnapshotNumbers:
    """Finds snapshots by source and id, numbered in the order in which their chunks were added."""

    def __init__(self) -> None:
        self._ids: dict[str, list[Any]] = {}
        self._numbers: dict[str, list[IntArray]] = {}
        self._count = 0

    def add(self, chunk: Chunk) -> None:
        """Number the snapshots of a chunk."""
        self._ids.setdefault(chunk.source, []).append(chunk.snapshot)
        numbers = np.arange(self._count, self._count + len(chunk.snapshot))
        self._numbers.setdefault(chunk.source, []).append(numbers)
        self._count += numbers.shape[0]

    def find(self, chunk: Chunk) -> IntArray:
        """Return the numbers (S,) of a chunk's snapshots; raises DataError for one that was not there."""
        at = pc.index_in(
            chunk.snapshot, value_set=pa.chunked_array(self._ids.get(chunk.source, []), chunk.snapshot.type)
        )
        if at.null_count:
            raise DataError(f"{chunk.source}: has changed while its tracks were found; run it again")
        return np.asarray(np.concatenate(self._numbers[chunk.source])[np.asarray(at)])


def one_row_each(chunk: Chunk, names: Sequence[str]) -> Chunk:
    """Return the snapshots of a chunk as one row each, with the columns ``names`` of its table.

    That is the first row, with the mean of the true positions of the rows that take part: those at the mean time.
    """
    first = pa.array(chunk.offsets[:-1])
    columns = {name: chunk.table.column(name).take(first) for name in names}
    for name in set(_MEAN) & columns.keys():
        columns[name] = _means(numbers(chunk.table.column(name)), columns[name], chunk)
    return Chunk(
        table=pa.table(columns),
        snapshot=chunk.snapshot,
        offsets=np.arange(len(chunk.snapshot) + 1),
        columns={},
        left_out=np.zeros(len(chunk.snapshot), dtype=np.bool_),
        source=chunk.source,
    )


def mean_truth(chunk: Chunk) -> dict[str, Any]:
    """Return the columns of true positions that a chunk has, by name: in each row (N,) the mean of its snapshot."""
    names = [name for name in _MEAN if name in chunk.table.column_names]
    rows = pa.array(np.repeat(np.arange(len(chunk.snapshot)), np.diff(chunk.offsets)))
    means = one_row_each(chunk, names).table
    return {name: means.column(name).take(rows) for name in names}


def _means(values: FloatArray, first: Any, chunk: Chunk) -> Any:
    """Return the means of the values (N,) of rows that take part, the first value where all are alike."""
    starts = chunk.offsets[:-1]
    least, most = np.minimum.reduceat(values, starts), np.maximum.reduceat(values, starts)
    if not (least < most).any():
        return first
    weight = _weights(chunk)
    mean = np.add.reduceat(weight * values, starts) / np.add.reduceat(weight, starts)
    chosen = np.where(least < most, mean, values[starts])
    return pa.array(chosen, pa.float64(), mask=np.isnan(chosen))


def _weights(chunk: Chunk) -> FloatArray:
    """Return 1 for the rows (N,) that take part, of a snapshot without any for all."""
    part = ~chunk.left_out
    some = np.add.reduceat(part, chunk.offsets[:-1], dtype=np.int64) > 0
    return (part | ~np.repeat(some, np.diff(chunk.offsets))).astype(np.float64)


def mean_ticks(chunk: Chunk) -> tuple[IntArray, FloatArray]:
    """Return the first time (S,) of each snapshot in ticks, and the mean (S,) of the rows that take part after it."""
    ticks, starts = chunk.columns[TICKS], chunk.offsets[:-1]
    first = np.minimum.reduceat(ticks, starts)
    weight = _weights(chunk)
    after = weight * (ticks - np.repeat(first, np.diff(chunk.offsets)))
    return first, np.add.reduceat(after, starts) / np.add.reduceat(weight, starts)


def mean_times(chunk: Chunk, column: str) -> FloatArray:
    """Return the mean time (S,) in seconds of the rows of each snapshot that take part."""
    if chunk.windows is not None:
        return chunk.windows.time_s
    first, mean = mean_ticks(chunk)
    whole, rest = np.divmod(first, TICKS_PER_SECOND[column])
    return np.asarray(whole + (rest + mean) / TICKS_PER_SECOND[column])


def elapsed_times(chunk: Chunk, column: str) -> FloatArray:
    """Return the times (N,) in seconds of rows after the mean of those of their snapshot that take part."""
    first, mean = mean_ticks(chunk)
    counts = np.diff(chunk.offsets)
    ticks = (chunk.columns[TICKS] - np.repeat(first, counts)) - np.repeat(mean, counts)
    return np.asarray(ticks / TICKS_PER_SECOND[column])
