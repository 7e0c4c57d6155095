"""Calibration of arrival times, and of all kinds in space, against dense least squares and mean residuals."""

from __future__ import annotations

import numpy as np
import pytest
from calibration_worlds import NAMES, ROOM, STDS, joint_fit, rows, session

import nlosctl
from nlosctl.errors import DataError, UsageError
from nlosctl.geometry.earth_centred import local_axes, to_earth_centred, to_geodetic

KINDS = [("arrivals", 2), ("arrivals", 3), ("bearings", 3), ("ranges", 3)]


def world(kind, dimension, snapshots=20, **more):
    """Return a session of seven sensors in the plane or in space."""
    return session(kind, snapshots, sensors=ROOM[:, :dimension], **more)


def calibrated(table, **arguments):
    """Return the calibration of a table, in space where it has heights."""
    return nlosctl.calibrate(table, dimensions=3 if "sensor_z_m" in table else 2, **arguments)


def offsets(found):
    """Return the offsets and their covariance in radians or metres, and the factors of stds."""
    calibration, unit = found.calibration, found.calibration.quantity.scale
    values = np.array([entry.offset for entry in calibration.entries]) * unit
    return values, calibration.covariance * unit**2, np.array([entry.std_scale for entry in calibration.entries])


@pytest.mark.parametrize(("kind", "dimension"), KINDS)
@pytest.mark.parametrize("prior", [None, 2.0])
def test_offsets_are_those_of_least_squares_over_everything(kind, dimension, prior) -> None:
    """Offsets and covariance are those of one fit of all positions, offsets of snapshots and offsets of sensors.

    Of arrivals without a prior those of zero mean, with the pseudo-inverse.
    """
    table, _ = world(kind, dimension, 12, seed=4)
    std = None if prior is None else prior * STDS[kind]
    unit = ("deg", np.pi / 180.0) if kind == "bearings" else ("m", 1.0)
    named = {} if std is None else {f"offset_prior_{unit[0]}": std / unit[1]}
    found, covariance, scale = offsets(calibrated(table, **named))
    expected, expected_covariance = joint_fit(kind, table, scale, found, std)
    if kind == "arrivals" and prior is None:
        assert abs(found.mean()) < 1e-9
        expected = expected - expected.mean()
    stds = np.sqrt(np.diag(expected_covariance))
    np.testing.assert_allclose((found - expected) / stds, 0.0, atol=0.02)
    np.testing.assert_allclose(covariance / np.outer(stds, stds), expected_covariance / np.outer(stds, stds), atol=0.02)


@pytest.mark.parametrize(("kind", "dimension"), KINDS)
def test_known_positions_give_the_mean_residual(kind, dimension) -> None:
    """With the truth an offset is the mean residual, of arrivals that about the mean of each snapshot's."""
    table, _ = world(kind, dimension, seed=5)
    axes = "xyz"[:dimension]
    away = np.stack([table[f"truth_{axis}_m"] - table[f"sensor_{axis}_m"] for axis in axes], axis=1)
    true = np.arctan2(away[:, 1], away[:, 0]) if kind == "bearings" else np.linalg.norm(away, axis=1)
    residual = table[NAMES[kind][0]] - true
    residual = np.angle(np.exp(1j * residual)) if kind == "bearings" else residual
    residual = residual.reshape(20, -1)
    if kind == "arrivals":
        residual = residual - residual.mean(axis=1, keepdims=True)
    found, covariance, scale = offsets(calibrated(table, truth="columns"))
    std = np.sqrt(np.diag(covariance))
    if kind != "arrivals":
        np.testing.assert_allclose(found, residual.mean(axis=0), atol=1e-9)
        np.testing.assert_allclose(std, scale * STDS[kind] / np.sqrt(20.0), rtol=0.02)
        return
    assert np.abs(found - residual.mean(axis=0)).max() < 0.3 * std.max()
    weight = scale**-2.0 / np.sum(scale**-2.0)
    centred = residual - (residual @ weight)[:, None]
    centred = centred.mean(axis=0) - centred.mean()
    np.testing.assert_allclose(found, centred, atol=0.02 * std.max())


def test_a_common_offset_of_arrivals_is_lost_and_named() -> None:
    """It is held at zero mean, also with known positions, and named in the notes; a prior gives it a std."""
    table, given = world("arrivals", 2, seed=6, offsets=np.arange(7) * 0.1)
    for arguments in ({}, {"truth": "columns"}):
        done = calibrated(table, **arguments)
        found, covariance, _ = offsets(done)
        assert abs(found.mean()) < 1e-9
        assert np.abs(covariance.sum(axis=0)).max() < 1e-9 * np.diag(covariance).max()
        assert np.abs(found - (given - given.mean())).max() < 4.0 * np.sqrt(np.diag(covariance)).max()
        everyone = "s0, s1, s2, s3, s4, s5, s6"
        expected = f"the measurements don't determine a common offset of {everyone}: it is held at zero mean"
        assert expected in done.report.notes()
    prior = calibrated(table, offset_prior_m=0.5)
    assert any(note.endswith("it has that of the prior") for note in prior.report.notes())
    common = np.sqrt(np.full(7, 1 / 7) @ offsets(prior)[1] @ np.full(7, 1 / 7))
    assert common == pytest.approx(0.5 / np.sqrt(7.0), rel=1e-6)


