"""Tables in memory as inputs and as results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any

import pyarrow as pa

from nlosctl.errors import UsageError
from nlosctl.io.paths.inputs import Input, Part
from nlosctl.io.paths.locations import FileFormat
from nlosctl.io.readers.base import plain_type

__all__ = ["gather", "input_of_table"]


def input_of_table(table: Any) -> Input:
    """Return a table (or anything that `pyarrow.table` accepts) as an input for the readers.

    Raises UsageError for a path.
    """
    if isinstance(table, str | PathLike):
        raise UsageError(f"got the path {str(table)!r}, expected a table; read it, such as by pyarrow.csv.read_csv")
    table = table if isinstance(table, pa.Table) else pa.table(table)
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, table.schema) as writer:
        writer.write_table(table)
    return Input(
        name="table",
        parts=(Part(name="table", format=FileFormat.ARROW_STREAM, stream=pa.BufferReader(sink.getvalue())),),
    )


def gather(tables: Sequence[Any], schema: Any, metadata: Mapping[str, str] | None = None) -> Any:
    """Return the tables as one table, with plain text for dictionary-encoded text."""
    plain = pa.schema([field.with_type(plain_type(field.type)) for field in schema], metadata=metadata)
    return pa.concat_tables([table.cast(plain) for table in tables]) if tables else plain.empty_table()
