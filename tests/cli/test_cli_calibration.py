"""``--calibration``: offsets off, standard deviations scaled, the offsets' covariance in weights and covariances."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pytest
from calibration_worlds import HALL, joined, session
from program import run_here

import nlosctl
from nlosctl.contract.calibration import Calibration, SensorOffset
from nlosctl.errors import UsageError

EXACT = """
[[sensor]]
name = "s0"
range_offset_m = 0.4
std_scale = 2.0

[[sensor]]
name = "s1"
range_offset_m = -0.2
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with measurements ``m.csv``, the same after the offsets of ``exact.toml``, and ``full.toml``."""
    folder = tmp_path_factory.mktemp("calibration")
    table, _ = session("ranges", 20, seed=1)
    pyarrow.csv.write_csv(pa.table(table), folder / "m.csv")
    offset = {"s0": 0.4, "s1": -0.2}
    table["range_m"] = table["range_m"] - np.array([offset.get(name, 0.0) for name in table["sensor"]])
    table["range_std_m"] = np.where(table["sensor"] == "s0", 2.0, 1.0) * table["range_std_m"]
    pyarrow.csv.write_csv(pa.table(table), folder / "by_hand.csv")
    (folder / "exact.toml").write_text(EXACT)
    assert run_here("calibrate", "m.csv", "-q", "-o", "full.toml", folder=folder).returncode == 0
    return folder


def output(folder: Path, *words: str) -> bytes:
    """Return the standard output of a run that succeeds."""
    done = run_here(*words, "-q", folder=folder)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("words", [("localize", "-m", "ml"), ("localize", "-m", "mixture-ml"), ("bound",)])
def test_exact_offsets_are_those_taken_off_by_hand(folder: Path, words: tuple[str, ...]) -> None:
    """Without stds of the offsets the results are those of measurements corrected and stds scaled by hand."""
    assert output(folder, *words, "m.csv", "--calibration", "exact.toml") == output(folder, *words, "by_hand.csv")


def test_the_bytes_do_not_depend_on_jobs_and_blocks(folder: Path) -> None:
    """With a full covariance estimates and flags are the same bytes for any jobs and block size."""
    words = ("localize", "m.csv", "--calibration", "full.toml")
    expected = output(folder, *words, "--jobs", "1")
    assert output(folder, *words, "--jobs", "2") == output(folder, *words, "--block-size", "3") == expected
    assert expected != output(folder, "localize", "m.csv", "--calibration", "exact.toml")


def test_sensors_without_an_entry_are_named_once(folder: Path) -> None:
    """A sensor that the calibration lacks has offset 0, and one line names them; unknown ones in it are no fault."""
    (folder / "other.toml").write_text(EXACT + '[[sensor]]\nname = "s9"\nrange_offset_m = 1.0\n')
    for words in (("localize",), ("bound",)):
        done = run_here(*words, "m.csv", "--calibration", "other.toml", "-o", "x.csv", "--overwrite", folder=folder)
        assert done.stderr.decode().count("sensors without an entry in the calibration, offset 0: s2, s3\n") == 1
    folders = run_here("localize", "m.csv", "--calibration", "other.toml", "-o", "parts/", folder=folder)
    assert folders.stderr.decode().count("offset 0: s2, s3\n") == 1


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            EXACT.replace("range_offset_m", "heading_offset_deg"),
            "has heading_offset_deg, offsets of bearings, but the input has ranges",
        ),
        (EXACT.replace("std_scale = 2.0", 'session = "a"'), "sensor[1].session: missing"),
        (
            EXACT.replace("std_scale = 2.0", 'day = "a"') + 'day = "a"\n',
            "its offsets are by 'day', a column that the input lacks",
        ),
        (EXACT.replace("0.4", "nan"), "sensor[0].range_offset_m: got nan"),
    ],
)
def test_calibrations_that_do_not_suit_the_input(folder: Path, text: str, message: str) -> None:
    """One line that names the file, the offsets and the measurements; also for a file that does not exist."""
    (folder / "bad.toml").write_text(text)
    done = run_here("localize", "m.csv", "--calibration", "bad.toml", folder=folder)
    assert done.returncode == 1
    assert done.stderr.decode().startswith("nlosctl: bad.toml: ")
    assert message in done.stderr.decode()
    assert done.stderr.count(b"\n") == 1
    gone = run_here("localize", "m.csv", "--calibration", "gone.toml", folder=folder)
    assert (gone.returncode, b"gone.toml: the calibration can't be read" in gone.stderr) == (1, True)


def test_offsets_by_session() -> None:
    """Rows take the entry of their sensor and session; the column is read, and not in the estimates."""
    tables = [
        session("ranges", 10, seed=number, first=100 * number, offsets=offset)[0]
        for number, offset in enumerate((0.5, -0.5))
    ]
    for table, name in zip(tables, "ab", strict=True):
        table["session"] = np.full(len(table["snapshot"]), name)
    entries = tuple(
        SensorOffset(name=f"s{number}", group=(name,), offset=offset)
        for number in range(4)
        for name, offset in (("a", 0.5), ("b", -0.5))
    )
    calibration = Calibration(kind="ranges", entries=entries, by=("session",))
    table = joined(*tables)
    corrected = {**table, "range_m": table["range_m"] - np.where(table["session"] == "a", 0.5, -0.5)}
    found = nlosctl.localize(table, calibration=calibration).estimates
    assert found["x_m"].to_pylist() == nlosctl.localize(corrected).estimates["x_m"].to_pylist()
    assert "session" not in found.column_names


def known_offsets(kind: str, covariance, count: int) -> Calibration:
    """Return a calibration of offsets 0 with this covariance in the unit of files."""
    entries = tuple(SensorOffset(name=f"s{number}") for number in range(count))
    return Calibration(kind=kind, entries=entries, order=tuple(range(count)), covariance=covariance)


def test_correlated_offsets_move_and_widen_the_fix() -> None:
    """Positions, covariances, costs and residuals are those of generalized least squares; the bound agrees."""
    rng = np.random.default_rng(3)
    root = 0.1 * rng.normal(size=(4, 4))
    calibration = known_offsets("ranges", root @ root.T, 4)
    table, _ = session("ranges", 12, seed=3, offsets=root @ rng.normal(size=4))
    solved = nlosctl.localize(table, calibration=calibration)
    whole = np.linalg.inv(0.01 * np.eye(4) + root @ root.T)
    bounds = nlosctl.bound(table, calibration=calibration).to_pylist()
    compared = 0
    for number, row in enumerate(solved.estimates.to_pylist()):
        point = np.array([row["x_m"], row["y_m"]])
        if np.hypot(*(point - HALL).T).min() < 2.0:
            continue  # so near a sensor a fix stays where the method found it
        residual = table["range_m"].reshape(12, 4)[number] - np.hypot(*(point - HALL).T)
        slopes = (point - HALL) / np.hypot(*(point - HALL).T)[:, None]
        np.testing.assert_allclose(slopes.T @ whole @ residual, 0.0, atol=2e-3)
        np.testing.assert_allclose(row["cost"], 0.5 * residual @ whole @ residual, rtol=1e-6)
        covariance = np.linalg.inv(slopes.T @ whole @ slopes)
        given = [[row["cov_xx_m2"], row["cov_xy_m2"]], [row["cov_xy_m2"], row["cov_yy_m2"]]]
        np.testing.assert_allclose(given, covariance, rtol=2e-3, atol=1e-6)
        compared += 1
        flags = np.array(solved.flags["residual_m"].to_pylist()).reshape(12, 4)[number]
        np.testing.assert_allclose(flags, residual, atol=1e-9)
        truth = np.array([row["truth_x_m"], row["truth_y_m"]])
        there = (truth - HALL) / np.hypot(*(truth - HALL).T)[:, None]
        bound = np.linalg.inv(there.T @ whole @ there)
        np.testing.assert_allclose([bounds[number]["bound_xx_m2"], bounds[number]["bound_xy_m2"]], bound[0], rtol=1e-9)
    assert compared > 8


@pytest.mark.parametrize("kind", ["bearings", "ranges"])
def test_fresh_snapshots_have_true_ellipses(kind: str) -> None:
    """The mean NEES of fresh snapshots is near 2 after sessions of 30 snapshots, and larger if offsets are exact."""
    nees: dict[tuple[str, bool], list[float]] = {}
    for seed in range(12):
        table, given = session(kind, 30, seed=5000 + seed)
        calibration = nlosctl.calibrate(table).calibration
        fresh, _ = session(kind, 40, seed=9000 + seed, offsets=given)
        exact = dataclasses.replace(calibration, order=(), covariance=None)
        for method in ("ml", "mixture-ml"):
            for used in (calibration, exact):
                solved = nlosctl.localize(fresh, method=method, calibration=used).estimates.to_pylist()
                nees.setdefault((method, used is exact), []).extend(nees_of(solved))
    for method, mean, share in (("ml", 2.6, 0.9), ("mixture-ml", 2.9, 0.87)):
        full = np.array(nees[method, False])
        assert full.mean() < mean
        assert np.mean(full < 5.99) > share
        assert np.mean(nees[method, True]) > full.mean() + 0.1


def nees_of(rows: list[dict[str, Any]]) -> Iterator[float]:
    """Yield the squared Mahalanobis distances of the truth from the estimates that have a covariance."""
    for row in (row for row in rows if row["cov_xx_m2"] is not None):
        error = np.array([row["x_m"] - row["truth_x_m"], row["y_m"] - row["truth_y_m"]])
        covariance = [[row["cov_xx_m2"], row["cov_xy_m2"]], [row["cov_xy_m2"], row["cov_yy_m2"]]]
        yield error @ np.linalg.solve(covariance, error)


def test_one_source_of_standard_deviations() -> None:
    """A calibration scales stds, so that they can't be estimated at the same time."""
    table, _ = session("ranges", 3, seed=1)
    with pytest.raises(UsageError, match="`estimate_std` and `calibration` both scale standard deviations"):
        nlosctl.localize(table, calibration=known_offsets("ranges", np.eye(4), 4), estimate_std="file")


def test_offsets_of_arrivals_add_their_variance(tmp_path: Path) -> None:
    """Arrivals lose their offsets, and each row has the variance of its offset beside its own."""
    (tmp_path / "a.toml").write_text('[[sensor]]\nname = "m1"\narrival_offset_m = 0.5\narrival_offset_std_m = 0.4\n')
    head = "sensor,sensor_x_m,sensor_y_m,arrival_m,arrival_std_m\n"
    others = "m2,40,0,22.5,0.3\nm3,40,40,30.1,0.3\nm4,0,40,21.0,0.3\nm5,20,60,40.0,0.3\n"
    (tmp_path / "m.csv").write_text(f"{head}m1,0,0,26.5,0.3\n{others}")
    (tmp_path / "by_hand.csv").write_text(f"{head}m1,0,0,26.0,0.5\n{others}")
    words = ("localize", "--kind", "arrivals")
    found = output(tmp_path, *words, "m.csv", "--calibration", "a.toml").decode().splitlines()[1].split(",")
    expected = output(tmp_path, *words, "by_hand.csv").decode().splitlines()[1].split(",")
    for value, other in zip(found, expected, strict=True):
        assert value == other or float(value) == pytest.approx(float(other), rel=1e-9)
