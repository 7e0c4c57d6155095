"""A suspicious thing in a file, and those that the readers and the advice on misfits already know."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

__all__ = ["Suspicion", "of_cause", "of_remarks"]

_REMARKS = (
    ("probably radians", "radians_as_degrees"),
    ("may be radians", "radians_as_degrees"),
    ("look like longitudes", "degrees_as_metres"),
)


@dataclass(frozen=True, kw_only=True)
class Suspicion:
    """What is suspicious (a word), in which column and how many rows (None: unknown), and a sentence."""

    what: str
    column: str | None
    rows: int | None
    text: str


def of_remarks(remarks: Sequence[str], rows: int) -> Iterator[Suspicion]:
    """Yield the suspicions among the remarks of a reader."""
    for remark in remarks:
        for words, what in _REMARKS:
            if words in remark:
                column = re.search(r"columns? '([^']+)'", remark)
                yield Suspicion(what=what, column=None if column is None else column[1], rows=rows, text=remark)


def of_cause(cause: str, rows: int | None = None) -> Suspicion:
    """Return the suspicion of a change of all rows after which most of them fit."""
    column = re.search(r"if '([^']+)' is read", cause)
    return Suspicion(what="misfit", column=None if column is None else column[1], rows=rows, text=cause)
