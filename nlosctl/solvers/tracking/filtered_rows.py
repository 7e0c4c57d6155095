"""The filter of measured tracks: each state of the likeliest path through all rows until then.

A state is the last of a path through its own rows and those of the states shortly before; what earlier rows state is a
prior of the first of these, linearized at the smoothed path, to which they have settled by then. So the result depends
on later rows by that linearization alone, and many states are found at once.
"""

from __future__ import annotations

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray
from nlosctl.solvers.tracking.fixes import Path, filter_forward
from nlosctl.solvers.tracking.measured_paths import MeasuredTracks, Prior, RowsAtStates, find_paths
from nlosctl.solvers.tracking.motion import Motion

__all__ = ["filter_paths"]

_LENGTH = 25
"""So many states, the last among them, are found by their own rows."""

_WINDOWS = 1024
"""States that are found at a time."""


def filter_paths(tracks: MeasuredTracks, smoothed: FloatArray, first: FloatArray) -> tuple[Path, BoolArray]:
    """Return each state given the rows until then, and whether its search (N,) has ended.

    ``smoothed`` (N, 2D) are the states given all rows, ``first`` (N, 2D) initial estimates of states by their own rows.
    """
    terms, size = tracks.terms(smoothed), smoothed.shape[0]
    pulled = np.einsum("nij,nj->ni", terms.matrix, smoothed) - terms.gradient
    information, vector = filter_forward(terms.matrix, pulled, tracks.motion)
    before = information - terms.matrix
    slope = np.einsum("nij,nj->ni", before, smoothed) - (vector - pulled)
    members = [_of_blocks(block, size) for block in tracks.blocks]
    parts: list[tuple[Path, BoolArray]] = []
    for start in range(0, size, _WINDOWS):
        last = np.arange(start, min(start + _WINDOWS, size))
        length = np.minimum(tracks.motion.within[last], _LENGTH - 1) + 1
        end = np.cumsum(length) - 1
        within = np.arange(int(end[-1]) + 1) - np.repeat(end - length + 1, length)
        state = np.repeat(last - length + 1, length) + within
        head = (within == 0)[:, None]
        prior = Prior(before[state] * head[:, :, None], slope[state] * head, smoothed[state])
        moves = np.append(within[1:], 0) > 0
        motion = Motion(within, np.where(moves, tracks.motion.step_s[state], 1.0), tracks.motion.density[state])
        blocks = [
            _repeated(block, *member, state) for block, member in zip(tracks.blocks, members, strict=True) if member
        ]
        initial = np.where(motion.alone[:, None], first[state], smoothed[state])
        found = find_paths(MeasuredTracks(blocks, motion, tracks.dimension, prior), initial)
        path = found.path
        mine = (path.states[end], path.covariance[end], path.known[end], path.moving[end])
        parts.append((Path(*mine, path.cost, path.log_evidence), found.settled))
    names = ("states", "covariance", "known", "moving", "cost", "log_evidence")
    joined = {name: np.concatenate([getattr(path, name) for path, _ in parts]) for name in names}
    return Path(**joined), np.concatenate([settled for _, settled in parts])


def _of_blocks(block: RowsAtStates, size: int) -> tuple[IntArray, IntArray]:
    """Return the snapshots of a block in order of their states, and where those of each state (N + 1,) begin."""
    order = np.argsort(block.state, kind="stable")
    return order, np.searchsorted(block.state[order], np.arange(size + 1))


def _repeated(block: RowsAtStates, order: IntArray, begin: IntArray, state: IntArray) -> RowsAtStates:
    """Return the snapshots of the states ``state`` (M,), each as often as its state is there."""
    count = begin[state + 1] - begin[state]
    number = np.repeat(np.arange(state.shape[0]), count)
    within = np.arange(number.shape[0]) - np.repeat(np.cumsum(count) - count, count)
    return block.take(order[begin[state][number] + within], number)
