"""The snapshots that begin in one part of a table: its rows without what an earlier part began, and what follows on."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import replace
from typing import Any

import numpy as np
import pyarrow.compute as pc
import pyarrow.parquet

from nlosctl.io.file_format import FileFormat
from nlosctl.io.inputs import Part
from nlosctl.io.pieces import Piece

__all__ = ["last_id", "pieces_beginning_in"]

ReadPart = Callable[[Part], Iterator[Piece]]


def pieces_beginning_in(
    parts: Sequence[Part], place: int, own: Callable[[Part, Any], Iterator[Piece]], other: ReadPart
) -> Iterator[Piece]:
    """Yield the good rows of the snapshots whose first good row is in ``parts[place]``.

    ``own`` reads that part (all of it is read, so that its faults are told), being told the id of the snapshot that
    the parts before have begun; ``other`` reads a neighbour quietly.
    """
    begun = last_id(parts[:place], other)
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
        yield from _following(parts[place + 1 :], last, other)


def last_id(parts: Sequence[Part], read: ReadPart) -> Any:
    """Return the snapshot id of the last good row of ``parts`` as an Arrow scalar, or None where there is no row."""
    for part in reversed(parts):
        for tail in _tails(part):
            last = None
            for piece in read(tail):
                last = piece.ids[len(piece.ids) - 1]
            if last is not None:
                return last
    return None


def _following(parts: Sequence[Part], last: Any, read: ReadPart) -> Iterator[Piece]:
    for part in parts:
        with closing(read(part)) as pieces:  # type: ignore[type-var]
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
    first, behind = part.row_groups or (0, pyarrow.parquet.read_metadata(part.path).num_row_groups)
    for place in reversed(range(first, behind)):
        yield replace(part, row_groups=(place, place + 1))
