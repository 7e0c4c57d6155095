"""Text columns of flags with few different words."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

__all__ = ["Words"]


@dataclass(frozen=True, kw_only=True)
class Words:
    """A text column with few different words: each entry of ``code`` (B, K) is an index into ``words``.

    It reads like an array of text. A word may be None: no value.
    """

    code: npt.NDArray[np.uint8]
    words: tuple[str | None, ...]

    @property
    def shape(self) -> tuple[int, ...]:
        """The shape of the array."""
        return self.code.shape

    def __getitem__(self, key: Any) -> Any:
        """Return the words at an index of the array."""
        return np.array(self.words, dtype=object)[self.code[key]]

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> npt.NDArray[np.object_]:
        """Return the words (B, K) as an array of text."""
        return np.array(self.words, dtype=object)[self.code]
