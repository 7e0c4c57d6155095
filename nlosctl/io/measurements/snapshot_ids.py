"""Snapshots in a column of ids: where each begins, and whether one comes back after others."""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from nlosctl.arrays import BoolArray, IntArray
from nlosctl.errors import DataError
from nlosctl.io.measurements.id_index import IdHistory, IdSet, SeenId
from nlosctl.io.paths.file_format import FileFormat
from nlosctl.io.paths.inputs import Input

__all__ = ["REMEMBERED_SNAPSHOTS", "IdSpan", "LostSnapshots", "ReturnWatch", "run_starts", "sort_hint"]

REMEMBERED_SNAPSHOTS = 1_000_000


def run_starts(ids: Any, before: Any) -> IntArray:
    """Return the places where ``ids`` (Arrow, no nulls) differs from the row before; ``before`` precedes the first."""
    if len(ids) == 0:
        return np.empty(0, dtype=np.int64)
    if pa.types.is_integer(ids.type):
        values = ids.to_numpy()
        changes = np.flatnonzero(values[1:] != values[:-1]) + 1
    else:
        differs = pc.not_equal(ids.slice(1), ids.slice(0, len(ids) - 1))
        changes = np.flatnonzero(differs.to_numpy(zero_copy_only=False)) + 1
    if before is None or ids[0].as_py() != before:
        changes = np.concatenate([np.zeros(1, dtype=np.int64), changes])
    return changes


@dataclass(frozen=True, kw_only=True)
class IdSpan:
    """The first and the last snapshot id of some rows (None: no row), and whether the ids rise or fall strictly."""

    first: int | str | None
    last: int | str | None
    ordered: bool


class ReturnWatch:
    """Finds a snapshot whose rows come back after those of others.

    Exact while the ids rise, or fall, strictly; else over the last million snapshots at least. ``column`` is the
    file's name for the ids, ``cure`` what to do about it: both for the message.
    """

    def __init__(self, column: str, cure: str, remembered: int = REMEMBERED_SNAPSHOTS) -> None:
        self._column, self._cure = column, cure
        self._history = IdHistory(remembered)
        self._seen = IdSet(remembered)
        self._last: Any = None
        self._sorted = True
        self._direction = 0
        self._first: Any = None

    def add(self, part: str, ids: Any, rows: IntArray) -> None:
        """Take the ids at run starts, and their row numbers in ``part``; raise DataError for one seen before."""
        if len(ids) == 0:
            return
        if self._sorted and self._still_sorted(ids):
            self._history.add(part, ids, rows)
        else:
            if self._sorted:
                self._sorted = False
                self._history.hand_over(self._seen)
            seen = self._seen.add(part, ids, rows)
            if seen is not None:
                raise DataError(self._came_back(ids[seen.place].as_py(), seen, (part, int(rows[seen.place]))))
        if self._first is None:
            self._first = ids[0]
        self._last = ids[len(ids) - 1]

    @property
    def span(self) -> IdSpan:
        """The ids taken so far: their ends, and whether all between lie between them."""
        if self._first is None:
            return IdSpan(first=None, last=None, ordered=True)
        return IdSpan(first=self._first.as_py(), last=self._last.as_py(), ordered=self._sorted)

    def _still_sorted(self, ids: Any) -> bool:
        if self._last is not None:
            ids = pa.concat_arrays([pa.array([self._last.as_py()], ids.type), ids])
        if len(ids) == 1:
            return True
        if self._direction == 0:
            self._direction = 1 if ids[1].as_py() > ids[0].as_py() else -1
        if pa.types.is_integer(ids.type):
            values = ids.to_numpy()
            rising = values[1:] > values[:-1] if self._direction > 0 else values[1:] < values[:-1]
            return bool(rising.all())
        compare = pc.greater if self._direction > 0 else pc.less
        return bool(pc.all(compare(ids.slice(1), ids.slice(0, len(ids) - 1))).as_py())

    def _came_back(self, identity: Any, earlier: SeenId, later: tuple[str, int]) -> str:
        return (
            f"{later[0]}, row {later[1]}, column {self._column!r}: {identity!r} comes back after other snapshots "
            f"(before: {earlier.part}, row {earlier.row}), expected the rows of a snapshot together; {self._cure}"
        )


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


_READ_BY_DUCKDB = frozenset(set(FileFormat) - {FileFormat.ARROW, FileFormat.ARROW_STREAM})


def sort_hint(given: Input, column: str) -> str:
    """Return how to sort an input by ``column``, as the file names it; the format is one that DuckDB reads."""
    formats = {part.format for part in given.parts}
    if len(formats) > 1 or not formats <= _READ_BY_DUCKDB:
        return f"sort the rows by {column!r}"
    file, first = given.name, given.parts[0]
    if first.path is None:
        file = "FILE"
    elif given.path != first.path:
        suffixes = first.path.suffixes[-2:] if first.format.compressed else first.path.suffixes[-1:]
        file = f"{file.rstrip('/')}/**/*{''.join(suffixes)}"
    name = column if re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", column) else '"' + column.replace('"', '""') + '"'
    quoted = file.replace("'", "''")
    statement = f"COPY (SELECT * FROM '{quoted}' ORDER BY {name}) TO 'sorted.parquet'"  # noqa: S608 - shown, not run
    shell = f'"{statement}"' if not re.search(r'["$`\\!]', statement) else shlex.quote(statement)
    return f"sort the file: duckdb -c {shell}"
