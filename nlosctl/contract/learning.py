"""How a method estimates some of its options from the whole input before it solves."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from nlosctl.arrays import FloatArray

__all__ = ["ESTIMATE", "Learning"]

ESTIMATE = "estimate"
"""The value of an option that is to be estimated from the input."""


def _nothing(options: Any, names: Sequence[str]) -> str:
    return ""


@dataclass(frozen=True, kw_only=True)
class Learning:
    """Options that a method estimates from the whole input, by passes over it until their values settle.

    ``options`` are their names; they begin with their defaults. ``statistics(batch, options)`` returns numbers (B, n)
    of each snapshot, finite, and zero where it has none. ``update(sums, options)`` returns the next value of each
    option by the sums (n,) over all snapshots: a positive number, or None if the input has too little information.
    ``refusal(options, names)`` is why the options ``names`` can't be estimated with the others as they are, empty if
    they can.
    """

    options: tuple[str, ...]
    statistics: Callable[[Any, Any], FloatArray]
    update: Callable[[Sequence[float], Any], Mapping[str, float | None]]
    refusal: Callable[[Any, Sequence[str]], str] = _nothing
