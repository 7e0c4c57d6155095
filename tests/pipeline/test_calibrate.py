"""Calibration against dense least squares over all positions and offsets, mean residuals, and Monte Carlo."""

from __future__ import annotations

import numpy as np
import pytest
from calibration_worlds import NAMES, STDS, joined, joint_fit, rows, session

import nlosctl
from nlosctl.errors import DataError, UsageError

UNIT = {"bearings": np.pi / 180.0, "ranges": 1.0}


def offsets(calibrated):
    """Return the offsets and their covariance in radians or metres, and the factors of stds."""
    calibration = calibrated.calibration
    unit = calibration.quantity.scale
    values = np.array([entry.offset for entry in calibration.entries]) * unit
    return values, calibration.covariance * unit**2, np.array([entry.std_scale for entry in calibration.entries])


@pytest.mark.parametrize("kind", ["bearings", "ranges"])
@pytest.mark.parametrize("prior", [None, 2.0])
def test_offsets_are_those_of_least_squares_over_everything(kind: str, prior: float | None) -> None:
    """Offsets and covariance are those of one fit of all positions and offsets; a prior is one more row of each."""
    table, _ = session(kind, 12, seed=4)
    std = None if prior is None else prior * STDS[kind]
    unit = "deg" if kind == "bearings" else "m"
    named = {} if std is None else {f"offset_prior_{unit}": std / UNIT[kind]}
    found, covariance, scale = offsets(nlosctl.calibrate(table, **named))
    expected, expected_covariance = joint_fit(kind, table, scale, found, std)
    stds = np.sqrt(np.diag(expected_covariance))
    np.testing.assert_allclose((found - expected) / stds, 0.0, atol=0.02)
    np.testing.assert_allclose(covariance / np.outer(stds, stds), expected_covariance / np.outer(stds, stds), atol=0.02)


@pytest.mark.parametrize("kind", ["bearings", "ranges"])
def test_known_positions_give_the_mean_residual(kind: str) -> None:
    """With the truth an offset is the mean residual, its std that of a mean, by the table's columns or by a file."""
    table, _ = session(kind, 30, seed=5)
    name, _ = NAMES[kind]
    dx, dy = table["truth_x_m"] - table["sensor_x_m"], table["truth_y_m"] - table["sensor_y_m"]
    residual = table[name] - (np.arctan2(dy, dx) if kind == "bearings" else np.hypot(dx, dy))
    residual = np.arctan2(np.sin(residual), np.cos(residual)) if kind == "bearings" else residual
    mean = residual.reshape(30, -1).mean(axis=0)
    found, covariance, scale = offsets(nlosctl.calibrate(table, truth="columns"))
    np.testing.assert_allclose(found, mean, atol=1e-9)
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)), scale * STDS[kind] / np.sqrt(30.0), rtol=0.02)
    squares = ((residual.reshape(30, -1) - mean) ** 2).sum(axis=0) / STDS[kind] ** 2
    every = squares.sum() / (29.0 * len(mean))
    np.testing.assert_allclose(scale, np.sqrt((squares + 5.0 * every) / 34.0), rtol=0.01)
    calibration = nlosctl.calibrate(table, truth="columns").calibration
    assert [entry.std_dof for entry in calibration.entries] == pytest.approx([34.0] * len(mean))
    truth = {column: table[column] for column in ("snapshot", "truth_x_m", "truth_y_m")}
    by_file = nlosctl.calibrate(table, truth=rows(truth, truth["snapshot"] < 25))
    part, _, _ = offsets(by_file)
    np.testing.assert_allclose(part, residual.reshape(30, -1)[:25].mean(axis=0), atol=1e-9)
    assert "5 of 30 snapshots have no true position: they are left out" in by_file.report.notes()


