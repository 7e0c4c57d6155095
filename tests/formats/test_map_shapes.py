"""Ellipses across the 180th meridian and about the poles, lines of bearing, cells of the bound, names: read by GDAL."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import geopandas
import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pyproj
import pytest
from shapely.geometry import MultiPolygon

from nlosctl.errors import DataError
from nlosctl.geometry.antimeridian import cut_line
from nlosctl.pipeline.convert.map_writer import MapWriter

GEOD = pyproj.Geod(ellps="WGS84")
EVIL = ["$5 {a}", "a\x1b[31mb", "北京", "🦊", "<b>&amp;", "new\nline", '"quoted"']
CENTRES = {
    "antimeridian": (-16.8, 179.99),
    "west of it": (10.0, -179.9999),
    "about the north pole": (89.95, 20.0),
    "about the south pole": (-89.9, -100.0),
    "at the south pole": (-90.0, 0.0),
    "beside the pole, across 180": (89.5, 179.0),
    "elsewhere": (47.0, 8.0),
}


def export(folder: Path, name: str, table: Any, **parameters: Any) -> Path:
    """Write a table with an exporter and return the file."""
    path = folder / f"map.{name}"
    with MapWriter(str(path), name, parameters) as writer:
        writer.write(table)
    return path


def fix(lat: float, lon: float, names: list[str] | None = None) -> Any:
    """Return estimates at the origin of a tangent plane, with a covariance turned by 45 degrees."""
    names = names or ["7"]
    cov = {"cov_xx_m2": 1.6e8, "cov_xy_m2": 0.6e8, "cov_yy_m2": 1.6e8}
    columns = {"snapshot": names, "method": ["ml"] * len(names), "x_m": [0.0] * len(names), "y_m": [0.0] * len(names)}
    numbers = {name: [value] * len(names) for name, value in cov.items()}
    frame = [f"{lat!r} {lon!r}"] * len(names)
    return pa.table({**columns, **numbers, "status": ["ok"] * len(names), "frame": frame})


def area_m2(geometry: Any) -> float:
    """Return the area on WGS 84 of the parts of a polygon; counter-clockwise rings count as positive."""
    parts = getattr(geometry, "geoms", [geometry])
    return sum(GEOD.geometry_area_perimeter(part)[0] for part in parts)


def ellipse_by(name: str, path: Path) -> Any:
    """Return the ellipse of a map as GDAL or geopandas reads it."""
    if name == "geoparquet":
        return geopandas.read_parquet(path)["ellipse"][0]
    frame = geopandas.read_file(path)
    if name == "geojson":
        return frame.geometry[1]
    polygons = [part for part in frame.geometry[0].geoms if part.geom_type == "Polygon"]
    return polygons[0] if len(polygons) == 1 else MultiPolygon(polygons)


@pytest.mark.parametrize("centre", CENTRES)
@pytest.mark.parametrize("name", ["geojson", "kml", "geoparquet"])
def test_ellipses_are_cut_where_the_map_ends(name: str, centre: str, tmp_path: Path) -> None:
    """Every part is valid and between -180 and 180 degrees, and their areas sum to that of the ellipse on the earth."""
    lat, lon = CENTRES[centre]
    ellipse = ellipse_by(name, export(tmp_path, name, fix(lat, lon), vertices=720))
    assert ellipse.is_valid
    low, _, high, _ = ellipse.bounds
    assert -180.0 <= low < high <= 180.0
    semi_axes = np.sqrt(np.linalg.eigvalsh([[1.6e8, 0.6e8], [0.6e8, 1.6e8]]) * -2.0 * math.log(0.05))
    exact = math.pi * float(np.prod(semi_axes))
    assert area_m2(ellipse) == pytest.approx(exact, rel=2e-3)
    parts = 1 if centre in ("elsewhere", "about the north pole", "about the south pole", "at the south pole") else 2
    assert len(getattr(ellipse, "geoms", [ellipse])) == parts
    if name == "geoparquet":
        assert ellipse.geom_type == ("Polygon" if parts == 1 else "MultiPolygon")


def test_the_types_of_geometries_are_declared(tmp_path: Path) -> None:
    """The metadata of GeoParquet list Polygon, and MultiPolygon where there is one."""
    for (lat, lon), expected in (((47.0, 8.0), ["Polygon"]), ((-16.8, 179.99), ["Polygon", "MultiPolygon"])):
        path = export(tmp_path, "geoparquet", fix(lat, lon))
        geo = json.loads(pa.parquet.read_metadata(path).metadata[b"geo"])
        assert geo["columns"]["ellipse"]["geometry_types"] == expected
        path.unlink()


@pytest.mark.parametrize("name", ["geojson", "kml", "geoparquet", "czml"])
def test_any_name_reaches_the_reader(name: str, tmp_path: Path) -> None:
    """Dollars, quotes, markup, line ends, CJK and emoji arrive as they are; XML replaces characters it can't hold."""
    path = export(tmp_path, name, fix(47.0, 8.0, EVIL))
    if name == "czml":
        found = [packet["properties"]["snapshot"] for packet in json.loads(path.read_text(encoding="utf-8"))[1:]]
        assert found == EVIL
    elif name == "geoparquet":
        assert geopandas.read_parquet(path)["snapshot"].tolist() == EVIL
    elif name == "geojson":
        frame = geopandas.read_file(path)
        assert frame[frame["feature"] == "estimate"]["snapshot"].tolist() == EVIL
    else:
        assert geopandas.read_file(path)["Name"].tolist() == [f"{word} ml".replace("\x1b", "\ufffd") for word in EVIL]


