"""Tables of bounds, and the truth that they are for."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from nlosctl.arrays import FloatArray, IntArray
from nlosctl.contract.tables import BOUND, SWEEP_PREFIX
from nlosctl.errors import DataError
from nlosctl.io.readers.base import plain_type

__all__ = ["bound_schema", "bound_table", "truth_positions"]


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


def truth_positions(rows: Any, first_row: IntArray, source: str) -> tuple[FloatArray, FloatArray]:
    """Return the true x and y (S,) of snapshots by their first row in the input's table; NaN where it is empty.

    Raises DataError where the input has no truth columns.
    """
    found = []
    for name in ("truth_x_m", "truth_y_m"):
        if name not in rows.column_names:
            raise DataError(f"{source}: no column {name!r}; a bound needs the truth, or --map for a grid of positions")
        cells = rows.column(name).take(pa.array(first_row)).cast(pa.float64())
        found.append(np.asarray(cells.to_numpy(), dtype=np.float64))
    return found[0], found[1]
