"""Deviations of arrays by direction: terms, stds and their use, compared with scipy and with the truth."""

from __future__ import annotations

import csv
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
from deviation_worlds import SOURCE_M, TERMS_DEG, Floats, design, drive
from program import run_here
from scipy.optimize import least_squares

import nlosctl
from nlosctl.contract.calibration import Calibration
from nlosctl.errors import DataError, UsageError
from nlosctl.geometry.angles import deviation, deviation_terms, direction_without_deviation
from nlosctl.io.calibrations.calibration_file import calibration_from_toml, calibration_to_toml


def angles(table: pa.Table, name: str) -> Floats:
    """Return a column as an array."""
    return np.array(table[name].to_pylist(), dtype=np.float64)


def wrapped(angle_rad: Floats) -> Floats:
    """Return angles in (-pi, pi]."""
    return np.asarray(np.angle(np.exp(1j * angle_rad)))


def terms_of(calibration: Calibration) -> Floats:
    """Return the terms of the only entry, in degrees."""
    return np.array(calibration.entries[0].terms)


def one_snapshot(table: pa.Table) -> pa.Table:
    """Return the rows as one snapshot."""
    return table.append_column("snapshot", pa.array([0] * table.num_rows))


def test_a_direction_is_the_inverse_of_its_deviation() -> None:
    """At every direction the deviated direction leads back; slopes and derivatives are finite differences."""
    direction, terms = np.linspace(-3.1, 3.1, 101), np.radians(TERMS_DEG)
    value, slope = deviation(direction, terms)
    assert wrapped(direction_without_deviation(direction + value, terms) - direction) == pytest.approx(0.0, abs=1e-13)
    assert value == pytest.approx(design(direction) @ terms, abs=1e-15)
    step = 1e-6
    assert slope == pytest.approx(
        (deviation(direction + step, terms)[0] - deviation(direction - step, terms)[0]) / (2 * step), abs=1e-8
    )
    assert deviation_terms(direction, 5) == pytest.approx(design(direction), abs=1e-15)


def test_terms_of_known_positions_are_those_of_least_squares() -> None:
    """With the transmitter known the terms and their covariance are those of numpy's linear least squares."""
    table, direction = drive()
    found = nlosctl.calibrate(one_snapshot(table), truth="columns", harmonics=2).calibration
    true = np.arctan2(SOURCE_M[1] - angles(table, "sensor_y_m"), SOURCE_M[0] - angles(table, "sensor_x_m"))
    rows = design(direction)
    residual = wrapped(angles(table, "bearing_rad") - true)
    expected = np.linalg.lstsq(rows, residual, rcond=None)[0]
    assert terms_of(found) == pytest.approx(np.degrees(expected), abs=1e-9)
    left = residual - rows @ expected
    factor = found.entries[0].std_scale
    assert factor == pytest.approx(np.sqrt(left @ left / (300 - 5)) / np.radians(2.0), rel=2e-3)  # of 5 prior degrees
    covariance = np.linalg.inv(rows.T @ rows) * (2.0 * factor) ** 2
    assert found.covariance == pytest.approx(covariance, rel=1e-9)


def test_a_drive_around_an_unknown_transmitter() -> None:
    """Terms, position and covariance are those of scipy's least squares over all unknowns together."""
    table, _ = drive(seed=3)
    found = nlosctl.calibrate(one_snapshot(table), harmonics=2).calibration
    place = np.stack([angles(table, "sensor_x_m"), angles(table, "sensor_y_m")])
    forward = 0.5 * np.pi - np.radians(angles(table, "heading_deg"))
    measured = angles(table, "bearing_rad")

    def residual(unknowns: Floats) -> Floats:
        bearing = np.arctan2(unknowns[1] - place[1], unknowns[0] - place[0])
        return wrapped(measured - bearing - design(bearing - forward) @ unknowns[2:]) / np.radians(2.0)

    fit = least_squares(residual, [*SOURCE_M, *np.radians(TERMS_DEG)], xtol=1e-14, ftol=1e-14, gtol=1e-14)
    whole = np.linalg.inv(fit.jac.T @ fit.jac)
    std_deg = np.degrees(np.sqrt(np.diag(whole)))[2:]
    assert np.abs(terms_of(found) - np.degrees(fit.x[2:])).max() < 0.05 * std_deg.max()
    part = found.entries[0].harmonics[1]
    stds = [found.entries[0].std, part.cos_std, part.sin_std]
    assert np.array(stds, dtype=np.float64) == pytest.approx(std_deg[[0, 3, 4]] * found.entries[0].std_scale, rel=0.03)


