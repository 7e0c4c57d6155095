"""The window of each row, in whole ticks of time: a grid for each part of the rows, or epochs."""

from __future__ import annotations

from typing import Any

import numpy as np

from nlosctl.arrays import FloatArray, IntArray
from nlosctl.contract.epochs import epoch_numbers
from nlosctl.contract.windows import ALL, AUTO, Width

__all__ = ["first_times", "microseconds", "width_in_ticks", "window_starts"]

_LARGEST = np.iinfo(np.int64).max


def microseconds(seconds: FloatArray) -> IntArray:
    """Return finite times (N,) in whole microseconds: the whole seconds, and the rest rounded."""
    whole = np.floor(seconds)
    ticks: IntArray = whole.astype(np.int64) * 10**6 + np.rint((seconds - whole) * 1e6).astype(np.int64)
    return ticks


def first_times(times: IntArray, parts: IntArray) -> IntArray:
    """Return the least time of each part (P,); ``parts`` (N,) numbers the rows' parts from 0 without gaps."""
    first = np.full(int(parts.max(initial=-1)) + 1, _LARGEST, dtype=np.int64)
    np.minimum.at(first, parts, times)
    return first


def window_starts(times: IntArray, parts: IntArray, first: IntArray, sensors: IntArray, width: Any) -> IntArray:
    """Return the start (N,) of each row's window in ticks.

    ``width`` is in ticks, or `ALL` or `AUTO`. A grid starts at the part's ``first`` time (P,): row t is in window k =
    (t - first) // width. An epoch starts at its first row; ``sensors`` (N,) are numbers of the sensors.
    """
    begin = first[parts]
    if width == ALL:
        return begin
    if width != AUTO:
        return np.asarray(begin + (times - begin) // width * width)
    order = np.lexsort((sensors, times, parts))
    starts = np.empty_like(times)
    edges = np.searchsorted(parts[order], np.arange(first.shape[0] + 1))
    for begins, ends in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        rows = order[begins:ends]
        numbers = np.array(epoch_numbers(times[rows].tolist(), sensors[rows].tolist()), dtype=np.int64)
        heads = np.flatnonzero(np.diff(numbers, prepend=-1))
        starts[rows] = times[rows][heads][numbers]
    return starts


def width_in_ticks(width: Width, ticks_per_second: int) -> Any:
    """Return a width in ticks; `ALL` and `AUTO` as they are."""
    return width * (ticks_per_second // 10**6) if isinstance(width, int) else width
