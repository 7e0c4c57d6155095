"""Named tuples of arrays that have a row for each problem, nested or not: some of their rows, the better of two."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, TypeVar, cast

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import BoolArray

__all__ = ["pick_rows", "take_rows_of"]

PartsT = TypeVar("PartsT", bound=tuple[Any, ...])


def take_rows_of(parts: PartsT, rows: npt.NDArray[Any]) -> PartsT:
    """Return some rows, by number or mask, of all arrays; parts that are None stay so."""

    def taken(part: Any) -> Any:
        if part is None:
            return None
        return take_rows_of(part, rows) if isinstance(part, tuple) else part[rows]

    return _like(parts, map(taken, parts))


def pick_rows(first: BoolArray, one: PartsT, other: PartsT) -> PartsT:
    """Return the rows of one tuple where ``first``, else those of the other; a part that either has not is None."""
    count = np.count_nonzero(first)
    if count in (0, first.size):
        return one if count else other

    def picked(mine: Any, theirs: Any) -> Any:
        if mine is None or theirs is None:
            return None
        return pick_rows(first, mine, theirs) if isinstance(mine, tuple) else np.where(first, mine, theirs)

    return _like(one, map(picked, one, other))


def _like(parts: PartsT, values: Iterable[Any]) -> PartsT:
    make: Any = type(parts)
    return cast(PartsT, make(*values))
