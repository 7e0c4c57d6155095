"""``fit_p_value`` and ``used_share`` of estimates of every kind and method."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pytest
from scipy.optimize import least_squares
from scipy.stats import chi2, kstest

import nlosctl
from nlosctl.contract.results import Estimates
from nlosctl.contract.statuses import Status
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.pipeline.solve.report import chi_square_p_value, fit_p_values

SEED = 18


def column(table: pa.Table, name: str) -> np.ndarray:
    """Return a column of numbers, null as NaN."""
    return table.column(name).to_numpy(zero_copy_only=False).astype(float)


def read(text: str) -> pa.Table:
    """Return the rows of a CSV text."""
    return pyarrow.csv.read_csv(io.BytesIO(text.encode()))


def ring(
    snapshots: int, sensors: int, *, bearing_std: float = 0.0, range_std: float = 0.0, span: float = 2.0 * np.pi
) -> pa.Table:
    """Return bearings, ranges or both of sources about the origin from sensors on an arc of 100 m, without outliers."""
    generator = np.random.default_rng(SEED)
    angle = span * np.arange(sensors) / sensors
    sensor = np.stack([np.cos(angle), np.sin(angle)], axis=1) * 100.0
    offset = generator.uniform(-50.0, 50.0, (snapshots, 1, 2)) - sensor
    columns: dict[str, Any] = {
        "snapshot": np.repeat(np.arange(snapshots), sensors),
        "sensor": np.tile(np.arange(sensors), snapshots),
        "sensor_x_m": np.tile(sensor[:, 0], snapshots),
        "sensor_y_m": np.tile(sensor[:, 1], snapshots),
    }
    if bearing_std:
        noise = bearing_std * generator.standard_normal((snapshots, sensors))
        columns["bearing_rad"] = (np.arctan2(offset[..., 1], offset[..., 0]) + noise).ravel()
        columns["bearing_std_rad"] = np.full(snapshots * sensors, bearing_std)
    if range_std:
        noise = range_std * generator.standard_normal((snapshots, sensors))
        columns["range_m"] = (np.hypot(offset[..., 0], offset[..., 1]) + noise).ravel()
        columns["range_std_m"] = np.full(snapshots * sensors, range_std)
    return pa.table(columns)


def triplets(snapshots: int, paths: int) -> pa.Table:
    """Return triplets of direct paths over one target, from transmitters and receivers on a ring."""
    generator = np.random.default_rng(SEED)
    angle = generator.uniform(-np.pi, np.pi, (2, snapshots, paths))
    tx, rx = np.stack([np.cos(angle), np.sin(angle)], axis=-1) * 40.0
    target = generator.uniform(-15.0, 15.0, (snapshots, 1, 2))
    leaving, arriving = target - tx, target - rx
    stds = {"dod_rad": np.radians(1.0), "doa_rad": np.radians(1.0), "path_length_m": 0.3}
    values = {
        "dod_rad": np.arctan2(leaving[..., 1], leaving[..., 0]),
        "doa_rad": np.arctan2(arriving[..., 1], arriving[..., 0]),
        "path_length_m": np.hypot(*np.moveaxis(leaving, -1, 0)) + np.hypot(*np.moveaxis(arriving, -1, 0)),
    }
    columns: dict[str, Any] = {
        "snapshot": np.repeat(np.arange(snapshots), paths),
        "path": np.tile(np.arange(paths), snapshots),
    }
    for name, points in (("tx", tx), ("rx", rx)):
        columns[f"{name}_x_m"], columns[f"{name}_y_m"] = points[..., 0].ravel(), points[..., 1].ravel()
    for name, exact in values.items():
        columns[name] = (exact + stds[name] * generator.standard_normal(exact.shape)).ravel()
        std_name = name.replace("_rad", "_std_rad") if name.endswith("_rad") else name.replace("_m", "_std_m")
        columns[std_name] = np.full(exact.size, stds[name])
    return pa.table(columns)


BEARINGS = {"bearing_std": np.radians(2.0)}
BOTH = {"bearing_std": np.radians(2.0), "range_std": 2.0}
RANGES = {"range_std": 1.0}


@pytest.mark.parametrize("degrees", [*range(1, 12), 39, 40, 41, 200])
def test_the_p_value_is_the_chi_squares_tail(degrees: int) -> None:
    """Closed forms agree with scipy's survival function at every number of degrees of freedom, to 1e-11."""
    values = np.concatenate([[0.0, 1e-9], np.geomspace(0.01, 900.0, 60)])
    got = chi_square_p_value(values, np.full(values.shape, degrees))
    np.testing.assert_allclose(got, chi2.sf(values, degrees), rtol=1e-11)


