"""Random numbers from each snapshot's own seed, which do not depend on the rest of the block."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from itertools import combinations
from math import comb

import numpy as np

from nlosctl.arrays import IntArray, SeedArray

__all__ = ["GOLDEN_RATIO", "choose_subsets", "random_keys", "random_order", "snapshot_seeds"]


GOLDEN_RATIO = np.uint64(0x9E3779B97F4A7C15)
"""The fraction of the golden ratio in units of 2^-64: its multiples are spread evenly."""


def random_keys(seed: SeedArray, count: int, stream: int = 0) -> SeedArray:
    """Return ``count`` independent 64-bit words (B, count) for each seed (B,); ``stream`` numbers independent uses.

    SplitMix64 (Steele, Lea, Flood 2014), as a counter-based generator.
    """
    start = _mix(seed + np.array([2 * stream + 1], dtype=np.uint64) * GOLDEN_RATIO)
    steps = np.arange(1, count + 1, dtype=np.uint64) * GOLDEN_RATIO
    return _mix(start[:, None] + steps)


def random_order(seed: SeedArray, count: int, stream: int = 0) -> IntArray:
    """Return a random permutation (B, count) of 0 .. count-1 for each seed (B,)."""
    return np.argsort(random_keys(seed, count, stream), axis=1, kind="stable").astype(np.int64)


def choose_subsets(seed: SeedArray, count: int, size: int, most: int) -> IntArray:
    """Return sets of ``size`` of ``count`` rows: all (S, size), or, if those are more than ``most``, (B, most, size).

    The latter are random, with replacement, from each seed (B,).
    """
    if comb(count, size) <= most:
        return np.array(list(combinations(range(count), size)), dtype=np.int64).reshape(-1, size)
    words = random_keys(seed, size * most).reshape(seed.shape[0], size, most)
    chosen = np.empty((seed.shape[0], most, size), dtype=np.int64)
    for n in range(size):
        index = (words[:, n] % np.uint64(count - n)).astype(np.int64)
        for taken in np.moveaxis(np.sort(chosen[..., :n], axis=-1), -1, 0):
            index += index >= taken
        chosen[..., n] = index
    return np.sort(chosen, axis=-1)


def snapshot_seeds(seed: int, ids: IntArray | Sequence[str]) -> SeedArray:
    """Return a seed (S,) for each snapshot id, integers or text; equal for equal seed and id, else unrelated."""
    keys = _scrambled(ids.astype(np.uint64)) if isinstance(ids, np.ndarray) else _digest(ids)
    return _scrambled(keys ^ _scrambled(np.array([seed], dtype=np.int64).astype(np.uint64)))


def _digest(ids: Sequence[str]) -> SeedArray:
    digests = b"".join(hashlib.blake2b(text.encode(), digest_size=8).digest() for text in ids)
    return np.frombuffer(digests, dtype="<u8").astype(np.uint64)


def _scrambled(key: SeedArray) -> SeedArray:
    """Return one step of SplitMix64 from each state (Steele, Lea, Flood 2014)."""
    return _mix(key + GOLDEN_RATIO)


def _mix(key: SeedArray) -> SeedArray:
    key = (key ^ (key >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    key = (key ^ (key >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return key ^ (key >> np.uint64(31))
