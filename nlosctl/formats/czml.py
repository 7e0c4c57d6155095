"""Estimates as CZML for Cesium: one packet per estimate, with a point and an ellipse on the ground.

The CZML Guide defines an ellipse's ``rotation`` counter-clockwise from north. CesiumJS draws the semi-major axis
``rotation`` counter-clockwise from east (``EllipseGeometryLibrary``); the files are for the program that draws them.
"""

from __future__ import annotations

import json
import math
from typing import IO, Any

from nlosctl.contract.formats import ExporterSpec, Places
from nlosctl.formats.map_options import MapOptions, known_values, title
from nlosctl.formats.track_lines import TrackLine, TrackLines, iso_time

__all__ = ["FORMAT"]

_POINT = {"pixelSize": 6, "color": {"rgba": [255, 85, 0, 255]}, "heightReference": "CLAMP_TO_GROUND"}
_FILL = {"solidColor": {"color": {"rgba": [255, 85, 0, 60]}}}


class _Writer:
    def __init__(self, sink: IO[bytes], options: MapOptions) -> None:
        self._sink, self._number, self._tracks = sink, 0, TrackLines()
        sink.write(b'[\n{"id": "document", "name": "nlosctl estimates", "version": "1.0"}')

    def write(self, places: Places) -> None:
        for row in range(places.size):
            packet = json.dumps(_packet(places, row, self._number), ensure_ascii=False, allow_nan=False)
            self._sink.write(f",\n{packet}".encode())
            self._number += 1
        self._tracks.add(places)

    def close(self) -> None:
        for number, track in enumerate(self._tracks.lines()):
            packet = json.dumps(_path(track, number), ensure_ascii=False, allow_nan=False)
            self._sink.write(f",\n{packet}".encode())
        self._sink.write(b"\n]\n")


def _packet(places: Places, row: int, number: int) -> dict[str, Any]:
    values = known_values(places, row)
    packet: dict[str, Any] = {
        "id": f"estimate-{number}",
        "name": title(values),
        "properties": {name: _plain(value) for name, value in values.items()},
    }
    point = places.point(row)
    if point:
        packet["position"] = {"cartographicDegrees": [*point, 0.0][:3]}
        packet["point"] = _POINT if places.z is None else {**_POINT, "heightReference": "NONE"}
    if not math.isnan(places.outline[row, 0, 0]):
        packet["ellipse"] = {
            "semiMajorAxis": float(places.semi_major_m[row]),
            "semiMinorAxis": max(float(places.semi_minor_m[row]), 1e-9),
            "rotation": 0.5 * math.pi - float(places.major_azimuth_rad[row]),
            "material": _FILL,
        }
    return packet


def _path(track: TrackLine, number: int) -> dict[str, Any]:
    """Return a packet that moves along a track, in seconds since 1970, and draws its path."""
    first = track.points[0][0]
    samples = [value for time_s, point in track.points for value in (time_s - first, *[*point, 0.0][:3])]
    return {
        "id": f"track-{number}",
        "name": track.name,
        "availability": f"{iso_time(first)}/{iso_time(track.points[-1][0])}",
        "properties": {name: _plain(value) for name, value in track.values.items()},
        "position": {"epoch": iso_time(first), "cartographicDegrees": samples},
        "point": _POINT,
        "path": {"width": 2, "material": {"solidColor": {"color": {"rgba": [255, 85, 0, 255]}}}},
    }


def _plain(value: Any) -> Any:
    plain = isinstance(value, str | int) or (isinstance(value, float) and math.isfinite(value))
    return value if plain else str(value)


FORMAT = ExporterSpec(
    name="czml",
    summary="CZML for Cesium: points and ellipses on the ground",
    reference="CZML Guide of AnalyticalGraphicsInc/czml-writer: Packet, Ellipse; rotation as drawn by CesiumJS",
    options=MapOptions,
    start=_Writer,
)
"""The specification of the exporter."""
