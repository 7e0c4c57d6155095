"""Good rows of one batch with their contract columns: what snapshots are put together from."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from nlosctl.arrays import BoolArray, IntArray
from nlosctl.errors import DataError
from nlosctl.io.measurements.bad_rows import BadRow, Fault, Problem, ProblemLog
from nlosctl.io.measurements.column_mapping import SNAPSHOT
from nlosctl.io.measurements.mapped_file import OpenedPart
from nlosctl.io.measurements.normalize import Normalizer
from nlosctl.io.measurements.options import ReadReport
from nlosctl.io.measurements.snapshot_ids import LostSnapshots
from nlosctl.io.readers.base import RecordBatch, as_text, plain, text_at

__all__ = ["Piece", "join_pieces", "read_pieces"]


@dataclass(frozen=True, kw_only=True)
class Piece:
    """Good rows (N,) of one file: table, snapshot ids, contract columns, row numbers, lines of a text file.

    ``starts`` are the places where snapshots start.
    """

    file: str
    table: Any
    ids: Any
    rows: IntArray
    columns: dict[str, npt.NDArray[Any]]
    left_out: BoolArray
    lines: IntArray | None
    starts: IntArray = field(default_factory=lambda: np.empty(0, dtype=np.int64))

    def with_starts(self, starts: IntArray) -> Piece:
        """Return the piece with the places where snapshots start."""
        return replace(self, starts=starts)

    def line_at(self, place: int) -> int | None:
        """Return the line of the row at ``place``, or None where the file has no lines."""
        return None if self.lines is None else int(self.lines[place])

    def slice(self, start: int, stop: int) -> Piece:
        """Return the rows from ``start`` to ``stop``."""
        within = (self.starts >= start) & (self.starts < stop)
        return replace(
            self,
            table=self.table.slice(start, stop - start),
            ids=self.ids.slice(start, stop - start),
            rows=self.rows[start:stop],
            lines=None if self.lines is None else self.lines[start:stop],
            columns={name: values[start:stop] for name, values in self.columns.items()},
            left_out=self.left_out[start:stop],
            starts=self.starts[within] - start,
        )

    def kept(self, keep: BoolArray) -> Piece:
        """Return the rows where ``keep`` is true; every snapshot must keep at least its first row."""
        mask = pa.array(keep)
        return replace(
            self,
            table=self.table.filter(mask),
            ids=self.ids.filter(mask),
            rows=self.rows[keep],
            lines=None if self.lines is None else self.lines[keep],
            columns={name: values[keep] for name, values in self.columns.items()},
            left_out=self.left_out[keep],
            starts=np.cumsum(keep)[self.starts] - 1 if self.starts.shape[0] else self.starts,
        )

    def texts(self, place: int) -> dict[str, str | None]:
        """Return the row's cells as text, by column."""
        return {name: text_at(self.table.column(name), place) for name in self.table.column_names}


def join_pieces(pieces: Sequence[Piece]) -> Piece:
    """Return the pieces as one, without their lines; a single one is not copied."""
    if len(pieces) == 1:
        return pieces[0]
    shifts = np.cumsum([0, *(len(piece.ids) for piece in pieces[:-1])])
    names = dict.fromkeys(name for piece in pieces for name in piece.columns)
    return replace(
        pieces[0],
        table=pa.concat_tables([piece.table for piece in pieces]),
        ids=pa.concat_arrays([piece.ids for piece in pieces]),
        rows=np.concatenate([piece.rows for piece in pieces]),
        lines=None,
        columns={name: np.concatenate([_column(piece, name) for piece in pieces]) for name in names},
        left_out=np.concatenate([piece.left_out for piece in pieces]),
        starts=np.concatenate([piece.starts + shift for piece, shift in zip(pieces, shifts, strict=True)]),
    )


def _column(piece: Piece, name: str) -> npt.NDArray[Any]:
    """Return a column of a piece; where its file has no such column it is NaN (only numbers can be absent)."""
    found = piece.columns.get(name)
    return np.full(len(piece.ids), np.nan) if found is None else found