def test_snapshots_without_spare_rows_determine_nothing() -> None:
    """Three arrivals in the plane have as many unknowns: all offsets are 0, without a std."""
    table, _ = world("arrivals", 2, seed=8)
    done = calibrated(rows(table, np.isin(table["sensor"], ["s0", "s1", "s3"])))
    assert [(entry.offset, entry.std) for entry in done.calibration.entries] == [(0.0, None)] * 3
    assert any("no snapshot has a position with rows to spare" in note for note in done.report.notes())


@pytest.mark.parametrize("kind", ["bearings", "ranges", "arrivals"])
@pytest.mark.parametrize("std", [0.0, 0.5])
def test_heights_of_the_source_enter_the_elimination(kind, std) -> None:
    """A height held exactly, or measured, is one more row of each snapshot: the offsets are those of a dense fit."""
    table, _ = world(kind, 3, 12, seed=9)
    rng = np.random.default_rng(1)
    height = table["truth_z_m"][::7] + std * rng.normal(size=12)
    heights = {"target_z_m": np.repeat(height, 7), "target_z_std_m": np.full(84, std)}
    found, covariance, scale = offsets(calibrated({**table, **heights}))
    expected, expected_covariance = joint_fit(kind, table, scale, found, height=(height, max(std, 1e-4)))
    expected = expected - (expected.mean() if kind == "arrivals" else 0.0)
    stds = np.sqrt(np.diag(expected_covariance))
    np.testing.assert_allclose((found - expected) / stds, 0.0, atol=0.03)
    np.testing.assert_allclose(covariance / np.outer(stds, stds), expected_covariance / np.outer(stds, stds), atol=0.03)


def test_rows_without_an_elevation_give_their_azimuth() -> None:
    """Offsets are those of a dense fit also where single elevations are empty, in degrees of freedom too."""
    table, _ = world("bearings", 3, 15, seed=13)
    table["elevation_rad"][np.random.default_rng(2).random(105) < 0.3] = np.nan
    found, covariance, scale = offsets(calibrated(table))
    expected, expected_covariance = joint_fit("bearings", table, scale, found)
    stds = np.sqrt(np.diag(expected_covariance))
    np.testing.assert_allclose((found - expected) / stds, 0.0, atol=0.02)
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)), stds, rtol=0.02)


@pytest.mark.parametrize("kind", ["bearings", "ranges", "arrivals"])
@pytest.mark.parametrize("truth", [None, "columns"])
def test_exact_heights_with_the_mixture(kind, truth) -> None:
    """With outliers, and the height held, offsets are within a few stds of the true ones, known positions or not."""
    table, given = world(kind, 3, 60, seed=14, outliers=0.1)
    given = given - given.mean() if kind == "arrivals" else given
    heights = {"target_z_m": table["truth_z_m"], "target_z_std_m": np.zeros(420)}
    found, covariance, _ = offsets(calibrated({**table, **heights}, method="mixture-ml", truth=truth))
    assert (np.abs(found - given) / np.sqrt(np.diag(covariance))).max() < 5.0
    assert np.sqrt(np.diag(covariance)).max() < STDS[kind]


def on_earth(table):
    """Return a table with its places as latitudes, longitudes and heights, by local axes at 48 N, 11 E."""
    origin = tuple(map(np.float64, to_earth_centred(np.radians(48.0), np.radians(11.0), 500.0)))
    axes = local_axes(np.radians(np.array([48.0])), np.radians(np.array([11.0])))[0]
    place = np.stack([table[f"sensor_{axis}_m"] for axis in "xyz"], axis=1) @ axes + origin
    latitude, longitude, height = to_geodetic(*place.T)
    kept = {name: values for name, values in table.items() if not name.startswith(("sensor_", "truth_"))}
    degrees = {"sensor_lat_deg": np.degrees(latitude), "sensor_lon_deg": np.degrees(longitude)}
    return {**kept, **degrees, "sensor_height_m": height}


@pytest.mark.parametrize("kind", ["ranges", "arrivals"])
def test_places_on_earth_give_the_offsets_of_local_metres(kind) -> None:
    """In three dimensions offsets don't depend on the frame; known positions are refused there."""
    table, _ = world(kind, 3, 12, seed=15)
    expected, covariance, _ = offsets(calibrated(table))
    found, _, _ = offsets(nlosctl.calibrate(on_earth(table), dimensions=3))
    np.testing.assert_allclose(found, expected, atol=0.02 * np.sqrt(np.diag(covariance)).min())
    truth = {name: table[name] for name in ("snapshot", "truth_x_m", "truth_y_m", "truth_z_m")}
    with pytest.raises(UsageError, match="`truth` is not for places on earth in three dimensions"):
        nlosctl.calibrate(on_earth(table), dimensions=3, truth=truth)


