"""Candidate positions from bearings: where two rays cross, and where a ray with a range ends."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, Point, SeedArray, ignoring_overflow
from nlosctl.contract.random_streams import random_keys
from nlosctl.models.bearings import SightLines

__all__ = ["Candidates", "choose_pairs", "cross_rays", "end_rays", "gather"]


_LEAST_SINE = 1e-6
"""Rays that make a smaller angle than this do not cross."""


@dataclass(frozen=True)
class Candidates:
    """Points (B, P) about the local origin; ``valid`` where there is one."""

    point: Point
    valid: BoolArray

    @classmethod
    def join(cls, parts: list[Candidates]) -> Candidates:
        """Return all candidates of several sources."""
        if len(parts) == 1:
            return parts[0]
        point = tuple(
            np.concatenate([part.T for part in same]).T for same in zip(*(part.point for part in parts), strict=True)
        )
        return cls(point, np.concatenate([part.valid.T for part in parts]).T)


def choose_pairs(seed: SeedArray, count: int, most: int) -> tuple[IntArray, IntArray]:
    """Return the pairs of ``count`` rows to try: all (P,), or, where there are more than ``most``, (B, most).

    Those are random, with replacement, from each snapshot's own seed.
    """
    if count * (count - 1) // 2 <= most:
        first, second = np.triu_indices(count, 1)
        return first.astype(np.int64), second.astype(np.int64)
    words = random_keys(seed, 2 * most)
    one = (words[:, :most] % np.uint64(count)).astype(np.int64)
    other = (words[:, most:] % np.uint64(count - 1)).astype(np.int64)
    other += other >= one
    return np.minimum(one, other), np.maximum(one, other)


def cross_rays(lines: SightLines, first: IntArray, second: IntArray) -> Candidates:
    """Return where the rays of pairs of rows cross; not valid where they are parallel or cross behind an origin.

    ``first`` and ``second`` are (P,), the same pairs for all snapshots, or (B, P).
    """
    x1, y1, c1, s1 = (gather(part, first) for part in (lines.origin_x, lines.origin_y, lines.cosine, lines.sine))
    x2, y2, c2, s2 = (gather(part, second) for part in (lines.origin_x, lines.origin_y, lines.cosine, lines.sine))
    sine = c1 * s2 - s1 * c2
    x2 -= x1
    y2 -= y1
    with ignoring_overflow():
        along1 = (x2 * s2 - y2 * c2) / sine  # equation (15)
        along2 = (x2 * s1 - y2 * c1) / sine
        valid = (np.abs(sine) > _LEAST_SINE) & (along1 > 0.0) & (along2 > 0.0)
        return Candidates((x1 + along1 * c1, y1 + along1 * s1), valid)


def end_rays(lines: SightLines, range_m: FloatArray) -> Candidates:
    """Return the point (B, K) of each ray at its measured range; not valid in rows without one (NaN)."""
    point = lines.origin_x + range_m * lines.cosine, lines.origin_y + range_m * lines.sine
    return Candidates(point, np.isfinite(range_m))


def gather(array: FloatArray, index: IntArray) -> FloatArray:
    """Return the values (B, P) at some rows of (B, K)."""
    if index.ndim == 1:
        return np.take(array.T, index, axis=0).T
    return np.take_along_axis(array, index, axis=1)
