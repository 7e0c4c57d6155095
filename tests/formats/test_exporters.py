"""Exporters, read back by other programs: GDAL, geopandas, czml3."""

from __future__ import annotations

import html
import json
import math
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import geopandas
import numpy as np
import pyarrow as pa
import pyproj
import pytest
from czml3 import Packet, Position
from czml3.properties import Ellipse
from program import run_here
from shapely.geometry import Point

from nlosctl.contract.scene import EarthFrame, parse_frame
from nlosctl.errors import DataError, UsageError
from nlosctl.io.scenes.scene_file import plane_of
from nlosctl.pipeline.convert.map_writer import MapWriter, exporter_of

GEOD = pyproj.Geod(ellps="WGS84")
FRAMES = {"tangent": "47.37 8.54", "turned": "47.37 8.54 30.0", "utm": "EPSG:32632"}
NAME = 'a<b> & \u0007 "c"'


def estimates(words: str | None = FRAMES["tangent"]) -> Any:
    """Return a fix with an ellipse, a fix without covariance, and a row without a fix."""
    x, y = 3000.0, -1000.0
    if words is not None:
        lat, lon = np.array([47.36]), np.array([8.58])
        x, y = (float(axis[0]) for axis in plane_of(parse_frame(words, "frame")).to_plane(lat, lon))
    rows: dict[str, list[Any]] = {
        "snapshot": [NAME, "1", "2"],
        "method": ["ml"] * 3,
        "x_m": [x, x, None],
        "y_m": [y, y, None],
        "cov_xx_m2": [900.0, None, None],
        "cov_xy_m2": [200.0, None, None],
        "cov_yy_m2": [100.0, None, None],
        "status": ["ok", "boundary", "too_few"],
    }
    return pa.table(rows if words is None else {**rows, "frame": [words] * 3})


def export(folder: Path, name: str, table: Any, **parameters: Any) -> Path:
    """Write a table with an exporter and return the file."""
    path = folder / f"fixes.{name}"
    with MapWriter(str(path), name, parameters) as writer:
        writer.write(table)
    return path


def assert_ellipse(polygon: Any, words: str) -> None:
    """Compare a 95 % ellipse on earth with the covariance: the vertices have a squared Mahalanobis distance of 5.99."""
    lon, lat = (np.array(axis) for axis in polygon.exterior.coords.xy)
    plane = plane_of(parse_frame(words, "frame"))
    x, y = plane.to_plane(lat, lon)
    centre = plane.to_plane(np.array([47.36]), np.array([8.58]))
    away = np.stack([x - centre[0], y - centre[1]])
    squared = np.einsum("in,ij,jn->n", away, np.linalg.inv([[900.0, 200.0], [200.0, 100.0]]), away)
    np.testing.assert_allclose(squared, -2.0 * math.log(0.05), rtol=1e-6)
    assert polygon.is_valid
    assert polygon.exterior.is_ccw


@pytest.mark.parametrize("words", FRAMES.values())
def test_geojson_by_gdal(tmp_path: Path, words: str) -> None:
    """GDAL reads points, ellipses and the row without a fix, with all columns."""
    frame = geopandas.read_file(export(tmp_path, "geojson", estimates(words)))
    assert frame.crs.to_epsg() == 4326
    assert frame["feature"].tolist() == ["estimate", "ellipse", "estimate", "estimate"]
    point = frame.geometry[0]
    assert GEOD.inv(point.x, point.y, 8.58, 47.36)[2] < 1e-3
    assert_ellipse(frame.geometry[1], words)
    assert frame.geometry[3] is None
    assert frame["status"].tolist() == ["ok", "ok", "boundary", "too_few"]
    assert frame["snapshot"][0] == NAME


def test_geojson_is_strict_json(tmp_path: Path) -> None:
    """Rings are closed, missing values are null."""
    tree = json.loads(export(tmp_path, "geojson", estimates()).read_text(), parse_constant=pytest.fail)
    assert tree["type"] == "FeatureCollection"
    ring = tree["features"][1]["geometry"]["coordinates"][0]
    assert ring[0] == ring[-1]
    assert len(ring) == 73
    assert tree["features"][-1]["geometry"] is None


