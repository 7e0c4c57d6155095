"""Estimates as GPX for navigation programs and receivers: states of tracks as tracks with times, others as waypoints.

GPX has no ellipses: a waypoint's description has the columns of its estimate, the covariance among them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import IO

from nlosctl.contract.formats import ExporterSpec, Places
from nlosctl.formats.map_options import known_values, title, xml_text
from nlosctl.formats.track_lines import TrackLine, TrackLines, are_states, iso_time

__all__ = ["FORMAT"]

_HEAD = """<?xml version="1.0" encoding="UTF-8"?>
<gpx version="1.1" creator="nlosctl" xmlns="http://www.topografix.com/GPX/1/1">
"""


@dataclass(frozen=True)
class GpxOptions:
    """GPX has no parameters."""


class _Writer:
    def __init__(self, sink: IO[bytes], options: GpxOptions) -> None:
        self._sink, self._tracks = sink, TrackLines()
        sink.write(_HEAD.encode("utf-8"))

    def write(self, places: Places) -> None:
        self._tracks.add(places)
        if not are_states(places):
            for row in range(places.size):
                self._sink.write(_waypoint(places, row).encode("utf-8"))

    def close(self) -> None:
        for track in self._tracks.lines():
            self._sink.write(_track(track).encode("utf-8"))
        self._sink.write(b"</gpx>\n")


def _waypoint(places: Places, row: int) -> str:
    """Return an estimate as a waypoint; nothing without a position, which GPX can't state."""
    point, values = places.point(row), known_values(places, row)
    if not point:
        return ""
    described = "\n".join(f"{key}: {value}" for key, value in values.items())
    name = f"<name>{xml_text(title(values))}</name><desc>{xml_text(described)}</desc>"
    return f"<wpt {_location(point)}>{_height(point)}{name}</wpt>\n"


def _track(track: TrackLine) -> str:
    points = "".join(
        f"<trkpt {_location(point)}>{_height(point)}<time>{iso_time(time_s)}</time></trkpt>\n"
        for time_s, point in track.points
    )
    return f"<trk><name>{xml_text(track.name)}</name><trkseg>\n{points}</trkseg></trk>\n"


def _location(point: Sequence[float]) -> str:
    """Return the attributes of a point; GPX has longitudes below 180 degrees."""
    longitude = point[0] if point[0] < 180.0 else point[0] - 360.0
    return f'lat="{point[1]!r}" lon="{longitude!r}"'


def _height(point: Sequence[float]) -> str:
    return f"<ele>{point[2]!r}</ele>" if len(point) > 2 else ""


FORMAT = ExporterSpec(
    name="gpx",
    summary="GPX: tracks with times of the states of tracks, waypoints of other estimates",
    reference="GPX 1.1 Schema Documentation, topografix.com",
    options=GpxOptions,
    start=_Writer,
)
"""The specification of the exporter."""
