"""Blocks (B, K): sums over the measurements whose bits do not depend on the number of snapshots, and rows of blocks."""

from __future__ import annotations

from typing import Any, Self, TypeVar, cast

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import FloatArray, IntArray, ScalarT

__all__ = ["RowBlock", "gather_rows", "max_measurements", "rows_of", "side_by_side", "sum_measurements"]

ValueT = TypeVar("ValueT")


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


def gather_rows(array: npt.NDArray[ScalarT], rows: IntArray) -> npt.NDArray[ScalarT]:
    """Return rows of a block (B, ...), in any order and with repetitions, in Fortran order."""
    return np.take(array.T, rows, axis=-1).T


def side_by_side(*blocks: npt.NDArray[ScalarT]) -> npt.NDArray[ScalarT]:
    """Return blocks (B, ...) joined along the measurements, in Fortran order."""
    return np.concatenate([block.T for block in blocks]).T


def sum_measurements(values: FloatArray) -> FloatArray:
    """Return the sum (..., B) over the measurements of ``values`` (..., B, K), added one by one in order.

    ``np.sum`` would add in pairs when a block holds one snapshot and in order when it holds several.
    """
    total = np.zeros(values.shape[:-1])
    for k in range(values.shape[-1]):
        total += values[..., k]
    return total


def max_measurements(values: FloatArray) -> FloatArray:
    """Return the largest value (B,) over the measurements of ``values`` (B, K); NaN where any is NaN."""
    largest = np.full(values.shape[0], -np.inf)
    for k in range(values.shape[1]):
        np.maximum(largest, values[:, k], out=largest)
    return largest
