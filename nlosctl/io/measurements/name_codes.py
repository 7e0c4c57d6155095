"""Names turned into numbers: sensors as codes, reflectors as places in the scene."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa

from nlosctl.arrays import IntArray

__all__ = ["NameCodes"]

NULL_CODE = -1


class NameCodes:
    """Codes of names, equal exactly where the text is equal; integers count as their text.

    New names get the next code while ``grows``; otherwise they get ``UNKNOWN``.
    """

    UNKNOWN = -2

    def __init__(self, names: tuple[str, ...] = (), grows: bool = True) -> None:
        self.names: list[str] = list(names)
        self._codes: dict[str, int] = {name: code for code, name in enumerate(names)}
        self._grows = grows
        self._last_dictionary: Any = None
        self._last_codes: IntArray = np.empty(0, dtype=np.int64)

    def encode(self, column: Any) -> IntArray:
        """Return (N,) codes of a text or integer column; null and empty text are -1."""
        if not pa.types.is_dictionary(column.type):
            column = column.dictionary_encode()
        codes = self._codes_of(column.dictionary)
        indices = column.indices
        if indices.null_count:
            places = indices.fill_null(len(codes) - 1).to_numpy(zero_copy_only=False)
        else:
            places = indices.to_numpy()
        encoded: IntArray = codes[places]
        return encoded

    def _codes_of(self, dictionary: Any) -> IntArray:
        """Return the code of each entry of a dictionary, and that of null at the end."""
        if self._last_dictionary is None or not dictionary.equals(self._last_dictionary):
            texts = dictionary.cast(pa.string()).to_pylist()
            self._last_codes = np.array([*(self._code(text) for text in texts), NULL_CODE], dtype=np.int64)
            self._last_dictionary = dictionary
        return self._last_codes

    def _code(self, text: str | None) -> int:
        if text is None or text == "":
            return NULL_CODE
        if text not in self._codes:
            if not self._grows:
                return self.UNKNOWN
            self._codes[text] = len(self.names)
            self.names.append(text)
        return self._codes[text]
