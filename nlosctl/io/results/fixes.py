"""Positions with covariances at times, read from a table of estimates: what a path leads through."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from nlosctl.arrays import BoolArray, FloatArray, IntArray
from nlosctl.contract.limits import LARGEST_NUMBER
from nlosctl.contract.tables import FIXES
from nlosctl.contract.windows import TICKS_PER_SECOND
from nlosctl.errors import DataError, did_you_mean
from nlosctl.io.measurements.reader import Chunk
from nlosctl.io.measurements.row_checks import Fault
from nlosctl.io.measurements.windows.times import TimeColumn
from nlosctl.io.measurements.windows.window_columns import time_column
from nlosctl.io.paths.inputs import Input
from nlosctl.io.readers.base import plain
from nlosctl.io.readers.open_file import open_part
from nlosctl.io.results.evaluation_arrays import group_codes, has_heights, numbers
from nlosctl.io.results.layouts import COVARIANCE, POSITION
from nlosctl.io.results.reader import PlainReader

__all__ = ["FixTable", "are_fixes", "column_names", "read_fixes"]

_NUMBERED = ("method", "target")
_FROM_MEASUREMENTS = (
    ", or localize the measurements again with `carry` time_s (or time), which keeps the mean time of each snapshot"
)


@dataclass(frozen=True, kw_only=True)
class FixTable:
    """S fixes in the order of the file.

    ``table`` has their rows, ``time_s`` (S,) the times as written, ``elapsed_s`` (S,) those since the track's first.
    ``position_m`` (S, D) and ``covariance_m2`` (S, D, D) are NaN where unknown. ``key`` (S,) numbers the tracks
    by the columns ``by``; ``further`` is the number of alternatives that were left out.
    """

    table: Any
    time_s: FloatArray
    elapsed_s: FloatArray
    position_m: FloatArray
    covariance_m2: FloatArray
    key: IntArray
    further: int

    @property
    def methods(self) -> list[str]:
        """The method (S,) of each fix, ``track`` where the table has none."""
        if "method" not in self.table.column_names:
            return ["track"] * len(self.time_s)
        return [str(name) for name in pc.fill_null(self.table.column("method"), "track").to_pylist()]

    @property
    def frames(self) -> set[str]:
        """The local planes on earth that the fixes name."""
        if "frame" not in self.table.column_names:
            return set()
        return {text for text in pc.unique(self.table.column("frame")).to_pylist() if text}

    def integers(self, name: str, otherwise: int) -> IntArray:
        """Return a column (S,) of integers, ``otherwise`` where it is absent or null."""
        if name not in self.table.column_names:
            return np.full(len(self.time_s), otherwise, dtype=np.int64)
        values = numbers(self.table.column(name))
        return np.where(np.isfinite(values), values, otherwise).astype(np.int64)

    @property
    def scan(self) -> IntArray:
        """The number (S,) of each fix's snapshot; without such a column of its time."""
        if "snapshot" not in self.table.column_names:
            return np.asarray(np.unique(self.time_s, return_inverse=True)[1], dtype=np.int64)
        return group_codes(self.table, ["snapshot"])[0]

    def chunk(self, source: str) -> Chunk:
        """Return the fixes as a chunk of snapshots of one row each."""
        size = len(self.time_s)
        has_ids = "snapshot" in self.table.column_names
        return Chunk(
            table=self.table,
            snapshot=self.table.column("snapshot").combine_chunks() if has_ids else pa.array(np.arange(size)),
            offsets=np.arange(size + 1),
            columns={},
            left_out=np.zeros(size, dtype=np.bool_),
            source=source,
        )


def column_names(given: Input) -> tuple[str, ...]:
    """Return the columns of the first part of an input, whose stream it uses up."""
    opened = open_part(given.parts[0], 1, False)
    try:
        return tuple(opened.names)
    finally:
        opened.close()


def are_fixes(names: Sequence[str], measured: frozenset[str]) -> bool:
    """Return whether a table with these columns is one of estimates: it has positions and nothing ``measured``."""
    return {"x_m", "y_m"} <= set(names) and measured.isdisjoint(names)


