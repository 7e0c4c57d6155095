"""Sensors that jump: a position for a single row, and the position before it again."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from nlosctl.arrays import FloatArray
from nlosctl.pipeline.describe.suspicions import Suspicion

__all__ = ["SensorJumps"]


@dataclass
class SensorJumps:
    """Counts for each sensor the rows at another position than the row before and the row after, which agree."""

    jumps: dict[str, int] = field(default_factory=dict)
    _last: dict[str, tuple[tuple[float, float], tuple[float, float]]] = field(default_factory=dict)

    def add(self, x_m: FloatArray, y_m: FloatArray, sensors: Sequence[str]) -> None:
        """Take the positions (N,) of a chunk's rows and the name of each row's sensor."""
        for x, y, sensor in zip(x_m.tolist(), y_m.tolist(), sensors, strict=True):
            place = (x, y)
            before, last = self._last.get(sensor, (place, place))
            if place == before != last:
                self.jumps[sensor] = self.jumps.get(sensor, 0) + 1
            self._last[sensor] = (last, place)

    def suspicions(self) -> Iterator[Suspicion]:
        """Yield the sensors that jump."""
        for sensor, count in self.jumps.items():
            text = f"sensor {sensor!r} is elsewhere for {count} single rows and then back: are its positions right?"
            yield Suspicion(what="sensor_jumps", column="sensor_x_m", rows=count, text=text)
