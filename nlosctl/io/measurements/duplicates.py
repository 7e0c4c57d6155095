"""Repeated measurements: rows of a snapshot with equal values in the row key, and flags of several methods."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow.compute as pc

from nlosctl.arrays import IntArray
from nlosctl.contract.random_streams import GOLDEN_RATIO
from nlosctl.contract.tables import is_swept
from nlosctl.errors import DataError
from nlosctl.io.measurements.column_mapping import METHOD
from nlosctl.io.measurements.returned_ids import APART
from nlosctl.io.measurements.row_batch import RowBatch, RowTally
from nlosctl.io.measurements.row_checks import TICKS, BadRow, Problem
from nlosctl.io.readers.base import plain, text_at

__all__ = ["drop_duplicates", "find_duplicates", "refuse_several_methods"]

_CURE = "drop one, or number them in a 'path' column"
_Words = npt.NDArray[np.uint64]

_SHIFT = np.uint64(29)


def find_duplicates(offsets: IntArray, columns: Sequence[npt.NDArray[Any]]) -> tuple[IntArray, IntArray]:
    """Return the rows that repeat an earlier one of their snapshot, and those earlier rows, both (D,) and rising.

    ``offsets`` (S+1,) delimits the snapshots, ``columns`` are (N,) arrays of 8-byte values; without columns no row
    repeats. If the first column (integers from -1 on) differs in all rows of every snapshot, the others are not needed.
    """
    none = np.empty(0, dtype=np.int64)
    if not columns:
        return none, none
    snapshot = np.repeat(np.arange(offsets.shape[0] - 1, dtype=np.uint64), np.diff(offsets))
    values = np.uint64(int(columns[0].max()) + 1)
    if _differ(snapshot * values + columns[0].astype(np.uint64)):
        return none, none
    words = [_words(column) for column in columns]
    hashes = _hashes(snapshot, words)
    ordered = np.sort(hashes)
    same = ordered[1:] == ordered[:-1]
    if not same.any():
        return none, none
    candidates = np.flatnonzero(np.isin(hashes, np.unique(ordered[1:][same])))
    return _verify(candidates, [snapshot, *words])


def _differ(keys: _Words) -> bool:
    ordered = np.sort(keys)
    return not bool((ordered[1:] == ordered[:-1]).any())


def _words(column: npt.NDArray[Any]) -> _Words:
    """Return the bits of 8-byte values; -0.0 counts as 0.0."""
    values = column + 0.0 if column.dtype == np.float64 else column
    return np.ascontiguousarray(values).view(np.uint64)


def _hashes(snapshot: _Words, words: Sequence[_Words]) -> _Words:
    hashes = snapshot * GOLDEN_RATIO
    for column in words:
        hashes ^= hashes >> _SHIFT
        hashes += column
        hashes *= GOLDEN_RATIO
    hashes ^= hashes >> _SHIFT
    return hashes


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


def drop_duplicates(batches: Sequence[RowBatch], whole: RowBatch, row_key: Sequence[str], tally: RowTally) -> RowBatch:
    """Return ``whole``, the joined ``batches``, without rows that repeat an earlier one; those are logged as bad."""
    names = [name for name in row_key if name in whole.columns]
    offsets = np.append(whole.starts, len(whole))
    repeated, first = find_duplicates(offsets, [whole.columns[name] for name in names])
    if repeated.shape[0] == 0:
        return whole
    ends = np.cumsum([len(batch) for batch in batches])
    rows = []
    for index, earlier in list(zip(repeated.tolist(), first.tolist(), strict=True))[: tally.log.wanted()]:
        number = int(np.searchsorted(ends, index, side="right"))
        batch, before = batches[number], batches[int(np.searchsorted(ends, earlier, side="right"))].file
        same, key = before == batch.file, ", ".join(names).replace(TICKS, "time")
        fault = (
            f"duplicate measurement: same snapshot, {key} as {'' if same else f'{before}, '}"
            f"row {whole.rows[earlier]}; {_CURE if same else APART}"
        )
        problem = Problem(
            file=batch.file,
            row=int(whole.rows[index]),
            line=None if batch.lines is None else int(batch.lines[index - int(ends[number]) + len(batch)]),
            column=None,
            fault=fault,
        )
        values = {name: text_at(whole.table.column(name), index) for name in whole.table.column_names}
        rows.append(BadRow(problem=problem, values=values))
    tally.log.add(rows, total=repeated.shape[0])
    tally.report.rows -= repeated.shape[0]
    tally.report.bad_rows += repeated.shape[0]
    keep = np.ones(len(whole), dtype=np.bool_)
    keep[repeated] = False
    return whole.filter(keep)


def refuse_several_methods(table: Any, starts: IntArray, file: str) -> None:
    """Raise DataError if a snapshot (at ``starts``) has flags of several methods, or of several values of a sweep.

    Each measurement is then repeated for each of them, and they can't be solved together.
    """
    swept = [name for name in table.column_names if is_swept(name)]
    for column, what, cure in [
        (METHOD, "methods", "run the earlier step with one `method`, or keep the rows of one method"),
        *(
            (name, "values of a sweep", "run the earlier step without `sweep`, or keep the rows of one")
            for name in swept
        ),
    ]:
        values = plain(table.column(column).combine_chunks())
        codes = pc.fill_null(pc.dictionary_encode(values).indices, -1).to_numpy(zero_copy_only=False)
        if codes.size and (np.maximum.reduceat(codes, starts) > np.minimum.reduceat(codes, starts)).any():
            several = ", ".join(str(value) for value in pc.unique(values).drop_null().to_pylist())
            raise DataError(
                f"{file}, column {column!r}: flags of several {what} ({several}), so every measurement is repeated, "
                f"expected those of one; {cure}"
            )
