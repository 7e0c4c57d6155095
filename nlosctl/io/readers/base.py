"""What all format readers share: record batches with row numbers and faults, read errors, Arrow values as text."""

from __future__ import annotations

import json
import zlib
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from nlosctl.arrays import IntArray
from nlosctl.contract.limits import refusal_hint
from nlosctl.contract.tables import ColumnType
from nlosctl.errors import DataError

__all__ = [
    "BadRow",
    "CellFault",
    "FormatReader",
    "LineFault",
    "Problem",
    "RecordBatch",
    "as_text",
    "closed_on_failure",
    "expansion_fault",
    "json_default",
    "plain",
    "plain_type",
    "readable",
    "text_at",
]


@dataclass(frozen=True, kw_only=True)
class CellFault:
    """A value that could not be read as its column's type: its index in the batch, and the fault."""

    index: int
    column: str
    fault: str


@dataclass(frozen=True, kw_only=True)
class LineFault:
    """A line that is not a row: its data row number, its line number, the fault, and its text."""

    row: int
    line: int
    fault: str
    text: str


@dataclass(frozen=True, kw_only=True)
class Problem:
    """One fault of one row: ``row`` counts data rows from 1, ``line`` is its line in a text file.

    ``row`` is None for a line of another program's file, which is not a row yet.
    """

    file: str
    row: int | None
    line: int | None
    column: str | None
    fault: str

    def __str__(self) -> str:
        """Return the problem as one line."""
        if self.row is None:
            line = f", line {self.line}" if self.line is not None else ""
            field = f", field {self.column!r}" if self.column is not None else ""
            return f"{self.file}{line}{field}: {self.fault}"
        line = f" (line {self.line})" if self.line is not None and self.line != self.row else ""
        column = f", column {self.column!r}" if self.column is not None else ""
        return f"{self.file}, row {self.row}{line}{column}: {self.fault}"


@dataclass(frozen=True, kw_only=True)
class BadRow:
    """A row with a fault: its first problem, and its content, by column as text or as the raw line."""

    problem: Problem
    values: dict[str, str | None]
    raw_line: str | None = None


@dataclass(frozen=True, kw_only=True)
class RecordBatch:
    """Rows of a file, as an Arrow record batch ``table``.

    ``rows`` (N,) are their numbers from 1 (None: consecutive from ``first_row``), ``lines`` (N,) the lines where they
    begin (None: not a text file). ``text`` holds the original cells where the reader converted text. Unreadable values
    are null in ``table`` and listed in ``cell_faults``. ``origins`` has for a column made of several of the file that
    of each row (N,). ``left_out`` counts rows that are not in the batch by the setting that leaves them out.
    """

    table: Any
    first_row: int
    rows: IntArray | None = None
    lines: IntArray | None = None
    text: Any = None
    cell_faults: Sequence[CellFault] = ()
    line_faults: Sequence[LineFault] = ()
    origins: Mapping[str, Any] = field(default_factory=dict)
    left_out: Mapping[str, int] = field(default_factory=dict)

    def row_numbers(self) -> IntArray:
        """Return the data row numbers (N,)."""
        if self.rows is not None:
            return self.rows
        return np.arange(self.first_row, self.first_row + self.table.num_rows, dtype=np.int64)


class FormatReader(Protocol):
    """An open file of one format: ``names`` are its columns, ``metadata`` its key-value metadata.

    A column of numbers may consist of ``accepted_texts``: values that stand for a missing one.
    """

    names: tuple[str, ...]
    metadata: Mapping[bytes, bytes]
    accepted_texts: Collection[str]

    def start(self, types: Mapping[str, ColumnType], columns: Sequence[str] | None) -> Any:
        """Set the types of the contract's columns, and which columns to read (None: all); return the Arrow schema."""

    def batches(self) -> Iterator[RecordBatch]:
        """Yield the rows in file order, in batches of bounded size; call `start` first."""

    def close(self) -> None:
        """Close the file."""


@contextmanager
def readable(name: str, what: str) -> Iterator[None]:
    """Turn read errors into a DataError: ``name`` is not a complete ``what``."""
    try:
        yield
    except EOFError as error:
        raise DataError(f"{name}: the {what} is cut short; copy or write it again") from error
    except MemoryError as error:  # pyarrow's out-of-memory error too
        raise DataError(
            f"{name}: reading the {what} takes more memory than there is; {refusal_hint('memory_mb')}"
        ) from error
    except (pa.ArrowException, OSError, ValueError, zlib.error) as error:
        if isinstance(error, OSError) and error.errno is not None and error.filename is not None:
            raise DataError(f"{name}: can't be read: {error.strerror}") from error
        reason = str(error).strip().splitlines()[0].rstrip(".") if str(error).strip() else type(error).__name__
        raise DataError(f"{name}: not a readable {what}, perhaps cut short: {reason}") from error


class _Closable(Protocol):
    def close(self) -> object: ...


@contextmanager
def closed_on_failure(file: _Closable) -> Iterator[None]:
    """Close ``file`` if the block raises."""
    try:
        yield
    except BaseException:
        file.close()
        raise


def expansion_fault(name: str, most: int) -> str:
    """Return the message for a file whose uncompressed content is larger than allowed."""
    return f"{name}: expands to more than {most} times its compressed size; {refusal_hint('expansion')}"


def as_text(cells: Any) -> Any:
    """Return a column as text: bytes as UTF-8 with escapes, lists and structs as JSON, anything else as Arrow does."""
    kind = cells.type
    if not (pa.types.is_binary(kind) or pa.types.is_large_binary(kind) or pa.types.is_fixed_size_binary(kind)):
        try:
            return cells.cast(pa.string())
        except (pa.ArrowInvalid, pa.ArrowNotImplementedError):
            pass
    return pa.array([_text(value) for value in cells.to_pylist()], pa.string())


def _text(value: Any) -> str | None:
    if value is None or isinstance(value, str):
        return value
    if isinstance(value, list | dict | tuple):
        return json.dumps(value, ensure_ascii=False, default=json_default)
    return str(json_default(value))


def json_default(value: Any) -> Any:
    """Return a value without a JSON type as text: for ``json.dumps(default=...)``."""
    return value.decode("utf-8", "backslashreplace") if isinstance(value, bytes) else str(value)


def text_at(column: Any, index: int) -> str | None:
    """Return one value as text, None for null."""
    value = column[index].as_py()
    return None if value is None else str(value)


def plain(column: Any) -> Any:
    """Return a dictionary-encoded column decoded, any other as it is."""
    return pc.cast(column, column.type.value_type) if pa.types.is_dictionary(column.type) else column


def plain_type(arrow_type: Any) -> Any:
    """Return the value type of a dictionary type, any other type as it is."""
    return arrow_type.value_type if pa.types.is_dictionary(arrow_type) else arrow_type
