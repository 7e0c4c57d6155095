"""Three dimensions on the command line: localize, its columns, evaluate, and usage errors."""

from __future__ import annotations

import json
import re
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.csv
import pyarrow.parquet
import pytest
from cli_support import Outcome, table_csv
from scipy.stats import chi2

import nlosctl

pytestmark = pytest.mark.extensive

Cli = Callable[..., Outcome]
SENSORS = np.array([[0.0, 0.0, 5.0], [200.0, 10.0, 20.0], [190.0, 220.0, 2.0], [-10.0, 180.0, 30.0]])
SNAPSHOTS = 400


def bearings_file(folder: Path, std_deg: float = 1.0, **columns: Any) -> Path:
    """Write azimuths and elevations of sources over four sensors, with errors, and their truth."""
    draws = np.random.default_rng(3)
    source = np.stack([*draws.uniform(20.0, 180.0, (2, SNAPSHOTS)), draws.uniform(0.0, 80.0, SNAPSHOTS)], axis=1)
    offset = source[:, None] - SENSORS
    errors = np.radians(std_deg) * draws.normal(size=(2, SNAPSHOTS, 4))
    content: dict[str, Any] = {
        "snapshot": np.repeat(np.arange(SNAPSHOTS), 4),
        "sensor": np.tile(["a", "b", "c", "d"], SNAPSHOTS),
        **{f"sensor_{axis}_m": np.tile(SENSORS[:, k], SNAPSHOTS) for k, axis in enumerate("xyz")},
        "bearing_rad": (np.arctan2(offset[..., 1], offset[..., 0]) + errors[0]).ravel(),
        "bearing_std_deg": np.full(4 * SNAPSHOTS, std_deg),
        "elevation_rad": (np.arctan2(offset[..., 2], np.hypot(offset[..., 0], offset[..., 1])) + errors[1]).ravel(),
        "elevation_std_deg": np.full(4 * SNAPSHOTS, std_deg),
        **{f"truth_{axis}_m": np.repeat(source[:, k], 4) for k, axis in enumerate("xyz")},
        **columns,
    }
    path = folder / "in.csv"
    path.write_text(table_csv({name: values for name, values in content.items() if values is not None}))
    return path


def numbers(path: Path, *names: str) -> np.ndarray:
    """Return columns of a CSV file as rows of numbers."""
    table = pyarrow.csv.read_csv(path)
    return np.array([np.array(table.column(name), dtype=float) for name in names])


def test_estimates_in_space_have_true_ellipsoids(cli: Cli, tmp_path: Path) -> None:
    """NEES has mean 3 by NumPy's inverse, and evaluate reports it, the parts of the RMSE, and coverage."""
    out = tmp_path / "out.csv"
    assert cli("localize", bearings_file(tmp_path), "-m", "ml", "--add", "nees,cep50,sep50", "-o", out).code == 0
    axes = [f"{kind}{axis}_m" for kind in ("", "truth_") for axis in "xyz"]
    x, y, z, true_x, true_y, true_z = numbers(out, *axes)
    error = np.stack([x - true_x, y - true_y, z - true_z], axis=1)
    xx, xy, yy, xz, yz, zz = numbers(out, *(f"cov_{axes}_m2" for axes in ("xx", "xy", "yy", "xz", "yz", "zz")))
    covariance = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]).transpose(2, 0, 1)
    nees = np.einsum("ei,eij,ej->e", error, np.linalg.inv(covariance), error)
    (own,) = numbers(out, "nees")
    np.testing.assert_allclose(own, nees, rtol=1e-6)
    assert abs(nees.mean() - 3.0) < 3.3 * np.sqrt(6.0 / SNAPSHOTS)
    (scores,) = cli("evaluate", out, "--json").json["groups"]
    assert scores["nees"] == pytest.approx(nees.mean(), rel=1e-9)
    assert scores["rmse_m"] == pytest.approx(np.sqrt((error**2).sum(axis=1).mean()))
    assert scores["horizontal_rmse_m"] == pytest.approx(np.sqrt((error[:, :2] ** 2).sum(axis=1).mean()))
    assert scores["vertical_rmse_m"] == pytest.approx(np.sqrt((error[:, 2] ** 2).mean()))
    assert scores["bias_z_m"] == pytest.approx(error[:, 2].mean())
    assert scores["inside_95"] == np.count_nonzero(nees <= chi2.ppf(0.95, 3))
    low, high = chi2.ppf([0.025, 0.975], 3 * SNAPSHOTS) / SNAPSHOTS
    assert (scores["nees_low"], scores["nees_high"]) == pytest.approx((low, high))
    draws = np.random.default_rng(0).normal(size=(100_000, 3)) @ np.linalg.cholesky(covariance[7]).T
    sep50, cep50 = numbers(out, "sep50_m", "cep50_m")[:, 7]
    assert sep50 == pytest.approx(np.median(np.linalg.norm(draws, axis=1)), rel=0.01)
    assert cep50 == pytest.approx(np.median(np.linalg.norm(draws[:, :2], axis=1)), rel=0.01)


