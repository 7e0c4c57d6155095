"""Epochs of a periodic log: which rows belong together, judged by sensors that report again and by the gaps between."""

from __future__ import annotations

import math
from collections.abc import Hashable, Sequence
from itertools import pairwise
from statistics import median

__all__ = ["epoch_numbers"]

_CLEARLY_WIDER = 2.0
"""Gaps between epochs are distinguished from those within only if they are so many times as wide."""


def epoch_numbers(times_s: Sequence[float], sensors: Sequence[Hashable]) -> list[int]:
    """Return the epoch of each row, numbered from 0; the rows are in order of their times.

    An epoch ends when a sensor reports again at a later time, or at a gap wider than the gaps within epochs
    (`_widest_within`).
    """
    return _cut(times_s, sensors, _widest_within(times_s, sensors)) if times_s else []


def _widest_within(times_s: Sequence[float], sensors: Sequence[Hashable]) -> float:
    """Return a limit between the gaps within epochs and those between them; infinity where the two are alike.

    The period is the median time until a sensor reports again, and there are about as many wide gaps as periods. Of the
    sorted gaps the limit is in the widest step (as a ratio) that leaves half to twice as many above it.
    """
    latest: dict[Hashable, float] = {}
    again = []
    for time, sensor in zip(times_s, sensors, strict=True):
        if latest.get(sensor, time) < time:
            again.append(time - latest[sensor])
        latest[sensor] = time
    period = median(again) if again else 0.0
    if period <= 0.0:
        return math.inf
    gaps = sorted(later - earlier for earlier, later in pairwise(times_s))
    periods = (times_s[-1] - times_s[0]) / period
    first, last = max(1, len(gaps) - round(2.0 * periods)), len(gaps) - max(1, round(0.5 * periods))
    least = 1e-6 * period  # equal times are no smaller
    steps = [(gaps[k] / max(gaps[k - 1], least), k) for k in range(first, last + 1)]
    ratio, k = max(steps, default=(0.0, 0))
    return math.sqrt(max(gaps[k - 1], least) * gaps[k]) if ratio > _CLEARLY_WIDER else math.inf


def _cut(times_s: Sequence[float], sensors: Sequence[Hashable], widest_s: float) -> list[int]:
    """Return the epochs that end when a sensor reports again, or at a gap above ``widest_s``."""
    numbers: list[int] = []
    seen: dict[Hashable, float] = {}
    number, before = 0, times_s[0]
    for time, sensor in zip(times_s, sensors, strict=True):
        if seen.get(sensor, time) < time or time - before > widest_s:
            number += 1
            seen.clear()
        seen[sensor] = time
        numbers.append(number)
        before = time
    return numbers
