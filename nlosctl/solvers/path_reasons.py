"""Why a path is flagged, or could not be judged: the words of the ``reason`` column."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nlosctl.contract.results import Words

__all__ = ["reasons"]

BoolArray = npt.NDArray[np.bool_]


def reasons(shape: tuple[int, ...], *parts: tuple[str, BoolArray]) -> Words:
    """Return the words of rows: the words of all ``parts`` that hold for a row, in order, joined by a comma.

    An empty text where none holds; eight words at most. ``parts`` are a word and where it holds, each of ``shape``.
    """
    held = [(word, where) for word, where in parts if where.any()]
    code = np.zeros(shape, dtype=np.uint8)
    for place, (_, where) in enumerate(held):
        code += where * np.uint8(1 << place)
    found = np.flatnonzero(np.bincount(code.ravel(), minlength=1))
    names = [",".join(word for place, (word, _) in enumerate(held) if value >> place & 1) for value in found]
    places = np.zeros(1 << len(held), dtype=np.uint8)
    places[found] = np.arange(found.shape[0])
    return Words(code=places[code], words=tuple(names))
