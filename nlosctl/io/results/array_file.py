"""Named arrays of one length in a Parquet file: the samples and figures of `nlosctl reproduce`."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.parquet as pq

from nlosctl.errors import DataError
from nlosctl.io.writers.table_writer import TableWriter

__all__ = ["read_arrays", "write_arrays"]

_DIGEST = "nlosctl.sha256"

Arrays = Mapping[str, npt.NDArray[Any]]


def write_arrays(path: Path, arrays: Arrays, metadata: Mapping[str, str]) -> None:
    """Write arrays (N,) as columns, atomically; an existing file is replaced and NaN becomes null."""
    table = pa.table({name: _column(values) for name, values in arrays.items()})
    metadata = {**metadata, _DIGEST: _digest(_arrays(table))}
    with TableWriter(str(path), table.schema, metadata=metadata, overwrite=True) as writer:
        writer.write(table)


def read_arrays(path: Path) -> tuple[dict[str, npt.NDArray[Any]], dict[str, str]]:
    """Return the columns, null as NaN, and the metadata; raises DataError if they are not as written."""
    try:
        table = pq.read_table(path)
        arrays, metadata = _arrays(table), _as_text(table.schema.metadata)
    except (OSError, ValueError, pa.ArrowException) as error:
        raise DataError(f"{path}: can't be read as Parquet: {error}") from error
    if metadata.pop(_DIGEST, None) != _digest(arrays):
        raise DataError(f"{path}: was changed after it was written")
    return arrays, metadata


def _arrays(table: Any) -> dict[str, npt.NDArray[Any]]:
    return {name: table.column(name).to_numpy() for name in table.column_names}


def _digest(arrays: Arrays) -> str:
    """Return the SHA-256 of names, types and values."""
    digest = hashlib.sha256()
    for name, values in arrays.items():
        digest.update(f"{name} {values.dtype.str} {values.shape}".encode())
        is_text = values.dtype.kind == "O"
        digest.update(repr(values.tolist()).encode() if is_text else np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()


def _column(values: npt.NDArray[Any]) -> Any:
    missing = np.isnan(values) if values.dtype.kind == "f" else None
    return pa.array(values, mask=missing)


def _as_text(metadata: Mapping[bytes, bytes] | None) -> dict[str, str]:
    return {key.decode(): value.decode() for key, value in (metadata or {}).items()}
