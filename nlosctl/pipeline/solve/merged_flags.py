"""Flags of all rows of a chunk: from those of batches, and of rows whose measurements were merged."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import IntArray
from nlosctl.contract.results import Flags, Words

__all__ = ["flags_of_windows", "scattered"]


def flags_of_windows(flags: Flags, leader: IntArray) -> Flags:
    """Return the flags (N,) with those of the row that stands for each; rows that are not kept (-1) keep their own."""
    row = np.where(leader < 0, np.arange(leader.shape[0]), leader)
    if (row == np.arange(row.shape[0])).all():
        return flags
    return Flags(used=flags.used[row], columns={name: _taken(column, row) for name, column in flags.columns.items()})


def _taken(column: npt.NDArray[Any] | Words, row: IntArray) -> npt.NDArray[Any] | Words:
    return Words(code=column.code[row], words=column.words) if isinstance(column, Words) else column[row]


def scattered(size: int, parts: Sequence[tuple[IntArray, npt.NDArray[Any] | Words]]) -> npt.NDArray[Any] | Words:
    """Return a flag column (N,) from its values at rows (B, K): null (NaN, None or masked) in all other rows."""
    first = parts[0][1]
    if isinstance(first, Words):
        words = tuple(dict.fromkeys([None, *(word for _, part in parts for word in part.words)]))  # type: ignore[union-attr]
        code = np.zeros(size, dtype=np.uint8)
        for row, part in parts:
            code[row] = np.array([words.index(word) for word in part.words], dtype=np.uint8)[part.code]  # type: ignore[union-attr]
        return Words(code=code, words=words)
    null, dtype = {"f": (np.nan, np.dtype(float)), "O": (None, first.dtype)}.get(first.dtype.kind, (0, first.dtype))
    values = np.full(size, null, dtype=dtype)
    unset = np.ones(size, dtype=bool)
    for row, part in parts:
        values[row] = part
        unset[row] = False
    return values if first.dtype.kind in "fO" else np.ma.MaskedArray(values, mask=unset)
