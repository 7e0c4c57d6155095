"""Atomic writer of tables, whose bytes do not depend on the batches in which the rows arrive."""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from types import TracebackType
from typing import IO, Any, Protocol

import numpy as np
import pyarrow as pa
import pyarrow.parquet

from nlosctl.contract.limits import size
from nlosctl.io.measurements.row_checks import BadRow
from nlosctl.io.paths.locations import FileFormat, Location, format_of_path, known_format_of_path, location
from nlosctl.io.readers.base import plain_type
from nlosctl.io.writers.byte_output import ByteOutput, writing
from nlosctl.io.writers.output_set import check_targets
from nlosctl.io.writers.text_encoders import CsvEncoder, JsonLinesEncoder

__all__ = ["BadRowWriter", "TableWriter", "provenance_text"]

_SPOOL_IN_MEMORY_BYTES = 64 << 20


class TableWriter:
    """Context manager that writes tables of one schema to ``target``: a path, or ``-`` for standard output.

    A file appears under its name only when the block ends without an exception; after a failure nothing is left.
    Standard output receives the rows immediately (Parquet: at the end). ``schema`` is the Arrow schema of the file.
    ``metadata`` is written in formats that can store it; ``set_metadata`` adds to it, for Parquet until the end.

    Raises DataError if the file exists (without ``overwrite``; with ``repeats``, if it has another content in the
    end), is one of ``inputs``, or can't be written, and UsageError for an unknown extension. A closed pipe is a
    BrokenPipeError, which the caller handles silently.
    """

    def __init__(
        self,
        target: str,
        schema: Any,
        *,
        format: FileFormat | None = None,
        overwrite: bool = False,
        repeats: bool = False,
        inputs: Sequence[Location] = (),
        metadata: Mapping[str, str] | None = None,
        stdout: IO[bytes] | None = None,
        group_rows: int | None = None,
    ) -> None:
        self.target = target
        self.rows = 0
        self.schema = pa.schema([column.with_type(plain_type(column.type)) for column in schema])
        self._metadata = dict(metadata or {})
        self._output = ByteOutput(target, stdout, overwrite=overwrite, repeats=repeats)
        self._group_rows = group_rows or size("group_rows")
        self._format = _format_for(target, format)
        self._buffered: list[Any] = []
        self._buffered_rows = 0
        self._sink: Any = None
        self._encoder: Encoder | None = None
        self._closed = False
        check_targets([target], overwrite=overwrite or repeats, inputs=inputs)

    def __enter__(self) -> TableWriter:
        self._sink = self._output.__enter__().sink
        if self.target == "-" and self._format is FileFormat.PARQUET:
            self._sink = tempfile.SpooledTemporaryFile(max_size=_SPOOL_IN_MEMORY_BYTES)
        return self

    @property
    def passes_on(self) -> bool:
        """Whether written rows can't be taken back: standard output, a pipe, a device."""
        return self._output.passes_on

    def set_metadata(self, metadata: Mapping[str, str]) -> None:
        """Add metadata; for Arrow before the first full row group is written."""
        self._metadata.update(metadata)

    def write(self, table: Any) -> None:
        """Write rows; dictionary-encoded columns are decoded."""
        self._buffered.append(_plain(table, self.schema))
        self._buffered_rows += table.num_rows
        self.rows += table.num_rows
        while self._buffered_rows >= self._group_rows:
            self._encode(self._take_buffered(self._group_rows))

    def _take_buffered(self, rows: int) -> Any:
        """Return the first buffered rows as one contiguous table and release the tables they came in."""
        buffered = pa.concat_tables(self._buffered) if self._buffered else self.schema.empty_table()
        self._buffered = [buffered.slice(rows)]
        self._buffered_rows -= rows
        return buffered.slice(0, rows).combine_chunks()

    def complete(self) -> None:
        """Write all buffered rows; only the renaming to the final name is left, see `OutputSet`."""
        with writing(self.target):
            self._close_encoder()
        self._output.complete()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self._output.end(kind, self.complete)
        finally:
            if self._sink is not self._output.sink:
                self._sink.close()

    def _encode(self, table: Any) -> None:
        with writing(self.target):
            if self._encoder is None:
                self._encoder = make_encoder(self._format, self._sink, self.schema, self._metadata)
            self._encoder.write(table)
        pa.default_memory_pool().release_unused()  # return the memory of the encoded group

    def _close_encoder(self) -> None:
        if self._closed:
            return
        if self._buffered_rows or self._encoder is None:
            self._encode(self._take_buffered(self._buffered_rows))
        assert self._encoder is not None  # noqa: S101 - made by _encode
        self._encoder.close(self._metadata)
        self._closed = True
        if self._sink is not self._output.sink:
            self._sink.seek(0)
            shutil.copyfileobj(self._sink, self._output.sink)


