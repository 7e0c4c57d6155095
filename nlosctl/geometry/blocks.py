"""Blocks (B, K): sums over the measurements whose bits do not depend on the number of snapshots, and rows of blocks."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Self, TypeVar, cast

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import FloatArray, IntArray, ScalarT

__all__ = [
    "RowBlock",
    "add_measurements",
    "column_blocks",
    "gather_rows",
    "max_measurements",
    "rows_in_order",
    "rows_of",
    "side_by_side",
    "sum_measurements",
    "sum_products",
]

ValueT = TypeVar("ValueT")

_NEAR = 8192
"""Temporaries of so many numbers stay in the near caches."""


class RowBlock:
    """Base of frozen dataclasses whose arrays (B, ...) have one row per snapshot (or per problem)."""

    def take(self, rows: IntArray) -> Self:
        """Return the given rows of each field, in any order and with repetitions; blocks keep Fortran order.

        Fields that are None or have no rows, such as numbers and options, stay as they are.
        """
        fields: Any = self.__dataclass_fields__  # type: ignore[attr-defined]
        return type(self)(**{name: rows_of(getattr(self, name), rows) for name in fields})


def rows_of(value: ValueT, rows: IntArray) -> ValueT:
    """Return the given rows of an array, of every item of a tuple, or of an object that has ``take``."""
    taken: Any = value
    if isinstance(value, np.ndarray):
        taken = value[rows] if value.ndim == 1 else gather_rows(value, rows)
    elif isinstance(value, tuple):
        items = [rows_of(item, rows) for item in value]
        taken = type(value)(*items) if hasattr(value, "_fields") else tuple(items)
    elif hasattr(value, "take"):
        taken = value.take(rows)
    return cast(ValueT, taken)


def rows_in_order(value: ValueT, rows: IntArray, size: int) -> ValueT:
    """Return the given rows as `rows_of`; where they are all ``size`` rows in order, the value itself."""
    return value if rows.shape[0] == size and bool((rows == np.arange(size)).all()) else rows_of(value, rows)


def gather_rows(array: npt.NDArray[ScalarT], rows: IntArray) -> npt.NDArray[ScalarT]:
    """Return rows of a block (B, ...), in any order and with repetitions, in Fortran order."""
    return np.take(array.T, rows, axis=-1).T


def side_by_side(*blocks: npt.NDArray[ScalarT]) -> npt.NDArray[ScalarT]:
    """Return blocks (B, ...) joined along the measurements, in Fortran order."""
    return np.concatenate([block.T for block in blocks]).T


def column_blocks(shape: tuple[int, ...]) -> Iterator[slice]:
    """Yield slices of the measurements of a block (B, K), as many as fit the near caches: one if B is large.

    What is computed slice by slice, and added by `add_measurements`, has the same bits in any block.
    """
    step = max(1, _NEAR // max(1, shape[-2]))
    for first in range(0, shape[-1], step):
        yield slice(first, min(first + step, shape[-1]))


def add_measurements(total: FloatArray, values: FloatArray) -> None:
    """Add ``values`` (..., B, K) to a total (..., B) in place, one measurement after the other.

    ``np.sum`` would add in pairs when a block holds one snapshot and in order when it holds several.
    """
    for k in range(values.shape[-1]):
        total += values[..., k]


def sum_measurements(values: FloatArray) -> FloatArray:
    """Return the sum (..., B) over the measurements of ``values`` (..., B, K), added one by one in order."""
    total = np.zeros(values.shape[:-1])
    add_measurements(total, values)
    return total


def sum_products(left: FloatArray, right: FloatArray) -> FloatArray:
    """Return the sum (..., B) over the measurements of products of blocks (..., B, K), as `sum_measurements`."""
    total = np.zeros(left.shape[:-1])
    for at in column_blocks(left.shape):
        add_measurements(total, left[..., at] * right[..., at])
    return total


def max_measurements(values: FloatArray) -> FloatArray:
    """Return the largest value (B,) over the measurements of ``values`` (B, K); NaN where any is NaN."""
    largest = np.full(values.shape[0], -np.inf)
    for k in range(values.shape[1]):
        np.maximum(largest, values[:, k], out=largest)
    return largest
