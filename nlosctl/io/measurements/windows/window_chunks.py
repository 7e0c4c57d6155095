"""Chunks of windows, with all rows of a sensor in a window, the nearest to its centre, or their mean."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from nlosctl.arrays import BoolArray, FloatArray, IntArray
from nlosctl.contract.run_options import InputOptions
from nlosctl.errors import DataError, UsageError
from nlosctl.io.measurements.column_mapping import NULL_CODE, SNAPSHOT
from nlosctl.io.measurements.duplicates import find_duplicates
from nlosctl.io.measurements.reader import Chunk
from nlosctl.io.measurements.row_batch import RowBatch, RowTally
from nlosctl.io.measurements.row_checks import TICKS, BadRow, Problem
from nlosctl.io.measurements.windows.chunk_windows import WindowRows
from nlosctl.io.measurements.windows.window_means import merged_columns
from nlosctl.io.paths.inputs import Input
from nlosctl.io.readers.base import text_at

__all__ = ["LINE", "ORIGIN", "PART", "WindowChunks"]

ORIGIN, PART, LINE = "origin", "part", "line"
"""Columns of a row batch: index in the input, index of the part, and line (-1: not a text file)."""

_OF_WINDOWS = frozenset({ORIGIN, PART, LINE, TICKS, "time_offset"})
"""Columns that only windows need."""

_DUPLICATE_CURE = "drop one, number them in a 'path' column, or set `window_keep` to nearest or mean"


class SortedRows(Protocol):
    """Rows sorted by window, with the start of each row's window and the first row of each."""

    rows: RowBatch
    start: IntArray
    heads: IntArray


@dataclass(frozen=True)
class _Piece:
    """The rows of some windows: ``offsets`` (S+1,), the start (S,) of each window, and its id (S,)."""

    rows: RowBatch
    offsets: IntArray
    start: IntArray
    ids: Sequence[str]

    @property
    def window(self) -> IntArray:
        """The number (N,) of each row's window."""
        return np.repeat(np.arange(self.start.shape[0]), np.diff(self.offsets))

    def without(self, bad: BoolArray) -> _Piece:
        """Return the piece without ``bad`` rows (N,), and without windows that have no other row."""
        good = np.add.reduceat(~bad, self.offsets[:-1], dtype=np.int64)
        some = good > 0
        return _Piece(
            rows=self.rows.take(np.flatnonzero(~bad)),
            offsets=np.concatenate([[0], np.cumsum(good[some])]),
            start=self.start[some],
            ids=[name for name, has_rows in zip(self.ids, some.tolist(), strict=True) if has_rows],
        )


