"""Paths of DeepMIMO scenarios: one NPZ file or a folder, triplets or bearings, compared with the geometry."""

from __future__ import annotations

import math
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io
from program import run_here

import nlosctl
from nlosctl.errors import DataError
from nlosctl.pipeline.convert.importer import Import

FORMATS = Path(__file__).parents[2] / "fixtures" / "formats"
TARGET = (12.0, 9.0)
LIGHT_M_S = 299_792_458.0


def arrays() -> dict[str, Any]:
    """Return the matrices of the sample."""
    with np.load(FORMATS / "deepmimo_paths.npz") as loaded:
        return {name: loaded[name] for name in loaded.files}


def table(folder: Path, changed: dict[str, Any], **parameters: Any) -> Any:
    """Return the table of the sample with other matrices, None for one that is absent."""
    kept = {name: value for name, value in {**arrays(), **changed}.items() if value is not None}
    np.savez(folder / "x.npz", **kept)
    return Import("deepmimo", parameters).read(str(folder / "x.npz")).table


def test_triplets_of_single_and_double_bounces(tmp_path: Path) -> None:
    """Paths without line of sight are triplets; lengths and angles are those of the points, the target's is direct."""
    rows = table(tmp_path, {}, target="12,9").to_pylist()
    assert [(row["snapshot"], row["interactions"], row["truth_ip"]) for row in rows] == [
        (0, 1, False),
        (1, 1, False),
        (2, 1, False),
        (3, 1, False),
        (3, 2, True),
    ]
    for row in rows[:4]:
        rx = (row["rx_x_m"], row["rx_y_m"])
        assert row["path_length_m"] == pytest.approx(math.hypot(*TARGET) + math.dist(TARGET, rx), rel=1e-6)
        assert row["dod_rad"] == pytest.approx(math.atan2(9.0, 12.0), abs=1e-6)
        assert row["doa_rad"] == pytest.approx(math.atan2(9.0 - rx[1], 12.0 - rx[0]), abs=1e-6)
        assert (row["dod_elevation_deg"], row["doa_elevation_deg"]) == pytest.approx((0.0, 0.0))
        assert (row["tx_z_m"], row["rx_z_m"]) == (1.5, 1.5)


