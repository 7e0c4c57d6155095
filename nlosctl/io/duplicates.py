"""Measurements that are there twice: same snapshot, and the same in all columns of the row key."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.contract.batches import IntArray

__all__ = ["find_duplicates"]

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
