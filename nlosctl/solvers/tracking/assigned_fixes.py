"""Fixes of several sources assigned to tracks: global nearest neighbours of predicted states, birth and death.

The fixes of one snapshot (a scan) are compared with the states that the tracks are predicted to have then. Of all
assignments, at most one fix to a track, the one with the largest sum of gate - d^2 is taken, with the Mahalanobis
distance d of a fix from a prediction. A fix that none takes begins a track; a track without a fix for several scans
ends.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.special import chdtri

from nlosctl.arrays import BoolArray, FloatArray, IntArray

__all__ = ["AssociationRule", "associate_fixes"]


@dataclass(frozen=True, kw_only=True)
class AssociationRule:
    """How fixes become tracks.

    ``density`` (m2/s3) is that of the white acceleration, ``speed_std_m_s`` the standard deviation of the velocity of a
    new track, per axis; ``gate_probability`` is that of a fix of a track outside its gate, ``misses`` the number of
    scans in a row without a fix after which a track ends.
    """

    density: float
    speed_std_m_s: float
    gate_probability: float
    misses: int


@dataclass
class _Tracks:
    """The tracks that continue: numbers (T,), states (T, 2D) and covariances at ``time_s`` (T,), scans missed (T,)."""

    number: IntArray
    state: FloatArray
    covariance: FloatArray
    time_s: FloatArray
    missed: IntArray

    @classmethod
    def of(
        cls, number: IntArray, position_m: FloatArray, covariance_m2: FloatArray, time_s: float, speed_std_m_s: float
    ) -> _Tracks:
        """Return new tracks at fixes (T, D)."""
        size, d = position_m.shape
        covariance = np.zeros((size, 2 * d, 2 * d))
        covariance[:, :d, :d] = covariance_m2
        covariance[:, d:, d:] = speed_std_m_s**2 * np.eye(d)
        state = np.concatenate([position_m, np.zeros((size, d))], axis=1)
        return cls(number, state, covariance, np.full(size, time_s), np.zeros(size, dtype=np.int64))

    def only(self, kept: BoolArray) -> _Tracks:
        """Return some of the tracks."""
        return _Tracks(*(part[kept] for part in vars(self).values()))

    def joined(self, other: _Tracks) -> _Tracks:
        """Return these and other tracks."""
        return _Tracks(*map(np.concatenate, zip(vars(self).values(), vars(other).values(), strict=True)))

    def predict(self, time_s: float, density: float) -> None:
        """Move the states to a time, under nearly constant velocity."""
        size, whole = self.state.shape
        d, h = whole // 2, time_s - self.time_s
        step, noise = np.tile(np.eye(whole), (size, 1, 1)), np.zeros((size, whole, whole))
        for axis in range(d):
            step[:, axis, d + axis] = h
            noise[:, axis, axis] = density * h**3 / 3.0
            noise[:, axis, d + axis] = noise[:, d + axis, axis] = density * h**2 / 2.0
            noise[:, d + axis, d + axis] = density * h
        self.state = np.einsum("tij,tj->ti", step, self.state)
        self.covariance = step @ self.covariance @ step.transpose(0, 2, 1) + noise
        self.time_s = np.full(size, time_s)

    def update(self, at: IntArray, position_m: FloatArray, covariance_m2: FloatArray) -> None:
        """Update the tracks ``at`` (A,) with fixes (A, D); the others have missed a scan."""
        d = position_m.shape[1]
        cross = self.covariance[at][:, :, :d]
        gain = np.linalg.solve(cross[:, :d] + covariance_m2, cross.transpose(0, 2, 1)).transpose(0, 2, 1)
        self.state[at] += np.einsum("aij,aj->ai", gain, position_m - self.state[at][:, :d])
        self.covariance[at] -= gain @ cross.transpose(0, 2, 1)
        self.missed += 1
        self.missed[at] = 0


def associate_fixes(
    scan: IntArray, time_s: FloatArray, position_m: FloatArray, covariance_m2: FloatArray, rule: AssociationRule
) -> IntArray:
    """Return the number of the track (S,) of each fix, from 0 in order of their beginnings; -1 for an unknown fix.

    ``scan`` (S,) numbers the snapshots, at one time each; positions (S, D) and covariances (S, D, D) are NaN where they
    are unknown.
    """
    track = np.full(scan.shape, -1, dtype=np.int64)
    known = np.asarray(np.isfinite(position_m).all(axis=1) & np.isfinite(covariance_m2).all(axis=(1, 2)))
    order = np.lexsort((scan, time_s))
    gate = float(chdtri(position_m.shape[1], rule.gate_probability))
    live, begun = None, 0
    for rows in np.split(order, np.flatnonzero(np.diff(scan[order])) + 1):
        own, now = rows[known[rows]], float(time_s[rows[0]])
        free = own
        if live is not None:
            live.predict(now, rule.density)
            tracks, fixes = _assigned(live, position_m[own], covariance_m2[own], gate)
            track[own[fixes]] = live.number[tracks]
            live.update(tracks, position_m[own[fixes]], covariance_m2[own[fixes]])
            live = live.only(live.missed < rule.misses)
            free = np.delete(own, fixes)
        number = np.arange(begun, begun + free.size)
        begun, track[free] = begun + free.size, number
        new = _Tracks.of(number, position_m[free], covariance_m2[free], now, rule.speed_std_m_s)
        live = new if live is None else live.joined(new)
    return track


def _assigned(
    live: _Tracks, position_m: FloatArray, covariance_m2: FloatArray, gate: float
) -> tuple[IntArray, IntArray]:
    """Return the tracks (A,) that take a fix, and those fixes (A,)."""
    d = position_m.shape[1]
    away = position_m[None] - live.state[:, None, :d]
    spread = live.covariance[:, None, :d, :d] + covariance_m2[None]
    squared = np.einsum("tfi,tfi->tf", away, np.linalg.solve(spread, away[..., None])[..., 0])
    gain = np.maximum(gate - squared, 0.0)
    tracks, fixes = linear_sum_assignment(gain, maximize=True)
    inside = gain[tracks, fixes] > 0.0
    return tracks[inside], fixes[inside]
