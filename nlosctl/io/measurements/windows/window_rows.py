"""Snapshots from times: the rows of one input in windows, each part of the rows (``by``) by itself.

The result does not depend on the order of the rows: within a snapshot they are sorted by time, sensor and path, then by
all of their values. Rows are sorted in memory; beyond the setting ``max_sort_rows`` the input must be in order of its
times, and a grid of windows is cut as the rows are read.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from nlosctl.arrays import BoolArray, IntArray
from nlosctl.contract.run_options import InputOptions
from nlosctl.contract.window_starts import width_in_ticks, window_starts
from nlosctl.contract.windows import TICKS_PER_SECOND, parse_window, value_text, window_id
from nlosctl.errors import DataError
from nlosctl.io.measurements.column_mapping import NameCodes
from nlosctl.io.measurements.reader import Chunk
from nlosctl.io.measurements.row_batch import RowBatch, RowTally, join_rows
from nlosctl.io.measurements.row_checks import TICKS
from nlosctl.io.measurements.windows.window_chunks import LINE, ORIGIN, PART, WindowChunks
from nlosctl.io.measurements.windows.window_tally import tally_windows
from nlosctl.io.paths.inputs import Input
from nlosctl.io.readers.base import plain

__all__ = ["NumberedRows", "WindowedRows"]

NumberedRows = tuple[int, RowBatch]
"""Rows with the index of their part."""

_FURTHEST = np.iinfo(np.int64).max


@dataclass
class _Sorted:
    """Rows sorted by window, with the start of each row's window, its part (``by``) and the values of the parts."""

    rows: RowBatch
    start: IntArray
    group: IntArray
    values: Sequence[tuple[str, ...]]
    heads: IntArray = field(init=False)

    def __post_init__(self) -> None:
        changes = (np.diff(self.start) != 0) | (np.diff(self.group) != 0)
        self.heads = np.concatenate([[0], np.flatnonzero(changes) + 1])