def bearings(**columns: Any) -> Any:
    """Return bearings of two sensors with these columns."""
    return pa.table({"snapshot": ["1", "1"], "sensor": EVIL[:2], **columns})


@pytest.mark.parametrize("name", ["geojson", "kml"])
def test_lines_of_bearing_are_geodesics(name: str, tmp_path: Path) -> None:
    """A line starts at its sensor, goes along its azimuth, and is as long as asked for, or as the range."""
    lat, lon, azimuth = [47.0, 48.0], [8.0, 8.5], [30.0, 250.0]
    table = bearings(sensor_lat_deg=lat, sensor_lon_deg=lon, azimuth_deg=azimuth, range_m=[None, 7000.0])
    frame = geopandas.read_file(export(tmp_path, name, table, line_length_m=25_000.0))
    for row, length in enumerate((25_000.0, 7000.0)):
        shown = frame.geometry[row]
        line = np.array(getattr(shown, "geoms", [shown])[0].coords)[:, :2]
        np.testing.assert_allclose(line[0], [lon[row], lat[row]])
        forward, _, distance = GEOD.inv(*line[0], *line[-1])
        assert forward % 360.0 == pytest.approx(azimuth[row])
        assert distance == pytest.approx(length)
    words = frame["Name"].tolist() if name == "kml" else frame["sensor"].tolist()
    assert "$5 {a}" in words[0]


@pytest.mark.parametrize("unit", ["bearing_deg", "bearing_rad"])
def test_bearings_of_the_plane_become_azimuths(unit: str, tmp_path: Path) -> None:
    """A bearing of 30 degrees from an x axis that is 20 degrees north of east is the azimuth 40 on the earth."""
    angle = 30.0 if unit.endswith("deg") else math.radians(30.0)
    table = bearings(sensor_x_m=[0.0, 0.0], sensor_y_m=[0.0, 0.0], **{unit: [angle, None]})
    table = table.append_column("frame", pa.array(["47.37 8.54 20.0"] * 2))
    frame = geopandas.read_file(export(tmp_path, "geojson", table))
    line = np.array(frame.geometry[0].coords)
    assert GEOD.inv(*line[0], *line[-1])[0] == pytest.approx(40.0, abs=1e-6)
    assert frame.geometry[1] is None


def test_lines_across_180_degrees_are_cut() -> None:
    """The parts meet at the meridian, on both of its sides, and keep the latitudes of the straight line."""
    parts = cut_line(np.array([[179.0, 10.0], [-179.0, 12.0], [-178.0, 12.0]]))
    np.testing.assert_allclose(parts[0], [[179.0, 10.0], [180.0, 11.0]])
    np.testing.assert_allclose(parts[1], [[-180.0, 11.0], [-179.0, 12.0], [-178.0, 12.0]])
    (back, forth) = cut_line(np.array([[-179.0, 0.0], [179.0, 2.0]]))
    np.testing.assert_allclose(back, [[-179.0, 0.0], [-180.0, 1.0]])
    np.testing.assert_allclose(forth, [[180.0, 1.0], [179.0, 2.0]])


@pytest.mark.parametrize("metres", [True, False])
def test_a_map_of_the_bound_is_cells(metres: bool, tmp_path: Path) -> None:
    """Cells fill the grid without overlap and carry the bound; a map in parts has the same bytes."""
    x, y = (part.ravel() for part in np.meshgrid(np.arange(0.0, 500.0, 100.0), np.arange(0.0, 150.0, 50.0)))
    table = pa.table({"x_m": x, "y_m": y, "rms_m": x + y, "bound_xx_m2": x})
    if not metres:
        table = table.append_column("frame", pa.array(["47.37 8.54"] * x.size))
    path = export(tmp_path, "geojson", table, metres=metres)
    frame = geopandas.read_file(path)
    assert frame["rms_m"].tolist() == (x + y).tolist()
    union = frame.geometry.union_all()
    if metres:
        assert union.bounds == (-50.0, -25.0, 450.0, 125.0)
        assert [cell.area for cell in frame.geometry] == [5000.0] * x.size
    else:
        assert abs(area_m2(union)) == pytest.approx(75_000.0, rel=1e-4)
        assert sum(area_m2(cell) for cell in frame.geometry) == pytest.approx(75_000.0, rel=1e-4)
    parts = tmp_path / "parts.geojson"
    with MapWriter(str(parts), "geojson", {"metres": metres}) as writer:
        for row in range(table.num_rows):
            writer.write(table.slice(row, 1))
    assert parts.read_bytes() == path.read_bytes()


def test_formats_without_lines_name_those_with(tmp_path: Path) -> None:
    """CZML and GeoParquet refuse bearings and name GeoJSON and KML; bearings without positions are refused."""
    table = bearings(sensor_lat_deg=[47.0, 48.0], sensor_lon_deg=[8.0, 8.5], azimuth_deg=[1.0, 2.0])
    for name in ("czml", "geoparquet"):
        with pytest.raises(DataError, match="takes estimates, not bearings: write geojson or kml"):
            export(tmp_path, name, table)
    with pytest.raises(DataError, match="need the sensors' positions"):
        export(tmp_path, "kml", bearings(azimuth_deg=[1.0, 2.0]))
    with pytest.raises(DataError, match="not on a grid"):
        export(tmp_path, "geojson", pa.table({"x_m": [1.0], "y_m": [1.0], "rms_m": [1.0], "bound_xx_m2": [1.0]}))
