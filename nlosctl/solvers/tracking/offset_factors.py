"""Offsets of sensors that are not exactly known, of each track: independent unknowns of variance 1, and what rows have
of them.

With the offsets o of covariance C = L L' and o = L z, z has the covariance 1, and a singular C needs nothing special.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import FloatArray, IntArray

__all__ = ["OffsetCauses", "offset_factors"]

_LEAST_SHARE = 1e-12
"""Directions of the offsets with a smaller share of the largest variance are exactly known."""


@dataclass(frozen=True)
class OffsetCauses:
    """The offsets of rows: numbers (N, M) of the causes of each, and stds (N, M), negative where a cause is subtracted.

    The causes 0 to E - 1 have the ``covariance`` (E, E), all others are independent, with the variance 1.
    """

    number: IntArray
    std: FloatArray
    covariance: FloatArray

    def of(self, causes: IntArray) -> FloatArray:
        """Return the covariance (C, C) of some causes (C,)."""
        matrix = np.eye(causes.shape[0])
        known = np.flatnonzero(causes < self.covariance.shape[0])
        matrix[np.ix_(known, known)] = self.covariance[np.ix_(causes[known], causes[known])]
        return matrix


def offset_factors(causes: OffsetCauses, track: IntArray, tracks: int) -> FloatArray:
    """Return the change (N, R) of the offset of each row per unit of the R unknowns z of its track (N,).

    A track has the unknowns of its own rows; those that it lacks change nothing.
    """
    rows, column = np.nonzero(causes.std)
    if not rows.size:
        return np.zeros((causes.number.shape[0], 0))
    number, std = causes.number[rows, column], causes.std[rows, column]
    span = int(number.max()) + 1
    pairs, pair = np.unique(track[rows] * span + number, return_inverse=True)
    of_track, cause = pairs // span, pairs % span
    within = np.arange(pairs.shape[0]) - np.searchsorted(of_track, np.arange(tracks))[of_track]
    sets = np.full((tracks, int(within.max()) + 1), -1, dtype=np.int64)
    sets[of_track, within] = cause
    distinct, which = np.unique(sets, axis=0, return_inverse=True)
    roots = [_root(causes.of(one[one >= 0])) for one in distinct]
    table = np.zeros((len(roots), sets.shape[1], max(root.shape[1] for root in roots)))
    for entry, root in zip(table, roots, strict=True):
        entry[: root.shape[0], : root.shape[1]] = root
    factors = np.zeros((*causes.number.shape, table.shape[2]))
    factors[rows, column] = std[:, None] * table[which.reshape(-1)[of_track[pair]], within[pair]]
    total = factors[:, 0]
    for further in range(1, factors.shape[1]):
        total = total + factors[:, further]
    return np.asarray(total)


def _root(covariance: FloatArray) -> FloatArray:
    """Return L (C, R) with L L' the covariance (C, C) of rank R."""
    if not covariance.size:
        return np.zeros((0, 0))
    values, vectors = np.linalg.eigh(covariance)
    kept = values > _LEAST_SHARE * max(float(values[-1]), 0.0)
    return np.asarray(vectors[:, kept] * np.sqrt(values[kept]))
