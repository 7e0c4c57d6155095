"""Flags of rows whose measurements were merged: those of the merged measurement."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import IntArray
from nlosctl.contract.results import Flags, Words

__all__ = ["flags_of_windows"]


def flags_of_windows(flags: Flags, leader: IntArray) -> Flags:
    """Return the flags (N,) with those of the row that stands for each; rows that are not kept (-1) keep their own."""
    row = np.where(leader < 0, np.arange(leader.shape[0]), leader)
    if (row == np.arange(row.shape[0])).all():
        return flags
    return Flags(used=flags.used[row], columns={name: _taken(column, row) for name, column in flags.columns.items()})


def _taken(column: npt.NDArray[Any] | Words, row: IntArray) -> npt.NDArray[Any] | Words:
    return Words(code=column.code[row], words=column.words) if isinstance(column, Words) else column[row]