def test_the_target_is_found(tmp_path: Path) -> None:
    """Every user's bounce on the target gives its position."""
    words = [
        "-p",
        "target=12,9",
        "-p",
        "bearing_std_deg=1",
        "-p",
        "range_std_m=0.3",
        "-q",
        "-o",
        str(tmp_path / "t.parquet"),
    ]
    assert run_here("convert", str(FORMATS / "deepmimo_paths.npz"), "--from", "auto", *words).returncode == 0
    done = run_here("localize", "t.parquet", "-q", "-o", "e.parquet", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    fixes = nlosctl.read(tmp_path / "e.parquet").to_pylist()
    assert len(fixes) == 5
    for fix in fixes[:4]:
        assert math.dist((fix["x_m"], fix["y_m"]), TARGET) < 1e-3


def test_bearings_of_the_base_station(tmp_path: Path) -> None:
    """With kind=bearings the base station is the source, and line of sight is its truth."""
    rows = table(tmp_path, {}, kind="bearings").to_pylist()
    assert [row["truth_los"] for row in rows] == [True, False, True, False, True, False, True, False, False]
    for row in rows[::2][:4]:
        true = math.atan2(-row["sensor_y_m"], -row["sensor_x_m"])
        assert math.remainder(row["bearing_rad"] - true, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-6)
        assert row["range_m"] == pytest.approx(math.hypot(row["sensor_x_m"], row["sensor_y_m"]), rel=1e-6)
    assert {row["snapshot"] for row in rows} == {0}


def scenario(folder: Path, extension: str) -> Path:
    """Write a scenario of two base stations and two sets of users, each a copy of the sample's."""
    path = folder / "scenario"
    path.mkdir()
    for station in (0, 1):
        for users in (0, 1):
            for name, matrix in arrays().items():
                stem = path / f"{name}_t001_tx{station:03}_r{users:03}"
                if extension == "mat":
                    scipy.io.savemat(f"{stem}.mat", {name: matrix})
                else:
                    np.savez_compressed(f"{stem}.npz", **{name: matrix})
    (path / "params.json").write_text("{}")
    return path


@pytest.mark.parametrize("extension", ["npz", "mat"])
@pytest.mark.parametrize("importer", ["auto", "deepmimo"])
def test_scenario_folders(tmp_path: Path, extension: str, importer: str) -> None:
    """Every transmitter and set of receivers is read: transmitters are snapshots of bearings, links of triplets."""
    path = scenario(tmp_path, extension)
    rows = Import(importer, {"kind": "bearings"}).read(str(path)).table.to_pylist()
    assert [row["snapshot"] for row in rows] == [0] * 18 + [1] * 18
    assert sorted({row["sensor"] for row in rows}) == [f"rx{number}" for number in range(8)]
    rows = Import(importer, {}).read(str(path)).table.to_pylist()
    assert [row["snapshot"] for row in rows] == [4 * k + n for k in range(4) for n in (0, 1, 2, 3, 3)]


def test_the_folder_of_the_sample_equals_its_file() -> None:
    """A folder and one NPZ file with the same matrices give the same table."""
    of_file = Import("auto", {}).read(str(FORMATS / "deepmimo_paths.npz")).table
    assert Import("auto", {}).read(str(FORMATS / "deepmimo_scenario")).table.equals(of_file)


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"delay": None}, "no array 'delay'; got .*, expected aoa_az, aod_az, delay, inter, rx_pos, tx_pos"),
        ({"aoa_az": np.zeros((4, 2))}, r"array 'aoa_az': got float64 of shape \(4, 2\), expected numbers of shape"),
        ({"delay": np.zeros(4)}, r"array 'delay': got shape \(4,\), expected \(receivers, paths\)"),
        ({"tx_pos": np.zeros((2, 3))}, r"array 'tx_pos': got shape \(2, 3\), expected one position"),
        ({"inter_pos": np.zeros((4, 3, 3))}, "array 'inter_pos': got shape"),
        ({"inter": np.full((4, 3), "LoS")}, "array 'inter': got <U3"),
        ({"delay": np.full((4, 3), np.nan)}, "no rows: the file contains no measurement"),
        ({"aoa_az": arrays()["aod_az"]}, "array 'aoa_az': a line-of-sight path arrives 180 deg off its transmitter"),
    ],
)
def test_invalid_matrices(tmp_path: Path, changed: dict[str, Any], says: str) -> None:
    """Missing matrices, wrong shapes and angles of another frame are errors with their name."""
    with pytest.raises(DataError, match=says):
        table(tmp_path, changed)


def test_folders_that_are_not_scenarios(tmp_path: Path) -> None:
    """Other folders are errors in one line, for ``auto``, for this importer and for others."""
    (tmp_path / "f").mkdir()
    with pytest.raises(DataError, match="is a folder without files"):
        Import("auto", {}).read(str(tmp_path / "f"))
    (tmp_path / "f" / "notes.txt").write_text("no\n")
    (tmp_path / "f" / "more.txt").write_text("no\n")
    for importer, says in (("auto", "no importer recognizes it"), ("deepmimo", "no matrices of DeepMIMO 4")):
        with pytest.raises(DataError, match=says):
            Import(importer, {}).read(str(tmp_path / "f"))
    shutil.copytree(FORMATS / "deepmimo_scenario", tmp_path / "s")
    done = run_here("convert", "s", "--from", "uwb", "-o", "x.csv", folder=tmp_path)
    assert (done.returncode, b"looks like a file for the importer 'deepmimo'" in done.stderr) == (1, True)