def test_a_chi_square_below_zero_by_rounding_is_a_perfect_fit() -> None:
    """A residual after a linearized step may be below zero by rounding: its p-value is 1, without a warning."""
    assert chi_square_p_value(np.full(3, -1e-17), np.array([1, 2, 50])).tolist() == [1.0, 1.0, 1.0]


def test_a_hopeless_fit_has_p_value_zero() -> None:
    """A chi-square beyond all floats has the p-value 0, one without degrees of freedom none."""
    degrees = np.array([1, 2, 7, 41, 0, -1])
    got = chi_square_p_value(np.full(6, 1e300), degrees)
    np.testing.assert_array_equal(got, [0.0, 0.0, 0.0, 0.0, np.nan, np.nan])


@pytest.mark.parametrize(
    ("method", "sensors", "stds", "parameters"),
    [
        ("ml", 3, BEARINGS, {}),
        ("ml", 8, BEARINGS, {}),
        ("ml", 2, BOTH, {}),
        ("ml", 8, BOTH, {}),
        ("ls", 8, BEARINGS, {}),
        ("stansfield", 8, BEARINGS, {}),
        ("sequential", 8, BEARINGS, {}),
        ("sequential", 4, BOTH, {}),
        ("mixture-ml", 8, BEARINGS, {"alpha": 1e-9}),
        ("mixture-ml", 4, BOTH, {"alpha": 1e-9}),
        ("suppress", 6, BEARINGS, {"alpha": 1e-9}),
        ("ml", 3, RANGES, {}),
        ("r-ls", 6, RANGES, {}),
        ("sr-ls", 6, RANGES, {}),
        ("mixture-ml", 6, RANGES, {"alpha": 1e-9}),
    ],
)
def test_p_values_are_uniform(method: str, sensors: int, stds: dict[str, float], parameters: dict[str, Any]) -> None:
    """With errors as stated the p-values of fixes are uniform: Kolmogorov-Smirnov distance within its 0.1 % limit."""
    estimates = nlosctl.localize(ring(1500, sensors, **stds), method=method, seed=1, **parameters).estimates
    p_value = column(estimates, "fit_p_value")
    assert np.isfinite(p_value).mean() > 0.98
    assert kstest(p_value[np.isfinite(p_value)], "uniform").pvalue > 1e-3


@pytest.mark.parametrize("joint", [False, True])
def test_p_values_of_triplets_are_uniform(joint: bool) -> None:
    """A path has one degree of freedom, n paths over one target 3 n - 2."""
    estimates = nlosctl.localize(triplets(600, 3), joint=joint).estimates
    p_value = column(estimates, "fit_p_value")
    assert np.isfinite(p_value).mean() > 0.95
    assert kstest(p_value[np.isfinite(p_value)], "uniform").pvalue > 1e-3


def test_detectors_and_echoes_have_p_values() -> None:
    """The targets of ``detect-ip`` and ``identify-los`` have them too."""
    for method in ("chi2", "joint"):
        estimates = nlosctl.detect_ip(triplets(300, 4), method=method).estimates
        p_value = column(estimates, "fit_p_value")
        assert 0.4 < np.nanmean(p_value) < 0.6
    targets = nlosctl.identify_los(nlosctl.simulate("echo-field", trials=20, seed=2)).estimates
    found = np.array(targets["status"].to_pylist()) == "ok"
    assert found.sum() > 20
    assert np.isfinite(column(targets, "fit_p_value")[found]).all()


