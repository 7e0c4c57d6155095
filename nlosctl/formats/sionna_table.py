"""Traced paths as a Parquet table, one row per path, converted to the arrays of a Sionna RT NPZ file."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet

from nlosctl.contract.formats import ForeignFile
from nlosctl.errors import DataError, did_you_mean

__all__ = ["arrays_of_table"]

_NUMBERS = ("tau", "phi_r", "phi_t", "rx_x", "rx_y", "tx_x", "tx_y")
_OPTIONAL = ("interactions", "vertex_x", "vertex_y")
_MOST_CELLS = 1 << 27
"""Largest size of an array: receivers times transmitters times the most paths of a link; 1 GiB per array."""
_MOST_INTERACTIONS = 1000


def arrays_of_table(file: ForeignFile, keep: Sequence[str] = ()) -> dict[str, Any]:
    """Return the arrays of the table's paths; raise DataError for a missing, empty or non-numeric column.

    The columns to ``keep`` become arrays of objects, None where there is no path.
    """
    columns, kept = _columns(file, keep)
    rx, tx = (np.unique(columns[name], return_inverse=True)[1] for name in ("rx", "tx"))
    receivers, transmitters = int(rx.max()) + 1, int(tx.max()) + 1
    link = rx * transmitters + tx
    order = np.argsort(link, kind="stable")
    starts = np.searchsorted(link[order], link[order])
    path = np.empty(order.shape[0], dtype=np.int64)
    path[order] = np.arange(order.shape[0]) - starts
    shape = (receivers, transmitters, int(path.max()) + 1)
    if math.prod(shape) > _MOST_CELLS:
        sizes = " x ".join(map(str, shape))
        raise DataError(
            f"{file.name}: {sizes} receivers, transmitters and paths, expected at most {_MOST_CELLS} in all"
        )
    at = (rx, tx, path)

    def filled(name: str, absent: float) -> Any:
        array = np.full(shape, absent)
        array[at] = columns[name]
        return array

    arrays: dict[str, Any] = {name: filled(name, -1.0 if name == "tau" else 0.0) for name in ("tau", "phi_r", "phi_t")}
    for name, prefix, node, count in (("targets", "rx", rx, receivers), ("sources", "tx", tx, transmitters)):
        arrays[name] = np.zeros((3, count))
        arrays[name][0, node], arrays[name][1, node] = columns[f"{prefix}_x"], columns[f"{prefix}_y"]
    if "interactions" in columns:
        count = filled("interactions", 0.0)
        wrong = ~((count >= 0.0) & (count <= _MOST_INTERACTIONS))
        if wrong.any():
            raise DataError(
                f"{file.name}, column 'interactions': got {count[wrong][0]:g}, expected 0 to {_MOST_INTERACTIONS}"
            )
        most = max(math.ceil(count.max()), 1)
        if most * count.size > _MOST_CELLS:
            raise DataError(
                f"{file.name}: {most} interactions of {count.size} paths, expected at most {_MOST_CELLS} in all"
            )
        arrays["interactions"] = (np.arange(most)[:, None, None, None] < count).astype(np.int64)
        if "vertex_x" in columns and "vertex_y" in columns:
            vertices = np.zeros((*arrays["interactions"].shape, 3))
            vertices[0, ..., 0], vertices[0, ..., 1] = filled("vertex_x", 0.0), filled("vertex_y", 0.0)
            arrays["vertices"] = vertices
    for name, cells in kept.items():
        arrays[name] = np.full(shape, None, dtype=object)
        arrays[name][at] = cells
    return arrays


def _columns(file: ForeignFile, keep: Sequence[str]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the columns of the paths as arrays (N,), and those to keep as arrays of Python values."""
    try:
        table = pyarrow.parquet.read_table(file.stream)
        names = table.column_names
    except (pa.ArrowException, OSError, ValueError) as error:
        raise DataError(f"{file.name}: not a complete Parquet file: {str(error).splitlines()[0]}") from error
    if not table.num_rows:
        raise DataError(f"{file.name}: no rows")
    columns = {}
    for name in ("rx", "tx", *_NUMBERS, *_OPTIONAL):
        if name not in names:
            if name in _OPTIONAL:
                continue
            near = did_you_mean(name, names)
            raise DataError(f"{file.name}: no column {name!r}{near}; a row of paths has rx, tx, {', '.join(_NUMBERS)}")
        cells = table.column(name)
        number = pa.types.is_floating(cells.type) or pa.types.is_integer(cells.type)
        if cells.null_count or (name in (*_NUMBERS, *_OPTIONAL) and not number):
            raise DataError(f"{file.name}, column {name!r}: got {cells.type}, expected numbers in every row")
        try:
            columns[name] = cells.combine_chunks().to_numpy(zero_copy_only=False)
        except (pa.ArrowException, ValueError) as error:
            raise DataError(f"{file.name}, column {name!r}: can't be read: {error}") from error
    kept = {}
    for name in keep:
        if name not in names:
            raise DataError(f"{file.name}: no column {name!r}{did_you_mean(name, names)}. It has: {', '.join(names)}")
        kept[name] = np.empty(table.num_rows, dtype=object)
        kept[name][:] = table.column(name).to_pylist()
    return columns, kept
