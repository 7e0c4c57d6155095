"""An open table file: the reader of its format, steps that add columns, and a guard against changes."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain
from typing import Any, Protocol

import pyarrow as pa

from nlosctl.contract.limits import limit, refusal_hint
from nlosctl.contract.tables import ColumnType
from nlosctl.errors import DataError
from nlosctl.io.paths.inputs import Part
from nlosctl.io.paths.locations import FileFormat, format_of_bytes, mark_of
from nlosctl.io.readers.arrow_ipc import ArrowReader
from nlosctl.io.readers.base import FormatReader, RecordBatch, readable
from nlosctl.io.readers.csv_reader import CsvReader
from nlosctl.io.readers.json_lines import JsonLinesReader
from nlosctl.io.readers.parquet_arrow import ParquetReader
from nlosctl.io.readers.partition_columns import PartitionColumns

__all__ = ["Step", "TableFile", "open_part"]

_HEAD_BYTES = 4096


class Step(Protocol):
    """Adds the columns ``names`` to the rows of a file in place of ``replaces``, or leaves out rows."""

    names: tuple[str, ...]
    replaces: Sequence[str]

    def request(
        self, types: Mapping[str, ColumnType], columns: list[str] | None
    ) -> tuple[Mapping[str, ColumnType], list[str] | None]:
        """Return the types and columns (None: all) to read so that ``columns`` can be given."""

    def extend(self, schema: Any) -> Any:
        """Return the Arrow schema with the added columns, without replaced ones."""

    def apply(self, batch: RecordBatch) -> RecordBatch:
        """Return a batch with the added columns, without replaced ones."""


class TableFile:
    """The rows of a file: ``names`` are its columns, those of the steps last, ``metadata`` its key-value metadata."""

    def __init__(self, part: Part, reader: FormatReader) -> None:
        self._part, self._reader = part, reader
        self._steps: list[Step] = []
        self._columns: list[str] = []
        self._rows: Iterator[RecordBatch] = iter(())
        self.names: tuple[str, ...] = reader.names
        self.metadata: Mapping[bytes, bytes] = reader.metadata

    def add_step(self, step: Step) -> None:
        """Add a step after the others; call it before `start`."""
        self._steps.append(step)
        self.names = (*(name for name in self.names if name not in step.replaces), *step.names)

    def accept_texts(self, texts: Collection[str]) -> None:
        """Do not refuse a column of numbers that contains nothing but these ``texts``, which a step handles."""
        self._reader.accepted_texts = frozenset(texts)

    @property
    def remarks(self) -> list[str]:
        """What the steps note on the file; call `start` first."""
        return [remark for step in self._steps for remark in getattr(step, "remarks", ())]

    def start(self, types: Mapping[str, ColumnType], columns: Sequence[str] | None) -> Any:
        """Set the types of the contract's columns, and which columns to read (None: all); return the Arrow schema."""
        self._columns = list(self.names if columns is None else columns)
        wanted = None if columns is None else list(columns)
        for step in reversed(self._steps):
            types, wanted = step.request(types, wanted)
        schema = self._reader.start(types, wanted)
        self._rows = self._guarded_rows()
        if not self._steps:
            return schema
        for step in self._steps:
            schema = step.extend(schema)
        return pa.schema([schema.field(name) for name in self._columns])

    def batches(self) -> Iterator[RecordBatch]:
        """Return the rows in file order, in batches of bounded size; call `start` first.

        Raises DataError at the end, or with the reader's own error, if the file has changed since the run began.
        """
        return map(self._with_steps, self._rows) if self._steps else self._rows

    def peek(self, without: Step | None = None) -> Iterator[RecordBatch]:
        """Yield rows without the columns of the step ``without``, the last one; `batches` yields them again."""
        seen: list[RecordBatch] = []
        rows, self._rows = self._rows, chain(seen, self._rows)
        for batch in rows:
            seen.append(batch)
            for step in self._steps:
                batch = batch if step is without else step.apply(batch)
            yield batch

    def _with_steps(self, batch: RecordBatch) -> RecordBatch:
        for step in self._steps:
            batch = step.apply(batch)
        text = batch.text if batch.text is None else batch.text.select(self._columns)
        return replace(batch, table=batch.table.select(self._columns), text=text)

    def _guarded_rows(self) -> Iterator[RecordBatch]:
        try:
            yield from self._reader.batches()
        except DataError as error:
            if self._is_changed():
                raise self._changed() from error
            raise
        if self._is_changed():
            raise self._changed()

    def _is_changed(self) -> bool:
        return self._part.path is not None and mark_of(self._part.path) != self._part.mark

    def _changed(self) -> DataError:
        return DataError(f"{self._part.name}: was changed while it was read; run again once it is complete")

    def close(self) -> None:
        """Close the file."""
        self._reader.close()


def open_part(part: Part, batch_rows: int, use_threads: bool) -> TableFile:
    """Open a file; raise DataError if it is empty, of another format than stated, or has too many columns."""
    head = _head(part)
    if head == b"":
        raise DataError(f"{part.name}: no rows: the file is empty (0 bytes)")
    if head is not None:
        part = _checked(part, head)
    file = TableFile(part, _format_reader(part, batch_rows, use_threads))
    if part.keys:
        file.add_step(PartitionColumns(part, file.names))
    if len(file.names) > limit("columns"):
        file.close()
        raise DataError(
            f"{part.name}: has {len(file.names)} columns, expected at most {limit('columns')}; "
            f"{refusal_hint('columns')}"
        )
    return file


def _format_reader(part: Part, batch_rows: int, use_threads: bool) -> FormatReader:
    if part.format is FileFormat.PARQUET:
        return ParquetReader(part, batch_rows, use_threads)
    if part.format in (FileFormat.ARROW, FileFormat.ARROW_STREAM):
        return ArrowReader(part, batch_rows)
    if part.format.is_delimited:
        return CsvReader(part, batch_rows)
    return JsonLinesReader(part, batch_rows)


def _head(part: Part) -> bytes | None:
    """Return the first bytes of a file or of stdin; None if they can't be read without consuming them."""
    if part.path is not None:
        with readable(part.name, "file"), part.path.open("rb") as file:
            return file.read(_HEAD_BYTES)
    peek = getattr(part.stream, "peek", None)
    return bytes(peek(_HEAD_BYTES)) if peek is not None else None


def _checked(part: Part, head: bytes) -> Part:
    """Return the part with the Arrow format that its first bytes show; raise DataError for another format."""
    detected = format_of_bytes(head)
    if {detected, part.format} == {FileFormat.ARROW, FileFormat.ARROW_STREAM}:
        return replace(part, format=detected)
    if detected is part.format or _is_same_text(part.format, detected, head):
        return part
    what = "text, perhaps CSV" if detected is FileFormat.CSV else detected.title
    raise DataError(
        f"{part.name}: expected {part.format.title}, but its bytes are {what}; correct the extension, or give "
        f"`input_format` {detected.value}"
    )


def _is_same_text(format: FileFormat, detected: FileFormat, head: bytes) -> bool:
    """Return whether the bytes, detected as text, may be of ``format``: other bytes may be a corrupted file of any."""
    if detected is FileFormat.CSV:
        is_text = format.uncompressed is format and (format.is_delimited or format is FileFormat.JSON_LINES)
        return is_text or b"\0" in head or not head.isascii()
    same_content = format.is_delimited and detected.is_delimited
    return format.compression == detected.compression and (same_content or format.compression in ("zst", "bz2"))