def test_known_positions_with_outliers_take_direct_rows_alone() -> None:
    """The mixture weighs rows by their probability to be direct at the known positions."""
    table, given = session("ranges", 80, seed=6, outliers=0.1)
    found, covariance, scale = offsets(nlosctl.calibrate(table, method="mixture-ml", truth="columns"))
    assert np.abs(found - given).max() < 4.5 * np.sqrt(np.diag(covariance)).max()
    assert np.sqrt(np.diag(covariance)).max() < 0.025
    assert scale.max() < 2.0
    trusting, _, _ = offsets(nlosctl.calibrate(table, truth="columns"))
    assert (trusting - given).max() > 0.15


def statistics(kind, snapshots, sessions, method="ml", outliers=0.0):
    """Return RMSE of the offsets in deg or m, mean chi-square per offset, and mean square of error over std."""
    errors, squares, ratios = [], [], []
    for seed in range(sessions):
        table, given = session(kind, snapshots, seed=1000 + seed, outliers=outliers)
        found, covariance, _ = offsets(nlosctl.calibrate(table, method=method))
        error = found - given
        errors.append(error / UNIT[kind])
        squares.append(error @ np.linalg.solve(covariance, error) / len(error))
        ratios.append(error**2 / np.diag(covariance))
    return np.sqrt(np.mean(np.square(errors))), np.mean(squares), np.mean(ratios)


@pytest.mark.parametrize(("kind", "rmse"), [("bearings", 0.25), ("ranges", 0.042)])
def test_offsets_scatter_as_their_covariance_states(kind: str, rmse: float) -> None:
    """Sessions of 30 snapshots with offsets of three stds: their RMSE, and chi-squares near the number of offsets."""
    error, square, _ = statistics(kind, 30, 8)
    assert 0.75 * rmse < error < 1.3 * rmse
    assert 0.5 < square < 1.7


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "snapshots", "rmse"),
    [
        *(("bearings", count, rmse) for count, rmse in ((10, 0.41), (30, 0.25), (100, 0.13))),
        *(("ranges", count, rmse) for count, rmse in ((10, 0.077), (30, 0.042), (100, 0.021))),
    ],
)
def test_many_sessions(kind: str, snapshots: int, rmse: float) -> None:
    """RMSE at most 1.15 times that of an independent implementation; chi-squares and squares of error over std near 1.

    The standard error of the mean chi-square over 150 sessions is .05 to .06.
    """
    error, square, ratio = statistics(kind, snapshots, 150)
    assert error < 1.15 * rmse
    assert 0.8 < square < 1.25
    assert 0.7 < ratio < 1.3 if kind == "bearings" else 0.7 < ratio < 1.5


@pytest.mark.slow
@pytest.mark.parametrize(("outliers", "rmse"), [(0.0, 0.173), (0.15, 0.213), (0.3, 0.269)])
def test_many_sessions_with_outliers(outliers: float, rmse: float) -> None:
    """Sixty snapshots with outliers: the mixture's RMSE is at most 1.25 times that of an independent implementation."""
    error, square, _ = statistics("bearings", 60, 60, "mixture-ml", outliers)
    assert error < 1.25 * rmse
    assert square < 1.5


def test_outliers_spoil_ml_not_the_mixture() -> None:
    """Fifteen per cent of bearings at random: the mixture's offsets are within a degree, those of ml are not."""
    table, given = session("bearings", 60, seed=7, outliers=0.15)
    robust, covariance, _ = offsets(nlosctl.calibrate(table, method="mixture-ml"))
    assert np.abs(robust - given).max() < 4.0 * np.sqrt(np.diag(covariance)).max() < np.radians(1.2)
    trusting, _, scale = offsets(nlosctl.calibrate(table))
    assert np.abs(trusting - given).max() > np.radians(1.5)
    assert scale.min() > 3.0


def test_two_rows_a_snapshot_determine_nothing() -> None:
    """All offsets are 0 without a std, and the reason is stated."""
    table, _ = session("ranges", 20, seed=8)
    calibrated = nlosctl.calibrate(rows(table, np.isin(table["sensor"], ["s0", "s1"])))
    assert [(entry.offset, entry.std, entry.std_scale) for entry in calibrated.calibration.entries] == [
        (0.0, None, 1.0)
    ] * 2
    assert calibrated.calibration.order == ()
    assert any("no snapshot has a position with rows to spare" in note for note in calibrated.report.notes())


