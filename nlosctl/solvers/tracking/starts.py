"""Paths of measured tracks from the fixes of their snapshots: initial estimates, and the better of two searches."""

from __future__ import annotations

import dataclasses

import numpy as np

from nlosctl.solvers.tracking.fixes import Fixes, Path, smooth_robustly
from nlosctl.solvers.tracking.measured_paths import FoundPaths, MeasuredTracks, find_paths
from nlosctl.solvers.tracking.states import States

__all__ = ["best_paths"]

_TEMPERING = (8.0, 4.0, 2.0)
_FEW_STEPS = 40


def best_paths(tracks: MeasuredTracks, fixes: Fixes, of: States, *, is_mixture: bool) -> FoundPaths:
    """Return the likeliest paths found from robustly smoothed fixes, of a mixture from two initial estimates.

    The second is the first after searches with standard deviations 8, 4 and 2 times as large; the lower cost counts.
    """
    start = smooth_robustly(fixes, of, tracks.motion)
    one = find_paths(tracks, start)
    if not is_mixture:
        return one
    for tempering in _TEMPERING:
        start = find_paths(tracks, start, tempering, _FEW_STEPS).path.states
    return _better(one, find_paths(tracks, start), tracks)


def _better(one: FoundPaths, other: FoundPaths, tracks: MeasuredTracks) -> FoundPaths:
    """Return the path of the lower cost of each track."""
    second = other.path.cost < one.path.cost
    by_state = second[tracks.motion.track]

    per_track = ("cost", "log_evidence")
    parts = {}
    for field in dataclasses.fields(Path):
        mine, theirs = getattr(one.path, field.name), getattr(other.path, field.name)
        which = second if field.name in per_track else by_state
        parts[field.name] = np.where(which.reshape(-1, *[1] * (mine.ndim - 1)), theirs, mine)
    return FoundPaths(Path(**parts), np.where(second, other.settled, one.settled))
