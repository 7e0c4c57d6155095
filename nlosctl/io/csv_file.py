"""Reader of CSV, plain or gzipped: streamed, every cell first taken as text, so that a fault has a row and column."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv

from nlosctl.contract.batches import IntArray
from nlosctl.contract.tables import ColumnType
from nlosctl.errors import DataError
from nlosctl.io.byte_streams import open_bytes
from nlosctl.io.inputs import Part
from nlosctl.io.raw import CellFault, LineFault, RawBatch, readable
from nlosctl.io.text_columns import arrow_type_of, convert_text, decode_utf8, infer_type

__all__ = ["CsvSource"]

_BLOCK_BYTES = 4 << 20
_HEADER_LINES = 1


class CsvSource:
    """A CSV file.

    The first block (4 MiB of text, whatever the batch size) decides the type of columns that the contract does
    not know, and whether ``snapshot`` holds integers; a later value that does not fit is a bad row.
    """

    metadata: Mapping[bytes, bytes] = {}

    def __init__(self, part: Part, batch_rows: int) -> None:
        self._part, self._batch_rows = part, batch_rows
        self._what = "gzipped CSV file" if part.format.compressed else "CSV file"
        with readable(part.name, self._what):
            self._stream = open_bytes(part)
            header = self._stream.readline()
        self.names: tuple[str, ...] = _names(header, part.name)
        self._kept: list[str] = list(self.names)
        self._types: dict[str, ColumnType] = {}
        self._hints: dict[str, str] = {}
        self._bad_lines: list[LineFault] = []
        self._blocks: Iterator[Any] = iter(())
        self._first: Any = None

    def start(self, types: Mapping[str, ColumnType], columns: Sequence[str] | None) -> Any:
        """See RawSource; reads the first block to decide the types that the contract leaves open."""
        self._kept = list(self.names if columns is None else columns)
        with readable(self._part.name, self._what):
            self._blocks = self._read_blocks()
            self._first = next(self._blocks, None)
        for name in self._kept:
            self._types[name] = types.get(name) or self._inferred(name, plain_integers=False)
            if self._types[name] == "identifier":
                self._types[name] = self._inferred(name, plain_integers=True)
        return pa.schema([(name, arrow_type_of(self._types[name])) for name in self._kept])

    def _inferred(self, name: str, plain_integers: bool) -> ColumnType:
        if self._first is None:
            return "text"
        cells, _ = decode_utf8(self._first.column(name), name)
        found = infer_type(cells, plain_integers)
        if found != "text":
            self._hints[name] = f" as in the first {self._first.num_rows} rows"
        return found

    def _read_blocks(self) -> Iterator[Any]:
        try:
            reader = pyarrow.csv.open_csv(
                self._stream,
                read_options=pyarrow.csv.ReadOptions(
                    use_threads=False, block_size=_BLOCK_BYTES, column_names=list(self.names)
                ),
                parse_options=pyarrow.csv.ParseOptions(
                    newlines_in_values=True, invalid_row_handler=self._take_bad_line
                ),
                convert_options=pyarrow.csv.ConvertOptions(
                    check_utf8=False,
                    strings_can_be_null=True,
                    quoted_strings_can_be_null=True,
                    null_values=[""],
                    column_types={name: pa.binary() for name in self.names},
                    include_columns=self._kept,
                ),
            )
        except pa.ArrowInvalid as error:
            if "Empty CSV" in str(error):
                return
            raise
        yield from reader

    def _take_bad_line(self, line: Any) -> str:
        expected, actual = line.expected_columns, line.actual_columns
        fault = f"the line has {actual} fields, expected {expected} as in the header"
        self._bad_lines.append(LineFault(row=line.number, fault=fault, text=line.text))
        return "skip"

    def batches(self) -> Iterator[RawBatch]:
        """See RawSource."""
        valid_rows = 0
        told: list[LineFault] = []
        with readable(self._part.name, self._what):
            for block in self._all_blocks():
                for start in range(0, block.num_rows, self._batch_rows):
                    batch = block.slice(start, self._batch_rows)
                    rows = self._numbered(valid_rows, batch.num_rows)
                    told_now = [line for line in self._bad_lines[len(told) :] if line.row < rows[-1]]
                    told.extend(told_now)
                    yield self._converted(batch, rows, told_now)
                    valid_rows += batch.num_rows
        rest = self._bad_lines[len(told) :]
        if rest:
            empty = pa.RecordBatch.from_pylist([], schema=self._text_schema())
            yield self._converted(empty, np.empty(0, np.int64), rest)

    def _all_blocks(self) -> Iterator[Any]:
        if self._first is not None:
            yield self._first
        self._first = None
        yield from self._blocks

    def _text_schema(self) -> Any:
        return pa.schema([(name, pa.binary()) for name in self._kept])

    def _numbered(self, valid_rows: int, count: int) -> IntArray:
        """Number rows by their place in the file, which the skipped lines before them push back."""
        places = np.arange(valid_rows, valid_rows + count, dtype=np.int64)
        skipped = np.array([line.row for line in self._bad_lines], dtype=np.int64)
        valid_before = skipped - 1 - np.arange(skipped.shape[0])
        return places + 1 + np.searchsorted(valid_before, places, side="right")

    def _converted(self, batch: Any, rows: IntArray, lines: Sequence[LineFault]) -> RawBatch:
        texts, columns, faults = [], [], list[CellFault]()
        for name in self._kept:
            cells, unreadable = decode_utf8(batch.column(name), name)
            column, unfit = convert_text(cells, self._types[name], name, self._hints.get(name, ""))
            faults += unreadable + unfit
            texts.append(cells)
            columns.append(column)
        return RawBatch(
            table=pa.RecordBatch.from_arrays(columns, names=self._kept),
            first_row=0,
            rows=rows,
            line_offset=_HEADER_LINES,
            text=pa.RecordBatch.from_arrays(texts, names=self._kept),
            cell_faults=faults,
            line_faults=lines,
        )

    def close(self) -> None:
        """Close the file."""
        self._stream.close()


def _names(header: bytes, name: str) -> tuple[str, ...]:
    if header.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise DataError(f"{name}: the file is UTF-16, expected UTF-8; save it as UTF-8")
    try:
        line = header.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise DataError(f"{name}, line 1: byte 0x{header[error.start]:02x} is not UTF-8; save it as UTF-8") from None
    if not line.strip():
        raise DataError(f"{name}: there is no header: the first line is empty")
    return tuple(field.strip() for field in next(csv.reader([line])))
