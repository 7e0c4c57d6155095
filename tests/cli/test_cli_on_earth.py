"""Tests of places on earth in three dimensions, from file to file."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pyarrow.csv
import pyproj
import pytest
from program import run_here
from scipy.optimize import least_squares

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
    """Rows by a mirror have no model among places on earth: a usage error says what to do."""
    (tmp_path / "in.csv").write_text(
        "sensor,sensor_lat_deg,sensor_lon_deg,sensor_height_m,azimuth_deg,elevation_deg,bearing_std_deg,"
        "elevation_std_deg,reflector\na,46,8,0,10,5,1,1,wall\nb,46.1,8.2,0,300,4,1,1,\n"
    )
    (tmp_path / "in.scene.toml").write_text(
        '[[reflector]]\nname = "wall"\nkind = "plane"\npoint = [0.0, 0.0, 0.0]\nnormal = [1.0, 0.0, 0.0]\n'
    )
    done = run_here("localize", "in.csv", "-m", "ml", "-o", "out.csv", folder=tmp_path)
    assert done.returncode == 2
    assert b"reflectors have no model among places on earth" in done.stderr


def test_a_height_beside_azimuth_and_elevation_on_earth(tmp_path: Path):
    """Exact directions of pyproj and an exact height: the fix is the source, and its height the given one."""
    source, rows = (46.3, 8.9, 9000.0), []
    target = np.array(ECEF.transform(source[1], source[0], source[2]))
    for name, (lat, lon, height) in {"a": (45.0, 7.0, 500.0), "b": (47.9, 7.2, 1500.0)}.items():
        topocentric = pyproj.Transformer.from_pipeline(
            f"+proj=pipeline +step +proj=cart +ellps=WGS84 +inv +step +proj=cart +ellps=WGS84 "
            f"+step +proj=topocentric +ellps=WGS84 +lat_0={lat} +lon_0={lon} +h_0={height}"
        )
        east, north, up = topocentric.transform(*target)
        azimuth = np.degrees(np.arctan2(east, north)) % 360.0
        elevation = np.degrees(np.arctan2(up, np.hypot(east, north)))
        rows.append(f"{name},{lat},{lon},{height},{azimuth:.12f},{elevation:.12f},0.1,0.1,9000")
    header = (
        "sensor,sensor_lat_deg,sensor_lon_deg,sensor_height_m,azimuth_deg,elevation_deg,bearing_std_deg,"
        "elevation_std_deg,target_height_m"
    )
    found = solved(tmp_path, rows, header, "-m", "ml")
    assert distance_m(source[0], source[1], found["lat_deg"][0], found["lon_deg"][0]) < 0.01
    assert (found["height_m"], found["cov_zz_m2"]) == ([9000.0], [0.0])


def drawn_on_earth(snapshots: int, sensors: int, height_std_m: float, *, offset_m: float) -> list[dict[str, float]]:
    """Return rows of sensors and sources in central Europe: distances in space, with errors of 100 m, and heights."""
    generator, rows = np.random.default_rng(sensors), []
    for number in range(snapshots):
        lat, lon = generator.uniform([40.0, -5.0], [55.0, 20.0])
        target = np.array(ECEF.transform(lon, lat, 10000.0))
        measured = 10000.0 + height_std_m * generator.standard_normal()
        for sensor in range(sensors):
            at_lat, at_lon, height = generator.uniform([36.0, -10.0, 0.0], [60.0, 25.0, 1000.0])
            away = np.linalg.norm(target - ECEF.transform(at_lon, at_lat, height)) + offset_m
            rows.append(
                {
                    "snapshot": number,
                    "sensor": sensor,
                    "sensor_lat_deg": at_lat,
                    "sensor_lon_deg": at_lon,
                    "sensor_height_m": height,
                    "away_m": away + 100.0 * generator.standard_normal(),
                    "target_height_m": measured,
                    "target_height_std_m": height_std_m,
                    "truth_lat_deg": lat,
                    "truth_lon_deg": lon,
                    "truth_z_m": 10000.0,
                }
            )
    return rows


@pytest.mark.parametrize(
    ("kind", "sensors", "height_std_m"),
    [("arrival_m", 5, 100.0), ("arrival_m", 3, 0.0), ("arrival_m", 3, 100.0), ("range_m", 4, 100.0)],
)
def test_measured_heights_over_a_curved_earth(tmp_path: Path, kind: str, sensors: int, height_std_m: float):
    """Each fix, alternatives too, is an optimum of arrivals (ranges) and height above the ellipsoid, found by scipy.

    Sources and sensors are up to 2500 km apart: a flat plane would put the altitude hundreds of kilometres wrong.
    """
    rows = drawn_on_earth(25, sensors, height_std_m, offset_m=1e5 if kind == "arrival_m" else 0.0)
    header = ",".join(rows[0]).replace("away_m", kind)
    lines = [",".join(f"{value:.12g}" for value in row.values()) for row in rows]
    std = ["--arrival-std-m" if kind == "arrival_m" else "--range-std-m", "100"]
    found = solved(tmp_path, lines, header, "-m", "ml", "--alternatives", "2", *std)
    answered = 0
    for index, number in enumerate(found["snapshot"]):
        if found["lat_deg"][index] is None:
            continue
        mine = [row for row in rows if row["snapshot"] == number]
        at = np.array(
            [ECEF.transform(row["sensor_lon_deg"], row["sensor_lat_deg"], row["sensor_height_m"]) for row in mine]
        )
        measured = np.array([row["away_m"] for row in mine])
        height = mine[0]["target_height_m"]

        def residuals(point, at=at, measured=measured, height=height):
            excess = measured - np.linalg.norm(point - at, axis=1)
            above = ECEF.transform(*point, direction="INVERSE")[2] - height
            excess = excess - excess.mean() if kind == "arrival_m" else excess
            return np.append(excess / 100.0, above / (height_std_m or 1e-3))

        fix = np.array(ECEF.transform(found["lon_deg"][index], found["lat_deg"][index], found["height_m"][index]))
        optimum = least_squares(residuals, fix, x_scale=1e3, xtol=1e-14, ftol=1e-14, gtol=1e-14)
        std_m = np.sqrt(found["cov_xx_m2"][index] + found["cov_yy_m2"][index] + found["cov_zz_m2"][index])
        assert np.linalg.norm(optimum.x - fix) < 1e-3 * std_m
        assert found["cost"][index] == pytest.approx(optimum.cost, abs=1e-6)
        answered += 1
    assert answered >= 22


def test_arrivals_and_their_bound_on_earth(tmp_path: Path):
    """NEES of fixes with altitudes has mean 3, and the bound at the truth is the size of the covariances."""
    rows = drawn_on_earth(150, 6, 100.0, offset_m=3e7)
    header = ",".join(rows[0]).replace("away_m", "arrival_m")
    lines = [",".join(f"{value:.12g}" for value in row.values()) for row in rows]
    found = solved(tmp_path, lines, header, "-m", "ml", "--arrival-std-m", "100", "--add", "nees")
    assert found["status"] == ["ok"] * 150
    assert 2.55 < np.mean(found["nees"]) < 3.45
    words = ["bound", "in.csv", "--dimensions", "3", "--arrival-std-m", "100", "-o", "bound.csv"]
    assert run_here(*words, folder=tmp_path).returncode == 0
    bound = pyarrow.csv.read_csv(tmp_path / "bound.csv").to_pydict()
    for axis in ("xx", "yy", "zz"):
        ratio = np.array(bound[f"bound_{axis}_m2"]) / np.array(found[f"cov_{axis}_m2"])
        assert 0.98 < np.median(ratio) < 1.02
    std = np.sqrt(np.array(found["cov_xx_m2"]) * np.array(found["offset_std_m"]) ** 2)
    assert (np.abs(found["cov_x_offset_m2"]) <= std).all()


def drawn_azimuths(snapshots: int, share: float, seed: int) -> tuple[str, list[str]]:
    """Return header and rows of azimuths at six stations to .3 degrees, a share of them anywhere."""
    generator, rows = np.random.default_rng(seed), []
    stations = {**STATIONS, "D": (60.0, 10.0), "E": (38.0, -6.0), "F": (46.0, 22.0)}
    for number in range(snapshots):
        lat, lon = generator.uniform([38.0, -10.0], [60.0, 25.0])
        for name, (at_lat, at_lon) in stations.items():
            azimuth = GEOD.inv(at_lon, at_lat, lon, lat)[0] + 0.3 * generator.standard_normal()
            wrong = generator.random() < share
            azimuth = generator.uniform(0.0, 360.0) if wrong else azimuth % 360.0
            rows.append(f"{number},{name},{at_lat},{at_lon},0,{azimuth},0.3,{lat},{lon},0")
    header = (
        "snapshot,sensor,sensor_lat_deg,sensor_lon_deg,sensor_height_m,azimuth_deg,bearing_std_deg,"
        "truth_lat_deg,truth_lon_deg,truth_z_m"
    )
    return header, rows


@pytest.mark.parametrize("method", ["mixture-ml", "suppress"])
def test_long_range_azimuths_with_outliers(tmp_path: Path, method: str):
    """With a fifth of the azimuths anywhere most fixes are ok, within 40 km, with covariances of that size."""
    header, rows = drawn_azimuths(100, 0.2, 2)
    found = solved(tmp_path, rows, header, "-m", method, "--alternatives", "1", "--add", "nees")
    ok = np.array(found["status"]) == "ok"
    assert ok.mean() > 0.85
    places = zip(found["truth_lat_deg"], found["truth_lon_deg"], found["lat_deg"], found["lon_deg"], strict=True)
    away = np.array([distance_m(*map(float, place)) for place, good in zip(places, ok, strict=True) if good])
    assert np.percentile(away, 95.0) < 40e3
    nees = np.array(found["nees"], dtype=float)[ok]
    assert 1.0 < np.median(nees) < 1.9
    assert np.mean(nees < 5.991) > 0.9
    assert set(np.array(found["height_m"], dtype=float)[ok]) == {0.0}


def test_the_share_of_outliers_is_estimated_on_earth(tmp_path: Path):
    """``alpha=estimate`` finds the share of azimuths that are anywhere: a fifth."""
    header, rows = drawn_azimuths(70, 0.2, 3)
    (tmp_path / "in.csv").write_text("\n".join([header, *rows]) + "\n")
    words = ("--dimensions", "3", "-m", "mixture-ml", "-p", "alpha=estimate", "-o", "out.csv", "--report", "r.json")
    done = run_here("localize", "in.csv", *words, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    match = re.search(rb"alpha = ([0-9.]+), estimated", done.stderr)
    assert match is not None
    assert 0.15 < float(match[1]) < 0.25


def test_a_region_in_metres_has_no_meaning_on_earth(tmp_path: Path):
    """A search region of x and y beside places on earth in three dimensions is a usage error."""
    header, rows = drawn_azimuths(1, 0.0, 4)
    (tmp_path / "in.csv").write_text("\n".join([header, *rows]) + "\n")
    words = ("--dimensions", "3", "-m", "mixture-ml", "--field", "circle:0,0,1e6", "-o", "out.csv")
    done = run_here("localize", "in.csv", *words, folder=tmp_path)
    assert done.returncode == 2
    assert b"set --field to sensors:FACTOR" in done.stderr


@pytest.mark.parametrize("method", ["mixture-ml", "suppress"])
@pytest.mark.parametrize("height_std_m", [0.0, 50.0])
def test_outliers_beside_a_measured_height_over_a_curved_earth(tmp_path: Path, method: str, height_std_m: float):
    """Directions of an aircraft over 400 km, a quarter anywhere, and its height: nearly all fixes are ok, NEES is D."""
    generator, rows = np.random.default_rng(5), []
    stations = generator.uniform([45.0, 6.0, 0.0], [48.0, 12.0, 1500.0], (6, 3))
    for number in range(60):
        lat, lon, height = generator.uniform([45.5, 7.0, 8000.0], [47.5, 11.0, 11000.0])
        target = np.array(ECEF.transform(lon, lat, height))
        measured = height + height_std_m * generator.standard_normal()
        for sensor, (at_lat, at_lon, at_height) in enumerate(stations):
            turn_lat, turn_lon = np.radians([at_lat, at_lon])
            away = target - ECEF.transform(at_lon, at_lat, at_height)
            up = np.array([np.cos(turn_lat) * np.cos(turn_lon), np.cos(turn_lat) * np.sin(turn_lon), np.sin(turn_lat)])
            east = np.array([-np.sin(turn_lon), np.cos(turn_lon), 0.0])
            azimuth = np.degrees(np.arctan2(east @ away, np.cross(up, east) @ away))
            elevation = np.degrees(np.arcsin(up @ away / np.linalg.norm(away)))
            azimuth, elevation = np.array([azimuth, elevation]) + 0.1 * generator.standard_normal(2)
            if generator.random() < 0.25:
                azimuth, elevation = generator.uniform([0.0, -90.0], [360.0, 90.0])
            rows.append(
                f"{number},s{sensor},{at_lat},{at_lon},{at_height},{azimuth % 360.0},{elevation},0.1,0.1,{measured},"
                f"{height_std_m},{lat},{lon},{height}"
            )
    header = (
        "snapshot,sensor,sensor_lat_deg,sensor_lon_deg,sensor_height_m,azimuth_deg,elevation_deg,bearing_std_deg,"
        "elevation_std_deg,target_height_m,target_height_std_m,truth_lat_deg,truth_lon_deg,truth_z_m"
    )
    found = solved(tmp_path, rows, header, "-m", method, "--alternatives", "1", "--add", "nees")
    ok = np.array(found["status"]) == "ok"
    assert ok.mean() > 0.95
    nees = np.array(found["nees"], dtype=float)[ok]
    assert (1.4 < nees.mean() < 2.8) if height_std_m == 0.0 else (2.1 < nees.mean() < 4.1)
