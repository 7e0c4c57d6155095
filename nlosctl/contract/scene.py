"""The scene: sensors and reflectors that stay where they are."""

from __future__ import annotations

from dataclasses import dataclass, field

__all__ = ["CircleReflector", "LineReflector", "Reflector", "Scene", "SegmentReflector", "Sensor"]


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


@dataclass(frozen=True, kw_only=True)
class CircleReflector:
    """The inner side of a circle about ``center`` (metres) mirrors; sensors and sources are inside it.

    ``blocker_radius`` is an opaque concentric circle (as the earth in the ionosphere), which no wave crosses.
    ``min_elevation_deg`` is the least elevation above the sensor's horizontal at which a path is received (to avoid
    ground clutter); without it the blocker's horizon is the limit.
    """

    name: str
    center: tuple[float, float]
    radius: float
    blocker_radius: float | None = None
    min_elevation_deg: float | None = None


Reflector = LineReflector | SegmentReflector | CircleReflector
"""Any kind of reflector."""


@dataclass(frozen=True, kw_only=True)
class Scene:
    """Sensors and reflectors, each by a name of its own. An empty scene has neither."""

    sensors: tuple[Sensor, ...] = ()
    reflectors: tuple[Reflector, ...] = field(default=())

    @property
    def has_circles(self) -> bool:
        """Whether any reflector is a circle."""
        return any(isinstance(reflector, CircleReflector) for reflector in self.reflectors)

    @property
    def reflector_names(self) -> tuple[str, ...]:
        """The names of the reflectors; a batch refers to them by their place in it."""
        return tuple(reflector.name for reflector in self.reflectors)
