"""Numbers that are only compared within a snapshot, such as arrival times since 1970, as exact sums of two floats."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from nlosctl.arrays import FloatArray, ignoring_overflow
from nlosctl.io.measurements.column_mapping import MappedColumn
from nlosctl.io.measurements.row_checks import Describe, Fault, as_float64, got, is_null, null_mask
from nlosctl.io.readers.base import plain

__all__ = ["LARGEST_INTEGER", "REST", "exact_numbers", "refuse_rounded"]

REST = "arrival_rest_m"
"""The column of what arrivals are beyond their floating-point numbers."""

LARGEST_INTEGER = 2**62
"""Integers beyond are not read: their sums and differences need more than 64 bits."""

_EXACT_FLOAT = 2.0**53
_SPLITTER = 2.0**27 + 1.0


def exact_numbers(mapped: MappedColumn, batch: Any, faults: list[Fault]) -> tuple[FloatArray, FloatArray]:
    """Return a column (N,) in the contract's unit as two floats whose sum is exact to 32 digits; adds to ``faults``.

    Integers stay integers until their product with the unit is split. A floating-point number of 2^53 or more, where
    neighbouring integers are the same number, is a fault.
    """
    cells = plain(batch.column(mapped.name))
    if cells.null_count:
        faults.append(Fault(mask=null_mask(cells), column=mapped.name, describe=is_null("a finite number")))
    if not pa.types.is_integer(cells.type):
        values = as_float64(cells)
        wrong = ~np.isfinite(values) & ~null_mask(cells)
        if wrong.any():
            faults.append(Fault(mask=wrong, column=mapped.name, describe=got(values, "a finite number")))
        with ignoring_overflow():
            rounded = np.abs(values) >= _EXACT_FLOAT
        if rounded.any():
            faults.append(Fault(mask=rounded, column=mapped.name, describe=_rounded(values, mapped.name)))
        return _product(np.where(np.isfinite(values), values, 0.0), mapped.scale)
    beyond = pc.fill_null(pc.greater(pc.abs(cells.cast(pa.float64(), safe=False)), float(LARGEST_INTEGER)), False)
    mask = np.asarray(beyond.to_numpy(zero_copy_only=False), dtype=np.bool_)
    if mask.any():
        describe = lambda index: f"got {cells[index].as_py()}, expected at most {LARGEST_INTEGER}"  # noqa: E731
        faults.append(Fault(mask=mask, column=mapped.name, describe=describe))
        cells = pc.if_else(beyond, pa.scalar(0, cells.type), cells)
    integers = np.asarray(cells.cast(pa.int64()).fill_null(0).to_numpy(zero_copy_only=False), dtype=np.int64)
    whole = integers.astype(np.float64)
    high, low = _product(whole, mapped.scale)
    return high, low + (integers - whole.astype(np.int64)) * mapped.scale


def _product(values: FloatArray, scale: float) -> tuple[FloatArray, FloatArray]:
    """Return the product and its rounding error (Dekker, Numerische Mathematik 18, 1971, 224)."""
    product = values * scale
    parts = []
    for factor in (values, np.float64(scale)):
        shifted = factor * _SPLITTER
        high = shifted - (shifted - factor)
        parts.append((high, factor - high))
    (high, low), (scale_high, scale_low) = parts
    error = ((high * scale_high - product) + high * scale_low + low * scale_high) + low * scale_low
    return product, np.asarray(error)


def _cure(name: str) -> str:
    """Return how to give the times of a column exactly."""
    if name.endswith("_ns"):
        return "give whole nanoseconds in a column of integers"
    if name.endswith("_m"):
        return "subtract an origin of the snapshot, or give times as integers in nanoseconds"
    return "give integers in a smaller unit, such as nanoseconds, in a column of integers"


def _rounded(values: FloatArray, name: str) -> Describe:
    return lambda index: (
        f"got {values[index]:.17g} as a floating-point number, which is only exact to {np.spacing(values[index]):g}, "
        f"expected an integer or a smaller number; {_cure(name)}"
    )


def refuse_rounded(mapped: MappedColumn, cells: Any, std: FloatArray, faults: list[Fault]) -> None:
    """Add the faults of floating-point numbers whose rounding is larger than their standard deviations (N,)."""
    cells = plain(cells)
    if pa.types.is_integer(cells.type):
        return
    values = as_float64(cells)
    step = np.spacing(np.abs(np.where(np.isfinite(values), values, 0.0)))
    coarse = (0.5 * step * mapped.scale > std) & (np.abs(values) < _EXACT_FLOAT)
    if coarse.any():
        cure = _cure(mapped.name)
        describe: Describe = lambda index: (  # noqa: E731
            f"got {values[index]:.17g}, a floating-point number that is only exact to "
            f"{step[index] * mapped.scale:.3g} m, more than its standard deviation {std[index]:.3g} m; {cure}"
        )
        faults.append(Fault(mask=coarse, column=mapped.name, describe=describe))
