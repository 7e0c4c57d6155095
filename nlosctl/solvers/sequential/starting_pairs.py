"""How many random pairs to start from, and which (Ananthasubramaniam and Madhow, Section IV-B)."""

from __future__ import annotations

import math
from bisect import bisect_left

import numpy as np

from nlosctl.arrays import IntArray, SeedArray
from nlosctl.contract.random_streams import random_order
from nlosctl.models.bearings import SightLines
from nlosctl.solvers.bearings.ray_crossings import choose_pairs, cross_rays

__all__ = [
    "bootstrap_failure",
    "conditioned_pairs",
    "count_bootstraps",
    "count_path_bootstraps",
    "few_direct_sensors",
    "path_bootstrap_failure",
    "shuffled_pairs",
]


_WELL_CONDITIONED = 0.5
"""Least sine of the angle between the rays of a pair that is preferred as bootstrap."""


def bootstrap_failure(paths: int, alpha: float, bootstraps: int) -> float:
    """Return the probability that each of ``bootstraps`` different pairs contains an outlier; (27) as corrected.

    C(K, M) / C(P, M) with P all pairs of ``paths`` and K those that are not both of the floor((1-alpha) paths) direct
    ones (printed upside down).
    """
    pairs = math.comb(paths, 2)
    bad = pairs - math.comb(math.floor((1.0 - alpha) * paths + 1e-9), 2)
    if bootstraps > bad:
        return 0.0
    return math.prod((bad - index) / (pairs - index) for index in range(bootstraps))


def count_bootstraps(paths: int, alpha: float, failure_probability: float) -> int:
    """Return the least number of bootstraps with which (27) is at most ``failure_probability``; at most all pairs."""
    pairs = math.comb(paths, 2)
    for bootstraps in range(1, pairs):
        if bootstrap_failure(paths, alpha, bootstraps) <= failure_probability:
            return bootstraps
    return max(pairs, 1)


def few_direct_sensors(sensors: int, alpha: float) -> float:
    """Return the probability that fewer than two of the sensors have a direct path: no pair can then be right."""
    return alpha**sensors + sensors * (1.0 - alpha) * alpha ** (sensors - 1)


def path_bootstrap_failure(sensors: int, pairs: int, alpha: float, bootstraps: int) -> float:
    """Return the probability that none of ``bootstraps`` different pairs has two direct paths, if any of them has.

    Equation (27) for several paths per sensor: ``pairs`` of paths of different sensors, the direct ones C(d, 2) if d
    sensors have a direct path. The number d is binomial with probability 1 - alpha, given that it is at least two.
    """
    if sensors < 2:
        return 1.0
    total = 0.0
    for direct in range(2, sensors + 1):
        weight = math.comb(sensors, direct) * (1.0 - alpha) ** direct * alpha ** (sensors - direct)
        good = math.comb(direct, 2)
        if bootstraps <= pairs - good:
            total += weight * math.prod((pairs - bootstraps - index) / (pairs - index) for index in range(good))
    return total / (1.0 - few_direct_sensors(sensors, alpha))


def count_path_bootstraps(sensors: int, pairs: int, alpha: float, failure_probability: float) -> int:
    """Return the least number of bootstraps for which `path_bootstrap_failure` is small enough; at most all pairs."""
    counts = range(1, pairs + 1)
    index = bisect_left(counts, -failure_probability, key=lambda m: -path_bootstrap_failure(sensors, pairs, alpha, m))
    return counts[index] if counts else 1


def shuffled_pairs(seed: SeedArray, count: int, most: int) -> tuple[IntArray, IntArray]:
    """Return different pairs of ``count`` rows in random order (B, P), or ``most`` draws where there are more."""
    pairs = count * (count - 1) // 2
    if pairs > most:
        return choose_pairs(seed, count, most)
    order = random_order(seed, pairs, stream=1)
    first, second = np.triu_indices(count, 1)
    return first[order].astype(np.int64), second[order].astype(np.int64)


def conditioned_pairs(seed: SeedArray, lines: SightLines, wanted: int, most: int) -> tuple[IntArray, IntArray]:
    """Return ``wanted`` pairs (B, wanted): those whose rays cross well in front of both first, else at random."""
    count = lines.origin_x.shape[1]
    pairs = min(count * (count - 1) // 2, most)
    first, second = shuffled_pairs(seed, count, most)
    crossings = cross_rays(lines, first, second)
    c1, s1, c2, s2 = (
        np.take_along_axis(part, index, axis=1) for index in (first, second) for part in (lines.cosine, lines.sine)
    )
    well = crossings.valid & (np.abs(s1 * c2 - c1 * s2) >= _WELL_CONDITIONED)
    order = np.argsort(np.where(well, 0, np.where(crossings.valid, 1, 2)), axis=1, kind="stable")
    order = order[:, : min(wanted, pairs)]
    return np.take_along_axis(first, order, axis=1), np.take_along_axis(second, order, axis=1)
