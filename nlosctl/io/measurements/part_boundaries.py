"""The snapshots that begin in one part of a table: its rows without what an earlier part began, and what follows on."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pyarrow.compute as pc

from nlosctl.io.measurements.row_batch import Piece
from nlosctl.io.paths.file_format import FileFormat
from nlosctl.io.paths.inputs import Part
from nlosctl.io.readers.parquet_arrow import parquet_metadata

__all__ = ["Neighbours", "pieces_beginning_in"]

ReadPart = Callable[[Part], Iterator[Piece]]


@dataclass(frozen=True, kw_only=True)
class Neighbours:
    """How the parts beside one are read: ``read`` gives their good rows, quietly.

    ``end_id`` gives the snapshot id of a part's first (0) or last (-1) row at little cost, or None where it takes
    reading; it is asked only where no row is set aside, so that every row is good or the run fails.
    """

    read: ReadPart
    end_id: Callable[[Part, int], Any]


def pieces_beginning_in(
    parts: Sequence[Part], place: int, own: Callable[[Part, Any], Iterator[Piece]], others: Neighbours
) -> Iterator[Piece]:
    """Yield the good rows of the snapshots whose first good row is in ``parts[place]``.

    ``own`` reads that part (all of it is read, so that its faults are told), being told the id of the snapshot that
    the parts before have begun.
    """
    begun = _last_id(parts[:place], others)
    last = None
    for piece in own(parts[place], None if begun is None else begun.as_py()):
        if begun is not None:
            head = _leading(piece, begun)
            if head == len(piece.ids):
                continue
            piece, begun = piece.slice(head, len(piece.ids)), None
        last = piece.ids[len(piece.ids) - 1]
        yield piece
    if last is not None:
        yield from _following(parts[place + 1 :], last, others)


def _last_id(parts: Sequence[Part], others: Neighbours) -> Any:
    """Return the snapshot id of the last good row of ``parts`` as an Arrow scalar, or None where there is no row."""
    for part in reversed(parts):
        for tail in _tails(part):
            last = others.end_id(tail, -1)
            if last is None:
                for piece in others.read(tail):
                    last = piece.ids[len(piece.ids) - 1]
            if last is not None:
                return last
    return None


def _following(parts: Sequence[Part], last: Any, others: Neighbours) -> Iterator[Piece]:
    for part in parts:
        first = others.end_id(part, 0)
        if first is not None and first != last:
            return
        with closing(others.read(part)) as pieces:  # type: ignore[type-var]
            for piece in pieces:
                count = _leading(piece, last)
                if count:
                    yield piece.slice(0, count)
                if count < len(piece.ids):
                    return


def _leading(piece: Piece, identity: Any) -> int:
    """Return how many rows at the beginning are of the snapshot ``identity``."""
    differs = np.asarray(pc.not_equal(piece.ids, identity).to_numpy(zero_copy_only=False), dtype=np.bool_)
    return int(np.argmax(differs)) if differs.any() else differs.shape[0]


def _tails(part: Part) -> Iterator[Part]:
    """Yield pieces of a part from its end, each cheap to read: the row groups of a Parquet file, else the file."""
    if part.format is not FileFormat.PARQUET or part.path is None:
        yield part
        return
    first, behind = part.row_groups or (0, parquet_metadata(part.path).num_row_groups)
    for place in reversed(range(first, behind)):
        yield replace(part, row_groups=(place, place + 1))
