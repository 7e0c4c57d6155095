"""Geographic coordinates, ellipses, CEP50 and GDOP on the command line."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.csv
import pyproj
import pytest
from cli_support import FIXTURES, Outcome
from scipy.stats import multivariate_normal

import nlosctl
from nlosctl.errors import UsageError

pytestmark = pytest.mark.extensive

GEOD = pyproj.Geod(ellps="WGS84")
SOURCE = (47.36, 8.58)
SENSORS = {"a": (47.37, 8.54), "b": (47.40, 8.60), "c": (47.33, 8.62)}


def bearings(folder: Path, std_deg: float = 1.0) -> str:
    """Write exact true azimuths to the source, and return the file's name."""
    path = folder / "bearings.csv"
    rows = ["snapshot,sensor,sensor_lat_deg,sensor_lon_deg,azimuth_deg,bearing_std_deg,truth_lat_deg,truth_lon_deg"]
    for name, (lat, lon) in SENSORS.items():
        azimuth = GEOD.inv(lon, lat, SOURCE[1], SOURCE[0])[0] % 360.0
        rows.append(f"1,{name},{lat},{lon},{azimuth:.9f},{std_deg},{SOURCE[0]},{SOURCE[1]}")
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return str(path)


def off_m(row: dict[str, Any]) -> float:
    """Return the distance of an estimate from the source on the ellipsoid, in metres."""
    return float(GEOD.inv(row["lon_deg"], row["lat_deg"], SOURCE[1], SOURCE[0])[2])


@pytest.mark.parametrize("words", [[], ["--crs", "EPSG:32632"], ["--crs", "EPSG:2056"], ["--origin", "47.3,8.6,40"]])
def test_fixes_have_geographic_coordinates(cli: Any, tmp_path: Path, words: list[str]) -> None:
    """In any plane the fix has the source's latitude and longitude, and is compared with the truth."""
    outcome: Outcome = cli("localize", bearings(tmp_path), *words)
    assert outcome.code == 0, outcome.err
    (row,) = outcome.table.to_pylist()
    assert off_m(row) < 0.05
    assert math.hypot(row["x_m"] - row["truth_x_m"], row["y_m"] - row["truth_y_m"]) < 0.05
    assert (
        row["frame"]
        == {"--crs": words[1] if words else "", "--origin": "47.3 8.6 40.0", "": "47.37 8.54"}[
            words[0] if words else ""
        ]
    )


def test_the_frame_goes_through_flags_and_pipes(cli: Any, tmp_path: Path) -> None:
    """Flags of a file in degrees are in degrees: solving them gives the same fix."""
    flags = str(tmp_path / "flags.csv")
    first = cli("localize", bearings(tmp_path), "--flags-out", flags)
    again = cli("localize", flags)
    assert again.code == 0, again.err
    assert again.out == first.out
    assert "sensor_x_m" not in Path(flags).read_text(encoding="utf-8")


def test_errors_of_the_plane_are_reported(cli: Any, tmp_path: Path) -> None:
    """The summary states the direction error of the plane if it matters beside the std."""
    name = bearings(tmp_path)
    assert "flat plane" not in cli("localize", name).err
    output = cli("localize", name, "--origin", "40,0").err
    assert "the scene is large for a flat plane: it turns lines by up to 0.23 deg (23% of the stated std" in output


def test_crs_and_origin_exclude_each_other(cli: Any, tmp_path: Path) -> None:
    """--crs with --origin is a usage error."""
    outcome = cli("localize", bearings(tmp_path), "--crs", "EPSG:32632", "--origin", "47,8")
    assert (outcome.code, outcome.out) == (2, b"")
    assert "give one" in outcome.err


def test_the_functions_take_an_origin_or_a_crs(cli: Any, tmp_path: Path) -> None:
    """From Python the origin is two numbers; the fix is that of the command, and both at once are refused."""
    name = bearings(tmp_path)
    (row,) = cli("localize", name, "--origin", "47.3,8.6").table.to_pylist()
    table = pyarrow.csv.read_csv(name)
    (same,) = nlosctl.localize(table, origin=(47.3, 8.6)).estimates.to_pylist()
    assert (same["lat_deg"], same["lon_deg"], same["x_m"]) == (row["lat_deg"], row["lon_deg"], row["x_m"])
    with pytest.raises(UsageError, match="give one"):
        nlosctl.localize(table, origin=(47.3, 8.6), crs="EPSG:32632")