def read_fixes(
    given: Input, by: Sequence[str], timezone: str | None, most_rows: int, *, several: bool = False
) -> FixTable:
    """Return the fixes of an input, the first alternative of each snapshot.

    Raises DataError without times, without a column of ``by``, for several methods or (unless there may be ``several``)
    targets in a track, and for more than ``most_rows`` rows.
    """
    with closing(PlainReader(given, FIXES)) as reader:
        names = reader.schema.names
        for name in by:
            if name not in names:
                near = did_you_mean(name, names)
                raise DataError(
                    f"{given.name}: `by` {name}: no column {name!r}{near}. The file has: {', '.join(names)}"
                )
        times = time_column(names, given.name, names, "the states of a track", _FROM_MEASUREMENTS)
        table = _all_rows(reader, given, most_rows)
    best = _best(table)
    further = table.num_rows - int(best.sum())
    rows = np.flatnonzero(best)
    table = table.take(pa.array(rows)).combine_chunks()
    key, _ = group_codes(table, list(by))
    time_s, elapsed_s = _times(table, times, given.name, timezone, rows, key)
    _refuse_several(table, (*by, "target") if several else by, key, given.name)
    dimension = 3 if has_heights(names) else 2
    position = np.stack([numbers(table.column(name)) for name in POSITION[:dimension]], axis=1)
    entries = [numbers(table.column(name)) for name in COVARIANCE[: dimension * (dimension + 1) // 2]]
    if np.nanmax(np.abs(position), initial=0.0) > LARGEST_NUMBER:
        raise DataError(f"{given.name}: positions beyond {LARGEST_NUMBER:g} m; correct them")
    covariance = np.empty((len(rows), dimension, dimension))
    for one in range(dimension):
        for other in range(one + 1):
            entry = entries[one * (one + 1) // 2 + other]
            covariance[:, one, other] = covariance[:, other, one] = entry
    return FixTable(
        table=table,
        time_s=time_s,
        elapsed_s=elapsed_s,
        position_m=position,
        covariance_m2=covariance,
        key=key,
        further=further,
    )


def _all_rows(reader: PlainReader, given: Input, most: int) -> Any:
    batches, count = [], 0
    for batch in reader.batches():
        count += batch.num_rows
        if count > most:
            raise DataError(
                f"{given.name}: more than {most} rows, which a track needs in memory; track parts of the file one by "
                "one, or raise `max_sort_rows`"
            )
        batches.append(batch)
    if not count:
        raise DataError(f"{given.name}: no rows")
    return pa.concat_tables(batches)


def _best(table: Any) -> BoolArray:
    if "alternative" not in table.column_names:
        return np.ones(table.num_rows, dtype=np.bool_)
    return np.asarray(~(numbers(table.column("alternative")) > 0.0))


def _times(
    table: Any, column: str, file: str, timezone: str | None, rows: IntArray, key: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Return the times (S,), and those since the track's first; raise DataError for one that can't be read."""
    faults: list[Fault] = []
    cells = plain(table.column(column).combine_chunks())
    ticks = TimeColumn(column, column, file, timezone).ticks(cells, rows + 1, faults)
    for fault in faults:
        at = int(np.flatnonzero(fault.mask)[0])
        more = int(fault.mask.sum()) - 1
        others = f" (and {more} more rows)" if more else ""
        raise DataError(f"{file}, row {rows[at] + 1}, column {column!r}: {fault.describe(at)}{others}")
    if column == "time_s":
        time_s = numbers(cells)
        first_s = np.full(int(key.max()) + 1, np.inf)
        np.minimum.at(first_s, key, time_s)
        return time_s, time_s - first_s[key]
    per_second = TICKS_PER_SECOND[column]
    whole, rest = np.divmod(ticks, per_second)
    first = np.full(int(key.max()) + 1, np.iinfo(np.int64).max)
    np.minimum.at(first, key, ticks)
    return whole + rest / per_second, (ticks - first[key]) / per_second


def _refuse_several(table: Any, by: Sequence[str], key: IntArray, file: str) -> None:
    """Raise DataError for estimates of several methods or targets that no column of ``by`` separates."""
    for name in _NUMBERED:
        if name not in table.column_names or name in by:
            continue
        codes, _ = group_codes(table, [name])
        first = np.full(int(key.max()) + 1, -1)
        first[key[::-1]] = codes[::-1]
        if (codes != first[key]).any():
            values = [str(value) for value in dict.fromkeys(table.column(name).to_pylist())][:5]
            raise DataError(
                f"{file}, column {name!r}: a track of several {name}s ({', '.join(values)}); add {name} to `by`, or "
                "leave out the others"
            )
