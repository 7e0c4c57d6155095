"""Exact sums of numbers from anywhere in a file: their bits depend neither on the order nor on how the file is cut."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from nlosctl.arrays import FloatArray, IntArray

__all__ = ["ExactSums"]

_DIGITS = 53
_UNIT = 1074 + _DIGITS
"""Sums are integers in units of 2 to the minus this: every finite float is a multiple of it."""

_LARGE = 500
"""Numbers above 2 to this are scaled down by it."""


@dataclass
class ExactSums:
    """Sums of n numbers for each key, as integers, so that adding is exact."""

    totals: dict[Hashable, list[int]] = field(default_factory=dict)

    def add(self, key: Hashable, values: FloatArray) -> None:
        """Add finite values (N, n), N below 2**36, to the sums of a key."""
        self.add_groups([key], np.zeros(values.shape[0], dtype=np.int64), values)

    def add_groups(self, keys: Sequence[Hashable], group: IntArray, values: FloatArray) -> None:
        """Add finite values (N, n), N below 2**36, to the sums of the keys that ``group`` (N,) indexes.

        A key without values gets sums of 0.
        """
        columns = [_group_sums(np.ascontiguousarray(column), group, len(keys)) for column in values.T]
        for number, key in enumerate(keys):
            self._increase(key, [column[number] for column in columns])

    def merge(self, other: ExactSums) -> None:
        """Add the sums of another part of the file."""
        for key, totals in other.totals.items():
            self._increase(key, totals)

    def sums(self, key: Hashable) -> list[float]:
        """Return the sums (n,) of a key, each rounded once; empty if nothing was added."""
        return [total / (1 << _UNIT) for total in self.totals.get(key, [])]

    def plain(self) -> dict[Hashable, list[tuple[int, int]]]:
        """Return the sums by key as pairs of a number without trailing zero bits and its power of 2, for `of_plain`."""
        return {key: [_without_zeros(total) for total in totals] for key, totals in self.totals.items()}

    @classmethod
    def of_plain(cls, pairs: Mapping[Any, Sequence[Sequence[int]]]) -> ExactSums:
        """Return the sums that `plain` returned."""
        return cls({key: [number << power for number, power in sums] for key, sums in pairs.items()})

    def _increase(self, key: Hashable, amounts: Sequence[int]) -> None:
        known = self.totals.get(key, [0] * len(amounts))
        self.totals[key] = [total + amount for total, amount in zip(known, amounts, strict=True)]


def _without_zeros(total: int) -> tuple[int, int]:
    power = max((total & -total).bit_length() - 1, 0)
    return total >> power, power


def _group_sums(values: FloatArray, group: IntArray, count: int) -> list[int]:
    """Return the sums (count,) of finite values (N,) by group; large ones are scaled down, as sums may overflow."""
    large = np.abs(values) > 2.0**_LARGE
    if not large.any():
        return _split_sums(values, group, count)
    small = _split_sums(np.where(large, 0.0, values), group, count)
    scaled = _split_sums(np.where(large, values * 2.0**-_LARGE, 0.0), group, count)
    return [total + (more << _LARGE) for total, more in zip(small, scaled, strict=True)]


def _split_sums(values: FloatArray, group: IntArray, count: int) -> list[int]:
    """Return the sums (count,) of values (N,) by group.

    Leading bits of all values, as many as their floating-point sum keeps, are split off and added until nothing is left
    (Rump, Ogita, Oishi 2008, Accurate floating-point summation, ExtractVector).
    """
    sums, rest = [0] * count, values
    room = int(values.size).bit_length() + 1
    while rest.any():
        above = 2.0 ** (int(np.frexp(np.abs(rest).max())[1]) + room)
        leading = (rest + above) - above
        rest = rest - leading
        mantissa, exponent = np.frexp(np.bincount(group, weights=leading, minlength=count))
        for number in np.flatnonzero(mantissa):
            sums[number] += int(mantissa[number] * (1 << _DIGITS)) << (int(exponent[number]) - _DIGITS + _UNIT)
    return sums
