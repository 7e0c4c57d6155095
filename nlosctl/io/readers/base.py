"""What every reader of a file format gives: batches of rows with the columns as they came."""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
import pyarrow as pa

from nlosctl.arrays import IntArray
from nlosctl.contract.limits import refusal_hint
from nlosctl.contract.tables import ColumnType
from nlosctl.errors import DataError

__all__ = ["CellFault", "LineFault", "RawBatch", "RawSource", "readable", "rebatch"]


@dataclass(frozen=True, kw_only=True)
class CellFault:
    """A value that could not be read as its column's type: its place in the batch, and what to say."""

    position: int
    column: str
    fault: str


@dataclass(frozen=True, kw_only=True)
class LineFault:
    """A line that is no row at all: its data row number and line, what to say, and its text."""

    row: int
    line: int
    fault: str
    text: str


@dataclass(frozen=True, kw_only=True)
class RawBatch:
    """Rows of a file.

    ``rows`` numbers them from 1 (None: they follow ``first_row`` without a gap); ``lines`` are the lines where they
    begin, or None where the file has no lines. ``text`` holds the cells as text where the reader had to convert
    them. Unreadable values are null in ``table`` and told in ``cell_faults``.
    """

    table: Any
    first_row: int
    rows: IntArray | None = None
    lines: IntArray | None = None
    text: Any = None
    cell_faults: Sequence[CellFault] = ()
    line_faults: Sequence[LineFault] = field(default=())

    def row_numbers(self) -> IntArray:
        """Return the data row number of each row."""
        if self.rows is not None:
            return self.rows
        return np.arange(self.first_row, self.first_row + self.table.num_rows, dtype=np.int64)


class RawSource(Protocol):
    """An open file. ``names`` and ``metadata`` are there at once, the schema after ``start``."""

    names: tuple[str, ...]
    metadata: Mapping[bytes, bytes]

    def start(self, types: Mapping[str, ColumnType], columns: Sequence[str] | None) -> Any:
        """Fix the type of the columns that the contract knows (and the subset to read); return the schema."""

    def batches(self) -> Iterator[RawBatch]:
        """Yield the rows, in file order, in batches of bounded size."""

    def close(self) -> None:
        """Close the file."""


@contextmanager
def readable(name: str, what: str) -> Iterator[None]:
    """Turn the faults of reading into a DataError that says ``name`` is not a whole ``what``."""
    try:
        yield
    except EOFError as error:
        raise DataError(f"{name}: the {what} is cut short; copy or write it again") from error
    except MemoryError as error:  # that of pyarrow too
        raise DataError(
            f"{name}: reading the {what} takes more memory than there is; {refusal_hint('memory_mb')}"
        ) from error
    except (pa.ArrowException, OSError, ValueError, zlib.error) as error:
        if isinstance(error, OSError) and error.errno is not None and error.filename is not None:
            raise DataError(f"{name}: can't be read: {error.strerror}") from error
        reason = str(error).strip().splitlines()[0].rstrip(".") if str(error).strip() else type(error).__name__
        raise DataError(f"{name}: not a readable {what}, perhaps cut short: {reason}") from error


def rebatch(batches: Iterator[Any], rows: int) -> Iterator[Any]:
    """Yield record batches of at most ``rows`` rows; runs of small ones are joined."""
    waiting: list[Any] = []
    count = 0
    for batch in batches:
        if waiting and count + batch.num_rows > rows:
            yield _joined(waiting)
            waiting, count = [], 0
        if batch.num_rows >= rows:
            for start in range(0, batch.num_rows, rows):
                yield batch.slice(start, rows)
        elif batch.num_rows:
            waiting.append(batch)
            count += batch.num_rows
    if waiting:
        yield _joined(waiting)


def _joined(batches: list[Any]) -> Any:
    if len(batches) == 1:
        return batches[0]
    columns = [pa.concat_arrays(parts) for parts in zip(*(batch.columns for batch in batches), strict=True)]
    return pa.RecordBatch.from_arrays(columns, schema=batches[0].schema)
