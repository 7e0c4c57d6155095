"""The sensors of a chunk by name."""

from __future__ import annotations

import numpy as np

from nlosctl.arrays import IntArray
from nlosctl.io.measurements.column_mapping import NameCodes
from nlosctl.io.measurements.reader import Chunk
from nlosctl.io.readers.base import plain

__all__ = ["sensor_texts"]


def sensor_texts(chunk: Chunk) -> tuple[IntArray, list[str]]:
    """Return the code (N,) of each row's sensor, and the names that the codes number; one for a file of one station."""
    names = NameCodes()
    if "sensor" not in chunk.table.column_names:
        return np.zeros(chunk.left_out.shape, dtype=np.int64), ["the station"]
    codes = names.encode(plain(chunk.table.column("sensor")).combine_chunks())
    return codes, names.names
