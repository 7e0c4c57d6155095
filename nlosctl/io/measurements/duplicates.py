"""Measurements that are there twice: same snapshot, and the same in all columns of the row key."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import IntArray
from nlosctl.io.measurements.bad_rows import BadRow, Problem, ProblemLog
from nlosctl.io.measurements.options import ReadReport
from nlosctl.io.measurements.row_batch import Piece

__all__ = ["drop_duplicates", "find_duplicates"]

_Words = npt.NDArray[np.uint64]

_MULTIPLIER = np.uint64(0x9E3779B97F4A7C15)

_SHIFT = np.uint64(29)


def find_duplicates(offsets: IntArray, columns: Sequence[npt.NDArray[Any]]) -> tuple[IntArray, IntArray]:
    """Return the rows that repeat an earlier one of their snapshot, and those earlier rows, both (D,) and rising.

    ``offsets`` (S+1,) delimits the snapshots, ``columns`` are (N,) arrays of 8-byte values; of none of
    them nothing repeats. Where the first column
    (integers from -1 on) tells all rows of every snapshot apart nothing repeats, and nothing else is looked at.
    """
    none = np.empty(0, dtype=np.int64)
    if not columns or _rises_within_snapshots(offsets, columns[0]):
        return none, none
    snapshot = np.repeat(np.arange(offsets.shape[0] - 1, dtype=np.uint64), np.diff(offsets))
    values = np.uint64(int(columns[0].max()) + 1)
    if _differ(snapshot * values + columns[0].astype(np.uint64)):
        return none, none
    words = [_words(column) for column in columns]
    mixed = _mix(snapshot, words)
    ordered = np.sort(mixed)
    same = ordered[1:] == ordered[:-1]
    if not same.any():
        return none, none
    candidates = np.flatnonzero(np.isin(mixed, np.unique(ordered[1:][same])))
    return _verify(candidates, [snapshot, *words])


def _rises_within_snapshots(offsets: IntArray, first: npt.NDArray[Any]) -> bool:
    falls = first[1:] <= first[:-1]
    falls[offsets[1:-1] - 1] = False
    return not bool(falls.any())


def _differ(keys: _Words) -> bool:
    ordered = np.sort(keys)
    return not bool((ordered[1:] == ordered[:-1]).any())


def _words(column: npt.NDArray[Any]) -> _Words:
    """Return the bits of 8-byte values; -0.0 counts as 0.0."""
    values = column + 0.0 if column.dtype == np.float64 else column
    return np.ascontiguousarray(values).view(np.uint64)


def _mix(snapshot: _Words, words: Sequence[_Words]) -> _Words:
    mixed = snapshot * _MULTIPLIER
    for column in words:
        mixed ^= mixed >> _SHIFT
        mixed += column
        mixed *= _MULTIPLIER
    mixed ^= mixed >> _SHIFT
    return mixed


def _verify(candidates: IntArray, keys: Sequence[_Words]) -> tuple[IntArray, IntArray]:
    """Compare the candidates exactly; equal rows are neighbours after a stable sort, earliest first."""
    order = candidates[np.lexsort([key[candidates] for key in keys][::-1])]
    equal = np.ones(order.shape[0] - 1, dtype=np.bool_)
    for key in keys:
        equal &= key[order[1:]] == key[order[:-1]]
    heads = np.where(np.concatenate([[True], ~equal]), np.arange(order.shape[0]), 0)
    first = order[np.maximum.accumulate(heads)]
    repeats = np.flatnonzero(equal) + 1
    by_row = np.argsort(order[repeats])
    return order[repeats][by_row], first[repeats][by_row]


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