def test_a_sensor_that_is_only_ever_one_of_two_rows_is_lost_alone() -> None:
    """It has offset 0, no std and no place in the covariance; the others are as if it were not there."""
    table, _ = session("ranges", 20, seed=9, sensors=[[0, 0], [30, 0], [30, 20], [0, 20], [15, 40]])
    pairs = table["snapshot"] >= 14
    keep = np.where(pairs, np.isin(table["sensor"], ["s0", "s4"]), table["sensor"] != "s4")
    calibrated = nlosctl.calibrate(rows(table, keep))
    *others, last = calibrated.calibration.entries
    assert (last.name, last.offset, last.std) == ("s4", 0.0, None)
    assert calibrated.calibration.order == (0, 1, 2, 3)
    assert any("don't determine the offsets of s4" in note for note in calibrated.report.notes())
    alone = nlosctl.calibrate(rows(table, ~pairs & (table["sensor"] != "s4")))
    for entry, expected in zip(others, alone.calibration.entries, strict=True):
        assert entry.offset == pytest.approx(expected.offset, abs=1e-3 * expected.std)


def test_groups_have_offsets_of_their_own() -> None:
    """With `by` the offsets of each session are those of the session alone, with its own count of positions."""
    first, _ = session("ranges", 25, seed=10)
    second, _ = session("ranges", 15, seed=11, first=100)
    for name, table in (("a", first), ("b", second)):
        table["session"] = np.full(len(table["snapshot"]), name)
    both = nlosctl.calibrate(joined(first, second), by="session", offset_prior_m=1.0)
    assert [entry.key for entry in both.calibration.entries] == [(f"s{n}", name) for n in range(4) for name in "ab"]
    for name, table in (("a", first), ("b", second)):
        single = nlosctl.calibrate(table, offset_prior_m=1.0)
        mine = [entry for entry in both.calibration.entries if entry.group == (name,)]
        for entry, expected in zip(mine, single.calibration.entries, strict=True):
            assert entry.offset == pytest.approx(expected.offset, abs=0.1 * expected.std)
        assert both.report.estimate.places[(name,)] == single.report.estimate.places[()]


def test_few_positions_are_named() -> None:
    """A source that stays at three places gives a warning with their number; one that moves does not."""
    table, _ = session("ranges", 60, seed=12, noise=0.0)
    third = np.repeat(np.arange(60) % 3, 4)
    table = rows(table, np.argsort(third, kind="stable"))
    for name in ("truth_x_m", "truth_y_m", "range_m"):
        by_place = table[name].reshape(3, 20, 4)
        table[name] = np.broadcast_to(by_place[:, :1], by_place.shape).ravel()
    table["range_m"] = table["range_m"] + 0.02 * np.random.default_rng(1).normal(size=240)
    calibrated = nlosctl.calibrate(table)
    assert calibrated.report.estimate.places == {(): 3}
    assert any(note.startswith("few different positions: 3;") for note in calibrated.report.notes())
    moving, _ = session("ranges", 60, seed=12)
    assert not any("few different" in note for note in nlosctl.calibrate(moving).report.notes())


def test_exact_measurements_have_small_factors_not_zeros() -> None:
    """Without noise the offsets are exact, and the factors of the stds are the least allowed."""
    table, given = session("ranges", 20, seed=13, noise=0.0)
    found, _, scale = offsets(nlosctl.calibrate(table))
    np.testing.assert_allclose(found, given, atol=1e-6)
    assert scale.tolist() == [1e-3] * 4