def test_a_held_height_counts_two_unknowns(cli: Cli, tmp_path: Path) -> None:
    """With the exact height its covariances are 0, and NEES and coverage are those of two unknowns."""
    path, out = bearings_file(tmp_path), tmp_path / "out.csv"
    heights = numbers(path, "truth_z_m")[0].tolist()
    path = bearings_file(tmp_path, target_z_m=heights)
    assert cli("localize", path, "-m", "ml", "-o", out).code == 0
    z, true_z, zz, xz, yz = numbers(out, "z_m", "truth_z_m", "cov_zz_m2", "cov_xz_m2", "cov_yz_m2")
    np.testing.assert_array_equal(z, true_z)
    assert not np.any([zz, xz, yz])
    (scores,) = cli("evaluate", out, "--json").json["groups"]
    assert abs(scores["nees"] - 2.0) < 3.3 * np.sqrt(4.0 / SNAPSHOTS)
    assert 0.92 < scores["coverage_95"] < 0.98
    assert scores["vertical_rmse_m"] == 0.0


def test_measured_heights_enter_the_fix(cli: Cli, tmp_path: Path) -> None:
    """Heights with errors of their std leave a NEES of mean 3, and a variance of z below that of the height."""
    path, out = bearings_file(tmp_path), tmp_path / "out.csv"
    errors = 0.5 * np.repeat(np.random.default_rng(5).normal(size=SNAPSHOTS), 4)
    heights = {"target_z_m": numbers(path, "truth_z_m")[0] + errors, "target_z_std_m": np.full(4 * SNAPSHOTS, 0.5)}
    path = bearings_file(tmp_path, **heights)
    assert cli("localize", path, "-m", "ml", "-o", out).code == 0
    (zz,) = numbers(out, "cov_zz_m2")
    assert (zz < 0.25).all()
    (scores,) = cli("evaluate", out, "--json").json["groups"]
    assert scores["nees_low"] < scores["nees"] < scores["nees_high"]


def test_the_ellipse_is_horizontal_with_an_interval_of_the_height(cli: Cli, tmp_path: Path) -> None:
    """``--ellipse`` has the marginal ellipse of x and y, and the marginal interval of z."""
    out = tmp_path / "out.csv"
    assert cli("localize", bearings_file(tmp_path), "-m", "ls", "--ellipse", "0.95", "-o", out).code == 0
    major, minor, half, xx, xy, yy, zz = numbers(
        out, "semi_major_m", "semi_minor_m", "half_height_m", "cov_xx_m2", "cov_xy_m2", "cov_yy_m2", "cov_zz_m2"
    )
    np.testing.assert_allclose(half, 1.959963984540054 * np.sqrt(zz))
    values = np.linalg.eigvalsh(np.array([[xx, xy], [xy, yy]]).transpose(2, 0, 1))
    np.testing.assert_allclose(np.stack([minor, major], axis=1), np.sqrt(chi2.ppf(0.95, 2) * values), rtol=1e-9)


def test_dilution_of_precision_has_parts(cli: Cli, tmp_path: Path) -> None:
    """GDOP squared is HDOP squared plus VDOP squared, the trace of the inverse of sum (I - u u')."""
    out = tmp_path / "out.csv"
    assert cli("localize", bearings_file(tmp_path), "-m", "ml", "--add", "gdop,hdop,vdop", "-o", out).code == 0
    gdop, hdop, vdop, x, y, z = numbers(out, "gdop", "hdop", "vdop", "x_m", "y_m", "z_m")
    np.testing.assert_allclose(gdop**2, hdop**2 + vdop**2, rtol=1e-9)
    rays = np.stack([x, y, z], axis=1)[:, None] - SENSORS
    unit = rays / np.linalg.norm(rays, axis=2, keepdims=True)
    variances = np.linalg.inv((np.eye(3) - unit[..., None] * unit[..., None, :]).sum(axis=1))
    np.testing.assert_allclose(vdop, np.sqrt(variances[:, 2, 2]), rtol=1e-6)
    np.testing.assert_allclose(gdop, np.sqrt(np.trace(variances, axis1=1, axis2=2)), rtol=1e-6)