class BadRowWriter:
    """Writes bad rows to a table file: ``row``, ``problem``, ``line``, then the columns as text.

    Call it with bad rows (it is a `nlosctl.io.measurements.row_checks.BadRowSink`). ``line`` is the raw text of a line
    that can't be parsed as a row. With several inputs ``problem`` names the file.
    """

    def __init__(self, writer: TableWriter) -> None:
        self._writer = writer

    _OWN = ("row", "problem", "line")

    @classmethod
    def schema(cls, names: Sequence[str]) -> Any:
        """Return the schema for an input with columns ``names``; names equal to ours get the prefix ``input_``."""
        own = [("row", pa.int64()), ("problem", pa.string()), ("line", pa.string())]
        return pa.schema([*own, *((cls._renamed(name), pa.string()) for name in names)])

    @classmethod
    def _renamed(cls, name: str) -> str:
        return f"input_{name}" if name in cls._OWN else name

    def __call__(self, rows: Sequence[BadRow]) -> None:
        """Write the rows."""
        records = [
            {
                **{self._renamed(name): value for name, value in row.values.items()},
                "row": row.problem.row,
                "problem": str(row.problem),
                "line": row.raw_line,
            }
            for row in rows
        ]
        self._writer.write(pa.Table.from_pylist(records, schema=self._writer.schema))


def provenance_text(provenance: Mapping[str, Any]) -> str:
    """Return provenance as JSON: the same bytes for the same content."""
    return json.dumps(provenance, sort_keys=True, ensure_ascii=False)


def _format_for(target: str, format: FileFormat | None) -> FileFormat:
    """Return the format of an output by its extension, else ``format``."""
    if target != "-":
        return known_format_of_path(location(target).name) or format or format_of_path(target)
    return FileFormat.ARROW_STREAM if format is FileFormat.ARROW else format or FileFormat.CSV


def _plain(table: Any, schema: Any) -> Any:
    table = table.replace_schema_metadata(None)
    if table.schema.equals(schema):
        return table
    return table.select(schema.names).cast(schema)


class Encoder(Protocol):
    """Encodes tables to a sink and leaves it open."""

    def write(self, table: Any) -> None:
        """Encode the rows of one table as one group."""

    def close(self, metadata: Mapping[str, str]) -> None:
        """Write the end of the file with the final ``metadata``."""


def make_encoder(format: FileFormat, sink: Any, schema: Any, metadata: Mapping[str, str]) -> Encoder:
    """Return the encoder of a format that writes to the binary file ``sink``."""
    if format is FileFormat.PARQUET:
        return _ParquetEncoder(sink, schema, metadata)
    if format in (FileFormat.ARROW, FileFormat.ARROW_STREAM):
        return _ArrowEncoder(sink, schema.with_metadata(dict(metadata)), format)
    # gzip by zlib writes no time and no name, so that equal rows give equal bytes
    codec = {"gz": "gzip", "zst": "zstd", "bz2": "bz2"}.get(format.compression)
    bytes_out = None if codec is None else pa.CompressedOutputStream(_unclosed(sink), codec)
    if format.is_delimited:
        separator = "\t" if format.uncompressed is FileFormat.TSV else ","
        return CsvEncoder(bytes_out or sink, schema, bytes_out, separator)
    return JsonLinesEncoder(bytes_out or sink, bytes_out)


def _unclosed(sink: Any) -> Any:
    return pa.PythonFile(_Unclosed(sink), mode="w")


class _Unclosed:
    """A file that only its owner closes; bytes that a library writes after that are discarded."""

    closed = False

    def __init__(self, sink: Any) -> None:
        self._sink = sink

    def write(self, data: Any) -> int:
        return len(data) if self._sink.closed else self._sink.write(data)

    def flush(self) -> None:
        if not self._sink.closed:
            self._sink.flush()

    def close(self) -> None:
        self.flush()


class _ParquetEncoder:
    """Zstandard, statistics; dictionaries for text only: for measured numbers they cost time and save nothing."""

    def __init__(self, sink: Any, schema: Any, metadata: Mapping[str, str]) -> None:
        self._written = dict(metadata)
        schema = schema.with_metadata(self._written)
        texts = [column.name for column in schema if pa.types.is_string(column.type)]
        self._writer = pa.parquet.ParquetWriter(_unclosed(sink), schema, compression="zstd", use_dictionary=texts)

    def write(self, table: Any) -> None:
        if table.num_rows:
            self._writer.write_table(table, row_group_size=table.num_rows)

    def close(self, metadata: Mapping[str, str]) -> None:
        late = {key: value for key, value in metadata.items() if self._written.get(key) != value}
        if late:
            self._writer.add_key_value_metadata(late)
        self._writer.close()


class _ArrowEncoder:
    def __init__(self, sink: Any, schema: Any, format: FileFormat) -> None:
        opener = pa.ipc.new_file if format is FileFormat.ARROW else pa.ipc.new_stream
        self._schema = schema
        self._writer = opener(_unclosed(sink), schema)

    def write(self, table: Any) -> None:
        if table.num_rows:
            # new buffers: a slice shares its bitmap with neighbouring rows, or has none
            table = table.take(pa.array(np.arange(table.num_rows)))
            self._writer.write_table(table.cast(self._schema), max_chunksize=table.num_rows)

    def close(self, metadata: Mapping[str, str]) -> None:
        self._writer.close()
