"""Snapshot ids that were read, held in little room: in their order while they are sorted, else found by their value."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from nlosctl.arrays import BoolArray, IntArray

__all__ = ["IdHistory", "IdSet", "SeenId"]

_STEP_TYPES = (np.int8, np.int16, np.int32, np.int64)


class SeenId(NamedTuple):
    """An id that is there twice: its place among those taken now, and the part and row where it was before."""

    place: int
    part: str
    row: int


class IdHistory:
    """Ids (Arrow, integers or text) with their part and rows (N,) in the order of taking, the last ``least`` of them.

    Integers and rows take as many bytes as their steps need: one each where they count up.
    """

    def __init__(self, least: int) -> None:
        self._least = least
        self._batches: deque[tuple[str, _Steps | Any, _Steps]] = deque()
        self._size = 0

    def add(self, part: str, ids: Any, rows: IntArray) -> None:
        """Take ids."""
        held = _Steps.of(ids.to_numpy()) if pa.types.is_integer(ids.type) else ids
        self._batches.append((part, held, _Steps.of(rows)))
        self._size += len(ids)
        while self._size - len(self._batches[0][1]) >= self._least:
            self._size -= len(self._batches.popleft()[1])

    def hand_over(self, seen: IdSet) -> None:
        """Move all ids to a set that has none of them yet."""
        while self._batches:
            part, held, rows = self._batches.popleft()
            seen.add(part, pa.array(held.values()) if isinstance(held, _Steps) else held, rows.values())


class IdSet:
    """Ids (Arrow, integers or text) with their part and rows (N,), the last ``least`` of them at least."""

    def __init__(self, least: int) -> None:
        self._least = least
        self._recent, self._older = _Generation(), _Generation()

    def add(self, part: str, ids: Any, rows: IntArray) -> SeenId | None:
        """Take ids, or return the first of them that is there already or for the second time."""
        integers = pa.types.is_integer(ids.type)
        # a process has its own secret for the hashes of text: no file can be made of such as agree
        keys = ids.to_numpy() if integers else np.fromiter(map(hash, ids.to_pylist()), np.int64, len(ids))
        order = np.argsort(keys, kind="stable")
        batch = _Batch(part=part, rows=_Steps.of(rows), texts=None if integers else ids)
        keys = keys[order]
        found = [_twice(keys, order, batch), *(ids.find(keys, order, batch) for ids in (self._older, self._recent))]
        seen = [each for each in found if each is not None]
        if seen:
            return min(seen)
        self._recent.add(keys, order, batch)
        if self._recent.keys.shape[0] >= self._least:
            self._older, self._recent = self._recent, _Generation()
        return None


@dataclass(frozen=True)
class _Steps:
    """Integers (N,), N > 0, as the first and the steps to the next, in the smallest type that holds these."""

    first: int
    steps: npt.NDArray[Any]

    @classmethod
    def of(cls, values: IntArray) -> _Steps:
        steps = np.diff(values)  # a step beyond 64 bits wraps around, and back again in the sum
        low, high = (int(steps.min()), int(steps.max())) if steps.shape[0] else (0, 0)
        fitting = next(kind for kind in _STEP_TYPES if np.iinfo(kind).min <= low and high <= np.iinfo(kind).max)
        return cls(int(values[0]), steps.astype(fitting))

    def __len__(self) -> int:
        return len(self.steps) + 1

    def values(self) -> IntArray:
        return np.cumsum(np.concatenate([[self.first], self.steps.astype(np.int64)]), dtype=np.int64)


@dataclass(frozen=True, kw_only=True)
class _Batch:
    part: str
    rows: _Steps
    texts: Any

    def same_id(self, place: int, other: _Batch, other_place: int) -> bool:
        """Return whether two ids with one key are the same: always for integers, which are their own keys."""
        return self.texts is None or bool(self.texts[place] == other.texts[other_place])


class _Generation:
    """Sorted keys (N,) with the place (N,) of each in the order of taking, and the batches that were taken."""

    def __init__(self) -> None:
        self.keys = np.empty(0, dtype=np.int64)
        self._places = np.empty(0, dtype=np.int32)
        self._firsts: list[int] = []
        self._batches: list[_Batch] = []

    def add(self, keys: IntArray, order: IntArray, batch: _Batch) -> None:
        """Take the sorted keys of a batch, and the place of each in it."""
        size = self.keys.shape[0]
        where = np.searchsorted(self.keys, keys)
        self.keys = np.insert(self.keys, where, keys)
        self._places = np.insert(self._places, where, (order + size).astype(np.int32))
        self._firsts.append(size)
        self._batches.append(batch)

    def find(self, keys: IntArray, order: IntArray, batch: _Batch) -> SeenId | None:
        """Return the first of a batch (sorted keys, the place of each) that is here."""
        first, behind = (np.searchsorted(self.keys, keys, side) for side in ("left", "right"))
        for number in _in_order_of_places(behind > first, order):
            for place in self._places[first[number] : behind[number]].tolist():
                taken = int(np.searchsorted(self._firsts, place, "right")) - 1
                earlier, within = self._batches[taken], place - self._firsts[taken]
                if earlier.same_id(within, batch, int(order[number])):
                    return SeenId(int(order[number]), earlier.part, int(earlier.rows.values()[within]))
        return None


def _twice(keys: IntArray, order: IntArray, batch: _Batch) -> SeenId | None:
    """Return the first that is in a batch (sorted keys, their places, rising where keys are equal) once more."""
    again = np.concatenate([[False], keys[1:] == keys[:-1]])
    for number in _in_order_of_places(again, order):
        for before in order[np.searchsorted(keys, keys[number]) : number].tolist():
            if batch.same_id(before, batch, int(order[number])):
                return SeenId(int(order[number]), batch.part, int(batch.rows.values()[before]))
    return None


def _in_order_of_places(wanted: BoolArray, order: IntArray) -> list[int]:
    """Return where ``wanted`` (N,) is true, sorted by ``order`` (N,)."""
    numbers = np.flatnonzero(wanted)
    found: list[int] = numbers[np.argsort(order[numbers])].tolist()
    return found
