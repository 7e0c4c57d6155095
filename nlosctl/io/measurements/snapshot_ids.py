"""Snapshot ids: where each snapshot begins, whether its rows are together, and whether one of them is good."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.compute as pc

from nlosctl.arrays import BoolArray, IntArray

__all__ = [
    "REMEMBERED_SNAPSHOTS",
    "IdSpan",
    "LostSnapshots",
    "SeenId",
    "SnapshotIndex",
    "id_type",
    "integer_ids",
    "run_starts",
]

REMEMBERED_SNAPSHOTS = 1_000_000

_STEP_TYPES = (np.int8, np.int16, np.int32, np.int64)


def id_type(schema: Any) -> Any:
    """Return the Arrow type of the snapshot ids of files with this schema: int64, uint64 if it has that, or text."""
    in_file = schema.field("snapshot").type
    return in_file if pa.types.is_uint64(in_file) else pa.int64() if pa.types.is_integer(in_file) else pa.string()


def integer_ids(ids: Any) -> IntArray:
    """Return integer ids (N,) as int64; unsigned ones beyond 2^63 wrap around, so that different ids stay different."""
    values: IntArray = ids.to_numpy().view(np.int64)
    return values


def run_starts(ids: Any, before: Any) -> IntArray:
    """Return the indices at which ``ids`` (Arrow, no nulls) differ from the row before, ``before`` for the first."""
    if len(ids) == 0:
        return np.empty(0, dtype=np.int64)
    if pa.types.is_integer(ids.type):
        values = ids.to_numpy()
        changes = np.flatnonzero(values[1:] != values[:-1]) + 1
    else:
        differs = pc.not_equal(ids.slice(1), ids.slice(0, len(ids) - 1))
        changes = np.flatnonzero(differs.to_numpy(zero_copy_only=False)) + 1
    if before is None or ids[0].as_py() != before:
        changes = np.concatenate([np.zeros(1, dtype=np.int64), changes])
    return changes


class LostSnapshots:
    """Counts snapshots without a good row; ``preceding`` is the id of one that has a good row already."""

    def __init__(self, preceding: Any = None) -> None:
        self._complete = 0
        self._last: Any = preceding
        self._last_is_good = True

    @property
    def count(self) -> int:
        """The number so far, if the last snapshot has no more rows."""
        return self._complete + (not self._last_is_good)

    def add(self, ids: Any, bad: BoolArray | None) -> None:
        """Add the ids (N,) of all rows of a batch, and which rows are bad (None: no row)."""
        good = np.ones(len(ids), dtype=np.bool_) if bad is None else ~bad
        if ids.null_count:
            valid = np.asarray(pc.is_valid(ids).to_numpy(zero_copy_only=False), dtype=np.bool_)
            ids, good = ids.drop_null(), good[valid]
        if len(ids) == 0:
            return
        first = ids[0].as_py()
        good_runs = good[:1] if bad is None else np.logical_or.reduceat(good, run_starts(ids, None))
        if first == self._last:
            good_runs[0] |= self._last_is_good
        else:
            self._complete += not self._last_is_good
        self._complete += int((~good_runs[:-1]).sum())
        self._last, self._last_is_good = ids[len(ids) - 1].as_py(), bool(good_runs[-1])


@dataclass(frozen=True, kw_only=True)
class IdSpan:
    """The first and the last snapshot id of some rows (None: no row); ``ordered`` if they rise or fall strictly."""

    first: int | str | None
    last: int | str | None
    ordered: bool


class SeenId(NamedTuple):
    """An id that occurs again: its index ``at`` among the ids just added, and the file and row of the earlier one."""

    at: int
    part: str
    row: int


class SnapshotIndex:
    """Finds a snapshot whose rows return after those of others.

    The result is exact while the ids rise strictly, or fall; after that for the last ``remembered`` ids at least.
    """

    def __init__(self, remembered: int = REMEMBERED_SNAPSHOTS) -> None:
        self._remembered = remembered
        self._sorted: deque[tuple[str, _Steps | Any, _Steps]] = deque()
        self._sorted_count = 0
        self._recent: _IdSet | None = None
        self._older: _IdSet | None = None
        self._direction = 0
        self._first: Any = None
        self._last: Any = None

    @property
    def span(self) -> IdSpan:
        """The span of the ids added so far."""
        if self._first is None:
            return IdSpan(first=None, last=None, ordered=True)
        return IdSpan(first=self._first.as_py(), last=self._last.as_py(), ordered=self._recent is None)

    def add(self, part: str, ids: Any, rows: IntArray) -> SeenId | None:
        """Add the first id of each run of rows (Arrow, N), with its row number in the file ``part``.

        Return the first id that has been added before, if any.
        """
        if len(ids) == 0:
            return None
        seen = None
        if self._recent is None and self._continues(ids):
            self._remember(part, ids, rows)
        else:
            if self._recent is None:
                self._recent = _IdSet()
                while self._sorted:
                    earlier, kept, numbers = self._sorted.popleft()
                    whole = (
                        pa.array(kept.values().view(ids.type.to_pandas_dtype())) if isinstance(kept, _Steps) else kept
                    )
                    self._index(earlier, whole, numbers)
            seen = self._index(part, ids, _Steps.of(rows))
        if self._first is None:
            self._first = ids[0]
        self._last = ids[len(ids) - 1]
        return seen

    def _continues(self, ids: Any) -> bool:
        """Return whether the ids continue to rise, or to fall, strictly."""
        if self._last is not None:
            ids = pa.concat_arrays([pa.array([self._last.as_py()], ids.type), ids])
        if len(ids) == 1:
            return True
        if self._direction == 0:
            self._direction = 1 if ids[1].as_py() > ids[0].as_py() else -1
        if pa.types.is_integer(ids.type):
            values = ids.to_numpy()
            rising = values[1:] > values[:-1] if self._direction > 0 else values[1:] < values[:-1]
            return bool(rising.all())
        compare = pc.greater if self._direction > 0 else pc.less
        return bool(pc.all(compare(ids.slice(1), ids.slice(0, len(ids) - 1))).as_py())

    def _remember(self, part: str, ids: Any, rows: IntArray) -> None:
        """Keep sorted ids in their order: integers and rows take a byte each where they count up."""
        kept = _Steps.of(integer_ids(ids)) if pa.types.is_integer(ids.type) else ids
        self._sorted.append((part, kept, _Steps.of(rows)))
        self._sorted_count += len(ids)
        while self._sorted_count - len(self._sorted[0][1]) >= self._remembered:
            self._sorted_count -= len(self._sorted.popleft()[1])

    def _index(self, part: str, ids: Any, rows: _Steps) -> SeenId | None:
        """Add ids to the recent set, unless one of them has been added before; return the first such id."""
        integers = pa.types.is_integer(ids.type)
        # Python's hash of text is seeded for each process, so that no file can be made of colliding ids
        keys = integer_ids(ids) if integers else np.fromiter(map(hash, ids.to_pylist()), np.int64, len(ids))
        order = np.argsort(keys, kind="stable")
        batch = _IdBatch(part=part, rows=rows, texts=None if integers else ids)
        keys = keys[order]
        assert self._recent is not None  # noqa: S101 - set by the caller
        matches = [_repeated(keys, order, batch), self._recent.find(keys, order, batch)]
        if self._older is not None:
            matches.append(self._older.find(keys, order, batch))
        seen = [match for match in matches if match is not None]
        if seen:
            return min(seen)
        self._recent.add(keys, order, batch)
        if self._recent.keys.shape[0] >= self._remembered:
            self._older, self._recent = self._recent, _IdSet()
        return None


@dataclass(frozen=True)
class _Steps:
    """Integers (N,), N > 0, as the first and the differences, which have the smallest type possible."""

    first: int
    steps: npt.NDArray[Any]

    @classmethod
    def of(cls, values: IntArray) -> _Steps:
        steps = np.diff(values)  # a difference beyond 64 bits wraps around, and back in the sum
        low, high = (int(steps.min()), int(steps.max())) if steps.shape[0] else (0, 0)
        fitting = next(kind for kind in _STEP_TYPES if np.iinfo(kind).min <= low and high <= np.iinfo(kind).max)
        return cls(int(values[0]), steps.astype(fitting))

    def __len__(self) -> int:
        return len(self.steps) + 1

    def values(self) -> IntArray:
        return np.cumsum(np.concatenate([[self.first], self.steps.astype(np.int64)]), dtype=np.int64)


@dataclass(frozen=True, kw_only=True)
class _IdBatch:
    """Ids that were added together: their file and rows, and their texts (None: integers, which are their own keys)."""

    part: str
    rows: _Steps
    texts: Any

    def same_id(self, index: int, other: _IdBatch, other_index: int) -> bool:
        """Return whether two ids with equal keys are equal."""
        return self.texts is None or bool(self.texts[index] == other.texts[other_index])


class _IdSet:
    """Ids as sorted keys (N,), each with its index (N,) in the order in which the batches were added."""

    def __init__(self) -> None:
        self.keys = np.empty(0, dtype=np.int64)
        self._indices = np.empty(0, dtype=np.int32)
        self._starts: list[int] = []
        self._batches: list[_IdBatch] = []

    def add(self, keys: IntArray, order: IntArray, batch: _IdBatch) -> None:
        """Add the sorted keys of a batch; ``order`` (N,) is the index of each in the batch."""
        size = self.keys.shape[0]
        at = np.searchsorted(self.keys, keys)
        self.keys = np.insert(self.keys, at, keys)
        self._indices = np.insert(self._indices, at, (order + size).astype(np.int32))
        self._starts.append(size)
        self._batches.append(batch)

    def find(self, keys: IntArray, order: IntArray, batch: _IdBatch) -> SeenId | None:
        """Return the first id of a batch, given as for `add`, that is in the set."""
        start, stop = (np.searchsorted(self.keys, keys, side) for side in ("left", "right"))
        for number in _in_file_order(stop > start, order):
            for index in self._indices[start[number] : stop[number]].tolist():
                at = int(np.searchsorted(self._starts, index, "right")) - 1
                earlier, within = self._batches[at], index - self._starts[at]
                if earlier.same_id(within, batch, int(order[number])):
                    return SeenId(int(order[number]), earlier.part, int(earlier.rows.values()[within]))
        return None


def _repeated(keys: IntArray, order: IntArray, batch: _IdBatch) -> SeenId | None:
    """Return the first id that a batch, given as for `_IdSet.add`, has twice."""
    again = np.concatenate([[False], keys[1:] == keys[:-1]])
    for number in _in_file_order(again, order):
        for earlier in order[np.searchsorted(keys, keys[number]) : number].tolist():
            if batch.same_id(earlier, batch, int(order[number])):
                return SeenId(int(order[number]), batch.part, int(batch.rows.values()[earlier]))
    return None


def _in_file_order(wanted: BoolArray, order: IntArray) -> list[int]:
    """Return the indices at which ``wanted`` (N,) is true, sorted by ``order`` (N,)."""
    numbers = np.flatnonzero(wanted)
    indices: list[int] = numbers[np.argsort(order[numbers])].tolist()
    return indices