def read_pieces(
    opened: OpenedPart,
    schema: Any,
    normalizer: Normalizer,
    log: ProblemLog,
    lost: LostSnapshots,
    report: ReadReport,
) -> Iterator[Piece]:
    """Yield the good rows of an open file, conformed to ``schema``; bad ones go to ``log``.

    Raises DataError at the end if a column plainly holds another unit.
    """
    for raw in opened.source.batches():
        batch = raw.table.rename_columns(list(opened.names))
        normalized = normalizer.normalize(batch)
        ids, id_faults = _ids(batch, opened, schema)
        bad = _log_bad_rows(raw, batch, [*id_faults, *normalized.faults], opened, log)
        good_rows = batch.num_rows - (0 if bad is None else int(bad.sum()))
        report.rows += good_rows
        report.bad_rows += batch.num_rows - good_rows + len(raw.line_faults)
        lost.add(ids, bad)
        piece = Piece(
            file=opened.part.name,
            table=_conformed(batch, schema, opened),
            ids=ids,
            rows=raw.row_numbers(),
            columns=normalized.columns,
            left_out=normalized.left_out,
            lines=raw.lines,
        )
        yield piece if bad is None else piece.kept(~bad)
    normalizer.raise_if_too_large()


def _ids(batch: Any, opened: OpenedPart, schema: Any) -> tuple[Any, list[Fault]]:
    if not opened.plan.has_snapshot:
        return pa.array(np.zeros(batch.num_rows, dtype=np.int64)), []
    wanted = schema.field(SNAPSHOT).type
    integers = pa.types.is_integer(wanted)
    ids = plain(batch.column(SNAPSHOT))
    try:
        ids = ids.cast(pa.int64() if integers else pa.string())
    except pa.ArrowInvalid as error:
        raise DataError(f"{opened.part.name}, column 'snapshot': beyond 64-bit integers; store it as text") from error
    if not ids.null_count:
        return ids, []
    mask = np.asarray(ids.is_null().to_numpy(zero_copy_only=False), dtype=np.bool_)
    fault = Fault(mask=mask, column=SNAPSHOT, describe=lambda _: "empty (null), expected text or an integer")
    return ids, [fault]


def _conformed(batch: Any, schema: Any, opened: OpenedPart) -> Any:
    table = pa.Table.from_batches([batch])
    if table.schema.equals(schema):
        return table
    columns = [
        _cast(plain(batch.column(column.name)), column, opened)
        if column.name in table.column_names
        else pa.nulls(batch.num_rows, column.type)
        for column in schema
    ]
    return pa.table(columns, schema=schema)


def _cast(cells: Any, column: Any, opened: OpenedPart) -> Any:
    try:
        return as_text(cells) if pa.types.is_string(column.type) else cells.cast(column.type)
    except pa.ArrowInvalid as error:
        raise DataError(
            f"{opened.part.name}, column {opened.file_name(column.name)!r}: holds {cells.type}, and a value of it "
            f"can't be {column.type} as in the other files; give the column one type in all of them"
        ) from error


def _log_bad_rows(
    raw: RecordBatch, batch: Any, faults: Sequence[Fault], opened: OpenedPart, log: ProblemLog
) -> BoolArray | None:
    """Hand the bad rows to the log, each once with its first fault; return their mask, or None if all are good."""
    if not (raw.line_faults or raw.cell_faults or faults):
        return None
    first: dict[int, tuple[str, str]] = {}
    for cell in raw.cell_faults:
        first.setdefault(cell.index, (cell.column, cell.fault))
    bad = np.zeros(batch.num_rows, dtype=np.bool_)
    bad[list(first)] = True
    wanted = log.wanted()
    for fault in faults:
        places = np.flatnonzero(fault.mask & ~bad)
        for place in places[:wanted].tolist():
            first[place] = (opened.file_name(fault.column), fault.describe(place))
        bad |= fault.mask
    rows = [*_bad_lines(raw, opened), *_bad_cells(raw, batch, first, opened)]
    rows.sort(key=lambda row: row.problem.row or 0)
    log.add(rows[:wanted], total=int(bad.sum()) + len(raw.line_faults))
    return bad


def _bad_cells(raw: RecordBatch, batch: Any, first: dict[int, tuple[str, str]], opened: OpenedPart) -> Iterator[BadRow]:
    numbers = raw.row_numbers()
    cells = batch if raw.text is None else raw.text.rename_columns(list(opened.names))
    for place, (column, fault) in sorted(first.items()):
        row = int(numbers[place])
        line = None if raw.lines is None else int(raw.lines[place])
        yield BadRow(
            problem=Problem(file=opened.part.name, row=row, line=line, column=column, fault=fault),
            values={name: text_at(cells.column(name), place) for name in opened.names},
        )


def _bad_lines(raw: RecordBatch, opened: OpenedPart) -> Iterator[BadRow]:
    for fault in raw.line_faults:
        problem = Problem(file=opened.part.name, row=fault.row, line=fault.line, column=None, fault=fault.fault)
        yield BadRow(problem=problem, values={}, raw_line=fault.text)