class WindowChunks:
    """Makes the chunks of one input; ``width`` is in ticks, ``per_second`` in a second."""

    def __init__(self, given: Input, options: InputOptions, tally: RowTally, width: Any, per_second: int) -> None:
        self._given, self._options, self._tally = given, options, tally
        self._width, self._per_second = width, per_second

    def of(
        self, made: SortedRows, ids: Sequence[str], mine: BoolArray, settled: int, row_key: Sequence[str]
    ) -> Iterator[Chunk]:
        """Yield the windows ``mine`` (S,); rows that follow have indices from ``settled``."""
        ends = np.append(made.heads[1:], len(made.rows))
        later = np.minimum.accumulate(np.append(made.rows.columns[ORIGIN], settled)[::-1])[::-1]
        first = 0
        while first < ends.shape[0]:
            begin = int(made.heads[first])
            last = max(int(np.searchsorted(ends, begin + self._options.chunk_rows, side="right")), first + 1)
            stop = int(ends[last - 1])
            wanted = mine[first:last]
            if wanted.any():
                heads = made.heads[first:last]
                piece = _Piece(
                    rows=made.rows.slice(begin, stop),
                    offsets=np.append(heads, stop) - begin,
                    start=made.start[heads],
                    ids=ids[first:last],
                )
                if not wanted.all():
                    piece = piece.without(np.repeat(~wanted, np.diff(piece.offsets)))
                chunk = self._chunk(piece, int(later[stop]), row_key)
                if chunk is not None:
                    yield chunk
            first = last

    def _chunk(self, piece: _Piece, settled: int, row_key: Sequence[str]) -> Chunk | None:
        if not len(piece.rows):
            return None
        most = self._options.max_snapshot_rows
        if int(np.diff(piece.offsets).max()) > most:
            raise DataError(
                f"{self._given.name}: a window has more than {most} rows, expected at most max_snapshot_rows; make "
                "`window` shorter, or raise `max_snapshot_rows` if that is meant"
            )
        keep = self._options.window_keep
        kept = piece.rows.columns
        leader = np.arange(len(piece.rows))
        if keep == "all":
            piece = self._without_duplicates(piece, row_key)
            leader = np.arange(len(piece.rows))
            kept = piece.rows.columns
        elif keep == "nearest":
            leader = _nearest(piece, self._width)
        elif "arrival_m" in kept:
            raise UsageError("`window_keep` mean is not for arrivals, which have no mean; set it to all or nearest")
        else:
            leader = _first_of_sensor(piece)
            kept, opposite = merged_columns(kept, leader, piece.start[piece.window])
            if opposite.any():
                self._log(piece, np.flatnonzero(opposite), _opposite_fault)
                return self._chunk(piece.without(opposite), settled, row_key)
        dropped = _OF_WINDOWS - {TICKS} if self._options.keep_times else _OF_WINDOWS
        if self._options.keep_times and "time_offset" in kept:
            kept = {**kept, TICKS: piece.start[piece.window] + np.rint(kept["time_offset"]).astype(np.int64)}
        rows = piece.rows
        left_out = rows.left_out | (leader != np.arange(len(rows)))
        window = piece.window
        snapshot = pa.array(piece.ids, pa.string())
        return Chunk(
            table=rows.table.add_column(0, SNAPSHOT, snapshot.take(pa.array(window))),
            snapshot=snapshot,
            offsets=piece.offsets,
            columns={name: values for name, values in kept.items() if name not in dropped},
            left_out=left_out,
            source=self._given.name,
            windows=WindowRows(
                origin=rows.columns[ORIGIN],
                settled=settled,
                source=self._given.name,
                time_s=self._mean_times(piece, kept, left_out),
                leader=leader,
            ),
        )

    def _without_duplicates(self, piece: _Piece, row_key: Sequence[str]) -> _Piece:
        """Return the piece without rows that repeat an earlier one at the same time (numbered paths: at any time)."""
        names = [name for name in row_key if name in piece.rows.columns]
        if not names:
            return piece
        columns = piece.rows.columns
        path = columns.get("path")
        ticks = columns[TICKS] if path is None else np.where(path == NULL_CODE, columns[TICKS], 0)
        repeated, first = find_duplicates(piece.offsets, [*(columns[name] for name in names), ticks])
        if not repeated.size:
            return piece
        # the later of two is that which is later in the file
        origin = columns[ORIGIN]
        swapped = origin[repeated] < origin[first]
        later, earlier = np.where(swapped, first, repeated), np.where(swapped, repeated, first)
        rows = dict(zip(later.tolist(), piece.rows.rows[earlier].tolist(), strict=True))

        def fault(index: int) -> str:
            return (
                f"duplicate measurement: same window, time, {', '.join(names)} as row {rows[index]}; {_DUPLICATE_CURE}"
            )

        bad = np.zeros(len(piece.rows), dtype=np.bool_)
        bad[later] = True
        self._log(piece, np.flatnonzero(bad), fault)
        return piece.without(bad)

    def _log(self, piece: _Piece, indices: IntArray, fault: Any) -> None:
        """Log rows of the piece as bad, in the order of the file."""
        rows, report = piece.rows, self._tally.report
        indices = indices[np.argsort(rows.columns[ORIGIN][indices])]
        bad = []
        for index in indices[: self._tally.log.wanted()].tolist():
            line = int(rows.columns[LINE][index])
            problem = Problem(
                file=self._given.parts[int(rows.columns[PART][index])].name,
                row=int(rows.rows[index]),
                line=None if line < 0 else line,
                column=None,
                fault=fault(index),
            )
            values = {name: text_at(rows.table.column(name), index) for name in rows.table.column_names}
            bad.append(BadRow(problem=problem, values=values))
        some = np.zeros(len(rows), dtype=np.bool_)
        some[indices] = True
        report.snapshots_lost += int(np.logical_and.reduceat(some, piece.offsets[:-1]).sum())
        self._tally.log.add(bad, total=indices.shape[0])
        report.rows -= indices.shape[0]
        report.bad_rows += indices.shape[0]

    def _mean_times(self, piece: _Piece, kept: Any, left_out: BoolArray) -> FloatArray:
        """Return the mean time (S,) in seconds of the rows that take part (of all, if none does)."""
        window, size = piece.window, piece.start.shape[0]
        offset = kept.get("time_offset", piece.rows.columns[TICKS] - piece.start[window])
        weight = (~left_out).astype(np.float64)
        none = np.bincount(window, weight, minlength=size) == 0.0
        weight[none[window]] = 1.0
        mean = np.bincount(window, weight * offset, minlength=size) / np.bincount(window, weight, minlength=size)
        whole, rest = np.divmod(piece.start, self._per_second)
        return np.asarray(whole + (rest + mean) / self._per_second)


