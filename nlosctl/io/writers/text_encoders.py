"""Encoders of CSV, TSV and JSON Lines, plain or compressed."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Mapping
from typing import Any

import pyarrow as pa
import pyarrow.csv

from nlosctl.io.readers.base import as_text, json_default

__all__ = ["CsvEncoder", "JsonLinesEncoder"]


class CsvEncoder:
    """Writes cells between commas (or another ``separator``), with quotes only where a cell needs them."""

    def __init__(self, sink: Any, schema: Any, stream: Any, separator: str = ",") -> None:
        self._sink, self._stream, self._separator = sink, stream, separator
        header = io.StringIO()
        csv.writer(header, lineterminator="\n", delimiter=separator).writerow(schema.names)
        sink.write(header.getvalue().encode())

    def _write(self, table: Any, quoting: str) -> None:
        buffer = pa.BufferOutputStream()
        options = pa.csv.WriteOptions(
            include_header=False, batch_size=16_384, quoting_style=quoting, delimiter=self._separator
        )
        pa.csv.write_csv(table, buffer, options)
        self._sink.write(buffer.getvalue())

    def write(self, table: Any) -> None:
        """Encode the rows of one table."""
        table = _with_plain_columns(table)
        try:
            self._write(table, "none")
        except pa.ArrowInvalid:  # a cell holds a separator, a quote or a line end
            self._write(table, "needed")

    def close(self, metadata: Mapping[str, str]) -> None:
        """End the compressed stream, if there is one; the formats have no metadata."""
        if self._stream is not None:
            self._stream.close()


def _with_plain_columns(table: Any) -> Any:
    """Return the table with text for columns of types that Arrow can't write as CSV, such as lists and bytes."""
    for index, column in enumerate(table.schema):
        if not _is_plain(column.type):
            table = table.set_column(index, column.name, as_text(table.column(index)))
    return table


def _is_plain(kind: Any) -> bool:
    types = pa.types
    if types.is_string(kind) or types.is_large_string(kind) or types.is_boolean(kind) or types.is_null(kind):
        return True
    number = types.is_integer(kind) or types.is_floating(kind) or types.is_decimal(kind)
    return bool(number or (types.is_temporal(kind) and not types.is_interval(kind)))


class JsonLinesEncoder:
    """Writes a JSON object per row; NaN and infinity become null."""

    def __init__(self, sink: Any, stream: Any) -> None:
        self._sink, self._stream = sink, stream

    def write(self, table: Any) -> None:
        """Encode the rows of one table."""
        columns = [_json_values(table.column(name)) for name in table.column_names]
        names = [json.dumps(name, ensure_ascii=False) for name in table.column_names]
        lines = (
            "{" + ", ".join(f"{name}: {value}" for name, value in zip(names, row, strict=True)) + "}\n"
            for row in zip(*columns, strict=True)
        )
        self._sink.write("".join(lines).encode("utf-8"))

    def close(self, metadata: Mapping[str, str]) -> None:
        """End the compressed stream, if there is one; the formats have no metadata."""
        if self._stream is not None:
            self._stream.close()


def _json_values(column: Any) -> list[str]:
    """Return the values as JSON; JSON has no NaN and no infinity, so these become null."""
    values = column.to_pylist()
    if pa.types.is_floating(column.type):
        values = [value if value is not None and math.isfinite(value) else None for value in values]
    if pa.types.is_decimal(column.type):
        return ["null" if value is None else str(value) for value in values]
    return [json.dumps(value, ensure_ascii=False, default=json_default) for value in values]