def test_estimates_of_two_dimensions_are_not_mixed(cli: Cli, tmp_path: Path) -> None:
    """Estimates with heights beside estimates without are refused in one line."""
    path = bearings_file(tmp_path)
    for dimensions in (2, 3):
        out = tmp_path / f"out{dimensions}.csv"
        assert cli("localize", path, "-m", "ml", "--dimensions", dimensions, "-o", out).code == 0
    done = cli("evaluate", tmp_path / "out2.csv", tmp_path / "out3.csv")
    assert (done.code, done.err.count("\n")) == (1, 1)
    assert "out2.csv: no column 'z_m', but" in done.err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("-m", "sequential"), "method 'sequential' solves in two dimensions, and the input is of three"),
        (("-m", "ml", "--dimensions", "2", "--field=0,1,0,1,0,1"), "has heights, but the input is of two dimensions"),
        (("-m", "ml", "--target-z-std-m", "1"), "--target-z-std-m needs --target-z-m"),
        (("-m", "ml", "--dimensions", "4"), "--dimensions"),
        (("-m", "ml", "--dimensions", "2", "--add", "sep50"), "is of three dimensions, and the input is of two"),
        (("-m", "suppress", "--estimate-std", "file"), "--estimate-std is not for suppress on bearings"),
        (("-m", "ml", "--estimate-std", "snapshot", "-p", "law=vonmises"), "law=vonmises is for two dimensions"),
    ],
)
def test_options_of_the_other_dimension_are_usage_errors(
    cli: Cli, tmp_path: Path, words: tuple[str, ...], message: str
) -> None:
    """A method, region or option of another dimension exits 2 and names it."""
    done = cli("localize", bearings_file(tmp_path), *words)
    assert done.code == 2, done.err
    assert message in done.err


def test_the_truth_of_a_table_has_heights(cli: Cli, tmp_path: Path) -> None:
    """``--truth`` needs ``truth_z_m`` for estimates in space, and gives the scores of the truth beside the rows."""
    path, out = bearings_file(tmp_path), tmp_path / "out.csv"
    assert cli("localize", path, "-m", "ml", "-o", out).code == 0
    table = pyarrow.csv.read_csv(path).select(["snapshot", "truth_x_m", "truth_y_m", "truth_z_m"])
    pyarrow.csv.write_csv(table, tmp_path / "truth.csv")
    scores = [
        cli("evaluate", out, "--json", *words).json["groups"] for words in ((), ("--truth", tmp_path / "truth.csv"))
    ]
    assert scores[0] == scores[1]
    pyarrow.csv.write_csv(table.drop_columns(["truth_z_m"]), tmp_path / "flat.csv")
    done = cli("evaluate", out, "--truth", tmp_path / "flat.csv")
    assert done.code == 1
    assert "no column 'truth_z_m', and the estimates have heights" in done.err


def test_maps_have_heights(cli: Cli, tmp_path: Path) -> None:
    """Points of GeoJSON, KML, CZML and GeoParquet have the height of their estimate."""
    out = tmp_path / "out.csv"
    words = ("--origin", "48,11", "-o", out)
    assert cli("localize", bearings_file(tmp_path), "-m", "ls", "--dimensions", "3", *words).code == 0
    lat, lon, z = (values[0] for values in numbers(out, "lat_deg", "lon_deg", "z_m"))
    assert cli("convert", out, "--to", "geojson", "-o", tmp_path / "m.geojson").code == 0
    first = json.loads((tmp_path / "m.geojson").read_text())["features"][0]
    assert first["geometry"]["coordinates"] == pytest.approx([lon, lat, z])
    assert cli("convert", out, "--to", "kml", "-o", tmp_path / "m.kml").code == 0
    kml = re.search(r"absolute</altitudeMode><coordinates>([^<]+)<", (tmp_path / "m.kml").read_text())
    assert kml is not None
    assert list(map(float, kml[1].split(","))) == pytest.approx([lon, lat, z])
    assert cli("convert", out, "--to", "czml", "-o", tmp_path / "m.czml").code == 0
    packet = json.loads((tmp_path / "m.czml").read_text())[1]
    assert packet["position"]["cartographicDegrees"] == pytest.approx([lon, lat, z])
    assert packet["point"]["heightReference"] == "NONE"
    assert cli("convert", out, "--to", "geoparquet", "-o", tmp_path / "m.geoparquet").code == 0
    table = pyarrow.parquet.read_table(tmp_path / "m.geoparquet")
    assert struct.unpack("<BIddd", table.column("geometry")[0].as_py()) == pytest.approx((1, 1001, lon, lat, z))
    assert json.loads(table.schema.metadata[b"geo"])["columns"]["geometry"]["geometry_types"] == ["Point Z"]


def test_python_has_the_results_of_the_command(cli: Cli, tmp_path: Path) -> None:
    """``dimensions`` and the heights are arguments in Python, with the same estimates to the bit."""
    path, out = bearings_file(tmp_path), tmp_path / "out.parquet"
    words = ("--dimensions", "3", "--target-z-m", "40", "--target-z-std-m", "30")
    assert cli("localize", path, "-m", "ml", *words, "-o", out).code == 0
    own = nlosctl.localize(path, method="ml", dimensions=3, target_z_m=40.0, target_z_std_m=30.0).estimates
    assert own.equals(pyarrow.parquet.read_table(out, partitioning=None), check_metadata=False)
    flat = nlosctl.localize(path, method="ml", dimensions=2).estimates
    assert "z_m" not in flat.column_names
