"""Simulated measurements as Arrow tables with the contract's columns."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from nlosctl.contract.tables import KINDS, Column

__all__ = ["measurement_table"]

_TYPES = {"number": pa.float64(), "integer": pa.int64(), "boolean": pa.bool_(), "text": pa.string()}


def measurement_table(kind: str, columns: Mapping[str, npt.NDArray[Any]]) -> Any:
    """Return flat columns (N,) of a kind of measurement as a table, in the order of the contract; NaN is null."""
    arrays = {}
    for column in KINDS[kind].columns:
        if column.name in columns:
            arrays[column.name] = _array(column, columns[column.name])
    return pa.table(arrays)


def _array(column: Column, values: npt.NDArray[Any]) -> Any:
    if column.type == "identifier":
        return pa.array(values, pa.int64() if values.dtype.kind in "iu" else pa.string())
    missing = np.isnan(values) if values.dtype.kind == "f" else None
    return pa.array(values, _TYPES[column.type], mask=missing)
