"""Reader of CSV and TSV: every cell is read as text first, so that a fault has a row and a column."""

from __future__ import annotations

import csv
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import IO, Any

import numpy as np
import pyarrow as pa
import pyarrow.csv

from nlosctl.arrays import IntArray
from nlosctl.contract.tables import ColumnType, declared_type
from nlosctl.errors import DataError
from nlosctl.io.paths.inputs import Part
from nlosctl.io.paths.locations import FileFormat
from nlosctl.io.readers.base import CellFault, LineFault, RecordBatch, closed_on_failure, readable
from nlosctl.io.readers.csv_records import CsvBlock, RecordBlocks
from nlosctl.io.readers.text_files import (
    arrow_type_of,
    convert_text,
    decode_utf8,
    identifier_type,
    infer_type,
    names,
    open_bytes,
    refuse_wrong_column,
    wider_type,
)

__all__ = ["CsvReader"]


@dataclass(frozen=True, kw_only=True)
class _Parsed:
    """A block as columns of bytes, the lines (R,) of its records, and bad lines as (index, fault, text)."""

    table: Any
    lines: IntArray
    bad: Sequence[tuple[int, str, str]]


class CsvReader:
    """A CSV file; its cells may be separated by commas, tabs or semicolons.

    A column that is not in the contract gets the narrowest type for all of its cells, for which a large file is read
    twice. A stream can't be read twice: its first block (4 MiB of text) determines the type, and a later cell of
    another type is an error. The first block also determines whether an identifier is an integer; a later cell that
    is not one is a bad row.
    """

    metadata: Mapping[bytes, bytes] = {}
    accepted_texts: Collection[str] = ()

    def __init__(self, part: Part, batch_rows: int) -> None:
        self._part, self._batch_rows = part, batch_rows
        self._what = f"{part.format.title} file"
        with readable(part.name, self._what):
            self._stream: IO[bytes] = open_bytes(part)
        with readable(part.name, self._what), closed_on_failure(self._stream):
            self._records = self._split(self._stream)
            self.names: tuple[str, ...] = _names(self._records.header(), self._records.separator, part.name)
        self._kept: list[str] = list(self.names)
        self._types: dict[str, ColumnType] = {}
        self._hints: dict[str, str] = {}
        self._named: set[str] = set()
        self._guessed: frozenset[str] = frozenset()
        self._blocks: Iterator[CsvBlock] = iter(())
        self._first: _Parsed | None = None

    def _split(self, stream: IO[bytes]) -> RecordBlocks:
        return RecordBlocks(stream, self._part.name, tabs=self._part.format.uncompressed is FileFormat.TSV)

    def start(self, types: Mapping[str, ColumnType], columns: Sequence[str] | None) -> Any:
        """See FormatReader; reads the first block to infer the types that the contract leaves open."""
        self._kept = list(self.names if columns is None else columns)
        with readable(self._part.name, self._what):
            self._blocks = self._records.blocks()
            block = next(self._blocks, None)
            self._first = None if block is None else self._parse(block, self._kept)
            exact = [name for name in self._kept if types.get(name) == "exact"]
            unknown = [name for name in self._kept if name not in types]
            self._types = {**types, **self._survey([*unknown, *exact])}
            self._guessed -= set(exact)
            self._types |= {name: self._exact_type(name) for name in exact}
        self._named = {name for name, kind in types.items() if kind in ("text", "identifier")}
        for name in self._kept:
            if self._first is None:
                continue
            cells, _ = decode_utf8(self._first.table.column(name), name)
            if self._types[name] == "identifier":
                self._types[name] = identifier_type(cells)
                if self._types[name] == "integer":
                    self._hints[name] = f" as in the first {self._first.table.num_rows} rows"
            elif name in types:
                refuse_wrong_column(cells, self._types[name], self._part.name, name, self.accepted_texts)
        return pa.schema([(name, arrow_type_of(self._types[name])) for name in self._kept])

    def _survey(self, unknown: Sequence[str]) -> dict[str, ColumnType]:
        """Return the types of columns that are not in the table: that of other tables if they are empty, else text."""
        if self._first is None or not unknown:
            return {name: declared_type(name) or "text" for name in unknown}
        types: dict[str, ColumnType | None] = dict.fromkeys(unknown)
        if self._records.at_end or self._part.path is None:
            self._guessed = frozenset() if self._records.at_end else frozenset(unknown)
            _widen(types, self._first.table)
        else:
            with open_bytes(self._part) as stream:
                records = self._split(stream)
                records.header()
                for block in records.blocks():
                    undecided = [name for name, kind in types.items() if kind != "text"]
                    if not undecided:
                        break
                    _widen(types, self._parse(block, undecided).table)
        return {name: kind or declared_type(name) or "text" for name, kind in types.items()}

    def _exact_type(self, name: str) -> ColumnType:
        """Return integer for a column that the survey found to be of integers, or of integers and wrong cells."""
        if self._types[name] != "text" or self._first is None:
            return "integer" if self._types[name] == "integer" else "number"
        cells, _ = decode_utf8(_one_chunk(self._first.table.column(name)), name)
        numbers, _ = convert_text(cells, "number", name)
        integers, _ = convert_text(cells, "integer", name)
        return "integer" if integers.null_count == numbers.null_count < len(cells) else "number"

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
                    encoding="utf8" if utf8 else "latin-1",  # for bad lines: pyarrow needs text
                ),
                parse_options=pyarrow.csv.ParseOptions(
                    delimiter=self._records.separator.decode(),
                    newlines_in_values=True,
                    invalid_row_handler=take_bad_line,
                ),
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
            raise DataError(f"{self._part.name}: after line {block.lines[0]}: quoted cells are ambiguous")
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
        """Yield the rows of a block after ``before`` rows, good or bad; a bad line goes with the rows after it."""
        bad = [
            LineFault(row=before + index + 1, line=int(parsed.lines[index]), fault=fault, text=text)
            for index, fault, text in parsed.bad
        ]
        good = np.ones(parsed.lines.shape[0], dtype=np.bool_)
        good[[index for index, _, _ in parsed.bad]] = False
        indices = np.flatnonzero(good)
        count = parsed.table.num_rows
        for start in range(0, max(count, 1), self._batch_rows):
            here = indices[start : start + self._batch_rows]
            rows = before + here + 1
            ends = start + self._batch_rows >= count
            passed = [line for line in bad if ends or line.row < rows[-1]]
            bad = bad[len(passed) :]
            yield self._converted(parsed.table.slice(start, self._batch_rows), rows, parsed.lines[here], passed)

    def _converted(self, table: Any, rows: IntArray, lines: IntArray, bad_lines: Sequence[LineFault]) -> RecordBatch:
        texts, columns, faults = [], [], list[CellFault]()
        for name in self._kept:
            cells, unreadable = decode_utf8(_one_chunk(table.column(name)), name)
            wanted = self._types[name]
            named = names(cells, wanted) if name in self._named else cells
            column, unfit = convert_text(named, wanted, name, self._hints.get(name, ""))
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
            line_faults=bad_lines,
        )

    def _misguessed(self, fault: CellFault, line: int) -> DataError:
        return DataError(
            f"{self._part.name}, line {line}, column {fault.column!r}: {fault.fault} as before; the type of a column "
            f"that is not in the contract is inferred from the first 4 MiB of a stream: save it as a file to use all"
        )

    def close(self) -> None:
        """Close the file."""
        self._stream.close()


