"""Sensors of the scene that are valid for a time: which entry holds at the time of a row."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

import numpy as np

from nlosctl.arrays import IntArray
from nlosctl.contract.scene import Scene
from nlosctl.contract.window_starts import microseconds

__all__ = ["SensorTimes"]

_FURTHEST = 2**62
"""No time of a row is further from 0, in ticks."""

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


class SensorTimes:
    """The entries of a scene's sensors in time; sensors are numbered in the order of ``scene.sensor_names``."""

    def __init__(self, scene: Scene) -> None:
        self._names = scene.sensor_names
        numbers = {name: number for number, name in enumerate(self._names)}
        number = np.array([numbers[sensor.name] for sensor in scene.sensors], dtype=np.int64)
        start = np.array([_ticks(sensor.start, -_FURTHEST) for sensor in scene.sensors], dtype=np.int64)
        end = np.array([_ticks(sensor.end, _FURTHEST + 1) for sensor in scene.sensors], dtype=np.int64)
        self._order = np.lexsort((start, number))
        self._number, self._start, self._end = number[self._order], start[self._order], end[self._order]
        self._starts = np.unique(start)
        self._keys = self._key(self._number, self._start)

    def _key(self, numbers: IntArray, ticks: IntArray) -> IntArray:
        """Return integers (N,) in the order of the sensors' numbers, then of the times among all starts."""
        keys: IntArray = numbers * (self._starts.shape[0] + 1) + np.searchsorted(self._starts, ticks, side="right")
        return keys

    def entries(self, numbers: IntArray, ticks: IntArray) -> IntArray:
        """Return the entry (N,) in the scene of each sensor at its time (N,), -1 without one."""
        latest = np.searchsorted(self._keys, self._key(numbers, ticks), side="right") - 1
        holds = (latest >= 0) & (self._number[latest] == numbers) & (ticks < self._end[latest])
        return np.where(holds, self._order[latest], -1)

    def valid(self, ticks: IntArray) -> set[str]:
        """Return the names of the sensors with an entry that holds at one of these times (N,)."""
        times = np.sort(ticks)
        holds = np.searchsorted(times, self._start) < np.searchsorted(times, self._end)
        return {self._names[number] for number in self._number[holds].tolist()}


def _ticks(limit: datetime | float | None, without: int) -> int:
    """Return a limit in the ticks of its column of times, ``without`` for none."""
    if limit is None:
        return without
    if isinstance(limit, datetime):
        ticks = (limit - _EPOCH) // timedelta(microseconds=1) * 1000
    else:
        ticks = int(microseconds(np.clip(np.array([limit]), -_FURTHEST / 1e6, _FURTHEST / 1e6))[0])
    return min(max(ticks, -_FURTHEST), _FURTHEST)
