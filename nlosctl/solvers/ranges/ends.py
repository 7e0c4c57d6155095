"""Where descents of the likelihood of ranges end, and the two best ends."""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ignoring_invalid
from nlosctl.geometry.blocks import RowBlock
from nlosctl.geometry.symmetric import SymmetricMatrix

__all__ = ["End", "TwoBest", "are_apart"]

_DISTINCT_STANDARD_DEVIATIONS = 1e-3
"""Optima nearer to each other than this are the same."""


@dataclass(frozen=True)
class End(RowBlock):
    """Where one descent of each snapshot ended (B,), about the local origin; NaN and not converged where none did."""

    point: tuple[FloatArray, ...]
    cost: FloatArray
    converged: BoolArray

    @classmethod
    def missing(cls, snapshots: int, dimension: int = 2) -> End:
        """Return the ends where no descent has been."""
        cost, *point = np.full((dimension + 1, snapshots), np.nan)
        return cls(tuple(point), cost, np.zeros(snapshots, dtype=bool))

    @property
    def x(self) -> FloatArray:
        """The first coordinate."""
        return self.point[0]

    @property
    def y(self) -> FloatArray:
        """The second coordinate."""
        return self.point[1]

    def put(self, rows: IntArray, other: End) -> None:
        """Replace the ends of some snapshots."""
        for mine, theirs in zip(self.point, other.point, strict=True):
            mine[rows] = theirs
        self.cost[rows], self.converged[rows] = other.cost, other.converged

    def improves(self, known: End) -> BoolArray:
        """Return where this end is better: converged while the other is not, or cheaper."""
        with ignoring_invalid():
            cheaper: BoolArray = (self.converged == known.converged) & (self.cost < known.cost)
        return cheaper | (self.converged & ~known.converged)


def are_apart(one: tuple[FloatArray, ...], other: tuple[FloatArray, ...], covariance: SymmetricMatrix) -> BoolArray:
    """Return which points (B,), given as D arrays, are two, by the covariance of one."""
    with ignoring_invalid():
        away = reduce(np.hypot, [mine - theirs for mine, theirs in zip(one, other, strict=True)])
        apart: BoolArray = away > _DISTINCT_STANDARD_DEVIATIONS * np.sqrt(covariance.trace)
    return apart


class TwoBest:
    """The cheapest optimum of each snapshot so far, and the cheapest apart from it."""

    def __init__(self, first: End) -> None:
        self.best = first
        self.other = End.missing(first.cost.size, len(first.point))

    def note(self, rows: IntArray, end: End, information: SymmetricMatrix) -> None:
        """Take the ends of further descents of some snapshots into account, whose information is that at the end."""
        best, other = self.best.take(rows), self.other.take(rows)
        apart = are_apart(end.point, best.point, information.inverse())
        better = end.improves(best)
        runner_up = np.flatnonzero(better & apart & best.converged)
        self.other.put(rows[runner_up], best.take(runner_up))
        second = np.flatnonzero(end.improves(other) & ~better & apart & end.converged)
        self.other.put(rows[second], end.take(second))
        first = np.flatnonzero(better)
        self.best.put(rows[first], end.take(first))