@pytest.mark.parametrize(("truth", "sessions"), [("columns", 25), (None, 25)])
def test_stds_are_honest(truth: str | None, sessions: int) -> None:
    """Over simulated drives the squared errors of the terms by their covariance have the mean 5."""
    squares = []
    for seed in range(sessions):
        table, _ = drive(120, seed=100 + seed)
        found = nlosctl.calibrate(one_snapshot(table), truth=truth, harmonics=2).calibration
        error = terms_of(found) - np.array(TERMS_DEG)
        assert found.covariance is not None
        squares.append(float(error @ np.linalg.solve(found.covariance, error)) / 5.0)
    assert 0.75 < np.mean(squares) < 1.3


def test_a_robust_drive() -> None:
    """A fifth of the bearings anywhere does not move the terms of mixture-ml by more than a few stds."""
    table, _ = drive(80, seed=5)
    rng = np.random.default_rng(1)
    wild = rng.random(80) < 0.2
    bearing = np.where(wild, rng.uniform(-np.pi, np.pi, 80), angles(table, "bearing_rad"))
    table = table.set_column(table.column_names.index("bearing_rad"), "bearing_rad", pa.array(bearing))
    found = nlosctl.calibrate(one_snapshot(table), method="mixture-ml", harmonics=2).calibration
    known = nlosctl.calibrate(one_snapshot(table), truth="columns", harmonics=2).calibration
    assert np.abs(terms_of(found) - TERMS_DEG).max() < 1.5
    assert np.abs(terms_of(known) - TERMS_DEG).max() > 3.0  # all rows alike


def test_a_calibration_removes_the_deviation() -> None:
    """Fixes of another drive: without it wrong by many stds, with it of the size of their covariance."""
    table, _ = drive(2000, seed=8)
    calibration = nlosctl.calibrate(one_snapshot(table), truth="columns", harmonics=2).calibration
    drives = [drive(10, seed=500 + seed, source_m=(100.0, -200.0))[0] for seed in range(60)]
    fresh = pa.concat_tables(
        table.append_column("snapshot", pa.array([number] * 10)) for number, table in enumerate(drives)
    )
    with_calibration, without = (
        nlosctl.evaluate(nlosctl.localize(fresh, method="ml", **known).estimates).groups[0]
        for known in ({"calibration": calibration}, {})
    )
    assert 1.4 < with_calibration["nees"] < 2.7
    assert without["nees"] > 4.0
    assert with_calibration["rmse_m"] < 0.6 * without["rmse_m"]


def test_bearings_without_their_deviation_are_the_true_ones() -> None:
    """Exact bearings with a deviation give exact fixes with the calibration, whatever their direction."""
    table, _ = drive(30, seed=2, std_deg=1e-9)
    exact = nlosctl.calibrate(one_snapshot(table), truth="columns", harmonics=2).calibration
    assert terms_of(exact) == pytest.approx(np.array(TERMS_DEG), abs=1e-6)
    wide = table.set_column(5, "bearing_std_rad", pa.array(np.full(30, 0.01)))
    fix = nlosctl.localize(one_snapshot(wide), method="ml", calibration=exact).estimates.to_pylist()[0]
    assert (fix["x_m"], fix["y_m"]) == pytest.approx(SOURCE_M, abs=1e-3)


def test_the_covariance_of_the_terms_counts() -> None:
    """A calibration from few rows widens the fixes of others more than one from many."""
    fresh, _ = drive(10, seed=77)
    sizes = []
    for rows in (30, 3000):
        table, _ = drive(rows, seed=9)
        calibration = nlosctl.calibrate(one_snapshot(table), truth="columns", harmonics=2).calibration
        fix = nlosctl.localize(one_snapshot(fresh), method="ml", calibration=calibration).estimates.to_pylist()[0]
        sizes.append(fix["cov_xx_m2"] + fix["cov_yy_m2"])
    assert sizes[0] > 1.1 * sizes[1]


