"""Readers of the formats that carry types: Parquet, Arrow IPC file and Arrow IPC stream."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import pyarrow as pa
import pyarrow.parquet

from nlosctl.contract.tables import ColumnType
from nlosctl.errors import DataError
from nlosctl.io.file_format import FileFormat
from nlosctl.io.inputs import Part
from nlosctl.io.raw import RawBatch, readable, rebatch
from nlosctl.io.to_text import without_views

__all__ = ["ArrowSource", "ParquetSource", "fits_type"]

_BUFFER_BYTES = 1 << 20

_EXPECTED = {
    "number": "numbers",
    "integer": "integers",
    "boolean": "true/false or 1/0",
    "text": "text",
    "identifier": "text or integers",
}


def fits_type(arrow_type: Any, wanted: ColumnType) -> bool:
    """Return whether a column of ``arrow_type`` can hold what the contract wants."""
    if pa.types.is_dictionary(arrow_type):
        arrow_type = arrow_type.value_type
    kinds = pa.types
    if kinds.is_null(arrow_type):
        return True
    integer = kinds.is_integer(arrow_type)
    text = kinds.is_string(arrow_type) or kinds.is_large_string(arrow_type) or kinds.is_string_view(arrow_type)
    if wanted == "number":
        return bool(integer or kinds.is_floating(arrow_type) or kinds.is_decimal(arrow_type))
    if wanted == "boolean":
        return bool(kinds.is_boolean(arrow_type) or integer)
    return bool({"integer": integer, "text": text, "identifier": text or integer}[wanted])


def _check_types(name: str, schema: Any, types: Mapping[str, ColumnType]) -> None:
    for column in schema:
        wanted = types.get(column.name)
        if wanted is not None and not fits_type(column.type, wanted):
            raise DataError(
                f"{name}, column {column.name!r}: wrong type: holds {column.type}, expected {_EXPECTED[wanted]}; "
                f"convert the column, or read another under this name with --column"
            )


def _without_views(schema: Any) -> Any:
    return pa.schema([column.with_type(without_views(column.type)) for column in schema], metadata=schema.metadata)


class ParquetSource:
    """A Parquet file, read in batches whatever the size of its row groups."""

    def __init__(self, part: Part, batch_rows: int, use_threads: bool) -> None:
        self._part, self._batch_rows, self._use_threads = part, batch_rows, use_threads
        with readable(part.name, "Parquet file"):
            self._file = self._open(())
        self._schema = self._file.schema_arrow
        self.names: tuple[str, ...] = tuple(self._schema.names)
        self.metadata: Mapping[bytes, bytes] = {
            **(self._schema.metadata or {}),
            **(self._file.metadata.metadata or {}),  # what was added at the end of writing is here alone
        }
        self._columns: list[str] | None = None

    def _open(self, dictionary: Sequence[str]) -> Any:
        source = self._part.stream if self._part.stream is not None else str(self._part.path)
        return pa.parquet.ParquetFile(
            source, read_dictionary=list(dictionary), pre_buffer=False, buffer_size=_BUFFER_BYTES
        )

    def start(self, types: Mapping[str, ColumnType], columns: Sequence[str] | None) -> Any:
        """See RawSource; text is read dictionary-encoded where the contract knows the column."""
        _check_types(self._part.name, self._schema, types)
        self._columns = list(columns) if columns is not None else None
        encoded = [
            column.name
            for column in self._schema
            if types.get(column.name) in ("text", "identifier") and pa.types.is_string(column.type)
        ]
        if encoded:
            with readable(self._part.name, "Parquet file"):
                self._reopen(encoded)
        self._schema = _without_views(self._file.schema_arrow.remove_metadata())
        return self._schema if columns is None else pa.schema([self._schema.field(name) for name in columns])

    def _reopen(self, encoded: Sequence[str]) -> None:
        if self._part.stream is not None:
            self._part.stream.seek(0)
        else:
            self._file.close()
        self._file = self._open(encoded)

    def batches(self) -> Iterator[RawBatch]:
        """See RawSource."""
        first, behind = self._part.row_groups or (0, self._file.metadata.num_row_groups)
        row = 1 + sum(self._file.metadata.row_group(place).num_rows for place in range(first))
        with readable(self._part.name, "Parquet file"):
            for batch in rebatch(
                self._file.iter_batches(
                    self._batch_rows,
                    row_groups=range(first, behind),
                    columns=self._columns,
                    use_threads=self._use_threads,
                ),
                self._batch_rows,
            ):
                wanted = _without_views(batch.schema)
                yield RawBatch(table=batch if batch.schema.equals(wanted) else batch.cast(wanted), first_row=row)
                row += batch.num_rows

    def close(self) -> None:
        """Close the file."""
        self._file.close()
        if self._part.stream is not None:
            self._part.stream.close()


class ArrowSource:
    """An Arrow IPC file or stream."""

    def __init__(self, part: Part, batch_rows: int) -> None:
        self._part, self._batch_rows = part, batch_rows
        with readable(part.name, "Arrow file"):
            self._handle = part.stream if part.stream is not None else pa.memory_map(str(part.path))
            opener = pa.ipc.open_file if part.format is FileFormat.ARROW else pa.ipc.open_stream
            self._reader = opener(self._handle)
        self._schema = _without_views(self._reader.schema)
        self.names: tuple[str, ...] = tuple(self._schema.names)
        self.metadata: Mapping[bytes, bytes] = self._schema.metadata or {}
        self._columns: list[str] | None = None

    def start(self, types: Mapping[str, ColumnType], columns: Sequence[str] | None) -> Any:
        """See RawSource."""
        _check_types(self._part.name, self._schema, types)
        self._columns = list(columns) if columns is not None else None
        schema = self._schema.remove_metadata()
        return schema if columns is None else pa.schema([schema.field(name) for name in columns])

    def batches(self) -> Iterator[RawBatch]:
        """See RawSource."""
        row = 1
        with readable(self._part.name, "Arrow file"):
            for batch in rebatch(self._record_batches(), self._batch_rows):
                yield RawBatch(table=batch, first_row=row)
                row += batch.num_rows

    def _record_batches(self) -> Iterator[Any]:
        if self._part.format is FileFormat.ARROW:
            found: Iterator[Any] = (self._reader.get_batch(place) for place in range(self._reader.num_record_batches))
        else:
            found = iter(self._reader)
        for batch in found:
            batch.validate()
            batch = batch if self._columns is None else batch.select(self._columns)
            wanted = _without_views(batch.schema)
            yield batch if batch.schema.equals(wanted) else batch.cast(wanted)

    def close(self) -> None:
        """Close the file."""
        self._handle.close()