def test_kml_by_gdal(tmp_path: Path) -> None:
    """GDAL reads a placemark per estimate; names that are not valid XML are escaped."""
    path = export(tmp_path, "kml", estimates())
    frame = geopandas.read_file(path)
    assert frame["Name"].tolist() == ['a<b> & \ufffd "c" ml', "1 ml", "2 ml"]
    assert "status: boundary" in frame["description"][1]
    point, polygon = frame.geometry[0].geoms
    assert GEOD.inv(point.x, point.y, 8.58, 47.36)[2] < 1e-3
    assert_ellipse(polygon, FRAMES["tangent"])
    assert ElementTree.parse(path).getroot().tag == "{http://www.opengis.net/kml/2.2}kml"  # noqa: S314 - our own file


def test_gpx_by_gdal(tmp_path: Path) -> None:
    """GDAL reads a waypoint per fix and a track per path, with its times; estimates without a position are left out."""
    fixes = geopandas.read_file(export(tmp_path, "gpx", estimates()), layer="waypoints")
    assert GEOD.inv(fixes.geometry[0].x, fixes.geometry[0].y, 8.58, 47.36)[2] < 1e-3
    assert fixes["name"].tolist() == ['a<b> & \ufffd "c" ml', "1 ml"]
    assert "status: boundary" in fixes["desc"][1]
    (tmp_path / "s.csv").write_text(STATES)
    words = ("--by", "tag", "-p", "acceleration_psd=1", "-q", "-o", "t.parquet")
    assert run_here("track", "s.csv", *words, folder=tmp_path).returncode == 0
    done = run_here("convert", "t.parquet", "--origin", "48,180", "-q", "-o", "t.gpx", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    points = geopandas.read_file(tmp_path / "t.gpx", layer="track_points")
    assert [str(time) for time in points["time"]][:2] == [
        "2023-11-14 22:13:20.500000+00:00",
        "2023-11-14 22:13:22+00:00",
    ]
    assert points["track_fid"].tolist() == [0, 0, 1, 1]
    assert (points.geometry.x < 180.0).all()
    assert geopandas.read_file(tmp_path / "t.gpx", layer="tracks")["name"].tolist() == [
        "track tag=a method=track",
        "track tag=b method=track",
    ]


def test_a_path_across_180_degrees_is_cut_in_geojson(tmp_path: Path) -> None:
    """GDAL reads a line on each side of the meridian, not one around the world."""
    rows = "".join(f"{n},{400 * n - 1000},0,1,0,1,{n}\n" for n in range(6))
    (tmp_path / "s.csv").write_text("snapshot,x_m,y_m,cov_xx_m2,cov_xy_m2,cov_yy_m2,time_s\n" + rows)
    words = ("-p", "acceleration_psd=1", "-q", "-o", "t.parquet")
    assert run_here("track", "s.csv", *words, folder=tmp_path).returncode == 0
    done = run_here("convert", "t.parquet", "--origin", "10,180", "-q", "-o", "t.geojson", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    frame = geopandas.read_file(tmp_path / "t.geojson")
    (path,) = frame.geometry[frame["feature"] == "track"]
    west, east = sorted(part.bounds[::2] for part in path.geoms)
    assert (west[0], east[1]) == (-180.0, 180.0)
    assert (west[1], east[0]) == pytest.approx((-179.9909, 179.9909), abs=1e-4)


def test_kml_descriptions_are_html_of_the_values(tmp_path: Path) -> None:
    """A viewer that reads the description as HTML shows each value on a line of its own, markup as text, in full."""
    table = estimates().append_column("note", pa.array(["SNR<3 <img src=x>", "", None]))
    table = table.append_column("time_s", pa.array([1720200001.5, 1720200002.0, None]))
    tree = ElementTree.parse(export(tmp_path, "kml", table))  # noqa: S314 - our own file
    descriptions = [node.text or "" for node in tree.iter("{http://www.opengis.net/kml/2.2}description")]
    shown = [html.unescape(line) for line in descriptions[0].split("<br>")]
    assert "note: SNR<3 <img src=x>" in shown
    assert "time_s: 1720200001.5" in shown
    assert "time_s: 1720200002" in descriptions[1].split("<br>")
    assert "<img" not in descriptions[0]


def test_geoparquet_by_geopandas(tmp_path: Path) -> None:
    """geopandas reads both geometries with their CRS, nulls, and columns in their types."""
    frame = geopandas.read_parquet(export(tmp_path, "geoparquet", estimates()))
    assert str(frame.crs) == "OGC:CRS84"
    assert GEOD.inv(frame.geometry[0].x, frame.geometry[0].y, 8.58, 47.36)[2] < 1e-3
    assert_ellipse(frame["ellipse"][0], FRAMES["tangent"])
    assert frame.geometry[2] is None
    assert frame["x_m"].dtype == np.float64
    assert isinstance(frame.geometry[1], Point)


def drawn_by_cesium(lon: float, lat: float, ellipse: dict[str, float], theta: float) -> tuple[float, float]:
    """Return the longitude and latitude at which CesiumJS draws the point ``theta`` of an ellipse.

    As in its EllipseGeometryLibrary: the centre is turned about a horizontal axis at the angle theta + rotation from
    east, by the radius of the ellipse at theta.
    """
    phi, lam = math.radians(lat), math.radians(lon)
    up = np.array([math.cos(phi) * math.cos(lam), math.cos(phi) * math.sin(lam), math.sin(phi)])
    east = np.cross([0.0, 0.0, 1.0], up)
    east /= np.linalg.norm(east)
    north = np.cross(up, east)
    turn = theta + ellipse["rotation"]
    axis = math.cos(turn) * east + math.sin(turn) * north
    major, minor = ellipse["semiMajorAxis"], ellipse["semiMinorAxis"]
    radius = major * minor / math.hypot(major * math.cos(theta), minor * math.sin(theta))
    angle = radius / 6_371_000.0
    point = math.cos(angle) * up + math.sin(angle) * np.cross(axis, up)
    return math.degrees(math.atan2(point[1], point[0])), math.degrees(math.asin(point[2]))


@pytest.mark.parametrize("words", FRAMES.values())
def test_czml_agrees_with_czml3(tmp_path: Path, words: str) -> None:
    """Positions and ellipses are czml3's; as Cesium draws it, the ellipse is that of the covariance."""
    document, first, *others = json.loads(export(tmp_path, "czml", estimates(words)).read_text())
    assert (document["id"], document["version"], len(others)) == ("document", "1.0", 2)
    packet = Packet(
        id="estimate-0",
        position=Position(cartographicDegrees=first["position"]["cartographicDegrees"]),
        ellipse=Ellipse(
            semiMajorAxis=first["ellipse"]["semiMajorAxis"],
            semiMinorAxis=first["ellipse"]["semiMinorAxis"],
            rotation=first["ellipse"]["rotation"],
        ),
    )
    theirs = json.loads(packet.dumps())
    assert first["position"] == theirs["position"]
    assert {**theirs["ellipse"], "material": first["ellipse"]["material"]} == first["ellipse"]
    lon, lat = first["position"]["cartographicDegrees"][:2]
    tip_lon, tip_lat = drawn_by_cesium(lon, lat, first["ellipse"], 0.5 * math.pi)
    side_lon, side_lat = drawn_by_cesium(lon, lat, first["ellipse"], 0.0)
    assert GEOD.inv(lon, lat, side_lon, side_lat)[2] == pytest.approx(first["ellipse"]["semiMinorAxis"], rel=0.01)
    plane = plane_of(parse_frame(words, "frame"))
    x, y = plane.to_plane(np.array([lat, tip_lat]), np.array([lon, tip_lon]))
    along = np.linalg.eigh([[900.0, 200.0], [200.0, 100.0]])[1][:, 1]
    assert abs(np.dot([x[1] - x[0], y[1] - y[0]], along)) == pytest.approx(math.hypot(*np.diff([x, y])[:, 0]), rel=1e-4)
    assert "position" not in others[1]


def test_the_frame_of_a_map(tmp_path: Path) -> None:
    """A frame from an option overrides the column; without either there is an error and no file."""
    table = estimates(None)
    path = tmp_path / "fixes.geojson"
    with MapWriter(str(path), "geojson", {}, frame=EarthFrame(origin_lat_deg=47.37, origin_lon_deg=8.54)) as writer:
        writer.write(table)
    assert geopandas.read_file(path).geometry[0].y == pytest.approx(47.361, abs=1e-3)
    with (
        pytest.raises(DataError, match="no location on earth"),
        MapWriter(str(tmp_path / "none.kml"), "kml", {}) as writer,
    ):
        writer.write(table)
    assert not (tmp_path / "none.kml").exists()
    assert list(tmp_path.glob(".*")) == []


def test_geojson_in_plain_metres(tmp_path: Path) -> None:
    """Plain metres are an option of geojson."""
    tree = json.loads(export(tmp_path, "geojson", estimates(None), metres=True).read_text())
    assert tree["features"][0]["geometry"]["coordinates"] == [3000.0, -1000.0]
    with pytest.raises(UsageError, match="has no parameter 'metres'"):
        export(tmp_path, "kml", estimates(None), metres=True)


def test_coverage_and_vertices_of_ellipses(tmp_path: Path) -> None:
    """Coverage and number of vertices are parameters."""
    path = export(tmp_path, "geojson", estimates(), ellipse=0.5, vertices=12)
    feature = json.loads(path.read_text())["features"][1]
    assert feature["properties"]["ellipse_probability"] == 0.5
    assert len(feature["geometry"]["coordinates"][0]) == 13


@pytest.mark.parametrize("name", ["geojson", "kml", "czml", "gpx", "html", "geoparquet"])
def test_empty_tables_give_valid_maps(tmp_path: Path, name: str) -> None:
    """An empty table gives an empty, readable map, and several tables the same as one."""
    path = tmp_path / f"none.{name}"
    with MapWriter(str(path), name, {}):
        pass
    if name == "geojson":
        assert json.loads(path.read_text())["features"] == []
    elif name == "czml":
        assert len(json.loads(path.read_text())) == 1
    elif name in ("kml", "gpx"):
        ElementTree.parse(path)  # noqa: S314 - our own file
    elif name == "html":
        assert "<caption>0 estimates</caption>" in path.read_text()
    else:
        assert len(geopandas.read_parquet(path)) == 0
    whole = export(tmp_path, name, estimates()).read_bytes()
    with MapWriter(str(path), name, {}, overwrite=True) as writer:
        for row in range(3):
            writer.write(estimates().slice(row, 1))
    assert path.read_bytes() == whole


class PageReader(HTMLParser):
    """The rows of the table of a page, and all of its elements with their attributes."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.rows: list[list[str]] = []
        self.elements: list[tuple[str, dict[str, Any]]] = []
        self._in_cell = False
        self.feed(path.read_text())

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note an element; begin a row or a cell."""
        self.elements.append((tag, dict(attrs)))
        if tag == "tr":
            self.rows.append([])
        if tag in ("th", "td"):
            self._in_cell = True
            self.rows[-1].append("")

    def handle_endtag(self, tag: str) -> None:
        """End a cell."""
        self._in_cell &= tag not in ("th", "td")

    def handle_data(self, data: str) -> None:
        """Add the text of a cell."""
        if self._in_cell:
            self.rows[-1][-1] += data


def test_html_by_a_reader_of_html(tmp_path: Path) -> None:
    """The table has all columns, names stay text, and the ellipse is drawn about the fix that is half way up."""
    table = estimates(None)
    names = ["</script><script>alert(1)</script>", "1 & 2", "2"]
    table = table.set_column(0, "snapshot", pa.array(names))
    truth = {"truth_x_m": [3100.0] * 3, "truth_y_m": [-900.0, -1100.0, -1000.0]}
    for name, values in truth.items():
        table = table.append_column(name, pa.array(values))
    page = PageReader(export(tmp_path, "html", table))
    rows = page.rows
    assert rows[0] == table.column_names
    assert [row[0] for row in rows[1:]] == names
    assert rows[1][2:7] == ["3000", "-1000", "900", "200", "100"]
    assert rows[3][2:4] == ["", ""]
    assert "script" not in [tag for tag, _ in page.elements]
    (drawing,) = (own for tag, own in page.elements if tag == "svg")
    width, height = (float(side) for side in drawing["viewbox"].split()[2:])
    circles = [own for tag, own in page.elements if tag == "circle"]
    assert len(circles) == 2
    assert float(circles[0]["cy"]) == pytest.approx(height / 2)
    half = math.sqrt(-2.0 * math.log(0.05) * 900.0)
    assert float(circles[0]["cx"]) == pytest.approx(16.0 + half, rel=1e-3)  # the margin is 8 % of 200 m
    assert width == pytest.approx(half + 100.0 + 32.0, rel=1e-3)
    ring = next(own["d"] for _, own in page.elements if own.get("class") == "ellipse")
    points = np.array([[float(word) for word in pair.split()] for pair in ring[1:-1].split("L")])
    away = (points - [float(circles[0]["cx"]), float(circles[0]["cy"])]) * [1.0, -1.0]
    squared = np.einsum("ni,ij,nj->n", away, np.linalg.inv([[900.0, 200.0], [200.0, 100.0]]), away)
    np.testing.assert_allclose(squared, -2.0 * math.log(0.05), rtol=1e-3)


def test_a_long_page_names_the_total(tmp_path: Path) -> None:
    """Estimates beyond the limit are counted; metres of several planes are an error unless one is named."""
    assert len(PageReader(export(tmp_path, "html", estimates(None), rows=2)).rows) == 3
    assert "The first 2 of 3 estimates are shown." in (tmp_path / "fixes.html").read_text()
    mixed = pa.concat_tables([estimates(None).append_column("frame", pa.nulls(3, pa.string())), estimates()])
    (tmp_path / "fixes.html").unlink()
    for name, more in (("html", {}), ("geojson", {"metres": True})):
        with pytest.raises(DataError, match=f"{name} in metres takes estimates in one plane"):
            export(tmp_path, name, mixed, **more)
    with MapWriter(str(tmp_path / "one.html"), "html", {}, frame=parse_frame("47.37 8.54", "frame")) as writer:
        writer.write(mixed)
    assert len(PageReader(tmp_path / "one.html").rows) == 7


@pytest.mark.parametrize(
    ("target", "name", "found"),
    [("a.geojson", None, "geojson"), ("a.KML", None, "kml"), ("a.parquet", None, None), ("-", "czml", "czml")],
)
def test_the_extension_selects_the_exporter(target: str, name: str | None, found: str | None) -> None:
    """Extension or option select an exporter; table formats do not."""
    assert exporter_of(target, name) == found


def test_measurements_can_not_be_exported_to_a_map(tmp_path: Path) -> None:
    """Measurements without estimates are an error."""
    with pytest.raises(DataError, match="geojson takes estimates"):
        export(tmp_path, "geojson", pa.table({"snapshot": [1], "sensor": ["a"]}))


STATES = """snapshot,tag,time_s,x_m,y_m,cov_xx_m2,cov_xy_m2,cov_yy_m2
0,a,1700000002,0,1,1,0,1
1,b,1700000000,50,1,1,0,1
2,a,1700000000.5,2,1,1,0,1
3,b,1700000001,51,2,1,0,1
4,c,1700000001,51,2,1,0,1
"""


def test_tracks_are_lines_with_times(tmp_path: Path) -> None:
    """Each track of two states or more is a line in order of time, by the columns that separate tracks."""
    (tmp_path / "s.csv").write_text(STATES)
    words = ("--by", "tag", "-p", "acceleration_psd=1", "-q", "-o", "t.parquet")
    assert run_here("track", "s.csv", *words, folder=tmp_path).returncode == 0
    for name in ("geojson", "kml", "czml"):
        done = run_here("convert", "t.parquet", "--origin", "48,11", "-q", "-o", f"t.{name}", folder=tmp_path)
        assert done.returncode == 0, done.stderr
    features = json.loads((tmp_path / "t.geojson").read_text())["features"]
    lines = [one for one in features if one["properties"]["feature"] == "track"]
    assert [one["properties"]["tag"] for one in lines] == ["a", "b"]
    assert lines[0]["properties"]["time_s"] == [1700000000.5, 1700000002.0]
    points = [one["geometry"]["coordinates"] for one in features if one["geometry"]["type"] == "Point"]
    assert lines[0]["geometry"]["coordinates"] == [points[2], points[0]]
    root = ElementTree.parse(tmp_path / "t.kml").getroot()  # noqa: S314 - our own file
    space = "{http://www.google.com/kml/ext/2.2}"
    tracks = list(root.iter(f"{space}Track"))
    whens = [when.text for when in tracks[0].iter("{http://www.opengis.net/kml/2.2}when")]
    assert whens == ["2023-11-14T22:13:20.500000Z", "2023-11-14T22:13:22Z"]
    assert [len(list(track.iter(f"{space}coord"))) for track in tracks] == [2, 2]
    assert len(list(root.iter("{http://www.opengis.net/kml/2.2}TimeStamp"))) == 5
    packets = [one for one in json.loads((tmp_path / "t.czml").read_text()) if one["id"].startswith("track-")]
    assert packets[0]["position"]["epoch"] == "2023-11-14T22:13:20.500000Z"
    assert packets[0]["position"]["cartographicDegrees"][4] == 1.5