def test_the_bound_reads_degrees_too(cli: Any, tmp_path: Path) -> None:
    """The bound at a true position in degrees is equal to that of the same position in metres."""
    (row,) = cli("bound", bearings(tmp_path)).table.to_pylist()
    (fix,) = cli("localize", bearings(tmp_path)).table.to_pylist()
    assert row["bound_xx_m2"] == pytest.approx(fix["cov_xx_m2"], rel=1e-5)


@pytest.mark.parametrize("share", [0.5, 0.95])
def test_ellipses_have_their_coverage(cli: Any, share: float) -> None:
    """Draws from the covariance are in the ellipse with its probability, and half of them within CEP50."""
    table = cli("localize", str(FIXTURES / "good_bearings.parquet"), "--ellipse", str(share), "--add", "cep50").table
    row = table.to_pylist()[0]
    covariance = [[row["cov_xx_m2"], row["cov_xy_m2"]], [row["cov_xy_m2"], row["cov_yy_m2"]]]
    draws = multivariate_normal(cov=covariance, seed=1).rvs(40_000)
    cos, sin = math.cos(row["orientation_rad"]), math.sin(row["orientation_rad"])
    along, across = draws @ [cos, sin], draws @ [-sin, cos]
    inside = (along / row["semi_major_m"]) ** 2 + (across / row["semi_minor_m"]) ** 2 <= 1.0
    assert inside.mean() == pytest.approx(share, abs=0.01)
    assert (np.hypot(*draws.T) <= row["cep50_m"]).mean() == pytest.approx(0.5, abs=0.01)
    assert row["ellipse_probability"] == share


def square(folder: Path, kind: str) -> str:
    """Write four sensors on a square about the source, and return the file's name."""
    path = folder / f"{kind}.csv"
    corners = [(100.0, 0.0), (0.0, 100.0), (-100.0, 0.0), (0.0, -100.0)]
    lines = [
        "sensor,sensor_x_m,sensor_y_m," + ("range_m,range_std_m" if kind == "ranges" else "bearing_rad,bearing_std_rad")
    ]
    for number, (x, y) in enumerate(corners):
        measured = "100,0.5" if kind == "ranges" else f"{math.atan2(-y, -x)},0.01"
        lines.append(f"{number},{x},{y},{measured}")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return str(path)


@pytest.mark.parametrize("kind", ["ranges", "bearings"])
def test_the_gdop_of_a_square_is_one(cli: Any, tmp_path: Path, kind: str) -> None:
    """Four rows from all sides give sqrt(1/2 + 1/2) = 1 metre per metre for any std."""
    (row,) = cli("localize", square(tmp_path, kind), "--add", "gdop").table.to_pylist()
    assert row["gdop"] == pytest.approx(1.0, abs=1e-6)


def test_the_gdop_is_that_of_the_rows_used(cli: Any, tmp_path: Path) -> None:
    """GDOP is sqrt(trace((H' H)^-1)) of the used rows' unit vectors at the fix."""
    name = str(FIXTURES / "good_ranges.csv")
    row = cli("localize", name, "--add", "gdop,cep50").table.to_pylist()[1]
    with Path(name).open(encoding="utf-8") as file:
        head = file.readline().strip().split(",")
        rows = [dict(zip(head, line.strip().split(","), strict=True)) for line in file]
    mine = [cells for cells in rows if cells["snapshot"] == str(row["snapshot"])]
    away = np.array([[row["x_m"] - float(c["sensor_x_m"]), row["y_m"] - float(c["sensor_y_m"])] for c in mine])
    unit = away / np.linalg.norm(away, axis=1, keepdims=True)
    assert row["gdop"] == pytest.approx(math.sqrt(np.trace(np.linalg.inv(unit.T @ unit))), rel=1e-9)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--ellipse", "1.5"], "--ellipse must be a probability between 0 and 1. Got 1.5 instead."),
        (["--add", "cep95"], "--add cep95: no such column (did you mean 'cep50'?); there are: cep50, sep50, gdop"),
    ],
)
def test_invalid_coverage_and_columns(cli: Any, words: list[str], message: str) -> None:
    """An invalid coverage and an unknown column are usage errors."""
    outcome = cli("localize", str(FIXTURES / "good_bearings.csv"), *words)
    assert (outcome.code, outcome.out) == (2, b"")
    assert message in outcome.err
