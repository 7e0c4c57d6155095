"""Estimates as GeoJSON (RFC 7946): a point and an ellipse per estimate, with all of its columns as properties."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import IO, Any

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.contract.formats import ExporterSpec, Places, Shapes
from nlosctl.contract.options import option
from nlosctl.formats.map_options import LineOptions
from nlosctl.formats.track_lines import TrackLines
from nlosctl.geometry.antimeridian import crosses_antimeridian, cut_line, rings_by_polygon

__all__ = ["FORMAT"]


@dataclass(frozen=True, kw_only=True)
class GeoJsonOptions(LineOptions):
    """Ellipses, and units of the coordinates."""

    metres: bool = option(
        False, meaning="coordinates in metres of the plane, for local tools, instead of longitude and latitude"
    )


class _Writer:
    def __init__(self, sink: IO[bytes], options: GeoJsonOptions) -> None:
        self._sink, self._separator, self._on_earth = sink, "\n", not options.metres
        self._tracks = TrackLines()
        sink.write(b'{"type": "FeatureCollection", "features": [')

    def write(self, places: Places) -> None:
        for row in range(places.size):
            for feature in _features(places, row):
                self._put(feature)
        self._tracks.add(places)

    def write_shapes(self, shapes: Shapes) -> None:
        for row, parts in enumerate(shapes.parts):
            properties = {name: _value(values[row]) for name, values in shapes.columns.items()}
            properties = {"feature": shapes.feature, **properties}
            geometry = _areas(parts) if shapes.closed else _lines(parts)
            self._put({"type": "Feature", "geometry": geometry, "properties": properties})

    def _put(self, feature: dict[str, Any]) -> None:
        text = json.dumps(feature, ensure_ascii=False, allow_nan=False)
        self._sink.write((self._separator + text).encode("utf-8"))
        self._separator = ",\n"

    def close(self) -> None:
        for track in self._tracks.lines():
            path = np.array([point for _, point in track.points])
            line = _lines(cut_line(path) if self._on_earth and crosses_antimeridian(path[None])[0] else [path])
            own = {"feature": "track", **{name: _value(value) for name, value in track.values.items()}}
            properties = {**own, "time_s": [time_s for time_s, _ in track.points]}
            self._put({"type": "Feature", "geometry": line, "properties": properties})
        self._sink.write(b"\n]}\n")


def _features(places: Places, row: int) -> Iterator[dict[str, Any]]:
    properties = {name: _value(values[row]) for name, values in places.columns.items()}
    coordinates = places.point(row)
    point = {"type": "Point", "coordinates": coordinates} if coordinates else None
    yield {"type": "Feature", "geometry": point, "properties": {"feature": "estimate", **properties}}
    polygon = _polygons(places.rings(row))
    if polygon is not None:
        share = {"feature": "ellipse", "ellipse_probability": places.probability}
        yield {"type": "Feature", "geometry": polygon, "properties": {**properties, **share}}


def _polygons(rings: Sequence[FloatArray]) -> dict[str, Any] | None:
    if len(rings) < 2:
        return {"type": "Polygon", "coordinates": [rings[0].tolist()]} if rings else None
    return {"type": "MultiPolygon", "coordinates": [[ring.tolist()] for ring in rings]}


def _areas(rings: Sequence[FloatArray]) -> dict[str, Any] | None:
    polygons = [[ring.tolist() for ring in polygon] for polygon in rings_by_polygon(rings)]
    if len(polygons) < 2:
        return {"type": "Polygon", "coordinates": polygons[0]} if polygons else None
    return {"type": "MultiPolygon", "coordinates": polygons}


def _lines(lines: Sequence[FloatArray]) -> dict[str, Any] | None:
    if len(lines) < 2:
        return {"type": "LineString", "coordinates": lines[0].tolist()} if lines else None
    return {"type": "MultiLineString", "coordinates": [line.tolist() for line in lines]}


def _value(value: Any) -> Any:
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value if value is None or isinstance(value, str | int | float | bool) else str(value)


FORMAT = ExporterSpec(
    name="geojson",
    summary="GeoJSON: points and ellipses, lines of bearing, cells of the bound, regions of a posterior",
    reference="RFC 7946, The GeoJSON Format",
    options=GeoJsonOptions,
    start=_Writer,
)
"""The specification of the exporter."""
