"""Estimates as CZML for Cesium: a packet for each, with a point and an ellipse on the ground."""

from __future__ import annotations

import json
import math
from typing import IO, Any

from nlosctl.contract.formats import ExporterSpec, Places
from nlosctl.formats.map_options import MapOptions

__all__ = ["FORMAT"]

_POINT = {"pixelSize": 6, "color": {"rgba": [255, 85, 0, 255]}, "heightReference": "CLAMP_TO_GROUND"}
_FILL = {"solidColor": {"color": {"rgba": [255, 85, 0, 60]}}}


class _Writer:
    def __init__(self, sink: IO[bytes], options: MapOptions) -> None:
        self._sink, self._number = sink, 0
        sink.write(b'[\n{"id": "document", "name": "nlosctl estimates", "version": "1.0"}')

    def write(self, places: Places) -> None:
        for place in range(places.size):
            packet = json.dumps(_packet(places, place, self._number), ensure_ascii=False, allow_nan=False)
            self._sink.write(f",\n{packet}".encode())
            self._number += 1

    def close(self) -> None:
        self._sink.write(b"\n]\n")


def _packet(piece: Places, place: int, number: int) -> dict[str, Any]:
    said = {name: values[place] for name, values in piece.columns.items() if values[place] is not None}
    packet: dict[str, Any] = {
        "id": f"estimate-{number}",
        "name": " ".join(str(said[key]) for key in ("snapshot", "method") if key in said),
        "properties": {name: value if isinstance(value, str | bool) else _plain(value) for name, value in said.items()},
    }
    if not math.isnan(piece.x[place]):
        packet["position"] = {"cartographicDegrees": [float(piece.x[place]), float(piece.y[place]), 0.0]}
        packet["point"] = _POINT
    if not math.isnan(piece.outline[place, 0, 0]):
        packet["ellipse"] = {
            "semiMajorAxis": float(piece.semi_major_m[place]),
            "semiMinorAxis": max(float(piece.semi_minor_m[place]), 1e-9),
            "rotation": -float(piece.major_azimuth_rad[place]),  # counter-clockwise from north
            "material": _FILL,
        }
    return packet


def _plain(value: Any) -> Any:
    finite = isinstance(value, int) or (isinstance(value, float) and math.isfinite(value))
    return value if finite else str(value)


FORMAT = ExporterSpec(
    name="czml",
    summary="CZML for Cesium: points and ellipses on the ground",
    reference="CZML Guide of AnalyticalGraphicsInc/czml-writer: Packet, Ellipse",
    options=MapOptions,
    start=_Writer,
)
"""The specification of the exporter."""
