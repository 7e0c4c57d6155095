"""Initial fixes of tracks whose snapshots have too few rows: those of several snapshots in a row, as if at rest."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray
from nlosctl.io.measurements.reader import Chunk
from nlosctl.pipeline.track.measured_snapshots import MeasuredSnapshots

__all__ = ["with_merged_fixes"]

_SIZES = (2, 4, 8, 16, 32)
_FEWEST = 2
"""A path needs so many fixes to start from."""

_SPREAD = 25.0
"""Covariances of fixes of several snapshots are so many times as large: the source has moved."""

Fix = Callable[[Chunk], tuple[FloatArray, FloatArray]]


def with_merged_fixes(snapshots: MeasuredSnapshots, fix: Fix) -> MeasuredSnapshots:
    """Return the snapshots with fixes for tracks that have fewer than two, of as few snapshots together as possible.

    ``fix`` returns positions (S, D) and covariances (S, D, D) of the snapshots of a chunk. A fix is that of the
    snapshot in the middle.
    """
    position, spread = snapshots.fix_m.copy(), snapshots.fix_m2.copy()
    time_s = snapshots.mean_elapsed_s
    for size in _SIZES:
        known = np.isfinite(position[:, 0])
        short = np.bincount(snapshots.key, known) < _FEWEST
        long_enough = np.bincount(snapshots.key) >= _FEWEST * size
        wanted = (short & long_enough)[snapshots.key]
        if not wanted.any():
            continue
        order = np.flatnonzero(wanted)
        order = order[np.lexsort((time_s[order], snapshots.key[order]))]
        heads = _heads(snapshots.key[order], size)
        found, covariance = fix(_merged(snapshots, order, heads))
        middle = order[np.minimum(heads + size // 2, np.append(heads[1:], order.shape[0]) - 1)]
        position[middle], spread[middle] = found, _SPREAD * covariance
    return dataclasses.replace(snapshots, fix_m=position, fix_m2=spread)


def _heads(key: IntArray, size: int) -> IntArray:
    """Return the index of the first of every ``size`` neighbours of equal keys (N,)."""
    first = np.flatnonzero(np.diff(key, prepend=key[0] - 1))
    within = np.arange(key.shape[0]) - np.repeat(first, np.diff(first, append=key.shape[0]))
    return np.flatnonzero(within % size == 0)


def _merged(snapshots: MeasuredSnapshots, order: IntArray, heads: IntArray) -> Chunk:
    """Return the rows of groups of snapshots, in the order ``order``, as a chunk of one snapshot each."""
    counts = np.diff(snapshots.offsets)[order]
    starts = snapshots.offsets[:-1][order]
    within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    rows = np.repeat(starts, counts) + within
    offsets = np.concatenate([[0], np.cumsum(np.add.reduceat(counts, heads))])
    left_out: BoolArray = snapshots.left_out[rows]
    return Chunk(
        table=None,
        snapshot=np.arange(heads.shape[0]),
        offsets=offsets,
        columns={name: values[rows] for name, values in snapshots.columns.items()},
        left_out=left_out,
        source="",
    )
