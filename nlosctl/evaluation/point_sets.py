"""Distances between the sets of estimated and true points: OSPA and GOSPA, with their parts."""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce

import numpy as np
from scipy.optimize import linear_sum_assignment

from nlosctl.arrays import FloatArray, IntArray, ignoring_invalid

__all__ = ["SetDistance", "set_distance"]


@dataclass(frozen=True, kw_only=True)
class SetDistance:
    """OSPA and GOSPA (alpha = 2) with their parts, in metres, and the matched ``pairs`` (P, 2) of point indices.

    The first of a pair is the estimated point, the second the true one. The p-th powers of the parts add up to that
    of the whole.
    """

    ospa_m: float
    ospa_location_m: float
    ospa_number_m: float
    gospa_m: float
    gospa_location_m: float
    gospa_missed_m: float
    gospa_false_m: float
    pairs: IntArray


def set_distance(estimated_m: FloatArray, true_m: FloatArray, *, order: float, cutoff_m: float) -> SetDistance:
    """Return the distances between estimated points (T, D) and true ones (K, D) in metres, of ``order`` p, cutoff c.

    OSPA: Schuhmacher, Vo, Vo 2008, (3); GOSPA: Rahmathullah, Garcia-Fernandez, Svensson 2017, with alpha = 2: a
    missed or a false point costs c^p / 2. Points without a position (NaN) are farther than the cutoff. Two empty
    sets have distance 0. Pairs nearer than the cutoff are matched.
    """
    estimated_count, true_count = estimated_m.shape[0], true_m.shape[0]
    offset = estimated_m[:, None] - true_m[None]
    distance = reduce(np.hypot, np.moveaxis(offset, -1, 0))
    with ignoring_invalid():
        cut = np.where(distance < cutoff_m, distance, cutoff_m)
    powers = cut**order
    estimated, true = linear_sum_assignment(powers)
    matched = cut[estimated, true] < cutoff_m
    largest = max(estimated_count, true_count)
    near = float(powers[estimated, true][matched].sum())
    far = float(cutoff_m**order) * int((~matched).sum())
    surplus = float(cutoff_m**order) * abs(estimated_count - true_count)
    missed = 0.5 * float(cutoff_m**order) * (true_count - int(matched.sum()))
    false = 0.5 * float(cutoff_m**order) * (estimated_count - int(matched.sum()))
    share = 1.0 / largest if largest else 0.0

    def root(power: float) -> float:
        return float(power ** (1.0 / order))

    return SetDistance(
        ospa_m=root(share * (near + far + surplus)),
        ospa_location_m=root(share * (near + far)),
        ospa_number_m=root(share * surplus),
        gospa_m=root(near + missed + false),
        gospa_location_m=root(near),
        gospa_missed_m=root(missed),
        gospa_false_m=root(false),
        pairs=np.stack([estimated[matched], true[matched]], axis=1),
    )
