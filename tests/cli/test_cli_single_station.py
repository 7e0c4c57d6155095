"""Tests of a single station under a spherical ionosphere: one direction and a height give a place."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pyarrow.csv
import pytest
from program import run_here

EARTH_M = 6_371_000.0
SCENE = """
[[sensor]]
name = "station"
position = [0, 0, 0]

[[reflector]]
name = "layer"
kind = "sphere"
center = "earth"
height_m = {height}
"""
HEADER = "snapshot,sensor,azimuth_deg,elevation_deg,bearing_std_deg,elevation_std_deg,reflector,target_height_m"


def located(folder: Path, rows: list[str], header: str, height_m: float, *words: str):
    """Return the estimates of rows of one station under a layer, and the run."""
    (folder / "in.csv").write_text("\n".join([header, *rows]) + "\n")
    (folder / "scene.toml").write_text(SCENE.format(height=height_m))
    done = run_here("localize", "in.csv", "-q", "-o", "out.csv", "--overwrite", *words, folder=folder)
    return (pyarrow.csv.read_csv(folder / "out.csv").to_pydict() if done.returncode == 0 else {}), done


@pytest.mark.parametrize("elevation_deg", [5.0, 20.0, 60.0])
@pytest.mark.parametrize("layer_m", [110e3, 300e3])
def test_one_hop_lands_where_the_triangle_says(tmp_path: Path, elevation_deg: float, layer_m: float):
    """A wave by a layer comes down at 2 (90 deg - e - asin(R cos e / (R + h))) along the ground, to a metre."""
    elevation = math.radians(elevation_deg)
    half = 0.5 * math.pi - elevation - math.asin(EARTH_M * math.cos(elevation) / (EARTH_M + layer_m))
    rows = [f"1,station,60,{elevation_deg},0.5,0.5,layer,0"]
    found, done = located(tmp_path, rows, HEADER, layer_m, "-m", "ml")
    assert done.returncode == 0, done.stderr
    assert found["status"] == ["ok"]
    across, down = EARTH_M * math.sin(2.0 * half), EARTH_M * (math.cos(2.0 * half) - 1.0)
    expected = (across * math.sin(math.radians(60.0)), across * math.cos(math.radians(60.0)), down)
    np.testing.assert_allclose([found[name][0] for name in ("x_m", "y_m", "z_m")], expected, atol=1.0)


def test_covariances_of_one_hop_are_the_size_of_errors(tmp_path: Path):
    """NEES of noisy directions is 3 for a height that is measured too, at 500 to 1300 km."""
    generator = np.random.default_rng(2)
    rows, std, height_std = [], 0.3, 3000.0
    for number in range(500):
        azimuth, elevation = generator.uniform(0.0, 360.0), generator.uniform(15.0, 40.0)
        half = 0.5 * math.pi - math.radians(elevation)
        half -= math.asin(EARTH_M * math.cos(math.radians(elevation)) / (EARTH_M + 300e3))
        radius, height = EARTH_M * math.sin(2.0 * half), EARTH_M * (math.cos(2.0 * half) - 1.0)
        x, y = radius * math.sin(math.radians(azimuth)), radius * math.cos(math.radians(azimuth))
        noise = std * generator.standard_normal(2)
        rows.append(
            f"{number},station,{(azimuth + noise[0]) % 360.0},{elevation + noise[1]},{std},{std},layer,"
            f"{height_std * generator.standard_normal()},{height_std},{x},{y},{height}"
        )
    header = f"{HEADER},target_height_std_m,truth_x_m,truth_y_m,truth_z_m"
    found, done = located(tmp_path, rows, header, 300e3, "-m", "ml")
    assert done.returncode == 0, done.stderr
    error = np.stack([np.array(found[f"{axis}_m"]) - found[f"truth_{axis}_m"] for axis in "xyz"], axis=1)
    covariance = np.empty((500, 3, 3))
    for i, j in ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2)):
        covariance[:, i, j] = covariance[:, j, i] = found[f"cov_{'xyz'[i]}{'xyz'[j]}_m2"]
    nees = np.einsum("ei,ei->e", error, np.linalg.solve(covariance, error[..., None])[..., 0])
    assert 2.6 < nees.mean() < 3.5
    assert 0.93 <= (nees <= 7.815).mean() <= 0.98


def test_a_height_above_ground_needs_a_ground(tmp_path: Path):
    """``target_height_m`` without a sphere or places on earth is a usage error; a linear fit of it one as well."""
    row = ["1,station,60,20,0.5,0.5,,0", "1,other,60,20,0.5,0.5,,0"]
    (tmp_path / "in.csv").write_text("\n".join([HEADER, *row]) + "\n")
    (tmp_path / "scene.toml").write_text(
        '[[sensor]]\nname = "station"\nposition = [0, 0, 0]\n[[sensor]]\nname = "other"\nposition = [9, 0, 0]\n'
    )
    done = run_here("localize", "in.csv", "-m", "ml", "-o", "out.csv", folder=tmp_path)
    assert done.returncode == 2
    assert b"name it target_z_m" in done.stderr
    _, done = located(tmp_path, ["1,station,60,20,0.5,0.5,layer,0"], HEADER, 300e3, "-m", "stansfield")
    assert done.returncode == 2
    assert b"use the method ml" in done.stderr


def test_a_layer_about_the_earth_has_a_height(tmp_path: Path):
    """A sphere about the earth takes height_m alone: without it, or with a radius, the scene is rejected."""
    row = ["1,station,60,20,0.5,0.5,layer,0"]
    (tmp_path / "in.csv").write_text("\n".join([HEADER, *row]) + "\n")
    for wrong, words in (
        ("", b"height_m"),
        ("height_m = 3e5\nradius = 7e6", b"radius"),
        ("height_m = -1", b"height_m"),
    ):
        (tmp_path / "scene.toml").write_text(SCENE.replace("height_m = {height}", wrong))
        done = run_here("localize", "in.csv", "-m", "ml", "-o", "out.csv", folder=tmp_path)
        assert done.returncode == 1
        assert words in done.stderr
