"""Arrivals in batches: about an origin, with a reference's arrival of 0, or as independent differences of pairs."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import FloatArray, IntArray
from nlosctl.contract.methods import MethodSpec
from nlosctl.contract.results import Solution
from nlosctl.errors import UsageError
from nlosctl.io.measurements.completion.references import FORM, Form
from nlosctl.io.measurements.reader import Chunk
from nlosctl.pipeline.solve.target_heights import by_height

__all__ = [
    "about_origin",
    "alike_blocks",
    "alike_differences",
    "difference_form",
    "lacks_reference",
    "with_references",
    "without_reference_row",
]

_OF_REFERENCE = {
    "sensor": ("reference",),
    "sensor_xy_m": ("reference_x_m", "reference_y_m"),
    "sensor_z_m": ("reference_z_m",),
    "arrival_std_m": ("reference_std_m",),
}
"""The columns of the reference for each array of a batch; its arrival is 0."""


def alike_blocks(chunk: Chunk, snapshot: IntArray, row: IntArray) -> Iterator[tuple[IntArray, IntArray]]:
    """Yield the snapshots (B,) and rows (B, K) of a block that can share a batch: by heights, then by differences."""
    for some, rows in by_height(chunk, snapshot, row):
        yield from alike_differences(chunk.columns, some, rows)


def alike_differences(
    columns: Mapping[str, npt.NDArray[Any]], snapshot: IntArray, row: IntArray
) -> Iterator[tuple[IntArray, IntArray]]:
    """Yield the snapshots (B,) and rows (B, K) of a block whose differences have the same form."""
    if FORM not in columns or not row.shape[1]:
        yield snapshot, row
        return
    form = columns[FORM][row[:, 0]]
    for known in Form:
        alike = form == known
        if alike.any():
            yield snapshot[alike], row[alike]


def difference_form(columns: Mapping[str, npt.NDArray[Any]], row: IntArray) -> Form | None:
    """Return the form of the snapshots with the rows (B, K), alike in this; None if they have no differences."""
    return Form(int(columns[FORM][row[0, 0]])) if FORM in columns and row.size else None


def lacks_reference(spec: MethodSpec, chunk: Chunk, snapshot: int, row: IntArray) -> bool:
    """Return whether the snapshots with the rows (B, K), alike in this, lack the row of their reference.

    Raises UsageError, naming the ``snapshot``, for independent differences and a method that takes them as arrivals
    with one offset, and for an uncertain speed and a method that takes it as exact.
    """
    if "speed_std" in chunk.columns and "speed_std" not in spec.reads:
        raise UsageError(
            f"method {spec.name!r} takes the speed of the wave as exactly known; use `method` ml, or leave "
            "`speed_std_m_s` out"
        )
    form = difference_form(chunk.columns, row)
    if form == Form.OF_PAIRS and "reference" not in spec.reads:
        raise UsageError(
            f"{chunk.source}, snapshot {chunk.snapshot[snapshot].as_py()!r}: differences to several references, but "
            f"method {spec.name!r} needs one reference in a snapshot; use `method` ml, or give each reference its "
            "snapshots"
        )
    return form == Form.WITHOUT_REFERENCE


def about_origin(whole: FloatArray, rest: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return exact values (B, K), each a sum of two floats, about their least one, and that origin (B,)."""
    origin = whole.min(axis=1)
    about = np.asfortranarray((whole - origin[:, None]) + rest)
    about.flags.writeable = False
    return about, origin


def with_references(
    arrays: dict[str, npt.NDArray[Any]], columns: Mapping[str, npt.NDArray[Any]], row: IntArray
) -> dict[str, npt.NDArray[Any]]:
    """Return the arrays (B, K, ...) of a batch with what its differences need.

    A reference without a row gets one at the end: (B, K + 1, ...). Independent differences have no origin, and the
    positions of their references are arrays of their own.
    """
    form = difference_form(columns, row)
    if form == Form.OF_PAIRS:
        return _with_pairs(arrays, columns, row)
    return _with_reference_row(arrays, columns, row) if form == Form.WITHOUT_REFERENCE else arrays


def _with_pairs(
    arrays: Mapping[str, npt.NDArray[Any]], columns: Mapping[str, npt.NDArray[Any]], row: IntArray
) -> dict[str, npt.NDArray[Any]]:
    origin = arrays["origin_m"]
    added = {"arrival_m": np.asfortranarray(arrays["arrival_m"] + origin[:, None]), "origin_m": np.zeros(origin.shape)}
    xy = [columns[f"reference_{axis}_m"][row] for axis in "xy"]
    added["reference_xy_m"] = np.asfortranarray(np.stack(xy, axis=-1))
    if "sensor_z_m" in arrays:
        added["reference_z_m"] = np.asfortranarray(columns["reference_z_m"][row])
    for values in added.values():
        values.flags.writeable = False
    return {**arrays, **added}


def _with_reference_row(
    arrays: Mapping[str, npt.NDArray[Any]], columns: Mapping[str, npt.NDArray[Any]], row: IntArray
) -> dict[str, npt.NDArray[Any]]:
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
