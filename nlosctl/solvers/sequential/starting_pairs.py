"""How many pairs to start from, and which (Ananthasubramaniam and Madhow, Sections III-B and IV-B)."""

from __future__ import annotations

import math
from bisect import bisect_left
from functools import lru_cache

import numpy as np

from nlosctl.arrays import FloatArray, IntArray, SeedArray
from nlosctl.contract.random_streams import random_keys, random_order
from nlosctl.solvers.bearings.ray_crossings import choose_pairs
from nlosctl.solvers.sequential.orders import RangedLines, pair_state
from nlosctl.solvers.sequential.polar_updates import bootstrap_state

__all__ = [
    "bootstrap_failure",
    "count_bootstraps",
    "count_path_bootstraps",
    "few_direct_sensors",
    "path_bootstrap_failure",
    "shuffled_pairs",
    "starting_pairs",
]


_PAIRS_PER_ROW = 6
"""Most pairs per row that are examined as starting pairs."""

_STATES = 32768
"""Number of pairs examined at once: temporaries stay in cache."""

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
        good = math.comb(direct, 2)
        if bootstraps <= pairs - good:
            weight = direct * math.log1p(-alpha) + (sensors - direct) * math.log(alpha)
            missed = _log_combinations(pairs - bootstraps, good) - _log_combinations(pairs, good)
            total += math.exp(_log_combinations(sensors, direct) + weight + missed)
    return total / (1.0 - few_direct_sensors(sensors, alpha))


def _log_combinations(of: int, taken: int) -> float:
    """Return the logarithm of C(of, taken), which may be too large for a float."""
    return math.lgamma(of + 1) - math.lgamma(taken + 1) - math.lgamma(of - taken + 1)


@lru_cache(maxsize=1024)
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


def starting_pairs(
    ranged: RangedLines, seed: SeedArray, wanted: int, most: int, *, at_random: bool
) -> tuple[IntArray, IntArray]:
    """Return ``wanted`` pairs of rows (B, wanted) to start from: those of the least predicted covariance.

    Or ``at_random``, as published: those whose rays cross well in front of both first. All pairs of a few rows are
    examined, of many rows a multiple of their number, at most ``most``.
    """
    first, second = _candidates(seed, ranged.lines.std_rad, most, shuffled=at_random)
    size, candidates = first.shape
    rank = np.empty((size, candidates))
    block = max(1, _STATES // max(candidates, 1))
    for start in range(0, size, block):
        rows = np.arange(start, min(start + block, size))
        pair = [np.asfortranarray(index[rows]) for index in (first, second)]
        rank[rows] = _rank(ranged.take(rows), pair[0], pair[1], at_random=at_random)
    order = np.argsort(rank, axis=1, kind="stable")[:, :wanted]
    first, second = (np.asfortranarray(np.take_along_axis(index, order, axis=1)) for index in (first, second))
    return first, second


def _rank(ranged: RangedLines, first: IntArray, second: IntArray, *, at_random: bool) -> FloatArray:
    """Return the variance (B, C) that each pair predicts, infinite where it has no crossing in front.

    Or, ``at_random``, 0 where the rays cross well in front of both, 1 where they cross there, else 2.
    """
    one, other = ranged.select(first), ranged.select(second)
    if at_random:
        well = np.abs(other.sine * one.cosine - other.cosine * one.sine) >= _WELL_CONDITIONED
        return np.where(bootstrap_state(one, other).alive, np.where(well, 0.0, 1.0), 2.0)
    state = pair_state(one, other, lognormal=ranged.lognormal)
    trace = state.covariance.trace
    return np.where(state.alive & np.isfinite(trace), trace, np.inf)


def _candidates(seed: SeedArray, std_rad: FloatArray, most: int, *, shuffled: bool) -> tuple[IntArray, IntArray]:
    """Return pairs (B, C) of different rows: all of a few rows, else a multiple of K; a random ``most`` if more.

    Each of many rows is paired with the next ones in the order of their standard deviations (equal ones at random),
    so that the most precise ones meet, and with others that are fixed shares of the list away.
    """
    size, count = std_rad.shape
    pairs = count * (count - 1) // 2
    if pairs <= _PAIRS_PER_ROW * count:
        first, second = (np.broadcast_to(index.astype(np.int64), (size, pairs)) for index in np.triu_indices(count, 1))
    else:
        by_std = np.lexsort((random_keys(seed, count, stream=2), std_rad), axis=1).astype(np.int64)
        steps = sorted({1, 2, 3, count // 4, count // 3, (count - 1) // 2})
        first = np.concatenate([by_std for _ in steps], axis=1)
        second = np.concatenate([np.roll(by_std, -step, axis=1) for step in steps], axis=1)
    if not shuffled and first.shape[1] <= most:
        return first, second
    order = random_order(seed, first.shape[1], stream=1)[:, :most]
    return np.take_along_axis(first, order, axis=1), np.take_along_axis(second, order, axis=1)
