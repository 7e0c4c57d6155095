"""Tables of bounds."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy.typing as npt
import pyarrow as pa

from nlosctl.arrays import IntArray
from nlosctl.contract.tables import BOUND, SWEEP_PREFIX
from nlosctl.io.readers.base import plain_type

__all__ = ["bound_schema", "bound_table"]


def bound_schema(input_schema: Any | None) -> Any:
    """Return the Arrow schema; ``snapshot`` as in the input, or left out where there is no input (a map)."""
    fields = []
    if input_schema is not None:
        known = "snapshot" in input_schema.names
        kind = input_schema.field("snapshot").type if known else pa.int64()
        fields.append(pa.field("snapshot", kind))
    for column in BOUND.columns[1:]:
        fields.append(pa.field(column.name, pa.int64() if column.type == "integer" else pa.float64()))
    if input_schema is not None:
        swept = [field for field in input_schema if field.name.startswith(SWEEP_PREFIX)]
        fields += [pa.field(field.name, plain_type(field.type)) for field in swept]
    return pa.schema(fields)


def bound_table(
    arrays: Mapping[str, npt.NDArray[Any]],
    schema: Any,
    snapshot: Any = None,
    rows: Any = None,
    first_row: IntArray | None = None,
) -> Any:
    """Return a table of arrays (B,) by column name; NaN becomes null. ``snapshot`` (B,) is an Arrow array.

    ``first_row`` (B,) is the first row of each snapshot in the input's table ``rows``, which tells its ``sweep_*``.
    """
    columns = []
    for field in schema:
        if field.name == "snapshot":
            columns.append(snapshot.cast(field.type))
        elif field.name.startswith(SWEEP_PREFIX):
            columns.append(rows.column(field.name).take(pa.array(first_row)).cast(field.type))
        else:
            values = arrays[field.name]
            columns.append(pa.array(values, field.type, from_pandas=values.dtype.kind == "f"))
    return pa.table(columns, schema=schema)
