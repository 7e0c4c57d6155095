"""Reader of JSON Lines, plain or gzipped: an object on each line, read in blocks."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import islice
from typing import IO, Any

import numpy as np
import pyarrow as pa

from nlosctl.contract.tables import ColumnType
from nlosctl.errors import DataError
from nlosctl.io.byte_streams import open_bytes
from nlosctl.io.inputs import Part
from nlosctl.io.raw import CellFault, LineFault, RawBatch, readable
from nlosctl.io.text_columns import EXPECTED, arrow_type_of, shown

__all__ = ["JsonLinesSource"]

_BLOCK_LINES = 1 << 15


class _Block:
    """Lines that parsed as objects, with their line numbers, and those that did not."""

    def __init__(self, first_line: int, lines: Sequence[bytes]) -> None:
        self.objects: list[dict[str, Any]] = []
        self.texts: list[bytes] = []
        self.numbers: list[int] = []
        self.faults: list[LineFault] = []
        for number, line in enumerate(lines, start=first_line):
            self._take(number, line)

    def _take(self, number: int, line: bytes) -> None:
        if not line.strip():
            return
        try:
            parsed = json.loads(line.decode("utf-8-sig" if number == 1 else "utf-8"))
        except UnicodeDecodeError as error:
            self._refuse(number, line, f"byte 0x{line[error.start]:02x} is not UTF-8; save the file as UTF-8")
        except json.JSONDecodeError as error:
            self._refuse(number, line, f"not JSON at character {error.colno}: {error.msg}")
        else:
            if isinstance(parsed, dict):
                self.objects.append(parsed)
                self.texts.append(line)
                self.numbers.append(number)
            else:
                self._refuse(number, line, f'got {shown(parsed)}, expected an object like {{"sensor": ...}}')

    def _refuse(self, number: int, line: bytes, fault: str) -> None:
        text = line.decode("utf-8", errors="backslashreplace").rstrip("\r\n")
        self.faults.append(LineFault(row=number, fault=fault, text=text))


class JsonLinesSource:
    """A JSON Lines file; a row's number is its line. The first block (32768 lines) decides names and types."""

    metadata: Mapping[bytes, bytes] = {}

    def __init__(self, part: Part, batch_rows: int) -> None:
        self._part, self._batch_rows = part, batch_rows
        with readable(part.name, "JSON Lines file"):
            self._stream: IO[bytes] = open_bytes(part)
            self._blocks = self._read_blocks()
            self._first = next(self._blocks, None)
        objects = self._first.objects if self._first is not None else []
        if self._first is not None and not objects and self._first.faults:
            fault = self._first.faults[0]
            raise DataError(f"{part.name}, line {fault.row}: {fault.fault}")
        self.names: tuple[str, ...] = tuple(dict.fromkeys(name for row in objects for name in row))
        self._kept: list[str] = list(self.names)
        self._types: dict[str, ColumnType] = {}

    def _read_blocks(self) -> Iterator[_Block]:
        line = 1
        while lines := list(islice(self._stream, _BLOCK_LINES)):
            yield _Block(line, lines)
            line += len(lines)

    def start(self, types: Mapping[str, ColumnType], columns: Sequence[str] | None) -> Any:
        """See RawSource."""
        self._kept = list(self.names if columns is None else columns)
        rows = self._first.objects if self._first is not None else []
        for name in self._kept:
            wanted = types.get(name)
            if wanted is None or wanted == "identifier":
                wanted = _inferred(rows, name, wanted)
            self._types[name] = wanted
        return pa.schema([(name, arrow_type_of(self._types[name])) for name in self._kept])

    def batches(self) -> Iterator[RawBatch]:
        """See RawSource."""
        with readable(self._part.name, "JSON Lines file"):
            block = self._first
            self._first = None
            while block is not None:
                yield from self._in_batches(block)
                block = next(self._blocks, None)

    def _in_batches(self, block: _Block) -> Iterator[RawBatch]:
        faults: Sequence[LineFault] = block.faults
        for start in range(0, max(len(block.objects), 1), self._batch_rows):
            stop = start + self._batch_rows
            yield self._converted(block, slice(start, stop), faults)
            faults = ()

    def _converted(self, block: _Block, part: slice, lines: Sequence[LineFault]) -> RawBatch:
        objects = block.objects[part]
        columns, faults = [], self._unknown_names(objects)
        for name in self._kept:
            column, unfit = _column([row.get(name) for row in objects], self._types[name], name)
            columns.append(column)
            faults += unfit
        texts = [[_as_text(row.get(name)) for row in objects] for name in self._kept] if faults else None
        return RawBatch(
            table=pa.RecordBatch.from_arrays(columns, names=self._kept),
            first_row=0,
            rows=np.array(block.numbers[part], dtype=np.int64),
            line_offset=0,
            text=None
            if texts is None
            else pa.RecordBatch.from_arrays([pa.array(column, pa.string()) for column in texts], names=self._kept),
            cell_faults=faults,
            line_faults=lines,
        )

    def _unknown_names(self, objects: Sequence[dict[str, Any]]) -> list[CellFault]:
        known = frozenset(self.names)
        return [
            CellFault(
                position=place, column=name, fault=f"the name is not among those of the first {_BLOCK_LINES} lines"
            )
            for place, row in enumerate(objects)
            if not known.issuperset(row)
            for name in sorted(set(row) - known)[:1]
        ]

    def close(self) -> None:
        """Close the file."""
        self._stream.close()


def _inferred(rows: Sequence[dict[str, Any]], name: str, wanted: ColumnType | None) -> ColumnType:
    kinds = {type(row[name]) for row in rows if row.get(name) is not None}
    if kinds and kinds <= {int}:
        return "integer"
    if wanted is None and kinds and kinds <= {int, float}:
        return "number"
    if wanted is None and kinds == {bool}:
        return "boolean"
    return "text"


def _column(values: list[Any], wanted: ColumnType, name: str) -> tuple[Any, list[CellFault]]:
    fits = _FITS[wanted]
    kept = list(values)
    faults = []
    for place, value in enumerate(values):
        if value is None or fits(value):
            continue
        kept[place] = None
        fault = f"got {shown(value)}, expected {EXPECTED[wanted]}"
        faults.append(CellFault(position=place, column=name, fault=fault))
    if wanted == "boolean":
        kept = [None if value is None else bool(value) for value in kept]
    elif wanted == "text":
        kept = [None if value is None or value == "" else str(value) for value in kept]
    return pa.array(kept, type=arrow_type_of(wanted)), faults


def _is_integer(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and -(2**63) <= value < 2**63


_FITS: dict[str, Callable[[Any], bool]] = {
    "number": lambda value: isinstance(value, int | float) and not isinstance(value, bool),
    "integer": _is_integer,
    "boolean": lambda value: isinstance(value, bool) or (isinstance(value, int) and value in (0, 1)),
    "text": lambda value: isinstance(value, str) or _is_integer(value),
}


def _as_text(value: Any) -> str | None:
    return value if value is None or isinstance(value, str) else json.dumps(value)
