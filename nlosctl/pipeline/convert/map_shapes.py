"""Lines of bearing and cells of a map of the bound, as shapes on the earth for an exporter."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.contract.formats import Shapes
from nlosctl.errors import DataError
from nlosctl.geometry.antimeridian import crosses_antimeridian, cut_line, cut_ring
from nlosctl.geometry.earth import EarthPlane, geodesics

__all__ = ["bearing_lines", "bound_cells", "has_bearings", "has_bound_cells"]

Columns = Mapping[str, Sequence[Any]]
Numbers = Callable[[Sequence[Any], str], FloatArray]
Planes = Callable[[Columns, int], Iterator[tuple[EarthPlane, Any]]]

_AZIMUTHS = ("azimuth_deg", "bearing_deg", "bearing_rad")
_PLACES = (("sensor_lat_deg", "sensor_lon_deg"), ("sensor_x_m", "sensor_y_m"))
_POINTS = 9
"""Points of a line: a geodesic is not straight on a map."""


def has_bearings(names: Sequence[str]) -> bool:
    """Return whether columns are those of bearings and not of estimates."""
    return "x_m" not in names and any(name in names for name in _AZIMUTHS)


def has_bound_cells(names: Sequence[str]) -> bool:
    """Return whether columns are those of a map of the bound."""
    return {"x_m", "y_m", "rms_m", "bound_xx_m2"} <= set(names) and "snapshot" not in names


def bearing_lines(columns: Columns, length_m: float, numbers: Numbers, planes: Planes) -> Shapes:
    """Return the geodesic of each bearing, from its sensor, ``length_m`` long or as long as the row's range.

    No part where a value is missing. Raises DataError without the sensors' positions.
    """
    first = next(iter(columns))
    size = len(columns[first])
    place = next((pair for pair in _PLACES if set(pair) <= columns.keys()), None)
    if place is None:
        raise DataError(
            "lines of bearing need the sensors' positions in the table: sensor_lat_deg and sensor_lon_deg, or "
            "sensor_x_m and sensor_y_m"
        )
    one, other = (numbers(columns[name], name) for name in place)
    name = next(name for name in _AZIMUTHS if name in columns)
    angle = numbers(columns[name], name) * (1.0 if name.endswith("_rad") else np.pi / 180.0)
    if place[0] == "sensor_lat_deg" and name == "azimuth_deg":
        lat, lon, azimuth = one, other, angle
    else:
        lat, lon, azimuth = (np.full(size, np.nan) for _ in range(3))
        for plane, rows in planes(columns, size):
            x, y = plane.to_plane(one[rows], other[rows]) if place[0] == "sensor_lat_deg" else (one[rows], other[rows])
            lat[rows], lon[rows] = plane.to_earth(x, y)
            azimuth[rows] = angle[rows] if name == "azimuth_deg" else plane.north_rad(x, y) - angle[rows]
    length = np.full(size, length_m)
    if "range_m" in columns:
        measured = numbers(columns["range_m"], "range_m")
        length = np.where(measured > 0.0, measured, length)
    paths = geodesics(lat, lon, azimuth, length, _POINTS)
    return Shapes(columns=columns, feature="bearing", parts=_parts(paths, cut_line), closed=False)


def bound_cells(columns: Columns, numbers: Numbers, planes: Planes, *, metres: bool) -> Shapes:
    """Return the cell of each position of a complete map of the bound; raises DataError without a grid."""
    x, y = (numbers(columns[name], name) for name in ("x_m", "y_m"))
    half_x, half_y = (0.5 * _step(values) for values in (x, y))
    if not (half_x > 0.0 and half_y > 0.0):
        raise DataError("the positions are not on a grid of at least 2 by 2; make a map with 'nlosctl bound --map'")
    corner_x, corner_y = np.array([-1.0, 1.0, 1.0, -1.0, -1.0]), np.array([-1.0, -1.0, 1.0, 1.0, -1.0])
    paths = np.stack([x[:, None] + half_x * corner_x, y[:, None] + half_y * corner_y], axis=2)
    if not metres:
        for plane, rows in planes(columns, x.shape[0]):
            lat, lon = plane.to_earth(paths[rows, :, 0], paths[rows, :, 1])
            paths[rows] = np.stack([lon, lat], axis=2)
            paths[rows, -1] = paths[rows, 0]
    parts = [[path] if np.isfinite(path).all() else [] for path in paths] if metres else _parts(paths, cut_ring)
    return Shapes(columns=columns, feature="cell", parts=parts, closed=True)


def _parts(paths: FloatArray, cut: Callable[[FloatArray], list[FloatArray]]) -> list[list[FloatArray]]:
    known, crossing = np.asarray(np.isfinite(paths).all(axis=(1, 2))), crosses_antimeridian(paths)
    return [
        (cut(path) if across else [path]) if good else []
        for path, good, across in zip(paths, known, crossing, strict=True)
    ]


def _step(values: FloatArray) -> float:
    """Return the spacing of a grid's axis; 0 for a single value."""
    steps = np.diff(np.unique(values[np.isfinite(values)]))
    return float(np.median(steps)) if steps.size else 0.0
