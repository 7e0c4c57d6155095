"""The paths of tracks among estimates, as lines with times: what exporters of maps add to the points."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from typing import Any

from nlosctl.contract.formats import Places
from nlosctl.contract.tables import has_states

__all__ = ["TrackLine", "TrackLines", "are_states", "iso_time"]

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_KEYS = ("source", "method", "target", "part")
"""Columns that separate tracks beside those of the run."""


@dataclass(frozen=True)
class TrackLine:
    """A track: its name, the values that make it, and its positions in order of time: seconds, then coordinates."""

    name: str
    values: dict[str, Any]
    points: Sequence[tuple[float, list[float]]]


@dataclass
class TrackLines:
    """Collects the states of tracks: estimates with a time and a velocity."""

    _points: dict[tuple[tuple[str, Any], ...], list[tuple[float, list[float]]]] = field(default_factory=dict)

    def add(self, places: Places) -> None:
        """Take the states among the estimates that have a position."""
        if not are_states(places):
            return
        names = [name for name in (*places.track, *_KEYS) if name in places.columns]
        for row in range(places.size):
            point, time_s = places.point(row), places.columns["time_s"][row]
            if point and time_s is not None:
                key = tuple((name, places.columns[name][row]) for name in names)
                self._points.setdefault(key, []).append((float(time_s), point))

    def lines(self) -> Iterator[TrackLine]:
        """Yield the tracks of two positions or more, in order of first appearance."""
        for key, points in self._points.items():
            if len(points) > 1:
                values = {name: value for name, value in key if value is not None}
                name = " ".join(f"{name}={value}" for name, value in values.items() if name != "target" or value)
                yield TrackLine(f"track {name}".strip(), values, sorted(points, key=lambda point: point[0]))


def are_states(places: Places) -> bool:
    """Return whether the estimates are states of tracks."""
    return has_states(places.columns)


def iso_time(time_s: float) -> str:
    """Return seconds since 1970 UTC as ISO 8601 with microseconds where there are any."""
    return (_EPOCH + timedelta(microseconds=round(time_s * 1e6))).isoformat().replace("+00:00", "Z")