def _opposite_fault(index: int) -> str:
    return "the directions of this sensor in the window cancel: they have no mean; make `window` shorter"


def _sensor_runs(piece: _Piece) -> tuple[IntArray, IntArray]:
    """Return an order (N,) that puts the rows of a sensor in a window together, and the number (N,) of each such run.

    A sensor is one with its reference, path and reflector (triplets: transmitter, receiver, path). Rows that an earlier
    step flagged are runs by themselves.
    """
    columns = piece.rows.columns
    names = (
        ("sensor", "reference", "path", "reflector")
        if "sensor" in columns
        else ("tx_x_m", "tx_y_m", "rx_x_m", "rx_y_m", "path")
    )
    alone = np.where(piece.rows.left_out, np.arange(len(piece.rows)), -1)
    keys: list[npt.NDArray[Any]] = [alone, *(columns[name] for name in names if name in columns), piece.window]
    order = np.lexsort(keys)
    begins = np.zeros(len(piece.rows), dtype=np.bool_)
    begins[:1] = True
    for key in keys:
        begins[1:] |= np.diff(key[order]) != 0
    return order, np.cumsum(begins) - 1


def _first_of_sensor(piece: _Piece) -> IntArray:
    """Return the first row (N,) of each row's sensor in its window."""
    order, run = _sensor_runs(piece)
    leader = np.empty(len(piece.rows), dtype=np.int64)
    leader[order] = order[np.flatnonzero(np.diff(run, prepend=-1))][run]
    return leader


def _nearest(piece: _Piece, width: Any) -> IntArray:
    """Return each row (N,) that is the nearest of its sensor to the centre of its window, -1 for the others.

    Of two as near the earlier is kept, of two at one time the first in the file. The centre of an epoch, and of one
    window for all rows, is half-way between its first and last row.
    """
    order, run = _sensor_runs(piece)
    ticks, window, origin = piece.rows.columns[TICKS], piece.window, piece.rows.columns[ORIGIN]
    span = np.maximum.reduceat(ticks, piece.offsets[:-1]) - piece.start
    twice_centre = np.full(span.shape, width) if isinstance(width, int) else span
    distance = np.abs(2 * (ticks - piece.start[window]) - twice_centre[window])
    run_of = np.empty_like(run)
    run_of[order] = run
    by_distance = np.lexsort((origin, ticks, distance, run_of))
    best = by_distance[np.flatnonzero(np.diff(run_of[by_distance], prepend=-1))]
    leader = np.full(len(piece.rows), -1, dtype=np.int64)
    leader[best] = best
    return leader