def test_faults_of_the_data_that_no_offset_explains_are_named() -> None:
    """Errors of many stds that differ from snapshot to snapshot remain in the factors, and the summary states it."""
    table, _ = session("bearings", 30, seed=14, noise=6.0)
    calibrated = nlosctl.calibrate(table, truth="columns")
    assert all(4.0 < entry.std_scale < 8.0 for entry in calibrated.calibration.entries)
    cure = "offsets are not the cause; if some rows are outliers, set `method` to mixture-ml"
    assert any(cure in note for note in calibrated.report.notes())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"method": "sr-ls"}, "sr-ls can't calibrate ranges; ml and mixture-ml can"),
        ({"method": "mixture-ml", "alpha": "estimate"}, "alpha=estimate: set a number to calibrate with"),
        ({"offset_prior_deg": 1.0}, "`offset_prior_deg` is not for ranges; set `offset_prior_m`"),
        ({"offset_prior_m": 0.0}, "`offset_prior_m` must be a finite number larger than 0. Got 0 instead."),
        ({"no_parameter": 1}, "no parameter 'no_parameter'"),
    ],
)
def test_settings_that_cannot_be(arguments, message: str) -> None:
    """Each is a usage error that names the cure."""
    table, _ = session("ranges", 3, seed=1)
    with pytest.raises(UsageError, match="(?s)" + message.replace(".", r"\.")):
        nlosctl.calibrate(table, **arguments)


def test_columns_that_are_not_there() -> None:
    """Unknown groups, and truth columns that the measurements lack, are named."""
    table, _ = session("ranges", 3, seed=1)
    with pytest.raises(DataError, match="`by` sesion: no column 'sesion'"):
        nlosctl.calibrate(table, by="sesion")
    without = {name: values for name, values in table.items() if not name.startswith("truth")}
    with pytest.raises(DataError, match="`truth` columns: the input has no column 'truth_x_m'"):
        nlosctl.calibrate(without, truth="columns")


def test_triplets_have_no_offsets() -> None:
    """A kind without offsets is a usage error that lists those with."""
    table = nlosctl.simulate("room", trials=3)
    with pytest.raises(UsageError, match="triplets have no offsets to calibrate; bearings, ranges"):
        nlosctl.calibrate(table)


def test_rows_flagged_as_not_direct_are_left_out() -> None:
    """Rows with los 0 have no say, whatever they measure; with `all_rows` they have."""
    table, _ = session("ranges", 20, seed=15, sensors=[[0, 0], [30, 0], [30, 20], [0, 20], [15, 40]])
    indirect = np.random.default_rng(3).random(100) < 0.15
    flagged = {**table, "los": (~indirect).astype(int), "range_m": table["range_m"] + 5.0 * indirect}
    found, covariance, _ = offsets(nlosctl.calibrate(flagged))
    expected, expected_covariance, _ = offsets(nlosctl.calibrate(rows(table, ~indirect)))
    assert found.tolist() == expected.tolist()
    assert covariance.tolist() == expected_covariance.tolist()
    assert np.abs(offsets(nlosctl.calibrate(flagged, all_rows=True))[0] - expected).max() > 0.3


def test_a_moving_sensor_has_one_heading_for_all_its_places() -> None:
    """A vehicle that is somewhere else in each snapshot has one offset, like sensors that stay."""
    rng = np.random.default_rng(16)
    table, given = session("bearings", 40, seed=16)
    place = rng.uniform(0.0, 400.0, (40, 2))
    truth = np.stack([table["truth_x_m"], table["truth_y_m"]], axis=1)[::6]
    away = truth - place
    table["sensor_x_m"][5::6], table["sensor_y_m"][5::6] = place.T
    table["bearing_rad"][5::6] = np.arctan2(away[:, 1], away[:, 0]) + given[5] + STDS["bearings"] * rng.normal(size=40)
    found, covariance, scale = offsets(nlosctl.calibrate(table))
    error = found - given
    assert len(found) == 6
    assert error @ np.linalg.solve(covariance, error) < 16.8  # 99 % of chi-square with 6 degrees of freedom
    assert 0.6 < scale[5] < 1.5
