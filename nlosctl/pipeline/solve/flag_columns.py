"""Flags of blocks scattered back to the rows of a chunk; rows that took no part say nothing."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import BoolArray, IntArray
from nlosctl.contract.results import Words

__all__ = ["FlagColumn"]


class FlagColumn:
    """One column (N,) of flags, filled block by block."""

    def __init__(self, rows: int) -> None:
        self._rows = rows
        self._values: npt.NDArray[Any] | None = None
        self._unsaid: BoolArray | None = None
        self._words: list[str | None] = []

    def set(self, row: IntArray, values: npt.NDArray[Any] | Words) -> None:
        """Put the values of a block at the rows (B, K)."""
        if isinstance(values, Words):
            values = self._codes(values)
        if self._values is None:
            self._begin(values)
        assert self._values is not None  # noqa: S101 - begun above
        self._values[row] = values
        if self._unsaid is not None:
            self._unsaid[row] = False

    def values(self) -> npt.NDArray[Any] | Words:
        """Return the column: NaN, None or a mask where nothing is said."""
        assert self._values is not None  # noqa: S101 - a column is made for its first block
        if self._words:
            return Words(code=self._values, words=tuple(self._words))
        if self._unsaid is not None:
            return np.ma.MaskedArray(self._values, mask=self._unsaid)
        return self._values

    def _begin(self, values: npt.NDArray[Any]) -> None:
        if self._words:
            self._values = np.zeros(self._rows, dtype=np.uint8)
        elif values.dtype.kind == "f":
            self._values = np.full(self._rows, np.nan)
        elif values.dtype.kind == "O":
            self._values = np.full(self._rows, None, dtype=object)
        else:
            self._values = np.zeros(self._rows, dtype=values.dtype)
            self._unsaid = np.ones(self._rows, dtype=bool)

    def _codes(self, values: Words) -> npt.NDArray[np.uint8]:
        """Return the codes of a block's words in the words of the column; code 0 is for nothing said."""
        self._words = self._words or [None]
        for word in values.words:
            if word not in self._words:
                self._words.append(word)
        places = np.array([self._words.index(word) for word in values.words], dtype=np.uint8)
        return places[values.code]
