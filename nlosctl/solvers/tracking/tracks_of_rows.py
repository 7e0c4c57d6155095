"""Tracks through measurements: states, searches, and the density of the acceleration where it is not given."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray
from nlosctl.solvers.tracking.acceleration import DensityEstimate, close_times, likeliest_density
from nlosctl.solvers.tracking.filtered_rows import filter_paths
from nlosctl.solvers.tracking.fixes import Fixes
from nlosctl.solvers.tracking.measured_paths import FoundPaths, MeasuredTracks, RowsAtStates, find_paths
from nlosctl.solvers.tracking.motion import Motion
from nlosctl.solvers.tracking.path_rows import FollowedRows
from nlosctl.solvers.tracking.starts import best_paths
from nlosctl.solvers.tracking.states import States, at_offset, order_states
from nlosctl.solvers.tracking.tracks_of_fixes import track_origins
from nlosctl.solvers.tracking.uncertain_offsets import UncertainRows, with_offsets

__all__ = ["SnapshotRows", "TrackedRows", "TracksOfRows", "track_rows"]


@dataclass(frozen=True)
class SnapshotRows:
    """Rows (B, K) of the snapshots ``snapshot`` (B,), at the times ``time_s`` (B, K) in the order of the rows."""

    rows: FollowedRows
    snapshot: IntArray
    time_s: FloatArray


@dataclass(frozen=True)
class TrackedRows:
    """S snapshots of tracks ``key`` (S,) at mean times (S,), with their blocks of rows and the fixes (S, D) of each.

    A gap longer than ``gap_s`` begins a new track. ``uncertain`` are the rows of the blocks if offsets of their sensors
    are not exactly known.
    """

    key: IntArray
    time_s: FloatArray
    blocks: Sequence[SnapshotRows]
    fix_m: FloatArray
    fix_m2: FloatArray
    gap_s: float
    is_mixture: bool
    causal: bool = False
    uncertain: UncertainRows | None = None


@dataclass(frozen=True)
class TracksOfRows:
    """Paths of measured tracks: states (S, 2D) of snapshots about ``origin_m`` (S, D), covariances (S, 2D, 2D).

    ``at`` are the blocks of rows at the ``states`` (N, 2D) of ``of``.
    """

    states: FloatArray
    covariance: FloatArray
    origin_m: FloatArray
    known: BoolArray
    moving: BoolArray
    settled: BoolArray
    of: States
    at: Sequence[RowsAtStates]
    path: FloatArray
    tracks: int
    density: DensityEstimate


def track_rows(tracked: TrackedRows, density: float | None) -> TracksOfRows:
    """Return the likeliest paths; ``density`` None is estimated from all tracks together."""
    dimension = tracked.fix_m.shape[1]
    known = Fixes.of(tracked.fix_m, tracked.fix_m2).known
    origin = track_origins(tracked.key, np.where(known[:, None], tracked.fix_m, np.nan))
    fixes = Fixes.of(tracked.fix_m - origin, tracked.fix_m2)
    variance = np.where(known, np.trace(tracked.fix_m2, axis1=1, axis2=2) / dimension, np.nan)
    last: list[FloatArray] = []

    def search(q: float) -> tuple[States, MeasuredTracks, FoundPaths]:
        of = order_states(
            tracked.key, tracked.time_s, tracked.gap_s, close_times(tracked.key, variance, q) * (not tracked.causal)
        )
        motion = Motion.of(of.within, of.time_s, q)

        def place(rows: Sequence[FollowedRows]) -> MeasuredTracks:
            at = [_at_states(block, own, of, origin) for block, own in zip(tracked.blocks, rows, strict=True)]
            return MeasuredTracks(at, motion, dimension)

        uncertain = tracked.uncertain
        tracks = place([block.rows for block in tracked.blocks] if uncertain is None else uncertain.widened())
        warm = bool(last) and last[0].shape[0] == of.within.shape[0]
        if not warm:
            found = best_paths(tracks, fixes, of, is_mixture=tracked.is_mixture)
        else:
            found = find_paths(tracks, last[0]) if uncertain is None else find_paths(tracks, last[0], most=0)
        unknowns = last[1:]
        if uncertain is not None:
            tracks, found, *unknowns = with_offsets(uncertain, place, tracks, found, last[1] if warm else None)
        last[:] = [found.path.states, *unknowns]
        return of, tracks, found

    def log_evidence(q: float) -> float:
        return float(search(q)[2].path.log_evidence.sum())

    chosen = likeliest_density(log_evidence, 1.0) if density is None else DensityEstimate(density, True)
    last.clear()
    of, tracks, found = search(chosen.density)
    at, path, settled = of.of_snapshot, found.path, found.settled[tracks.motion.track]
    if tracked.causal:
        path, settled = filter_paths(tracks, path.states, _own_fixes(fixes, of, path.states))
    known_path = path.known & _have_starts(tracks.motion, of, fixes.known)
    states, covariance = at_offset(path.states[at], path.covariance[at], of.offset_s)
    return TracksOfRows(
        states, covariance, origin, known_path[at], path.moving[at], settled[at], of, tracks.blocks, path.states,
        tracks.motion.first.shape[0], chosen,
    )  # fmt: skip


def _at_states(block: SnapshotRows, rows: FollowedRows, of: States, origin_m: FloatArray) -> RowsAtStates:
    """Return rows of a block's snapshots at their states."""
    state = of.of_snapshot[block.snapshot]
    return RowsAtStates(rows, state, origin_m[block.snapshot], block.time_s - of.time_s[state][:, None])


def _have_starts(motion: Motion, of: States, fixed: BoolArray) -> BoolArray:
    """Return which states (N,) are of tracks with two fixes, or of a single state and one: others start nowhere."""
    count = np.bincount(motion.track[of.of_snapshot], fixed, minlength=motion.first.shape[0])
    return np.asarray(count[motion.track] >= np.where(motion.alone, 1, 2))


def _own_fixes(fixes: Fixes, of: States, states: FloatArray) -> FloatArray:
    """Return states (N, 2D) at rest at a fix of their own, those of ``states`` where there is no fix."""
    dimension = fixes.position_m.shape[1]
    own = states.copy()
    own[:, dimension:] = 0.0
    known = np.flatnonzero(fixes.known)
    own[of.of_snapshot[known], :dimension] = fixes.position_m[known]
    return own
