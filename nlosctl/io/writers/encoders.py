"""Rows to bytes, for each format."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from nlosctl.io.paths.file_format import FileFormat
from nlosctl.io.readers.arrow_text import as_text, json_default

__all__ = ["Encoder", "make_encoder"]


class Encoder(Protocol):
    """Turns tables to bytes on a sink that stays open."""

    def write(self, table: Any) -> None:
        """Encode the rows of one table as one group."""

    def close(self, metadata: Mapping[str, str]) -> None:
        """End the file; ``metadata`` is what there is by now."""


def make_encoder(format: FileFormat, sink: Any, schema: Any, metadata: Mapping[str, str]) -> Encoder:
    """Return the encoder of a format that writes to the binary file ``sink``."""
    if format is FileFormat.PARQUET:
        return _ParquetEncoder(sink, schema, metadata)
    if format in (FileFormat.ARROW, FileFormat.ARROW_STREAM):
        return _ArrowEncoder(sink, schema.with_metadata(dict(metadata)), format)
    # gzip by zlib writes no time and no name, so that equal rows give equal bytes
    bytes_out = pa.CompressedOutputStream(_kept_open(sink), "gzip") if format.compressed else None
    if format in (FileFormat.CSV, FileFormat.CSV_GZ):
        return _CsvEncoder(bytes_out or sink, schema, bytes_out)
    return _JsonLinesEncoder(bytes_out or sink, bytes_out)


def _kept_open(sink: Any) -> Any:
    return pa.PythonFile(_Unclosed(sink), mode="w")


class _Unclosed:
    """A file whose owner closes it; what a library writes to it later, when it is given up, goes nowhere."""

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
    """Zstandard, statistics, dictionaries for text alone (for measured numbers they cost 5 times and save nothing)."""

    def __init__(self, sink: Any, schema: Any, metadata: Mapping[str, str]) -> None:
        self._written = dict(metadata)
        schema = schema.with_metadata(self._written)
        texts = [column.name for column in schema if pa.types.is_string(column.type)]
        self._writer = pa.parquet.ParquetWriter(sink, schema, compression="zstd", use_dictionary=texts)

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
        self._writer = opener(pa.PythonFile(_Unclosed(sink), mode="w"), schema)

    def write(self, table: Any) -> None:
        if table.num_rows:
            # fresh buffers: those of a slice would carry its neighbours' bits, or lack a bitmap
            table = table.take(pa.array(np.arange(table.num_rows)))
            self._writer.write_table(table.cast(self._schema), max_chunksize=table.num_rows)

    def close(self, metadata: Mapping[str, str]) -> None:
        self._writer.close()


class _CsvEncoder:
    def __init__(self, sink: Any, schema: Any, stream: Any) -> None:
        self._sink, self._stream = sink, stream
        header = io.StringIO()
        csv.writer(header, lineterminator="\n").writerow(schema.names)
        sink.write(header.getvalue().encode())

    def _write(self, table: Any, options: Any) -> None:
        buffer = pa.BufferOutputStream()
        pa.csv.write_csv(table, buffer, options)
        self._sink.write(buffer.getvalue())

    def write(self, table: Any) -> None:
        table = _with_plain_columns(table)
        try:
            self._write(table, _csv_options("none"))
        except pa.ArrowInvalid:  # a cell holds a comma, a quote or a line end
            self._write(table, _csv_options("needed"))

    def close(self, metadata: Mapping[str, str]) -> None:
        if self._stream is not None:
            self._stream.close()


def _with_plain_columns(table: Any) -> Any:
    """Return the table with text for columns of types that Arrow can't write as CSV, such as lists and bytes."""
    for place, column in enumerate(table.schema):
        if not _is_plain(column.type):
            table = table.set_column(place, column.name, as_text(table.column(place)))
    return table


def _is_plain(kind: Any) -> bool:
    types = pa.types
    if types.is_string(kind) or types.is_large_string(kind) or types.is_boolean(kind) or types.is_null(kind):
        return True
    number = types.is_integer(kind) or types.is_floating(kind) or types.is_decimal(kind)
    return bool(number or (types.is_temporal(kind) and not types.is_interval(kind)))


def _csv_options(quoting: str) -> Any:
    return pa.csv.WriteOptions(include_header=False, batch_size=16_384, quoting_style=quoting)


class _JsonLinesEncoder:
    def __init__(self, sink: Any, stream: Any) -> None:
        self._sink, self._stream = sink, stream

    def write(self, table: Any) -> None:
        columns = [_json_values(table.column(name)) for name in table.column_names]
        names = [json.dumps(name, ensure_ascii=False) for name in table.column_names]
        lines = (
            "{" + ", ".join(f"{name}: {value}" for name, value in zip(names, row, strict=True)) + "}\n"
            for row in zip(*columns, strict=True)
        )
        self._sink.write("".join(lines).encode("utf-8"))

    def close(self, metadata: Mapping[str, str]) -> None:
        if self._stream is not None:
            self._stream.close()


def _json_values(column: Any) -> list[str]:
    """Return the values as JSON; JSON has no NaN and no infinity, so these become null."""
    values = column.to_pylist()
    if pa.types.is_floating(column.type):
        values = [value if value is not None and math.isfinite(value) else None for value in values]
    return [json.dumps(value, ensure_ascii=False, default=json_default) for value in values]
