"""Tests of places on earth in three dimensions, from file to file."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pyarrow.csv
import pyproj
from program import run_here

GEOD = pyproj.Geod(ellps="WGS84")
ECEF = pyproj.Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True)
STATIONS = {"A": (48.0, 2.0), "B": (52.0, 13.0), "C": (41.0, 12.0)}


def solved(folder: Path, rows: list[str], header: str, *words: str) -> dict[str, list]:
    """Return the estimates of a file of rows."""
    (folder / "in.csv").write_text("\n".join([header, *rows]) + "\n")
    done = run_here("localize", "in.csv", "--dimensions", "3", "-o", "out.csv", "-q", *words, folder=folder)
    assert done.returncode == 0, done.stderr
    return pyarrow.csv.read_csv(folder / "out.csv").to_pydict()


def distance_m(lat: float, lon: float, to_lat: float, to_lon: float) -> float:
    """Return the length of the geodesic."""
    return GEOD.inv(lon, lat, to_lon, to_lat)[2]


def test_long_range_azimuths_meet_at_the_source(tmp_path: Path):
    """Exact azimuths of pyproj at three stations 500 to 3000 km away give each source to a metre, at its height."""
    sources = [(36.0, -5.0), (60.0, 25.0), (38.0, 30.0), (47.0, 20.0)]
    rows = [
        f"{number},{name},{lat},{lon},0,{GEOD.inv(lon, lat, source[1], source[0])[0] % 360.0:.10f},0.5,120"
        for number, source in enumerate(sources)
        for name, (lat, lon) in STATIONS.items()
    ]
    header = "snapshot,sensor,sensor_lat_deg,sensor_lon_deg,sensor_height_m,azimuth_deg,bearing_std_deg,target_height_m"
    for method in ("ml", "stansfield", "ls"):
        found = solved(tmp_path, rows, header, "-m", method, "--overwrite")
        assert found["status"] == ["ok"] * 4
        assert found["height_m"] == [120.0] * 4
        assert found["cov_zz_m2"] == [0.0] * 4
        for place, lat, lon in zip(sources, found["lat_deg"], found["lon_deg"], strict=True):
            assert distance_m(*place, lat, lon) < 1.0


def test_azimuth_and_elevation_at_each_horizon(tmp_path: Path):
    """Azimuths from north and elevations above each horizon, by pyproj, give place and height to a centimetre."""
    source = (46.3, 8.9, 9000.0)
    target = np.array(ECEF.transform(source[1], source[0], source[2]))
    rows = []
    for name, (lat, lon, height) in {
        "a": (46.0, 8.0, 500.0),
        "b": (46.9, 8.2, 1500.0),
        "c": (45.9, 9.6, 200.0),
    }.items():
        topocentric = pyproj.Transformer.from_pipeline(
            f"+proj=pipeline +step +proj=cart +ellps=WGS84 +inv +step +proj=cart +ellps=WGS84 "
            f"+step +proj=topocentric +ellps=WGS84 +lat_0={lat} +lon_0={lon} +h_0={height}"
        )
        east, north, up = topocentric.transform(*target)
        azimuth, elevation = (
            np.degrees(np.arctan2(east, north)) % 360.0,
            np.degrees(np.arctan2(up, np.hypot(east, north))),
        )
        rows.append(f"{name},{lat},{lon},{height},{azimuth:.12f},{elevation:.12f},0.1,0.1")
    header = (
        "sensor,sensor_lat_deg,sensor_lon_deg,sensor_height_m,azimuth_deg,elevation_deg,bearing_std_deg,"
        "elevation_std_deg"
    )
    found = solved(tmp_path, rows, header, "-m", "ml")
    assert distance_m(source[0], source[1], found["lat_deg"][0], found["lon_deg"][0]) < 0.01
    assert abs(found["height_m"][0] - source[2]) < 0.01
    assert found["frame"][0].endswith("ellipsoid")


def test_errors_are_in_local_axes(tmp_path: Path):
    """NEES compares places in east, north and up: of noisy long-range azimuths its mean is 2."""
    generator = np.random.default_rng(1)
    rows, std = [], 0.05
    for number in range(400):
        lat, lon = generator.uniform([35.0, -10.0], [58.0, 35.0])
        for name, (at_lat, at_lon) in STATIONS.items():
            azimuth = GEOD.inv(at_lon, at_lat, lon, lat)[0] + std * generator.standard_normal()
            rows.append(f"{number},{name},{at_lat},{at_lon},0,{azimuth % 360.0:.10f},{std},{lat},{lon},0")
    header = (
        "snapshot,sensor,sensor_lat_deg,sensor_lon_deg,sensor_height_m,azimuth_deg,bearing_std_deg,"
        "truth_lat_deg,truth_lon_deg,truth_z_m"
    )
    found = solved(tmp_path, rows, header, "-m", "ml", "--add", "nees")
    nees = np.array([value for value in found["nees"] if value != "" and value is not None], dtype=float)
    assert nees.size > 360
    assert 1.7 < nees.mean() < 2.4
    done = run_here("evaluate", "out.csv", "--json", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert abs(json.loads(done.stdout)["groups"][0]["nees"] - nees.mean()) < 1e-6


def test_reflectors_on_earth_are_refused(tmp_path: Path):
    """A measured height beside elevations has no model among places on earth: a usage error says what to do."""
    (tmp_path / "in.csv").write_text(
        "sensor,sensor_lat_deg,sensor_lon_deg,sensor_height_m,azimuth_deg,elevation_deg,bearing_std_deg,elevation_std_deg\n"
        "a,46,8,0,10,5,1,1\nb,46.1,8.2,0,300,4,1,1\n"
    )
    done = run_here("localize", "in.csv", "-m", "ml", "--target-z-m", "100", "-o", "out.csv", folder=tmp_path)
    assert done.returncode == 2
    assert b"measured height of the target on earth is for azimuths alone" in done.stderr
