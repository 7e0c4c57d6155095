"""Reader of Parquet, and what it shares with that of Arrow IPC."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import lru_cache
from typing import Any

import pyarrow as pa
import pyarrow.parquet

from nlosctl.contract.limits import limit
from nlosctl.contract.tables import ColumnType
from nlosctl.errors import DataError
from nlosctl.io.paths.inputs import Part
from nlosctl.io.paths.locations import FileFormat, Location, pyarrow_source
from nlosctl.io.readers.arrow_types import (
    contract_batch,
    contract_column,
    contract_schema,
    read_batch,
    read_column,
    read_schema,
)
from nlosctl.io.readers.base import RecordBatch, expansion_fault, readable

__all__ = [
    "ParquetReader",
    "as_read",
    "check_types",
    "checked",
    "fits_type",
    "in_contract",
    "parquet_end_value",
    "parquet_metadata",
    "rebatch",
]

_BUFFER_BYTES = 1 << 20

_EXPECTED = {
    "number": "numbers",
    "exact": "numbers",
    "integer": "integers",
    "boolean": "true/false or 1/0",
    "text": "text",
    "identifier": "text, whole numbers or times",
}


_COMMON = {pa.string(), pa.dictionary(pa.int32(), pa.string()), pa.float64(), pa.int64(), pa.bool_()}
"""The types of the tables that nlosctl writes."""


def fits_type(arrow_type: Any, wanted: ColumnType) -> bool:
    """Return whether a column of ``arrow_type`` fits a type of the contract."""
    if pa.types.is_dictionary(arrow_type):
        arrow_type = arrow_type.value_type
    kinds = pa.types
    if kinds.is_null(arrow_type):
        return True
    integer = kinds.is_integer(arrow_type)
    text = kinds.is_string(arrow_type) or kinds.is_large_string(arrow_type) or kinds.is_string_view(arrow_type)
    if wanted in ("number", "exact"):
        return bool(integer or kinds.is_floating(arrow_type) or kinds.is_decimal(arrow_type))
    integer = integer or kinds.is_floating(arrow_type) or kinds.is_decimal(arrow_type)  # of whole numbers
    if wanted == "boolean":
        return bool(kinds.is_boolean(arrow_type) or integer)
    time = kinds.is_timestamp(arrow_type) or kinds.is_date(arrow_type)
    return bool({"integer": integer, "text": text, "identifier": text or integer or time}[wanted])


def check_types(name: str, schema: Any, types: Mapping[str, ColumnType]) -> None:
    """Raise DataError for a column of another type than ``types`` states."""
    for column in schema:
        wanted = types.get(column.name)
        if wanted is not None and not fits_type(column.type, wanted):
            raise DataError(
                f"{name}, column {column.name!r}: wrong type: contains {column.type}, expected {_EXPECTED[wanted]}; "
                f"convert the column, or read another under this name with `columns`"
            )


def _is_plain(schema: Any, types: Mapping[str, ColumnType]) -> bool:
    """Return whether all columns are read as they are: common types, and no floats as ids, integers or booleans."""
    return all(
        field.type in _COMMON and (field.type != pa.float64() or types.get(field.name, "number") in ("number", "exact"))
        for field in schema
    )


def as_read(schema: Any, types: Mapping[str, ColumnType]) -> Any:
    """Return the schema of a file as its columns are read, those of the contract with these ``types``."""
    return schema if _is_plain(schema, types) else contract_schema(read_schema(schema), types)


def in_contract(batch: Any, types: Mapping[str, ColumnType], row: int) -> RecordBatch:
    """Return the rows of a `checked` Arrow batch with the schema of `as_read`."""
    if _is_plain(batch.schema, types):
        return RecordBatch(table=batch, first_row=row)
    return contract_batch(batch, types, row)


def checked(batch: Any) -> Any:
    """Return the batch as `read_batch` does; offsets out of range would be read unchecked."""
    if _is_plain(batch.schema, {}):
        with suppress(pa.ArrowInvalid):
            batch.validate(full=True)
            return batch
    return read_batch(batch)


def rebatch(batches: Iterator[Any], rows: int) -> Iterator[Any]:
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

    accepted_texts: Collection[str] = ()

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
        self._types: dict[str, ColumnType] = {}
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
        check_types(self._part.name, as_read(self._schema, {}), types)
        self._columns = list(columns) if columns is not None else None
        encoded = [
            column.name
            for column in self._schema
            if types.get(column.name) in ("text", "identifier") and pa.types.is_string(column.type)
        ]
        if encoded:
            with readable(self._part.name, "Parquet file"):
                self._reopen(encoded)
        self._types = dict(types)
        self._schema = as_read(self._file.schema_arrow.remove_metadata(), types)
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
            for batch in rebatch(self._record_batches(range(start, stop)), self._batch_rows):
                yield in_contract(batch, self._types, row)
                row += batch.num_rows

    def _record_batches(self, row_groups: range) -> Iterator[Any]:
        batches = self._file.iter_batches(
            self._batch_rows, row_groups=row_groups, columns=self._columns, use_threads=self._use_threads
        )
        while True:
            try:
                batch = next(batches, None)
            except pa.ArrowInvalid as error:
                raise pa.ArrowInvalid(f"{self._unreadable_column(row_groups)}{error}") from error
            if batch is None:
                return
            # a name with a dot selects the member of a structure too
            yield checked(batch if self._columns is None else batch.select(self._columns))

    def _unreadable_column(self, row_groups: range) -> str:
        """Return the first column that can't be read, for a message; empty if each can."""
        for name in self._columns or self.names:
            try:
                for _ in self._file.iter_batches(self._batch_rows, row_groups=row_groups, columns=[name]):
                    pass
            except pa.ArrowInvalid:
                return f"column {name!r}: "
        return ""

    def close(self) -> None:
        """Close the file."""
        self._file.close(force=self._part.path is not None)
        if self._part.stream is not None:
            self._part.stream.close()


def parquet_end_value(part: Part, column: str, index: int) -> Any:
    """Return the id in ``column`` in the first (0) or last (-1) row of a part; None if it is null.

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
        if batch is None or not batch.num_rows:
            return None
        cells = pa.table(batch.select([column])).column(0)
        cells = cells.slice(index % len(cells), 1).combine_chunks()
        return contract_column(read_column(cells), "identifier", column)[0][0].as_py()
