"""Times of the rows: the first, the last, the largest gap, and stamps that repeat or go back."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import FloatArray
from nlosctl.pipeline.describe.suspicions import Suspicion

__all__ = ["RowTimes"]

_MOST_SORTED = 1_000_000


@dataclass
class RowTimes:
    """Times in seconds of the column ``time_s`` (numbers) or ``time`` (ISO 8601), whichever a file has.

    The largest gap is between sorted times for up to a million rows, else between successive rows.
    """

    name: str = ""
    first_s: float = np.inf
    last_s: float = -np.inf
    repeated: int = 0
    leaps_back: int = 0
    _largest_step_s: float = 0.0
    _previous_s: float = np.nan
    _kept: list[FloatArray] = field(default_factory=list)
    _count: int = 0
    _of_sensor: dict[str, float] = field(default_factory=dict)

    def add(self, columns: Mapping[str, npt.NDArray[Any]], sensors: Sequence[str]) -> None:
        """Take the rows of a chunk, and the name of each row's sensor."""
        self.name = next((name for name in ("time", "time_s") if name in columns), "")
        if not self.name:
            return
        values = columns[self.name]
        times = values if values.dtype.kind == "f" else np.array([_seconds(text) for text in values])
        self._count_repeats(times, sensors)
        times = times[np.isfinite(times)]
        if not times.size:
            return
        self.first_s, self.last_s = min(self.first_s, float(times.min())), max(self.last_s, float(times.max()))
        steps = np.diff(times, prepend=times[0] if np.isnan(self._previous_s) else self._previous_s)
        self.leaps_back += int(np.count_nonzero(steps < 0.0))
        self._largest_step_s = max(self._largest_step_s, float(steps.max()))
        self._previous_s = float(times[-1])
        self._count += times.size
        self._kept = [*self._kept, times] if self._count <= _MOST_SORTED else []

    def _count_repeats(self, times: FloatArray, sensors: Sequence[str]) -> None:
        for time, sensor in zip(times.tolist(), sensors, strict=True):
            self.repeated += self._of_sensor.get(sensor) == time
            self._of_sensor[sensor] = time

    def as_dict(self) -> dict[str, Any] | None:
        """Return first and last time (ISO 8601 in UTC, or seconds) and the largest gap; None without times."""
        if not self._count:
            return None
        gap = self._largest_step_s
        if self._kept:
            gap = float(np.diff(np.sort(np.concatenate(self._kept)), prepend=self.first_s).max())
        first, last = ((_iso(time) if self.name == "time" else time) for time in (self.first_s, self.last_s))
        return {"first": first, "last": last, "largest_gap_s": gap}

    def suspicions(self) -> Iterator[Suspicion]:
        """Yield repeated stamps of a sensor, and stamps that go back."""
        if self.repeated:
            text = f"{self.repeated} rows have the time of the row before of their sensor: are they measured twice?"
            yield Suspicion(what="duplicated_stamps", column=self.name, rows=self.repeated, text=text)
        if self.leaps_back:
            text = f"the times go back at {self.leaps_back} rows: the file is not sorted, or a clock was set"
            yield Suspicion(what="times_go_back", column=self.name, rows=self.leaps_back, text=text)


def _seconds(text: str) -> float:
    """Return ISO 8601 as seconds since 1970 (without a zone: UTC), NaN for other text."""
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        return np.nan
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()


def _iso(seconds: float) -> str:
    return datetime.fromtimestamp(seconds, UTC).isoformat().replace("+00:00", "Z")
