"""Tables in memory as inputs and as results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import pyarrow as pa
import pyarrow.parquet

from nlosctl.errors import UsageError, in_one_line
from nlosctl.io.paths.inputs import Input, Part
from nlosctl.io.paths.locations import FileFormat
from nlosctl.io.readers.base import plain_type

__all__ = ["gather", "input_of_table", "read_table"]


def input_of_table(table: Any) -> Input:
    """Return a table (or anything that `pyarrow.table` accepts) as an input for the readers; a LazyFrame is collected.

    Raises UsageError for anything else.
    """
    if hasattr(table, "collect_schema") and hasattr(table, "collect"):
        table = table.collect()  # a LazyFrame of polars
    if not isinstance(table, pa.Table):
        try:
            table = pa.table(table)
        except (TypeError, ValueError, pa.ArrowException) as error:
            raise UsageError(
                f"got a {type(table).__name__}, expected a table (pyarrow, polars, pandas, a dict) or a path: "
                f"{in_one_line(error)}"
            ) from error
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, table.schema) as writer:
        writer.write_table(table)
    reopen = partial(pa.BufferReader, sink.getvalue())
    part = Part(name="table", format=FileFormat.ARROW_STREAM, reopen=reopen)
    return Input(name="table", parts=(part.again(),))


def read_table(path: str) -> Any:
    """Return a Parquet file of this program as a table."""
    return pyarrow.parquet.read_table(path)


def gather(tables: Sequence[Any], schema: Any, metadata: Mapping[str, str] | None = None) -> Any:
    """Return the tables as one table, with plain text for dictionary-encoded text."""
    plain = pa.schema([field.with_type(plain_type(field.type)) for field in schema], metadata=metadata)
    return pa.concat_tables([table.cast(plain) for table in tables]) if tables else plain.empty_table()
