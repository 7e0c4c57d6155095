"""Exact sums of numbers from anywhere in a file: their bits depend neither on the order nor on how the file is cut."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, field

import numpy as np

from nlosctl.arrays import FloatArray

__all__ = ["ExactSums"]

_DIGITS = 53
_HALF = 26
_UNIT = 1074 + _DIGITS
"""Sums are integers in units of 2 to the minus this: every finite float is a multiple of it."""


@dataclass
class ExactSums:
    """Sums of n numbers for each key, as integers, so that adding is exact."""

    totals: dict[Hashable, list[int]] = field(default_factory=dict)

    def add(self, key: Hashable, values: FloatArray) -> None:
        """Add finite values (N, n), N below 2**36, to the sums of a key."""
        self._increase(key, [_exact_sum(values[:, column]) for column in range(values.shape[1])])

    def merge(self, other: ExactSums) -> None:
        """Add the sums of another part of the file."""
        for key, totals in other.totals.items():
            self._increase(key, totals)

    def sums(self, key: Hashable) -> list[float]:
        """Return the sums (n,) of a key, each rounded once; empty if nothing was added."""
        return [total / (1 << _UNIT) for total in self.totals.get(key, [])]

    def _increase(self, key: Hashable, amounts: list[int]) -> None:
        known = self.totals.get(key, [0] * len(amounts))
        self.totals[key] = [total + amount for total, amount in zip(known, amounts, strict=True)]


def _exact_sum(values: FloatArray) -> int:
    """Return the sum of finite values (N,): mantissas of equal exponents are added as two halves, in 64 bits."""
    mantissa, exponent = np.frexp(values)
    digits = (mantissa * float(1 << _DIGITS)).astype(np.int64)
    total = 0
    for power in np.unique(exponent):
        same = digits[exponent == power]
        high, low = int((same >> _HALF).sum()), int((same & ((1 << _HALF) - 1)).sum())
        total += ((high << _HALF) + low) << (int(power) - _DIGITS + _UNIT)
    return total
