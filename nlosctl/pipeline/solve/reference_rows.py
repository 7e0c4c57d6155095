"""Arrivals in batches: about an origin, and with a reference's arrival of 0, which a file need not have as a row."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import FloatArray, IntArray
from nlosctl.contract.results import Solution
from nlosctl.io.measurements.reader import Chunk
from nlosctl.pipeline.solve.target_heights import by_height

__all__ = [
    "LACKS_REFERENCE",
    "about_origin",
    "alike_blocks",
    "lacks_reference",
    "with_reference_row",
    "without_reference_row",
]

LACKS_REFERENCE = "lacks_reference"
"""The column that marks rows whose snapshot lacks the row of its reference."""

_OF_REFERENCE = {
    "sensor": ("reference",),
    "sensor_xy_m": ("reference_x_m", "reference_y_m"),
    "sensor_z_m": ("reference_z_m",),
    "arrival_std_m": ("reference_std_m",),
}
"""The columns of the reference for each array of a batch; its arrival is 0."""


def alike_blocks(chunk: Chunk, snapshot: IntArray, row: IntArray) -> Iterator[tuple[IntArray, IntArray]]:
    """Yield the snapshots (B,) and rows (B, K) of a block that can share a batch: by heights, then by references."""
    for some, rows in by_height(chunk, snapshot, row):
        if LACKS_REFERENCE not in chunk.columns or not row.shape[1]:
            yield some, rows
            continue
        lacks = chunk.columns[LACKS_REFERENCE][rows[:, 0]]
        for alike in (lacks == 0, lacks == 1):
            if alike.any():
                yield some[alike], rows[alike]


def lacks_reference(columns: Mapping[str, npt.NDArray[Any]], row: IntArray) -> bool:
    """Return whether the snapshots with the rows (B, K), alike in this, lack the row of their reference."""
    return row.size > 0 and bool(columns[LACKS_REFERENCE][row[0, 0]])


def about_origin(whole: FloatArray, rest: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return exact values (B, K), each a sum of two floats, about their least one, and that origin (B,)."""
    origin = whole.min(axis=1)
    about = np.asfortranarray((whole - origin[:, None]) + rest)
    about.flags.writeable = False
    return about, origin


def with_reference_row(
    arrays: Mapping[str, npt.NDArray[Any]], columns: Mapping[str, npt.NDArray[Any]], row: IntArray
) -> dict[str, npt.NDArray[Any]]:
    """Return the arrays (B, K, ...) of a batch with the reference's row at the end: (B, K + 1, ...)."""
    extended = {}
    for name, values in arrays.items():
        if name == "arrival_m":
            last = -arrays["origin_m"]
        elif name in _OF_REFERENCE:
            last = np.stack([columns[part][row[:, 0]] for part in _OF_REFERENCE[name]], axis=-1)
            last = last.reshape(row.shape[0], *values.shape[2:])
        else:
            extended[name] = values
            continue
        extended[name] = np.asfortranarray(np.concatenate([values, last[:, None]], axis=1))
        extended[name].flags.writeable = False
    return extended


def without_reference_row(solution: Solution) -> Solution:
    """Return a solution without the row at the end, which is not one of the input."""
    estimates, flags = solution.estimates, solution.flags
    estimates = dataclasses.replace(estimates, n_used=np.maximum(estimates.n_used - 1, 0))
    if flags is not None:
        columns = {name: values[:, :-1] for name, values in flags.columns.items()}
        flags = dataclasses.replace(flags, used=flags.used[:, :-1], columns=columns)
    return dataclasses.replace(solution, estimates=estimates, flags=flags)
