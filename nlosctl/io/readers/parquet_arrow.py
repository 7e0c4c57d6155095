"""Readers of the typed formats: Parquet, Arrow IPC file and Arrow IPC stream."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from typing import Any

import pyarrow as pa
import pyarrow.parquet

from nlosctl.contract.limits import limit
from nlosctl.contract.tables import ColumnType
from nlosctl.errors import DataError
from nlosctl.io.paths.inputs import Part
from nlosctl.io.paths.locations import FileFormat, Location, pyarrow_source
from nlosctl.io.readers.base import RecordBatch, expansion_fault, readable

__all__ = ["ArrowReader", "ParquetReader", "fits_type", "parquet_end_value", "parquet_metadata"]

_BUFFER_BYTES = 1 << 20

_EXPECTED = {
    "number": "numbers",
    "integer": "integers",
    "boolean": "true/false or 1/0",
    "text": "text",
    "identifier": "text or integers",
}


def fits_type(arrow_type: Any, wanted: ColumnType) -> bool:
    """Return whether a column of ``arrow_type`` fits a type of the contract."""
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
                f"{name}, column {column.name!r}: wrong type: contains {column.type}, expected {_EXPECTED[wanted]}; "
                f"convert the column, or read another under this name with `columns`"
            )


def _without_views(schema: Any) -> Any:
    """Return the schema with plain text and bytes for views, on which Arrow can compute little."""
    plain = {pa.string_view(): pa.string(), pa.binary_view(): pa.binary()}
    return pa.schema(
        [column.with_type(plain.get(column.type, column.type)) for column in schema], metadata=schema.metadata
    )


def _rebatch(batches: Iterator[Any], rows: int) -> Iterator[Any]:
    """Yield Arrow record batches of at most ``rows`` rows; small ones are joined."""
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


def parquet_metadata(path: Location) -> Any:
    """Return the metadata at the end of a Parquet file, cached while the file is the same."""
    status = path.stat()
    return _parquet_metadata(path, status.st_size, status.st_mtime_ns)


@lru_cache(maxsize=4)
def _parquet_metadata(path: Location, size: int, modified: int) -> Any:
    return pyarrow.parquet.read_metadata(pyarrow_source(path))


class ParquetReader:
    """A Parquet file, read in batches of any size, independent of its row groups."""

    def __init__(self, part: Part, batch_rows: int, use_threads: bool) -> None:
        self._part, self._batch_rows, self._use_threads = part, batch_rows, use_threads
        with readable(part.name, "Parquet file"):
            self._file = self._open(())
            self._schema = self._file.schema_arrow
            self.names: tuple[str, ...] = tuple(self._schema.names)
            self.metadata: Mapping[bytes, bytes] = {
                **(self._schema.metadata or {}),
                **(self._file.metadata.metadata or {}),  # metadata added at the end of writing is only here
            }
        self._columns: list[str] | None = None
        self._refuse_bomb()

    def _refuse_bomb(self) -> None:
        """Refuse pages that expand too much, before any is decompressed."""
        metadata, most = self._file.metadata, limit("expansion")
        groups = [metadata.row_group(index) for index in range(metadata.num_row_groups)]
        unpacked = sum(group.total_byte_size for group in groups)
        if unpacked <= limit("unchecked_expansion_mb") << 20:
            return
        columns = range(metadata.num_columns)
        packed = sum(group.column(index).total_compressed_size for group in groups for index in columns)
        if unpacked > most * packed:
            raise DataError(expansion_fault(self._part.name, most))

    def _open(self, dictionary: Sequence[str]) -> Any:
        path = self._part.path
        return pa.parquet.ParquetFile(
            self._part.stream if path is None else pyarrow_source(path),
            metadata=None if path is None else parquet_metadata(path),
            read_dictionary=list(dictionary),
            pre_buffer=False,
            buffer_size=_BUFFER_BYTES,
        )

    def start(self, types: Mapping[str, ColumnType], columns: Sequence[str] | None) -> Any:
        """See FormatReader; text is read dictionary-encoded in columns of the contract."""
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
            self._file.close(force=True)
        self._file = self._open(encoded)

    def batches(self) -> Iterator[RecordBatch]:
        """See FormatReader."""
        start, stop = self._part.row_groups or (0, self._file.metadata.num_row_groups)
        row = 1 + sum(self._file.metadata.row_group(index).num_rows for index in range(start))
        with readable(self._part.name, "Parquet file"):
            for batch in _rebatch(
                self._file.iter_batches(
                    self._batch_rows,
                    row_groups=range(start, stop),
                    columns=self._columns,
                    use_threads=self._use_threads,
                ),
                self._batch_rows,
            ):
                batch.validate(full=True)
                wanted = _without_views(batch.schema)
                yield RecordBatch(table=batch if batch.schema.equals(wanted) else batch.cast(wanted), first_row=row)
                row += batch.num_rows

    def close(self) -> None:
        """Close the file."""
        self._file.close(force=self._part.path is not None)
        if self._part.stream is not None:
            self._part.stream.close()


def parquet_end_value(part: Part, column: str, index: int) -> Any:
    """Return the value of ``column`` in the first (0) or last (-1) row of a part; None if it is null.

    It is None too if the part is not a Parquet file with a path, or has no row or no such column.
    """
    if part.format is not FileFormat.PARQUET or part.path is None:
        return None
    metadata = parquet_metadata(part.path)
    start, stop = part.row_groups or (0, metadata.num_row_groups)
    if start == stop or column not in metadata.schema.to_arrow_schema().names:
        return None
    with (
        readable(part.name, "Parquet file"),
        pa.parquet.ParquetFile(pyarrow_source(part.path), metadata=metadata) as file,
    ):
        if index == 0:
            batch = next(file.iter_batches(1, row_groups=[start], columns=[column], use_threads=False), None)
        else:
            batch = file.read_row_group(stop - 1, columns=[column], use_threads=False)
        return None if batch is None or not batch.num_rows else batch.column(0)[index].as_py()


class ArrowReader:
    """An Arrow IPC file or stream."""

    def __init__(self, part: Part, batch_rows: int) -> None:
        self._part, self._batch_rows = part, batch_rows
        with readable(part.name, "Arrow file"):
            # not memory-mapped: truncating the file meanwhile would kill the process
            source: Any = part.stream if part.path is None else pyarrow_source(part.path)
            self._handle: Any = pa.OSFile(source) if isinstance(source, str) else source
            opener = pa.ipc.open_file if part.format is FileFormat.ARROW else pa.ipc.open_stream
            self._reader = opener(self._handle)
            self._schema = _without_views(self._reader.schema)
            self.names: tuple[str, ...] = tuple(self._schema.names)
        self.metadata: Mapping[bytes, bytes] = self._schema.metadata or {}
        self._columns: list[str] | None = None

    def start(self, types: Mapping[str, ColumnType], columns: Sequence[str] | None) -> Any:
        """See FormatReader."""
        _check_types(self._part.name, self._schema, types)
        self._columns = list(columns) if columns is not None else None
        schema = self._schema.remove_metadata()
        return schema if columns is None else pa.schema([schema.field(name) for name in columns])

    def batches(self) -> Iterator[RecordBatch]:
        """See FormatReader."""
        row = 1
        with readable(self._part.name, "Arrow file"):
            for batch in _rebatch(self._record_batches(), self._batch_rows):
                yield RecordBatch(table=batch, first_row=row)
                row += batch.num_rows

    def _record_batches(self) -> Iterator[Any]:
        if self._part.format is FileFormat.ARROW:
            batches: Iterator[Any] = map(self._reader.get_batch, range(self._reader.num_record_batches))
        else:
            batches = iter(self._reader)
        for batch in batches:
            batch.validate(full=True)  # offsets out of range would be read unchecked
            batch = batch if self._columns is None else batch.select(self._columns)
            wanted = _without_views(batch.schema)
            yield batch if batch.schema.equals(wanted) else batch.cast(wanted)

    def close(self) -> None:
        """Close the file."""
        self._handle.close()
