"""Estimates as KML for Google Earth and similar tools: a placemark with ellipse and the columns as description.

Viewers read a description as HTML: text is escaped once for HTML, and the HTML once for XML.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import IO, Any
from xml.sax.saxutils import escape

from nlosctl.arrays import FloatArray
from nlosctl.contract.formats import ExporterSpec, Places, Shapes
from nlosctl.formats.map_options import LineOptions, known_values, title, xml_text
from nlosctl.formats.track_lines import TrackLine, TrackLines, are_states, iso_time
from nlosctl.geometry.antimeridian import rings_by_polygon

__all__ = ["FORMAT"]

_HEAD = """<?xml version="1.0" encoding="UTF-8"?>
<kml xmlns="http://www.opengis.net/kml/2.2">
<Document>
<name>nlosctl estimates</name>
<Style id="ellipse"><LineStyle><color>ff0055ff</color><width>2</width></LineStyle><PolyStyle><color>330055ff</color>\
</PolyStyle></Style>
"""

_EXACT = 2**53


class _Writer:
    def __init__(self, sink: IO[bytes], options: LineOptions) -> None:
        self._sink, self._tracks = sink, TrackLines()
        sink.write(_HEAD.encode("utf-8"))

    def write(self, places: Places) -> None:
        for row in range(places.size):
            self._sink.write(_placemark(places, row).encode("utf-8"))
        self._tracks.add(places)

    def write_shapes(self, shapes: Shapes) -> None:
        for row, parts in enumerate(shapes.parts):
            shown = [_polygon(*part) for part in rings_by_polygon(parts)] if shapes.closed else list(map(_line, parts))
            self._sink.write(_described(known_values(shapes, row), shown).encode("utf-8"))

    def close(self) -> None:
        for track in self._tracks.lines():
            self._sink.write(_described(track.values, [_gx_track(track)], track.name).encode("utf-8"))
        self._sink.write(b"</Document>\n</kml>\n")


def _placemark(places: Places, row: int) -> str:
    geometries = []
    point = places.point(row)
    if point:
        mode = "<altitudeMode>absolute</altitudeMode>" if len(point) == 3 else ""
        geometries.append(f"<Point>{mode}<coordinates>{','.join(map(repr, point))}</coordinates></Point>")
    geometries += [_polygon(ring) for ring in places.rings(row)]
    time_s = places.columns["time_s"][row] if are_states(places) else None
    when = "" if time_s is None else f"<TimeStamp><when>{iso_time(time_s)}</when></TimeStamp>"
    return _described(known_values(places, row), geometries, when=when)


def _polygon(ring: FloatArray, *holes: FloatArray) -> str:
    boundary = f"<outerBoundaryIs><LinearRing>{_coordinates(ring)}</LinearRing></outerBoundaryIs>"
    inner = (f"<innerBoundaryIs><LinearRing>{_coordinates(hole)}</LinearRing></innerBoundaryIs>" for hole in holes)
    return f"<Polygon>{boundary}{''.join(inner)}</Polygon>"


def _line(line: FloatArray) -> str:
    return f"<LineString><tessellate>1</tessellate>{_coordinates(line)}</LineString>"


def _coordinates(path: FloatArray) -> str:
    return f"<coordinates>{' '.join(f'{lon!r},{lat!r}' for lon, lat in path.tolist())}</coordinates>"


def _gx_track(track: TrackLine) -> str:
    """Return a path with a time for each position, in seconds since 1970."""
    mode = "<altitudeMode>absolute</altitudeMode>" if len(track.points[0][1]) == 3 else ""
    times = "".join(f"<when>{iso_time(time_s)}</when>" for time_s, _ in track.points)
    places = "".join(f"<gx:coord>{' '.join(map(repr, [*point, 0.0][:3]))}</gx:coord>" for _, point in track.points)
    return f'<gx:Track xmlns:gx="http://www.google.com/kml/ext/2.2">{mode}{times}{places}</gx:Track>'


def _described(values: Mapping[str, Any], geometries: Sequence[str], name: str = "", when: str = "") -> str:
    """Return a placemark with a title, the values as description, and geometries."""
    name = name or title(values)
    description = "<br>".join(escape(f"{key}: {_shown(value)}") for key, value in values.items())
    geometry = f"<MultiGeometry>{''.join(geometries)}</MultiGeometry>" if geometries else ""
    style = "<styleUrl>#ellipse</styleUrl>"
    return (
        f"<Placemark><name>{xml_text(name)}</name><description>{xml_text(description)}</description>{when}{style}{geometry}"
        f"</Placemark>\n"
    )


def _shown(value: Any) -> str:
    """Return a value as text: numbers in full, whole ones without exponent and fraction."""
    if not isinstance(value, float):
        return str(value)
    return str(int(value)) if value.is_integer() and abs(value) < _EXACT else repr(value)


FORMAT = ExporterSpec(
    name="kml",
    summary="KML: placemarks with ellipses or lines of bearing, all other columns in the description",
    reference="OGC 07-147r2, KML 2.2",
    options=LineOptions,
    start=_Writer,
)
"""The specification of the exporter."""