def test_azimuths_of_geodesics_are_refused() -> None:
    """Azimuths alone on the ground are not calibrated in three dimensions; the message names the cure."""
    table, _ = world("bearings", 3, 5, seed=16)
    azimuths = {name: values for name, values in on_earth(table).items() if not name.startswith("elevation")}
    with pytest.raises(
        UsageError, match="not for azimuths of geodesics or heights above a sphere; set `dimensions` to 2"
    ):
        nlosctl.calibrate({**azimuths, "target_height_m": np.zeros(35)}, dimensions=3)


def statistics(kind, dimension, sessions, snapshots=30):
    """Return the mean chi-square per determined offset, and the mean square of error over std."""
    squares, ratios = [], []
    for seed in range(sessions):
        table, given = world(kind, dimension, snapshots, seed=500 + seed)
        found, covariance, _ = offsets(calibrated(table))
        error = found - given + (given.mean() if kind == "arrivals" else 0.0)
        inverse = np.linalg.pinv(covariance, rcond=1e-8, hermitian=True)
        squares.append(error @ inverse @ error / np.linalg.matrix_rank(inverse, rtol=1e-8))
        ratios.append(error**2 / np.diag(covariance))
    return np.mean(squares), np.mean(ratios)


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "dimension"), KINDS)
def test_many_sessions(kind, dimension) -> None:
    """Chi-squares and squares of error over std near 1; their standard error over 100 sessions is .06."""
    square, ratio = statistics(kind, dimension, 100)
    assert 0.8 < square < 1.25
    assert 0.7 < ratio < 1.3


@pytest.mark.parametrize("truth", [None, "columns"])
def test_late_arrivals_spoil_ml_not_the_mixture(truth) -> None:
    """A fifth of arrivals late by 15 stds: the mixture's offsets are near the true ones, with known positions too."""
    table, given = world("arrivals", 2, 60, seed=12, outliers=0.2)
    given = given - given.mean()
    done = calibrated(table, method="mixture-ml", truth=truth)
    assert done.report.estimate.settled
    assert done.report.estimate.passes <= 20
    robust, covariance, _ = offsets(done)
    assert np.abs(robust - given).max() < 4.5 * np.sqrt(np.diag(covariance)).max() < 0.25
    trusting, _, scale = offsets(calibrated(table, truth=truth))
    assert np.sqrt(np.mean((trusting - given) ** 2)) > 2.0 * np.sqrt(np.mean((robust - given) ** 2))
    assert scale.min() > 3.0


def test_differences_need_the_rows_of_their_references() -> None:
    """With the reference's row differences give the offsets of arrivals; without it, and to several, an error."""
    table, _ = world("arrivals", 2, seed=10)
    first = np.repeat(table["arrival_m"][::7], 7)
    differences = {name: values for name, values in table.items() if name != "arrival_m"}
    differences |= {"tdoa_m": table["arrival_m"] - first, "reference": np.full(140, "s0")}
    found, _, _ = offsets(calibrated(differences))
    np.testing.assert_allclose(found, offsets(calibrated(table))[0], atol=1e-9)
    with pytest.raises(UsageError, match="needs the row of each reference, whose difference is 0; add these rows"):
        calibrated(
            {
                **rows(differences, differences["sensor"] != "s0"),
                "reference_x_m": np.zeros(120),
                "reference_y_m": np.zeros(120),
            }
        )
    of = np.tile([0, 0, 0, 3, 3, 3, 3], 20)
    others = (table["arrival_m"] - table["arrival_m"][np.repeat(np.arange(20) * 7, 7) + of]) * (
        of != np.arange(140) % 7
    )
    several = {**differences, "tdoa_m": others, "reference": np.array([f"s{number}" for number in of])}
    with pytest.raises(UsageError, match="has the offsets of two sensors; a calibration needs one reference"):
        calibrated(several)


def test_an_uncertain_speed_is_refused() -> None:
    """The message names the setting."""
    table, _ = world("arrivals", 2, 3, seed=1)
    with pytest.raises(UsageError, match="takes the speed of the wave as exactly known; leave `speed_std_m_s` out"):
        calibrated(table, speed_m_s="sound", speed_std_m_s=1.0)


def test_truth_in_space_needs_heights() -> None:
    """Truth columns without truth_z_m are an error that names the column."""
    table, _ = world("ranges", 3, seed=11)
    without = {name: values for name, values in table.items() if name != "truth_z_m"}
    with pytest.raises(DataError, match="`truth` columns: the input has no column 'truth_z_m'"):
        calibrated(without, truth="columns")
    with pytest.raises(DataError, match="no column 'truth_z_m'"):
        calibrated(table, truth={name: without[name] for name in ("snapshot", "truth_x_m", "truth_y_m")})
