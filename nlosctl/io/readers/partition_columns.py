"""Columns from the names of folders (``year=2026/part.parquet``)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import pyarrow as pa

from nlosctl.contract.tables import ColumnType
from nlosctl.errors import DataError
from nlosctl.io.paths.inputs import Part
from nlosctl.io.readers.base import RecordBatch
from nlosctl.io.readers.text_files import EXPECTED, arrow_type_of

__all__ = ["PartitionColumns"]


class PartitionColumns:
    """A `Step` that adds the columns in a file's folder names; a column of the file itself takes precedence.

    A value is an integer if it is written as one, else text; a column of the contract has the contract's type.
    """

    replaces: Sequence[str] = ()

    def __init__(self, part: Part, file_names: Sequence[str]) -> None:
        self._file = part.name
        self._texts = {name: text for name, text in part.keys if name not in file_names}
        self.names: tuple[str, ...] = tuple(self._texts)
        self._values: dict[str, Any] = {}

    def request(
        self, types: Mapping[str, ColumnType], columns: list[str] | None
    ) -> tuple[Mapping[str, ColumnType], list[str] | None]:
        """See Step; raises DataError if a folder's value does not fit its column."""
        self._values = {
            name: _scalar(text, types.get(name), self._file, name)
            for name, text in self._texts.items()
            if columns is None or name in columns
        }
        own = None if columns is None else [name for name in columns if name not in self._values]
        return {name: kind for name, kind in types.items() if name not in self._texts}, own

    def extend(self, schema: Any) -> Any:
        """See Step."""
        return pa.schema([*schema, *(pa.field(name, value.type) for name, value in self._values.items())])

    def apply(self, batch: RecordBatch) -> RecordBatch:
        """See Step."""
        table, text = batch.table, batch.text
        for name, value in self._values.items():
            table = table.append_column(name, pa.repeat(value, table.num_rows))
            if text is not None:
                text = text.append_column(name, pa.repeat(pa.scalar(self._texts[name], pa.string()), table.num_rows))
        return replace(batch, table=table, text=text)


def _scalar(text: str | None, kind: ColumnType | None, file: str, name: str) -> Any:
    if kind in ("number", "integer", "boolean"):
        try:
            return pa.scalar(text, pa.string()).cast(arrow_type_of(kind))
        except pa.ArrowInvalid:
            raise DataError(f"{file}: its folder name is {name}={text}, expected {EXPECTED[kind]}") from None
    if kind != "text" and text is not None and _is_integer(text):
        return pa.scalar(int(text), pa.int64())
    return pa.scalar(text, pa.string())


def _is_integer(text: str) -> bool:
    digits = text.removeprefix("-")
    return digits.isascii() and digits.isdigit() and str(int(text)) == text and abs(int(text)) < 2**63
