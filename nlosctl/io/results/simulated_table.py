"""Simulated measurements as Arrow tables with the contract's columns."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from nlosctl.contract.tables import KINDS, Column
from nlosctl.io.arrow_columns import SweepColumns

__all__ = ["measurement_table"]

_NO_SWEEP = SweepColumns()
_TYPES = {"number": pa.float64(), "integer": pa.int64(), "boolean": pa.bool_(), "text": pa.string()}


def measurement_table(
    kind: str, columns: Mapping[str, npt.NDArray[Any]], sweeps: SweepColumns = _NO_SWEEP, point: int = 0
) -> Any:
    """Return flat columns (N,) of a kind of measurement as a table, in the order of the contract; NaN is null.

    The columns of ``sweeps`` follow, with the values of its ``point``.
    """
    arrays = {}
    for column in KINDS[kind].columns:
        if column.name in columns:
            arrays[column.name] = _array(column, columns[column.name])
    rows = len(arrays["snapshot"])
    for name in sweeps.names:
        arrays[name] = sweeps.take(name, np.full(rows, point))
    return pa.table(arrays)


def _array(column: Column, values: npt.NDArray[Any]) -> Any:
    if column.type == "identifier":
        return pa.array(values, pa.int64() if values.dtype.kind in "iu" else pa.string())
    missing = np.isnan(values) if values.dtype.kind == "f" else None
    return pa.array(values, _TYPES[column.type], mask=missing)
