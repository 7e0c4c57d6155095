"""Estimates as GeoParquet 1.1: their columns, the point as ``geometry`` and the ellipse as ``ellipse``, both WKB."""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from typing import IO, Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet

from nlosctl.arrays import FloatArray
from nlosctl.contract.formats import ExporterSpec, Places
from nlosctl.formats.map_options import MapOptions

__all__ = ["FORMAT"]

_GEOMETRIES = {"geometry": "Point", "ellipse": "Polygon"}
_POINT, _POINT_Z, _POLYGON, _MULTI_POLYGON = 1, 1001, 3, 6
"""The types of geometries in WKB."""


class _Writer:
    """Collects all rows and writes them at the end: the type of a column depends on all of its values."""

    def __init__(self, sink: IO[bytes], options: MapOptions) -> None:
        self._sink = sink
        self._columns: dict[str, list[Any]] = {}

    def write(self, places: Places) -> None:
        geometries = {"geometry": _points(places), "ellipse": _polygons(places)}
        for name, cells in {**places.columns, **geometries}.items():
            self._columns.setdefault(name, []).extend(cells)

    def close(self) -> None:
        columns = {name: pa.array(cells, _type(name)) for name, cells in self._columns.items()}
        described = {name: {"encoding": "WKB", "geometry_types": [kind]} for name, kind in _GEOMETRIES.items()}
        if any(cell is not None and cell[1] == _MULTI_POLYGON for cell in self._columns.get("ellipse", ())):
            described["ellipse"]["geometry_types"] = ["Polygon", "MultiPolygon"]
        if any(
            cell is not None and cell[1:5] == struct.pack("<I", _POINT_Z) for cell in self._columns.get("geometry", ())
        ):
            described["geometry"]["geometry_types"] = ["Point Z"]
        geo = {"version": "1.1.0", "primary_column": "geometry", "columns": described}
        columns = columns or {name: pa.array([], pa.binary()) for name in _GEOMETRIES}
        table = pa.table(columns).replace_schema_metadata({"geo": json.dumps(geo)})
        pyarrow.parquet.write_table(table, pa.PythonFile(_Unclosed(self._sink), mode="w"))


def _type(name: str) -> Any:
    return pa.binary() if name in _GEOMETRIES else None


class _Unclosed:
    """A sink that stays open: its owner closes it."""

    def __init__(self, sink: IO[bytes]) -> None:
        self._sink = sink
        self.closed = False

    def write(self, content: bytes) -> int:
        return self._sink.write(content)

    def flush(self) -> None:
        self._sink.flush()

    def close(self) -> None:
        """Leave the sink open."""


def _points(places: Places) -> Sequence[bytes | None]:
    kind = _POINT if places.z is None else _POINT_Z
    points = map(places.point, range(places.size))
    return [struct.pack(f"<BI{len(point)}d", 1, kind, *point) if point else None for point in points]


def _polygons(places: Places) -> Sequence[bytes | None]:
    polygons = [[_polygon(ring) for ring in places.rings(row)] for row in range(places.size)]
    return [_joined(parts) if len(parts) != 1 else parts[0] for parts in polygons]


def _polygon(ring: FloatArray) -> bytes:
    return struct.pack("<BIII", 1, _POLYGON, 1, ring.shape[0]) + np.ascontiguousarray(ring, dtype="<f8").tobytes()


def _joined(polygons: Sequence[bytes]) -> bytes | None:
    return struct.pack("<BII", 1, _MULTI_POLYGON, len(polygons)) + b"".join(polygons) if polygons else None


FORMAT = ExporterSpec(
    name="geoparquet",
    summary="GeoParquet: a table with points and ellipses",
    reference="GeoParquet 1.1.0; WKB of OGC 06-103r4",
    options=MapOptions,
    start=_Writer,
)
"""The specification of the exporter."""
