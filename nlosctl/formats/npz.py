"""Arrays of NPZ files, checked before they are used; pickled objects are not read."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Collection
from typing import Any

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.contract.formats import ForeignFile
from nlosctl.errors import DataError

__all__ = ["numbers", "read_npz"]

_LARGEST_BYTES = 4 << 30
_UNREADABLE = (zipfile.BadZipFile, zlib.error, EOFError, OSError, KeyError, NotImplementedError, RuntimeError)
"""Exceptions of damaged zip files, whose bytes may also look like encryption or an unknown compression method."""


def read_npz(file: ForeignFile, wanted: Collection[str] | None = None) -> dict[str, Any]:
    """Return the arrays of an NPZ file by name, only those ``wanted`` if given.

    Raises DataError for a damaged file, for objects and for excessive sizes.
    """
    try:
        with zipfile.ZipFile(file.stream) as archive:
            size = sum(member.file_size for member in archive.infolist())
        if size > _LARGEST_BYTES:
            raise DataError(f"{file.name}: arrays of {size} bytes, expected at most {_LARGEST_BYTES}")
        file.stream.seek(0)
        with np.load(file.stream, allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays.files if wanted is None or name in wanted}
    except _UNREADABLE as error:
        raise DataError(f"{file.name}: not a complete NPZ file: {error}") from error
    except ValueError as error:
        raise DataError(f"{file.name}: an array can't be read: {error}") from error


def numbers(file: ForeignFile, arrays: dict[str, Any], name: str, shape: tuple[int, ...] | None = None) -> FloatArray:
    """Return an array as float64; raise DataError if it is not of numbers or has another shape."""
    array = arrays[name]
    if array.dtype.kind not in "fiu" or (shape is not None and array.shape != shape):
        wanted = "numbers" if shape is None else f"numbers of shape {shape}"
        raise DataError(f"{file.name}, array {name!r}: got {array.dtype} of shape {array.shape}, expected {wanted}")
    return np.asarray(array, dtype=np.float64)
