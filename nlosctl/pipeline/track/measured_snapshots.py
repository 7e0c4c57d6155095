"""The snapshots of measured tracks, collected from chunks: rows, times, tracks and fixes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import BoolArray, FloatArray, IntArray
from nlosctl.contract.windows import TICKS_PER_SECOND
from nlosctl.errors import DataError
from nlosctl.io.measurements.completion.calibrated_rows import OFFSET_ENTRY
from nlosctl.io.measurements.completion.sensor_keys import group_texts
from nlosctl.io.measurements.reader import Chunk
from nlosctl.io.measurements.row_checks import TICKS
from nlosctl.io.results.snapshot_rows import mean_times

__all__ = ["Collected", "MeasuredSnapshots"]

_CODES = frozenset({"sensor", "path", "reflector", "reference", OFFSET_ENTRY})


@dataclass(frozen=True, kw_only=True)
class MeasuredSnapshots:
    """S snapshots with their rows (N,), in the order of the input.

    ``columns`` are the contract's, ``offsets`` (S+1,) the rows of each snapshot, ``left_out`` (N,) those that take no
    part. ``elapsed_s`` (N,) are times since a first row of the track, ``time_s`` (S,) the mean times of snapshots as
    they are written. ``key`` (S,) numbers the tracks. ``fix_m`` (S, D) and ``fix_m2`` (S, D, D) are NaN without a fix.
    """

    columns: Mapping[str, npt.NDArray[Any]]
    offsets: IntArray
    left_out: BoolArray
    elapsed_s: FloatArray
    time_s: FloatArray
    key: IntArray
    fix_m: FloatArray
    fix_m2: FloatArray

    @property
    def mean_elapsed_s(self) -> FloatArray:
        """The mean elapsed times (S,) of the rows that take part, of all where none does."""
        starts = self.offsets[:-1]
        part = ~self.left_out
        some = np.add.reduceat(part, starts, dtype=np.int64) > 0
        weight = (part | ~np.repeat(some, np.diff(self.offsets))).astype(np.float64)
        first = np.repeat(self.elapsed_s[starts], np.diff(self.offsets))
        after = np.add.reduceat(weight * (self.elapsed_s - first), starts) / np.add.reduceat(weight, starts)
        return np.asarray(self.elapsed_s[starts] + after)


@dataclass
class Collected:
    """Collects the chunks of all inputs; ``by`` are the columns that separate tracks, ``column`` that of the times."""

    by: Sequence[str]
    column: str
    most_rows: int
    _chunks: list[Chunk] = field(default_factory=list)
    _keys: list[IntArray] = field(default_factory=list)
    _elapsed: list[FloatArray] = field(default_factory=list)
    _times: list[FloatArray] = field(default_factory=list)
    _fixes: list[tuple[FloatArray, FloatArray]] = field(default_factory=list)
    _known: dict[tuple[str, ...], int] = field(default_factory=dict)
    _first: dict[int, int] = field(default_factory=dict)
    _rows: int = 0

    @property
    def tracks(self) -> int:
        """The number of tracks so far."""
        return len(self._known)

    def add(self, chunk: Chunk) -> None:
        """Take a chunk; raise DataError for a snapshot of several tracks, or too many rows."""
        self._rows += int(chunk.offsets[-1])
        if self._rows > self.most_rows:
            raise DataError(
                f"{chunk.source}: more than {self.most_rows} rows, which a track needs in memory; track parts of the "
                "input one by one, or raise `max_sort_rows`"
            )
        codes, groups = group_texts(chunk, self.by)
        starts = chunk.offsets[:-1]
        mixed = np.maximum.reduceat(codes, starts) != np.minimum.reduceat(codes, starts)
        if mixed.any():
            at = int(np.flatnonzero(mixed)[0])
            texts = [" ".join(groups[code]) for code in np.unique(codes[chunk.offsets[at] : chunk.offsets[at + 1]])]
            raise DataError(
                f"{chunk.source}, snapshot {chunk.snapshot[at].as_py()!r}: rows of several tracks by "
                f"{', '.join(self.by)} ({', '.join(texts)}); a snapshot is of one: number them apart, or leave the "
                "column 'snapshot' out and set `window`"
            )
        numbers = [self._known.setdefault((chunk.source, *group), len(self._known)) for group in groups]
        key = np.array(numbers, dtype=np.int64)[codes[starts]]
        self._keys.append(key)
        ticks = chunk.columns[TICKS]
        for number, tick in zip(key.tolist(), ticks[starts].tolist(), strict=True):
            self._first.setdefault(number, tick)
        first = np.array([self._first[number] for number in key.tolist()])
        self._elapsed.append((ticks - np.repeat(first, np.diff(chunk.offsets))) / TICKS_PER_SECOND[self.column])
        self._times.append(mean_times(chunk, self.column))
        self._chunks.append(chunk)

    def add_fixes(self, position_m: FloatArray, covariance_m2: FloatArray) -> None:
        """Take the fixes (S, D) of the next chunk, with covariances (S, D, D)."""
        self._fixes.append((position_m, covariance_m2))

    def together(self) -> MeasuredSnapshots:
        """Return everything as one."""
        chunks = self._chunks
        shifts = np.cumsum([0, *(int(chunk.offsets[-1]) for chunk in chunks)])
        offsets = [chunk.offsets[:-1] + shift for chunk, shift in zip(chunks, shifts, strict=False)]
        names = dict.fromkeys(name for chunk in chunks for name in chunk.columns)
        return MeasuredSnapshots(
            columns={name: np.concatenate([_column(chunk, name) for chunk in chunks]) for name in names},
            offsets=np.append(np.concatenate(offsets), shifts[-1]),
            left_out=np.concatenate([chunk.left_out for chunk in chunks]),
            elapsed_s=np.concatenate(self._elapsed),
            time_s=np.concatenate(self._times),
            key=np.concatenate(self._keys),
            fix_m=np.concatenate([fix for fix, _ in self._fixes]),
            fix_m2=np.concatenate([spread for _, spread in self._fixes]),
        )


def _column(chunk: Chunk, name: str) -> npt.NDArray[Any]:
    """Return a column (N,) of a chunk; one that is absent is null in every row."""
    if name in chunk.columns:
        return chunk.columns[name]
    size = chunk.left_out.shape[0]
    return np.full(size, -1, dtype=np.int64) if name in _CODES else np.full(size, np.nan)