class WindowedRows:
    """Cuts the rows of one input into windows; ``column`` has the times, ``names`` are those of the sensors."""

    def __init__(self, given: Input, column: str, options: InputOptions, tally: RowTally, names: NameCodes) -> None:
        self._given, self._column, self._options, self._tally, self._names = given, column, options, tally, names
        per_second = TICKS_PER_SECOND[column]
        self._width = width_in_ticks(parse_window(options.window or ""), per_second)
        self._first: dict[tuple[str, ...], int] = {}
        self._last: int | None = None
        self._pending: list[RowBatch] = []
        self._in_order = False
        self._chunks = WindowChunks(given, options, tally, self._width, per_second)

    def chunks(self, batches: Iterable[NumberedRows], row_key: Sequence[str], own: int | None) -> Iterator[Chunk]:
        """Yield the windows whose first row in the file is in the part with index ``own`` (None: all)."""
        count, waiting, limit = 0, 0, self._options.max_sort_rows
        for part, batch in batches:
            rows = _numbered(batch, part, count)
            count += len(rows)
            waiting += len(rows)
            if count > limit and not self._in_order:
                for earlier in self._pending:
                    self._require_order(earlier)
                self._in_order = True
            if self._in_order:
                self._require_order(rows)
            self._pending.append(rows)
            if self._in_order and isinstance(self._width, int) and waiting > limit:
                yield from self._cut(self._last, row_key, own)
                waiting = 0
        if self._pending:
            yield from self._cut(None, row_key, own)

    def _require_order(self, rows: RowBatch) -> None:
        ticks = rows.columns[TICKS]
        falls = np.flatnonzero(np.diff(ticks, prepend=ticks[0] if self._last is None else self._last) < 0)
        if falls.size:
            at = int(falls[0])
            raise DataError(
                f"{rows.file}, row {rows.rows[at]}, column {self._column!r}: the time is before that of the row above, "
                f"and more than {self._options.max_sort_rows} rows are not sorted; sort the file by "
                f"{self._column!r}, or raise `max_sort_rows`"
            )
        self._last = int(ticks[-1])

    def _cut(self, until: int | None, row_key: Sequence[str], own: int | None) -> Iterator[Chunk]:
        """Yield the windows that end at ``until`` or before (None: all); the other rows wait."""
        rows = join_rows(self._pending)
        ticks = rows.columns[TICKS]
        group, values = self._groups(rows)
        first = np.full(len(values), _FURTHEST, dtype=np.int64)
        np.minimum.at(first, group, ticks)
        for index, key in enumerate(values):
            first[index] = self._first.setdefault(key, int(first[index]))
        start = window_starts(ticks, group, first, self._epoch_sensors(rows), self._width)
        self._pending = []
        if until is not None:
            whole = until - start >= self._width
            self._pending = [] if whole.all() else [rows.take(np.flatnonzero(~whole))]
            rows, start, group = rows.take(np.flatnonzero(whole)), start[whole], group[whole]
        if not len(rows):
            return
        order = self._order(rows, start, group)
        sorted_rows = _Sorted(rows.take(order), start[order], group[order], values)
        settled = min((int(batch.columns[ORIGIN].min()) for batch in self._pending), default=int(_FURTHEST))
        mine = self._owned(sorted_rows, own)
        tally_windows(self._tally.report.windows, sorted_rows, mine, self._width)
        yield from self._chunks.of(sorted_rows, self._ids(sorted_rows), mine, settled, row_key)

    def _groups(self, rows: RowBatch) -> tuple[IntArray, list[tuple[str, ...]]]:
        """Return the part of each row (N,), and the values (as text) of the parts in their natural order."""
        codes = np.zeros(len(rows), dtype=np.int64)
        values: list[tuple[str, ...]] = [()]
        for name in self._options.by:
            cells = plain(rows.table.column(name).combine_chunks())
            cells = cells.cast(pa.string()) if pa.types.is_boolean(cells.type) else cells
            encoded = cells.dictionary_encode()
            order = pc.array_sort_indices(encoded.dictionary).to_numpy()
            rank = np.empty(len(order) + 1, dtype=np.int64)
            rank[order], rank[-1] = np.arange(len(order)), len(order)
            mine = rank[encoded.indices.fill_null(len(order)).to_numpy(zero_copy_only=False)]
            texts = [value_text(value) for value in encoded.dictionary.take(pa.array(order)).to_pylist()] + [""]
            used, codes = np.unique(codes * len(texts) + mine, return_inverse=True)
            values = [(*values[code // len(texts)], texts[code % len(texts)]) for code in used.tolist()]
        return codes, values

    def _sensor_ranks(self, rows: RowBatch) -> IntArray:
        """Return the rank (N,) of each row's sensor by its name; 0 without sensors."""
        if "sensor" not in rows.columns:
            return np.zeros(len(rows), dtype=np.int64)
        names = self._names.names
        rank = np.empty(len(names), dtype=np.int64)
        rank[sorted(range(len(names)), key=names.__getitem__)] = np.arange(len(names))
        return np.asarray(rank[rows.columns["sensor"]])

    def _epoch_sensors(self, rows: RowBatch) -> IntArray:
        """Return numbers (N,) of what reports again in a later epoch: a sensor, its reference, path and reflector."""
        numbers = self._sensor_ranks(rows)
        for name in ("reference", "path", "reflector"):
            if name in rows.columns:
                values = rows.columns[name]
                numbers = numbers * (int(values.max(initial=0)) + 2) + values + 1
        return numbers

    def _order(self, rows: RowBatch, start: IntArray, group: IntArray) -> IntArray:
        """Return the order (N,) of the rows; equal ones keep that of the input."""
        nothing = np.zeros(len(rows), dtype=np.int64)
        path = rows.columns.get("path", nothing)
        keys = [path, self._sensor_ranks(rows), rows.columns[TICKS], group, start]
        order = np.lexsort(keys)
        tied = np.ones(len(rows) - 1, dtype=np.bool_)
        for key in keys:
            tied &= np.diff(key[order]) == 0
        if tied.any():
            inside = np.concatenate([[False], tied]) | np.concatenate([tied, [False]])
            runs = np.cumsum(np.concatenate([[True], ~tied]))[inside]
            among = order[inside]
            names = sorted({*rows.columns} - {ORIGIN, PART, LINE, TICKS, "sensor", "path"}, reverse=True)
            order[inside] = among[
                np.lexsort([rows.columns[ORIGIN][among], *(rows.columns[name][among] for name in names), runs])
            ]
        return np.asarray(order)

    def _owned(self, made: _Sorted, own: int | None) -> BoolArray:
        """Return which snapshots (S,) begin in the part ``own``: by their first row in the file."""
        if own is None:
            return np.ones(made.heads.shape[0], dtype=np.bool_)
        origin, part = made.rows.columns[ORIGIN], made.rows.columns[PART]
        first = np.minimum.reduceat(origin, made.heads)
        ends = np.append(made.heads[1:], len(made.rows))
        at = np.flatnonzero(origin == np.repeat(first, ends - made.heads))
        return np.asarray(part[at] == own)

    def _ids(self, made: _Sorted) -> list[str]:
        by = self._options.by
        return [
            window_id(list(zip(by, made.values[group], strict=True)), start, self._column)
            for group, start in zip(made.group[made.heads].tolist(), made.start[made.heads].tolist(), strict=True)
        ]


def _numbered(rows: RowBatch, part: int, before: int) -> RowBatch:
    """Return the rows with their index in the input, their part and their line."""
    size = len(rows)
    lines = np.full(size, -1, dtype=np.int64) if rows.lines is None else np.asarray(rows.lines, dtype=np.int64)
    own = {ORIGIN: np.arange(before, before + size), PART: np.full(size, part), LINE: lines}
    return replace(rows, columns={**rows.columns, **own}, lines=None)