@contextmanager
def _signals_left_to_python() -> Iterator[None]:
    """Keep Arrow from handling Ctrl-C while it parses a block: one that arrives as it ends would be lost."""
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
    """Return a table that was read as Latin-1 with the original bytes."""
    columns = [
        pa.array(
            [None if cell is None else cell.decode().encode("latin-1") for cell in column.to_pylist()], column.type
        )
        for column in table.columns
    ]
    return pa.table(columns, names=table.column_names)


def _widen(types: dict[str, ColumnType | None], table: Any) -> None:
    """Widen the types so that they fit the cells of a table."""
    for name in table.column_names:
        if name in types:
            cells, _ = decode_utf8(_one_chunk(table.column(name)), name)
            types[name] = wider_type(types[name], infer_type(cells))


def _one_chunk(column: Any) -> Any:
    whole = column.combine_chunks()
    return pa.concat_arrays(whole.chunks) if isinstance(whole, pa.ChunkedArray) else whole


def _names(header: bytes, separator: bytes, name: str) -> tuple[str, ...]:
    if header.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise DataError(f"{name}: the file is UTF-16, expected UTF-8; save it as UTF-8")
    try:
        line = header.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise DataError(f"{name}, line 1: byte 0x{header[error.start]:02x} is not UTF-8; save it as UTF-8") from None
    if not line.strip():
        raise DataError(f"{name}: no header: the first line is empty")
    try:
        names = [field.strip() for field in next(csv.reader([line], delimiter=separator.decode()))]
    except csv.Error as error:
        raise DataError(f"{name}, line 1: the header can't be read: {error}") from error
    if len(names) == 1:
        _refuse_single(names[0], name)
    return tuple(field or f"unnamed_{number}" for number, field in enumerate(names, start=1))


def _refuse_single(header: str, name: str) -> None:
    if header.startswith("#"):
        raise DataError(f"{name}, line 1: begins with '#', expected the header; remove the comments: grep -v '^#'")
    if "|" in header:
        raise DataError(
            f"{name}: the columns are separated by bars, expected commas, tabs or semicolons; "
            f"convert it, for example: mlr --icsv --ifs '|' --ocsv cat"
        )