@pytest.mark.parametrize("method", ["mixture-ml", "suppress"])
def test_robust_methods_test_their_inliers(method: str) -> None:
    """The p-value is that of the least chi-square of the rows used, by scipy, with as many rows minus two."""
    given = nlosctl.simulate("ring", trials=60, seed=3, bearing_std_deg=2.0, outlier_fraction=0.3)
    result = nlosctl.localize(given, method=method)
    estimates, flags = result.estimates, result.flags
    compared = 0
    for index, snapshot in enumerate(estimates["snapshot"].to_pylist()):
        p_value = column(estimates, "fit_p_value")[index]
        rows = np.flatnonzero((column(flags, "snapshot") == snapshot) & (column(flags, "used") == 1.0))
        assert estimates["used_share"][index].as_py() == len(rows) / 8
        x, y, bearing, std = (
            column(flags, name)[rows] for name in ("sensor_x_m", "sensor_y_m", "bearing_rad", "bearing_std_rad")
        )
        if len(rows) <= 2 or np.isnan(p_value):
            continue

        def scaled(
            point: np.ndarray,
            x: np.ndarray = x,
            y: np.ndarray = y,
            bearing: np.ndarray = bearing,
            std: np.ndarray = std,
        ) -> np.ndarray:
            off = bearing - np.arctan2(point[1] - y, point[0] - x)
            return np.asarray((off + np.pi) % (2.0 * np.pi) - np.pi) / std

        start = [column(estimates, "x_m")[index], column(estimates, "y_m")[index]]
        least = 2.0 * least_squares(scaled, start, x_scale=100.0, xtol=1e-12, ftol=1e-12).cost
        assert p_value == pytest.approx(chi2.sf(least, len(rows) - 2), abs=0.02)
        compared += 1
    assert compared > 25


def test_a_bearing_with_a_range_counts_as_two_scalars() -> None:
    """R1 of the public reports: two rows have 4 - 2 degrees of freedom, chi-square 240.65, p = 5.5e-53."""
    rows = read(
        "snapshot,sensor,sensor_x_m,sensor_y_m,bearing_deg,bearing_std_deg,range_m,range_std_m\n"
        "1,a,0,0,45,1,141.42,0.5\n1,b,200,0,135,1,180,0.5\n"
    )
    result = nlosctl.localize(rows)
    assert column(result.estimates, "fit_p_value")[0] == pytest.approx(5.5e-53, rel=0.01)
    assert any("fits badly" in note for note in result.report.notes)


def test_ranges_and_bearings_as_stated_fit() -> None:
    """R1: of eight sensors with bearing and range .001 of the snapshots have a p-value below .001, not .069."""
    result = nlosctl.localize(ring(4000, 8, **BOTH))
    assert np.mean(column(result.estimates, "fit_p_value") < 1e-3) < 0.003
    assert not any("fits badly" in note for note in result.report.notes)


def test_misfit_of_three_bearings() -> None:
    """Three azimuths of std 4 degrees with chi-square 47 and one degree of freedom have p = 7.2e-12."""
    rows = read(
        "snapshot,sensor,sensor_x_m,sensor_y_m,azimuth_deg,bearing_std_deg\n"
        "4,a,533987,5172222,237,4\n4,b,532394,5171630,354,4\n4,c,532701,5171675,326,4\n"
    )
    estimates = nlosctl.localize(rows).estimates
    assert column(estimates, "fit_p_value")[0] == pytest.approx(7.2e-12, rel=0.01)
    assert estimates["status"].to_pylist() == ["ok"]


REVERSED = (
    "snapshot,path,tx_x_m,tx_y_m,rx_x_m,rx_y_m,dod_deg,doa_deg,toa_ns,dod_std_deg,doa_std_deg,path_length_std_m\n"
    "1,1,0,0,40,10,50.1944,-53.1301,213.65197,1,1,0.3\n1,2,0,0,40,10,-60.9454,43.0251,205.56831,1,1,0.3\n"
)


