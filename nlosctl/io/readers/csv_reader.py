"""Reader of CSV, plain or gzipped: streamed, every cell first taken as text, so that a fault has a row and column."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import IO, Any

import numpy as np
import pyarrow as pa
import pyarrow.csv

from nlosctl.arrays import IntArray
from nlosctl.contract.tables import ColumnType
from nlosctl.errors import DataError
from nlosctl.io.paths.inputs import Part
from nlosctl.io.readers.base import CellFault, LineFault, RecordBatch, closed_on_failure, readable
from nlosctl.io.readers.csv_records import CsvBlock, RecordBlocks
from nlosctl.io.readers.text_files import (
    arrow_type_of,
    convert_text,
    decode_utf8,
    identifier_type,
    infer_type,
    open_bytes,
    refuse_wrong_column,
    wider_type,
)

__all__ = ["CsvReader"]


@dataclass(frozen=True, kw_only=True)
class _Parsed:
    """A block as columns of bytes, the line of each row, and lines that are no rows (by their place in the block)."""

    table: Any
    lines: IntArray
    bad: Sequence[tuple[int, str, str]]


class CsvReader:
    """A CSV file.

    Columns that the contract does not know get the narrowest type that all their cells fit: a large file is read
    once more for that if such columns are wanted. A stream can't be, so the first block (4 MiB of text) decides,
    and a later cell that does not fit is an error of the file. The first block also decides whether an identifier
    holds integers; a later one that does not fit is a bad row.
    """

    metadata: Mapping[bytes, bytes] = {}

    def __init__(self, part: Part, batch_rows: int) -> None:
        self._part, self._batch_rows = part, batch_rows
        self._what = "gzipped CSV file" if part.format.compressed else "CSV file"
        with readable(part.name, self._what):
            self._stream: IO[bytes] = open_bytes(part)
        with readable(part.name, self._what), closed_on_failure(self._stream):
            self._records = RecordBlocks(self._stream, part.name)
            self.names: tuple[str, ...] = _names(self._records.header(), part.name)
        self._kept: list[str] = list(self.names)
        self._types: dict[str, ColumnType] = {}
        self._hints: dict[str, str] = {}
        self._guessed: frozenset[str] = frozenset()
        self._blocks: Iterator[CsvBlock] = iter(())
        self._first: _Parsed | None = None

    def start(self, types: Mapping[str, ColumnType], columns: Sequence[str] | None) -> Any:
        """See FormatReader; reads the first block to decide the types that the contract leaves open."""
        self._kept = list(self.names if columns is None else columns)
        with readable(self._part.name, self._what):
            self._blocks = self._records.blocks()
            block = next(self._blocks, None)
            self._first = None if block is None else self._parse(block, self._kept)
            unknown = [name for name in self._kept if name not in types]
            self._types = {**types, **self._survey(unknown)}
        for name in self._kept:
            if self._first is None:
                continue
            cells, _ = decode_utf8(self._first.table.column(name), name)
            if self._types[name] == "identifier":
                self._types[name] = identifier_type(cells)
                if self._types[name] == "integer":
                    self._hints[name] = f" as in the first {self._first.table.num_rows} rows"
            elif name in types:
                refuse_wrong_column(cells, types[name], self._part.name, name)
        return pa.schema([(name, arrow_type_of(self._types[name])) for name in self._kept])

    def _survey(self, unknown: Sequence[str]) -> dict[str, ColumnType]:
        """Return the types of columns that the contract does not know: text where there is nothing in them."""
        if self._first is None or not unknown:
            return dict.fromkeys(unknown, "text")
        found: dict[str, ColumnType | None] = dict.fromkeys(unknown)
        if self._records.at_end or self._part.path is None:
            self._guessed = frozenset() if self._records.at_end else frozenset(unknown)
            _widen(found, self._first.table)
        else:
            with open_bytes(self._part) as stream:
                records = RecordBlocks(stream, self._part.name)
                records.header()
                for block in records.blocks():
                    open_yet = [name for name, kind in found.items() if kind != "text"]
                    if not open_yet:
                        break
                    _widen(found, self._parse(block, open_yet).table)
        return {name: kind or "text" for name, kind in found.items()}

    def _parse(self, block: CsvBlock, columns: list[str]) -> _Parsed:
        bad: list[tuple[int, str, str]] = []
        utf8 = _is_utf8(block.content)

        def take_bad_line(line: Any) -> str:
            fault = f"the line has {line.actual_columns} fields, expected {line.expected_columns} as in the header"
            text = line.text if utf8 else line.text.encode("latin-1").decode("utf-8", "backslashreplace")
            bad.append((line.number - 1, fault, text))
            return "skip"

        if block.lines.shape[0] == 0:
            return _Parsed(
                table=pa.schema([(name, pa.binary()) for name in columns]).empty_table(), lines=block.lines, bad=bad
            )
        with _signals_left_to_python():
            table = pyarrow.csv.read_csv(
                pa.BufferReader(block.content),
                read_options=pyarrow.csv.ReadOptions(
                    use_threads=False,
                    block_size=2 * len(block.content) + 1,
                    column_names=list(self.names),
                    encoding="utf8" if utf8 else "latin-1",  # each byte as a character: pyarrow can't tell of others
                ),
                parse_options=pyarrow.csv.ParseOptions(newlines_in_values=True, invalid_row_handler=take_bad_line),
                convert_options=pyarrow.csv.ConvertOptions(
                    check_utf8=False,
                    strings_can_be_null=True,
                    quoted_strings_can_be_null=True,
                    null_values=[""],
                    column_types={name: pa.binary() for name in self.names},
                    include_columns=columns,
                ),
            ).combine_chunks()
        if table.num_rows + len(bad) != block.lines.shape[0]:
            raise DataError(f"{self._part.name}: after line {block.lines[0]}: cells in quotes can't be told apart")
        return _Parsed(table=table if utf8 else _as_bytes(table), lines=block.lines, bad=bad)

    def batches(self) -> Iterator[RecordBatch]:
        """See FormatReader."""
        before = 0
        with readable(self._part.name, self._what):
            parsed, self._first = self._first, None
            while parsed is not None:
                yield from self._in_batches(parsed, before)
                before += parsed.lines.shape[0]
                block = next(self._blocks, None)
                parsed = None if block is None else self._parse(block, self._kept)

    def _in_batches(self, parsed: _Parsed, before: int) -> Iterator[RecordBatch]:
        """Yield the rows of a block, which ``before`` rows precede, good or not; a bad line goes with the next rows."""
        bad = [
            LineFault(row=before + place + 1, line=int(parsed.lines[place]), fault=fault, text=text)
            for place, fault, text in parsed.bad
        ]
        good = np.ones(parsed.lines.shape[0], dtype=np.bool_)
        good[[place for place, _, _ in parsed.bad]] = False
        places = np.flatnonzero(good)
        count = parsed.table.num_rows
        for start in range(0, max(count, 1), self._batch_rows):
            here = places[start : start + self._batch_rows]
            rows = before + here + 1
            ends = start + self._batch_rows >= count
            told = [line for line in bad if ends or line.row < rows[-1]]
            bad = bad[len(told) :]
            yield self._converted(parsed.table.slice(start, self._batch_rows), rows, parsed.lines[here], told)

    def _converted(self, table: Any, rows: IntArray, lines: IntArray, told: Sequence[LineFault]) -> RecordBatch:
        texts, columns, faults = [], [], list[CellFault]()
        for name in self._kept:
            cells, unreadable = decode_utf8(_one_chunk(table.column(name)), name)
            column, unfit = convert_text(cells, self._types[name], name, self._hints.get(name, ""))
            if unfit and name in self._guessed:
                raise self._misguessed(unfit[0], int(lines[unfit[0].index]))
            faults += unreadable + unfit
            texts.append(cells)
            columns.append(column)
        return RecordBatch(
            table=pa.RecordBatch.from_arrays(columns, names=self._kept),
            first_row=0,
            rows=rows,
            lines=lines,
            text=pa.RecordBatch.from_arrays(texts, names=self._kept),
            cell_faults=faults,
            line_faults=told,
        )

    def _misguessed(self, fault: CellFault, line: int) -> DataError:
        return DataError(
            f"{self._part.name}, line {line}, column {fault.column!r}: {fault.fault} as before; the type of a column "
            f"of your own is told by the first 4 MiB of a stream: save it as a file, and all of it is looked at"
        )

    def close(self) -> None:
        """Close the file."""
        self._stream.close()


@contextmanager
def _signals_left_to_python() -> Iterator[None]:
    """Keep Arrow from taking Ctrl-C while it parses: one that comes as it ends is lost. A block is short."""
    pa.enable_signal_handlers(False)
    try:
        yield
    finally:
        pa.enable_signal_handlers(True)


def _is_utf8(content: bytes) -> bool:
    try:
        content.decode("utf-8")
    except UnicodeDecodeError:
        return False
    return True


def _as_bytes(table: Any) -> Any:
    """Return a table that was read as Latin-1 with the bytes that were in the file."""
    columns = [
        pa.array(
            [None if cell is None else cell.decode().encode("latin-1") for cell in column.to_pylist()], column.type
        )
        for column in table.columns
    ]
    return pa.table(columns, names=table.column_names)


def _widen(found: dict[str, ColumnType | None], table: Any) -> None:
    for name in table.column_names:
        if name in found:
            cells, _ = decode_utf8(_one_chunk(table.column(name)), name)
            found[name] = wider_type(found[name], infer_type(cells))


def _one_chunk(column: Any) -> Any:
    whole = column.combine_chunks()
    return pa.concat_arrays(whole.chunks) if isinstance(whole, pa.ChunkedArray) else whole


def _names(header: bytes, name: str) -> tuple[str, ...]:
    if header.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise DataError(f"{name}: the file is UTF-16, expected UTF-8; save it as UTF-8")
    try:
        line = header.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise DataError(f"{name}, line 1: byte 0x{header[error.start]:02x} is not UTF-8; save it as UTF-8") from None
    if not line.strip():
        raise DataError(f"{name}: there is no header: the first line is empty")
    try:
        names = [field.strip() for field in next(csv.reader([line]))]
    except csv.Error as error:
        raise DataError(f"{name}, line 1: the header can't be read: {error}") from error
    if len(names) == 1:
        _refuse_single(names[0], name)
    return tuple(field or f"unnamed_{place}" for place, field in enumerate(names, start=1))


def _refuse_single(header: str, name: str) -> None:
    if header.startswith("#"):
        raise DataError(f"{name}, line 1: begins with '#', expected the header; take the comments out: grep -v '^#'")
    for separator, word in ((";", "semicolons"), ("\t", "tabs"), ("|", "bars")):
        if separator in header:
            raise DataError(
                f"{name}: the columns are separated by {word}, expected commas (and a point within numbers); "
                f"save it so, such as by: mlr --icsv --ifs {separator!r} --ocsv cat"
            )
