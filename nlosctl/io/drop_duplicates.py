"""Duplicate measurements taken out of the pieces of a chunk, each told by its row and that of the first."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nlosctl.io.duplicates import find_duplicates
from nlosctl.io.pieces import Piece
from nlosctl.io.problems import BadRow, Problem, ProblemLog
from nlosctl.io.read_report import ReadReport

__all__ = ["drop_duplicates"]


def drop_duplicates(
    pieces: Sequence[Piece], whole: Piece, row_key: Sequence[str], log: ProblemLog, report: ReadReport
) -> Piece:
    """Return ``whole``, the joined ``pieces``, without rows that repeat an earlier one; these go to ``log``."""
    names = [name for name in row_key if name in whole.columns]
    offsets = np.append(whole.starts, len(whole.ids))
    repeated, first = find_duplicates(offsets, [whole.columns[name] for name in names])
    if repeated.shape[0] == 0:
        return whole
    begins = np.cumsum([0, *(len(piece.ids) for piece in pieces)])
    rows = []
    for place, earlier in list(zip(repeated.tolist(), first.tolist(), strict=True))[: log.wanted()]:
        number = int(np.searchsorted(begins, place, side="right")) - 1
        fault = (
            f"duplicate measurement: same snapshot, {', '.join(names)} as row {whole.rows[earlier]}; "
            f"drop one, or number them in a 'path' column"
        )
        problem = Problem(
            file=pieces[number].file,
            row=int(whole.rows[place]),
            line=pieces[number].line_at(place - int(begins[number])),
            column=None,
            fault=fault,
        )
        rows.append(BadRow(problem=problem, values=whole.texts(place)))
    log.add(rows, total=repeated.shape[0])
    report.rows -= repeated.shape[0]
    report.bad_rows += repeated.shape[0]
    keep = np.ones(len(whole.ids), dtype=np.bool_)
    keep[repeated] = False
    return whole.kept(keep)
