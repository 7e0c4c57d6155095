"""Columns that the names of folders tell (``year=2026/part.parquet``), added to the rows of a file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import pyarrow as pa

from nlosctl.contract.tables import ColumnType
from nlosctl.errors import DataError
from nlosctl.io.paths.inputs import Part
from nlosctl.io.readers.base import RawBatch, RawSource

__all__ = ["KeyedSource"]


class KeyedSource:
    """A file with the columns that its folders' names tell; a column of the file itself comes first.

    A value is an integer where it is written as one, else text, unless the contract knows the column.
    """

    def __init__(self, part: Part, source: RawSource) -> None:
        self._part, self._source = part, source
        self._texts = {name: text for name, text in part.keys if name not in source.names}
        self.names: tuple[str, ...] = (*source.names, *self._texts)
        self.metadata: Mapping[bytes, bytes] = source.metadata
        self._values: dict[str, Any] = {}

    def start(self, types: Mapping[str, ColumnType], columns: Sequence[str] | None) -> Any:
        """See RawSource; raises DataError where a folder's value does not fit its column."""
        wanted = self.names if columns is None else tuple(columns)
        self._values = {
            name: _scalar(text, types.get(name), self._part.name, name)
            for name, text in self._texts.items()
            if name in wanted
        }
        own = None if columns is None else [name for name in columns if name not in self._values]
        schema = self._source.start({name: kind for name, kind in types.items() if name not in self._texts}, own)
        fields = {field.name: field for field in schema}
        fields |= {name: pa.field(name, value.type) for name, value in self._values.items()}
        self.names = tuple(wanted)
        return pa.schema([fields[name] for name in wanted])

    def batches(self) -> Iterator[RawBatch]:
        """See RawSource."""
        for batch in self._source.batches():
            texts = {name: pa.scalar(self._texts[name], pa.string()) for name in self._values}
            text = batch.text if batch.text is None else self._with(batch.text, texts)
            yield replace(batch, table=self._with(batch.table, self._values), text=text)

    def _with(self, rows: Any, values: Mapping[str, Any]) -> Any:
        columns = [
            pa.repeat(values[name], rows.num_rows) if name in values else rows.column(name) for name in self.names
        ]
        return pa.RecordBatch.from_arrays(columns, names=list(self.names))

    def close(self) -> None:
        """Close the file."""
        self._source.close()


def _scalar(text: str | None, kind: ColumnType | None, file: str, name: str) -> Any:
    if kind in ("number", "integer", "boolean"):
        wanted = {"number": pa.float64(), "integer": pa.int64(), "boolean": pa.bool_()}[kind]
        try:
            return pa.scalar(text, pa.string()).cast(wanted)
        except pa.ArrowInvalid:
            expected = {"number": "a number", "integer": "an integer", "boolean": "true/false or 1/0"}[kind]
            raise DataError(f"{file}: its folder says {name}={text}, expected {expected}") from None
    if kind != "text" and text is not None and _is_integer(text):
        return pa.scalar(int(text), pa.int64())
    return pa.scalar(text, pa.string())


def _is_integer(text: str) -> bool:
    digits = text.removeprefix("-")
    return digits.isascii() and digits.isdigit() and str(int(text)) == text and abs(int(text)) < 2**63