def test_files_of_a_run(tmp_path: Path) -> None:
    """TOML and table hold the same terms; the TOML reads back to the same calibration and applies in a run."""
    table, _ = drive()
    pyarrow.parquet.write_table(table, tmp_path / "drive.parquet")
    words = ["calibrate", "drive.parquet", "--harmonics", "2", "--window", "all", "--table-out", "d.csv"]
    done = run_here(*words, "-o", "c.toml", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    rows = list(csv.DictReader((tmp_path / "d.csv").read_text().splitlines()))
    assert list(rows[0]) == ["sensor", "order", "cos_deg", "sin_deg", "cos_std_deg", "sin_std_deg"]
    (entry,) = tomllib.loads((tmp_path / "c.toml").read_text())["sensor"]
    assert [(row["order"], float(row["cos_deg"])) for row in rows] == [
        (str(part["order"]), part["cos_deg"]) for part in entry["harmonic"]
    ]
    text = (tmp_path / "c.toml").read_text()
    calibration = calibration_from_toml(text, "c.toml")
    assert calibration_from_toml(calibration_to_toml(calibration, {}), "c.toml").entries == calibration.entries
    assert calibration.covariance is not None
    assert calibration.covariance.shape == (5, 5)
    localized = run_here(
        "localize",
        "drive.parquet",
        "--window",
        "all",
        "--calibration",
        "c.toml",
        "-m",
        "ml",
        "-o",
        "f.csv",
        folder=tmp_path,
    )
    assert localized.returncode == 0, localized.stderr
    fix = next(csv.DictReader((tmp_path / "f.csv").read_text().splitlines()))
    assert np.hypot(float(fix["x_m"]) - SOURCE_M[0], float(fix["y_m"]) - SOURCE_M[1]) < 15.0


def test_bytes_do_not_depend_on_the_cut(tmp_path: Path) -> None:
    """The file is the same for any number of processes and any cut into batches."""
    tables = [drive(40, seed=seed)[0] for seed in range(4)]
    together = pa.concat_tables(
        table.append_column("snapshot", pa.array([number] * 40)) for number, table in enumerate(tables)
    )
    pyarrow.parquet.write_table(together, tmp_path / "whole.parquet")
    pyarrow.parquet.write_table(together, tmp_path / "cut.parquet", row_group_size=37)
    texts = []
    for number, words in enumerate(
        (["whole.parquet"], ["cut.parquet", "--jobs", "2"], ["cut.parquet", "--block-size", "1"])
    ):
        done = run_here("calibrate", *words, "--harmonics", "1", "-o", f"{number}.toml", folder=tmp_path)
        assert done.returncode == 0, done.stderr
        texts.append((tmp_path / f"{number}.toml").read_text())
    assert texts[0] == texts[1] == texts[2]


def test_headings_of_relative_bearings_and_of_the_scene() -> None:
    """Relative bearings with a heading column, and a fixed array with its heading in the scene, give the same terms."""
    table, _ = drive(200, seed=4)
    whole = terms_of(nlosctl.calibrate(one_snapshot(table), truth="columns", harmonics=2).calibration)
    forward = 0.5 * np.pi - np.radians(angles(table, "heading_deg"))
    relative = -np.degrees(wrapped(angles(table, "bearing_rad") - forward))
    turned = table.drop_columns(["bearing_rad"]).append_column("relative_bearing_deg", pa.array(relative))
    found = terms_of(nlosctl.calibrate(one_snapshot(turned), truth="columns", harmonics=2).calibration)
    assert found == pytest.approx(whole, abs=1e-9)
    ahead = table.set_column(6, "heading_deg", pa.array(np.full(200, 30.0)))
    scene = {"sensor": [{"name": "car", "position": [0.0, 0.0], "heading_deg": 30.0}]}
    lacking = one_snapshot(ahead.drop_columns(["heading_deg"]))
    by_column = nlosctl.calibrate(one_snapshot(ahead), truth="columns", harmonics=2).calibration
    by_scene = nlosctl.calibrate(lacking, truth="columns", harmonics=2, scene=_scene(scene)).calibration
    assert terms_of(by_scene).tolist() == terms_of(by_column).tolist()
    with pytest.raises(DataError, match="no heading of 'car'"):
        nlosctl.calibrate(lacking, truth="columns", harmonics=2)
    with pytest.raises(DataError, match="no heading of 'car'"):
        nlosctl.localize(lacking, method="ml", calibration=by_column)


def _scene(content: dict[str, Any]) -> Any:
    from nlosctl.contract.scene import Scene, Sensor

    return Scene(
        sensors=tuple(Sensor(**{**known, "position": tuple(known["position"])}) for known in content["sensor"])
    )


def test_what_is_needed_is_stated() -> None:
    """Without known positions and without a drive as one snapshot, an error names both; other kinds are refused."""
    table, _ = drive(50)
    single = table.append_column("snapshot", pa.array(range(50)))
    with pytest.raises(DataError, match=r"known positions \(`truth`\).*one snapshot \(`window` all\)"):
        nlosctl.calibrate(single, harmonics=2)
    with pytest.raises(UsageError, match="`harmonics` are of bearings, and the input has ranges"):
        nlosctl.calibrate(nlosctl.simulate("ranges", trials=5), harmonics=1)
    with pytest.raises(UsageError, match="`harmonics` must be at most 8"):
        nlosctl.calibrate(single, harmonics=9)


def test_a_straight_road_does_not_do() -> None:
    """Past a transmitter at an unknown place neither its position nor the deviation is determined: an error."""
    step = np.arange(150.0)
    x, y = 20.0 * step - 1500.0, np.full(150, -900.0)
    bearing = np.arctan2(700.0 - y, 300.0 - x)
    noise = np.radians(3.0) * np.random.default_rng(2).standard_normal(150)
    measured = bearing + np.radians(design(bearing) @ TERMS_DEG) + noise
    columns = {"snapshot": [0] * 150, "sensor": ["car"] * 150, "sensor_x_m": x, "sensor_y_m": y}
    more = {"bearing_rad": measured, "bearing_std_deg": [3.0] * 150, "heading_deg": [90.0] * 150}
    with pytest.raises(DataError, match="don't determine the positions and the deviations together"):
        nlosctl.calibrate(pa.table({**columns, **more}), harmonics=2)
    known = pa.table({**columns, **more, "truth_x_m": [300.0] * 150, "truth_y_m": [700.0] * 150})
    with pytest.raises(DataError, match="from too few directions relative to the heading"):
        nlosctl.calibrate(known, harmonics=3, truth="columns")
    held = nlosctl.calibrate(known, harmonics=3, truth="columns", offset_prior_deg=5.0).calibration
    assert np.abs(terms_of(held)).max() < 15.0


def test_a_standing_array_does_not_do() -> None:
    """One direction alone determines no harmonics, although a pseudo-inverse has standard deviations for them."""
    table, _ = drive(1, seed=3)
    standing = pa.concat_tables([table] * 30).append_column("path", pa.array(range(30)))
    with pytest.raises(DataError, match="from too few directions relative to the heading"):
        nlosctl.calibrate(one_snapshot(standing), harmonics=1, truth="columns")


def test_a_narrow_view_is_named() -> None:
    """Bearings from a sector alone don't cover the directions: the summary states how many sectors they do."""
    table, direction = drive(600, seed=6)
    ahead = table.filter(pa.array(np.abs(wrapped(direction)) < 1.6))
    report = nlosctl.calibrate(one_snapshot(ahead), truth="columns", harmonics=2).report
    assert any("sectors of ten degrees relative to the heading" in note for note in report.notes())


@pytest.mark.parametrize(
    ("toml", "message"),
    [
        ("order = 2\ncos_deg = 1.0\nsin_deg = 0.0", "sensor[0].harmonic[0].order: got 2, expected 1"),
        ("order = 1\ncos_deg = 1.0", "sensor[0].harmonic[0].sin_deg: missing"),
        ("order = 1\ncos_deg = nan\nsin_deg = 0.0", "sensor[0].harmonic[0].cos_deg: got nan, expected a finite number"),
        ("order = 1\ncos_deg = 90.0\nsin_deg = 0.0", "sensor[0].harmonic: the deviation falls by 1.57 deg per degree"),
        ("order = 1\ncos_deg = 1.0\nsin_deg = 0.0\nphase = 1", "sensor[0].harmonic[0].phase: unknown key"),
    ],
)
def test_bad_files_are_named(toml: str, message: str) -> None:
    """A malformed harmonic is an error that names its key."""
    text = f'[[sensor]]\nname = "car"\nheading_offset_deg = 1.0\n[[sensor.harmonic]]\n{toml}\n'
    with pytest.raises(DataError) as error:
        calibration_from_toml(text, "c.toml")
    assert message in str(error.value)
