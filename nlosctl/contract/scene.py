"""The scene: sensors and reflectors that stay where they are."""

from __future__ import annotations

from dataclasses import dataclass, field

__all__ = ["LineReflector", "Reflector", "Scene", "SegmentReflector", "Sensor"]


@dataclass(frozen=True, kw_only=True)
class Sensor:
    """A sensor at ``position`` (x, y in metres); ``heading_deg`` is its boresight, clockwise from +y."""

    name: str
    position: tuple[float, float]
    heading_deg: float | None = None


@dataclass(frozen=True, kw_only=True)
class LineReflector:
    """An infinite mirror through ``point`` (metres) along ``direction`` (any length, not zero)."""

    name: str
    point: tuple[float, float]
    direction: tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class SegmentReflector:
    """A finite wall from ``start`` to ``end`` (metres, not equal): mirrors within it, blocks what would pass it."""

    name: str
    start: tuple[float, float]
    end: tuple[float, float]

    @property
    def point(self) -> tuple[float, float]:
        """A point of its line."""
        return self.start

    @property
    def direction(self) -> tuple[float, float]:
        """The direction of its line."""
        return self.end[0] - self.start[0], self.end[1] - self.start[1]


Reflector = LineReflector | SegmentReflector
"""Any kind of reflector."""


@dataclass(frozen=True, kw_only=True)
class Scene:
    """Sensors and reflectors, each by a name of its own. An empty scene has neither."""

    sensors: tuple[Sensor, ...] = ()
    reflectors: tuple[Reflector, ...] = field(default=())

    @property
    def reflector_names(self) -> tuple[str, ...]:
        """The names of the reflectors; a batch refers to them by their place in it."""
        return tuple(reflector.name for reflector in self.reflectors)
