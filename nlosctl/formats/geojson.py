"""Estimates as GeoJSON (RFC 7946): a point and an ellipse per estimate, with all of its columns as properties."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import IO, Any

from nlosctl.contract.formats import ExporterSpec, Places
from nlosctl.contract.options import option
from nlosctl.formats.map_options import MapOptions

__all__ = ["FORMAT"]


@dataclass(frozen=True, kw_only=True)
class GeoJsonOptions(MapOptions):
    """Ellipses, and units of the coordinates."""

    metres: bool = option(
        False, meaning="coordinates in metres of the plane, for local tools, instead of longitude and latitude"
    )


class _Writer:
    def __init__(self, sink: IO[bytes], options: GeoJsonOptions) -> None:
        self._sink, self._separator = sink, "\n"
        sink.write(b'{"type": "FeatureCollection", "features": [')

    def write(self, places: Places) -> None:
        for row in range(places.size):
            for feature in _features(places, row):
                text = json.dumps(feature, ensure_ascii=False, allow_nan=False)
                self._sink.write((self._separator + text).encode("utf-8"))
                self._separator = ",\n"

    def close(self) -> None:
        self._sink.write(b"\n]}\n")


def _features(places: Places, row: int) -> Iterator[dict[str, Any]]:
    properties = {name: _value(values[row]) for name, values in places.columns.items()}
    x, y = float(places.x[row]), float(places.y[row])
    point = None if math.isnan(x) else {"type": "Point", "coordinates": [x, y]}
    yield {"type": "Feature", "geometry": point, "properties": {"feature": "estimate", **properties}}
    outline = places.outline[row]
    if not math.isnan(outline[0, 0]):
        polygon = {"type": "Polygon", "coordinates": [outline.tolist()]}
        share = {"feature": "ellipse", "ellipse_probability": places.probability}
        yield {"type": "Feature", "geometry": polygon, "properties": {**properties, **share}}


def _value(value: Any) -> Any:
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value if value is None or isinstance(value, str | int | float | bool) else str(value)


FORMAT = ExporterSpec(
    name="geojson",
    summary="GeoJSON: points and ellipses",
    reference="RFC 7946, The GeoJSON Format",
    options=GeoJsonOptions,
    start=_Writer,
)
"""The specification of the exporter."""