def test_triplets_are_tested() -> None:
    """R2: reversed arrivals leave chi-squares of 2510 and 6266 with one degree of freedom; the summary says so."""
    rows = read(REVERSED.replace("dod_std_deg", "dod_std_rad").replace("doa_std_deg", "doa_std_rad"))
    rows = rows.set_column(rows.column_names.index("dod_std_rad"), "dod_std_rad", pa.array([np.radians(1.0)] * 2))
    rows = rows.set_column(rows.column_names.index("doa_std_rad"), "doa_std_rad", pa.array([np.radians(1.0)] * 2))
    result = nlosctl.localize(rows)
    np.testing.assert_allclose(2.0 * column(result.estimates, "cost"), [2509.86, 6266.36], rtol=1e-3)
    assert (column(result.estimates, "fit_p_value") < 1e-300).all()
    assert any("ml fits badly: in 2 of 2 fits" in note for note in result.report.notes)
    assert any("2 of 2 paths fit (0 as given) if 'doa_deg' is read as turned" in note for note in result.report.notes)


def test_no_p_value_without_spare_scalars_or_covariance() -> None:
    """Two bearings leave nothing over; a fix on the boundary has no p-value, an infeasible one has."""
    assert np.isnan(column(nlosctl.localize(ring(20, 2, **BEARINGS, span=np.pi)).estimates, "fit_p_value")).all()
    status = np.array([Status.OK, Status.INFEASIBLE, Status.BOUNDARY, Status.BEHIND], dtype=np.uint8)
    zero = np.zeros(4)
    estimates = Estimates.of(
        status, (zero, zero), SymmetricMatrix.full(4, 1.0), zero, 3, chi_square=zero + 1.0, degrees_of_freedom=1
    )
    assert np.isnan(fit_p_values(estimates)).tolist() == [False, False, True, True]


def test_the_summary_states_the_share_of_rows_used() -> None:
    """Summary and report state the share of the rows that the fixes use; nothing where it is all."""
    given = nlosctl.simulate("ring", trials=50, seed=3, outlier_fraction=0.3)
    report = nlosctl.localize(given, method="mixture-ml").report
    share = report.as_dict()["methods"]["mixture-ml"]["used_share"]
    assert share == pytest.approx(0.7, abs=0.06)
    assert f"; {100.0 * share:.3g} % of the rows used" in report.lines()[1]
    assert "rows used" not in nlosctl.localize(ring(5, 4, **BEARINGS)).report.lines()[1]


def changed_triplets(change: str) -> pa.Table:
    """Return triplets with arrivals in the direction of travel, or with the names of the directions exchanged."""
    table = triplets(30, 3)
    if change == "turned":
        index = table.column_names.index("doa_rad")
        return table.set_column(index, "doa_rad", pa.array(column(table, "doa_rad") + np.pi))
    swap = {"dod": "doa", "doa": "dod"}
    return table.rename_columns([swap.get(name[:3], name[:3]) + name[3:] for name in table.column_names])


@pytest.mark.parametrize(("change", "text"), [("turned", "turned by 180 degrees"), ("exchanged", "are exchanged")])
def test_the_likely_cause_of_bad_triplets_is_stated(change: str, text: str) -> None:
    """Where one change of all paths makes most of them fit, the summary states it, whichever method ran."""
    given = changed_triplets(change)
    reports = [
        nlosctl.localize(given).report,
        nlosctl.localize(given, joint=True).report,
        nlosctl.detect_ip(given, method="chi2").report,
        nlosctl.detect_ip(given, method="joint").report,
        nlosctl.detect_ip(given, method="tdaj").report,
    ]
    for report in reports:
        (note,) = [note for note in report.notes if "paths fit" in note]
        assert text in note


def test_no_cause_is_made_up() -> None:
    """Direct paths, and a room full of indirect ones, have no such note."""
    for given in (triplets(30, 3), nlosctl.simulate("room", trials=20, seed=1)):
        for method in ("chi2", "joint"):
            assert not any("paths fit" in note for note in nlosctl.detect_ip(given, method=method).report.notes)
