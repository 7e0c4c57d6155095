"""Rows that compete to be the one direct path: the paths of one sensor at one position by one stated reflector."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ScalarT

__all__ = ["PathGroups", "group_paths", "path_shares", "restore_rows", "sort_rows"]


@dataclass(frozen=True)
class PathGroups:
    """How the rows (B, K) of each snapshot fall into groups.

    ``order`` (B, K) sorts the rows so that groups are together, ``last`` (B, K) marks the last row of each group in
    that order; both are None where every row is a group of its own. ``leader`` (B, K) is, in the file's order, the
    first row of a row's group, ``rank`` its rank in the group by path number, ``size`` the number of its rows.
    """

    leader: IntArray
    rank: IntArray
    size: IntArray
    order: IntArray | None
    last: BoolArray | None

    def unordered(self, prior: str) -> BoolArray | None:
        """Return in which snapshots (B,) paths compete in unknown order; None if in no snapshot."""
        if self.order is None or prior != "uniform":
            return None
        return np.asarray((self.size > 1).any(axis=1))

    def direct_pairs(self, prior: str) -> tuple[IntArray, IntArray]:
        """Return the number (B,) of groups, and that of pairs of rows that may both be direct: of different groups."""
        possible = np.where(self.rank == 0, 1, 0 if prior == "first" else 1)
        leading, size = self.rank == 0, np.where(prior == "first", 1, self.size)
        rows = np.count_nonzero(possible, axis=1)
        within = np.sum(np.where(leading, size * size, 0), axis=1)
        return np.count_nonzero(leading, axis=1), (rows * rows - within) // 2


def group_paths(keys: Sequence[npt.NDArray[Any]], path: IntArray) -> PathGroups:
    """Return the groups of rows (B, K) whose ``keys`` are all equal; ``path`` (B, K) numbers the rows of a group.

    Rows of equal path number count as ranked in the file's order. Cost K log K.
    """
    if _all_different(keys[0]):
        return _alone(path.shape)
    by_row = np.lexsort(keys[::-1], axis=1)
    starts = np.ones(path.shape, dtype=bool)
    starts[:, 1:] = False
    for key in keys:
        starts[:, 1:] |= _steps(np.take_along_axis(key, by_row, axis=1))
    if starts.all():
        return _alone(path.shape)
    position = np.arange(path.shape[1])
    begin = np.maximum.accumulate(np.where(starts, position, 0), axis=1)
    ends = np.concatenate([starts[:, 1:], np.ones_like(starts[:, :1])], axis=1)
    end = np.minimum.accumulate(np.where(ends, position, position[-1])[:, ::-1], axis=1)[:, ::-1]
    leader, rank, size = (np.empty(path.shape, dtype=np.int64, order="F") for _ in range(3))
    np.put_along_axis(leader, by_row, np.take_along_axis(by_row, begin, axis=1), axis=1)
    np.put_along_axis(size, by_row, end - begin + 1, axis=1)
    by_path = np.lexsort((path, *keys[::-1]), axis=1)
    np.put_along_axis(rank, by_path, position - begin, axis=1)
    order = np.asfortranarray(np.argsort(leader, axis=1, kind="stable"))
    sorted_leader = np.take_along_axis(leader, order, axis=1)
    last = np.ones(path.shape, dtype=bool, order="F")
    last[:, :-1] = sorted_leader[:, 1:] != sorted_leader[:, :-1]
    return PathGroups(leader, rank, size, order, last)


def _all_different(key: npt.NDArray[Any]) -> bool:
    """Return whether no snapshot has a value of the key (B, K) twice."""
    return bool(_steps(np.sort(key, axis=1)).all())


def _steps(values: npt.NDArray[Any]) -> BoolArray:
    """Return where neighbours (B, K - 1) of each snapshot's values (B, K) differ."""
    return np.asarray(values[:, 1:] != values[:, :-1])


def _alone(shape: tuple[int, ...]) -> PathGroups:
    """Return the groups of snapshots whose rows (B, K) are each a group of its own."""
    leader, rank, size = (np.zeros(shape, dtype=np.int64, order="F") for _ in range(3))
    leader[...] = np.arange(shape[1])
    size[...] = 1
    return PathGroups(leader, rank, size, None, None)


def path_shares(groups: PathGroups, prior: str) -> FloatArray:
    """Return the probability (B, K) of each row to be the direct one, if any row of its group is; sums to 1.

    ``uniform``: all rows alike; ``first``: only the one of the lowest path number; ``falling``: each row half as
    probable as the one before it.
    """
    if prior == "first":
        return np.where(groups.rank == 0, 1.0, 0.0)
    if prior == "falling":
        shares: FloatArray = np.exp2(-1.0 - groups.rank) / (1.0 - np.exp2(-groups.size.astype(np.float64)))
        return shares
    return 1.0 / groups.size.astype(np.float64)


def sort_rows(values: npt.NDArray[ScalarT], groups: PathGroups) -> npt.NDArray[ScalarT]:
    """Return values (B, K, ...) with the rows of each group next to each other."""
    if groups.order is None:
        return values
    indices = groups.order.reshape(*groups.order.shape, *([1] * (values.ndim - 2)))
    return np.asfortranarray(np.take_along_axis(values, indices, axis=1))


def restore_rows(values: npt.NDArray[ScalarT], groups: PathGroups | None) -> npt.NDArray[ScalarT]:
    """Return values (B, K) of a grouped batch in the file's order; ``groups`` is None without competing rows."""
    if groups is None or groups.order is None:
        return values
    restored = np.empty_like(values)
    np.put_along_axis(restored, groups.order, values, axis=1)
    return restored
