"""Named arrays of one length in a Parquet file: what `nlosctl reproduce` keeps of its samples and figures."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.parquet as pq

from nlosctl.errors import DataError
from nlosctl.io.write import TableWriter

__all__ = ["read_array_metadata", "read_arrays", "write_arrays"]

Arrays = Mapping[str, npt.NDArray[Any]]


def write_arrays(path: Path, arrays: Arrays, metadata: Mapping[str, str]) -> None:
    """Write arrays (N,) as columns, whole or not at all, over what is there; NaN is null."""
    table = pa.table({name: _column(values) for name, values in arrays.items()})
    with TableWriter(str(path), table.schema, metadata=metadata, overwrite=True) as writer:
        writer.write(table)


def read_arrays(path: Path) -> tuple[dict[str, npt.NDArray[Any]], dict[str, str]]:
    """Return the columns, null as NaN, and the metadata; raises DataError where the file can't be read."""
    try:
        table = pq.read_table(path)
    except (OSError, pa.ArrowException) as error:
        raise DataError(f"{path}: can't be read as Parquet: {error}") from error
    arrays = {name: table.column(name).to_numpy() for name in table.column_names}
    return arrays, _words(table.schema.metadata)


def read_array_metadata(path: Path) -> dict[str, str]:
    """Return the metadata alone, empty where the file is no Parquet file."""
    try:
        return _words(pq.read_schema(path).metadata)
    except (OSError, pa.ArrowException):
        return {}


def _column(values: npt.NDArray[Any]) -> Any:
    missing = np.isnan(values) if values.dtype.kind == "f" else None
    return pa.array(values, mask=missing)


def _words(metadata: Mapping[bytes, bytes] | None) -> dict[str, str]:
    return {key.decode(): value.decode() for key, value in (metadata or {}).items()}
