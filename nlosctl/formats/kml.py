"""Estimates as KML for Google Earth and similar tools: a placemark with ellipse and the columns as description.

Viewers read a description as HTML: text is escaped once for HTML, and the HTML once for XML.
"""

from __future__ import annotations

import math
import re
from typing import IO, Any
from xml.sax.saxutils import escape

from nlosctl.contract.formats import ExporterSpec, Places
from nlosctl.formats.map_options import MapOptions, known_values, title

__all__ = ["FORMAT"]

_HEAD = """<?xml version="1.0" encoding="UTF-8"?>
<kml xmlns="http://www.opengis.net/kml/2.2">
<Document>
<name>nlosctl estimates</name>
<Style id="ellipse"><LineStyle><color>ff0055ff</color><width>2</width></LineStyle><PolyStyle><color>330055ff</color>\
</PolyStyle></Style>
"""
_NOT_XML = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


_EXACT = 2**53


class _Writer:
    def __init__(self, sink: IO[bytes], options: MapOptions) -> None:
        self._sink = sink
        sink.write(_HEAD.encode("utf-8"))

    def write(self, places: Places) -> None:
        for row in range(places.size):
            self._sink.write(_placemark(places, row).encode("utf-8"))

    def close(self) -> None:
        self._sink.write(b"</Document>\n</kml>\n")


def _placemark(places: Places, row: int) -> str:
    values = known_values(places, row)
    name = title(values)
    description = "<br>".join(escape(f"{key}: {_shown(value)}") for key, value in values.items())
    geometries = []
    x, y = float(places.x[row]), float(places.y[row])
    if not math.isnan(x):
        geometries.append(f"<Point><coordinates>{x!r},{y!r}</coordinates></Point>")
    outline = places.outline[row]
    if not math.isnan(outline[0, 0]):
        ring = " ".join(f"{lon!r},{lat!r}" for lon, lat in outline.tolist())
        boundary = f"<outerBoundaryIs><LinearRing><coordinates>{ring}</coordinates></LinearRing></outerBoundaryIs>"
        geometries.append(f"<Polygon>{boundary}</Polygon>")
    geometry = f"<MultiGeometry>{''.join(geometries)}</MultiGeometry>" if geometries else ""
    style = "<styleUrl>#ellipse</styleUrl>"
    return (
        f"<Placemark><name>{_text(name)}</name><description>{_text(description)}</description>{style}{geometry}"
        f"</Placemark>\n"
    )


def _shown(value: Any) -> str:
    """Return a value as text: numbers in full, whole ones without exponent and fraction."""
    if not isinstance(value, float):
        return str(value)
    return str(int(value)) if value.is_integer() and abs(value) < _EXACT else repr(value)


def _text(text: str) -> str:
    return escape(_NOT_XML.sub("\ufffd", text))


FORMAT = ExporterSpec(
    name="kml",
    summary="KML: placemarks with ellipses, status and all other columns in the description",
    reference="OGC 07-147r2, KML 2.2",
    options=MapOptions,
    start=_Writer,
)
"""The specification of the exporter."""
