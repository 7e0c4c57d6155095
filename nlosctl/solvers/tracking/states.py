"""The states of tracks: which snapshots are one state, and when."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray

__all__ = ["States", "at_offset", "order_states", "state_sums"]


@dataclass(frozen=True)
class States:
    """N states in order of track and time, and the S snapshots that they belong to.

    ``of_snapshot`` (S,) is the state of each snapshot, ``offset_s`` (S,) the time of the snapshot after its state.
    ``time_s`` (N,) is the time, ``within`` (N,) the number of a state in its track, ``track`` (N,) that of its track,
    ``part`` (S,) the number of a snapshot's track among those of its key.
    """

    of_snapshot: IntArray
    offset_s: FloatArray
    time_s: FloatArray
    within: IntArray
    track: IntArray
    part: IntArray


def order_states(key: IntArray, time_s: FloatArray, gap_s: float, together_s: FloatArray) -> States:
    """Return the states of snapshots (S,) of tracks ``key`` at times (S,), which may be in any order.

    A gap longer than ``gap_s`` begins a new track. Snapshots at one time, and those within ``together_s`` (S,) of the
    first of them, are one state at their mean time.
    """
    order = np.lexsort((time_s, key))
    keys, times = key[order], time_s[order]
    steps = np.diff(times, prepend=times[:1])
    other = np.diff(keys, prepend=keys[:1]) != 0
    begins = other | (steps > gap_s)
    begins[:1] = True
    track = np.cumsum(begins) - 1
    first = np.flatnonzero(other | (np.arange(keys.shape[0]) == 0))
    part = track - np.repeat(track[first], np.diff(first, append=keys.shape[0]))
    opens = begins | (steps > 0.0)
    close = ~begins & (steps > 0.0) & (steps <= together_s[order])
    if close.any():
        opens = _joined(times, begins, together_s[order])
    state = np.cumsum(opens) - 1
    size = int(state[-1]) + 1 if state.size else 0
    head = np.flatnonzero(opens)
    mean = times[head] + np.bincount(state, times - times[head][state], minlength=size) / np.bincount(
        state, minlength=size
    )
    of_snapshot, offset_s, parts = np.empty_like(order), np.empty_like(times), np.empty_like(order)
    of_snapshot[order], offset_s[order], parts[order] = state, times - mean[state], part
    of_state = track[head]
    starts = np.flatnonzero(np.diff(of_state, prepend=-1))
    within = np.arange(size) - np.repeat(starts, np.diff(starts, append=size))
    return States(of_snapshot, offset_s, mean, within, of_state, parts)


def _joined(times: FloatArray, begins: BoolArray, together_s: FloatArray) -> BoolArray:
    """Return where a state opens if snapshots within ``together_s`` of the first of it are one."""
    opens = np.ones(times.shape, dtype=np.bool_)
    head = 0
    for index in range(1, times.shape[0]):
        if not begins[index] and times[index] - times[head] <= together_s[index]:
            opens[index] = False
        else:
            head = index
    return opens


def at_offset(states: FloatArray, covariance: FloatArray, offset_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return states (S, 2D) and covariances (S, 2D, 2D) moved on by times (S,) at their velocities."""
    dimension = states.shape[1] // 2
    moved = states.copy()
    moved[:, :dimension] += offset_s[:, None] * states[:, dimension:]
    carried = np.tile(np.eye(2 * dimension), (states.shape[0], 1, 1))
    for axis in range(dimension):
        carried[:, axis, dimension + axis] = offset_s
    if not offset_s.any():
        return moved, covariance
    return moved, carried @ covariance @ carried.transpose(0, 2, 1)


def state_sums(values: FloatArray, state: IntArray, size: int) -> FloatArray:
    """Return the sums (N, ...) of values (B, ...) that belong to states (B,), in their order."""
    total = np.zeros((size, *values.shape[1:]))
    if np.unique(state).shape[0] == state.shape[0]:
        total[state] = values
    else:
        np.add.at(total, state, values)
    return total
