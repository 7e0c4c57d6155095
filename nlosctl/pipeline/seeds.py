"""A seed for every snapshot, from the run's seed and the snapshot's id alone."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

__all__ = ["snapshot_seeds"]

SeedArray = npt.NDArray[np.uint64]


def snapshot_seeds(seed: int, ids: npt.NDArray[np.int64] | Sequence[str]) -> SeedArray:
    """Return a seed (S,) for each snapshot id, integers or text; equal for equal seed and id, else unrelated."""
    keys = _mix(ids.astype(np.uint64)) if isinstance(ids, np.ndarray) else _digest(ids)
    return _mix(keys ^ _mix(np.array([seed], dtype=np.int64).astype(np.uint64)))


def _digest(ids: Sequence[str]) -> SeedArray:
    digests = b"".join(hashlib.blake2b(text.encode(), digest_size=8).digest() for text in ids)
    return np.frombuffer(digests, dtype="<u8").astype(np.uint64)


def _mix(key: SeedArray) -> SeedArray:
    """Finalizer of SplitMix64 (Steele, Lea, Flood 2014)."""
    key = key + np.uint64(0x9E3779B97F4A7C15)
    key = (key ^ (key >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    key = (key ^ (key >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return key ^ (key >> np.uint64(31))
