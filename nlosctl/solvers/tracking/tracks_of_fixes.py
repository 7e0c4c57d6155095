"""Tracks through fixes: states, smoother or filter, and the density of the acceleration where it is not given."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray
from nlosctl.solvers.tracking.acceleration import DensityEstimate, close_times, likeliest_density
from nlosctl.solvers.tracking.fixes import Fixes, Path, filter_fixes, smooth_fixes
from nlosctl.solvers.tracking.motion import Motion
from nlosctl.solvers.tracking.states import States, at_offset, order_states

__all__ = ["TracksOfFixes", "track_fixes", "track_origins"]


@dataclass(frozen=True)
class TracksOfFixes:
    """States (S, 2D) of snapshots about ``origin_m`` (S, D), their covariances (S, 2D, 2D), and what is known.

    ``misfit`` (S,) is half the chi-square of each fix, ``fixed`` (S,) marks fixes that count, ``tracks`` is the number
    of tracks, gaps included.
    """

    states: FloatArray
    covariance: FloatArray
    origin_m: FloatArray
    known: BoolArray
    moving: BoolArray
    misfit: FloatArray
    fixed: BoolArray
    part: IntArray
    tracks: int
    density: DensityEstimate


def track_fixes(
    key: IntArray,
    time_s: FloatArray,
    position_m: FloatArray,
    covariance_m2: FloatArray,
    density: float | None,
    *,
    gap_s: float,
    causal: bool,
) -> TracksOfFixes:
    """Return the paths of tracks ``key`` through fixes (S, D) with covariances (S, D, D), NaN where they are unknown.

    ``density`` None is estimated from all tracks together.
    """
    usable = Fixes.of(position_m, covariance_m2).known
    origin = track_origins(key, np.where(usable[:, None], position_m, np.nan))
    fixes = Fixes.of(position_m - origin, covariance_m2)
    variance = np.where(usable, np.trace(covariance_m2, axis1=1, axis2=2) / position_m.shape[1], np.nan)

    def states(q: float, together: bool = True) -> tuple[States, Motion]:
        close = close_times(key, variance, q) if together else np.zeros(key.shape)
        of = order_states(key, time_s, gap_s, close)
        return of, Motion.of(of.within, of.time_s, q)

    def log_evidence(q: float) -> float:
        path = smooth_fixes(fixes, *states(q))
        return float(path.log_evidence[np.isfinite(path.log_evidence)].sum())

    found = likeliest_density(log_evidence, 1.0) if density is None else DensityEstimate(density, True)
    of, motion = states(found.density, not causal)
    path: Path = filter_fixes(fixes, of, motion) if causal else smooth_fixes(fixes, of, motion)
    at = of.of_snapshot
    moved, covariance = at_offset(path.states[at], path.covariance[at], of.offset_s)
    _, chi_square = fixes.misfit(path.states, of)
    return TracksOfFixes(
        moved, covariance, origin, path.known[at], path.moving[at], 0.5 * chi_square, fixes.known, of.part,
        motion.first.shape[0], found,
    )  # fmt: skip


def track_origins(key: IntArray, position_m: FloatArray) -> FloatArray:
    """Return a local origin (S, D) of the track of each snapshot: the mean of its positions, NaN where not known."""
    known = np.isfinite(position_m).all(axis=1)
    tracks = int(key.max(initial=-1)) + 1
    count = np.maximum(np.bincount(key, known, minlength=tracks), 1.0)
    sums = [np.bincount(key, np.where(known, axis, 0.0), minlength=tracks) for axis in position_m.T]
    return np.stack([np.round(total / count)[key] for total in sums], axis=1)
