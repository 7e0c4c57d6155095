"""Tests of ls, stansfield and ml on azimuths and elevations in space."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares
from space_worlds import angles_of, dense_covariance, ring_world, space_batch, with_height

from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.statuses import Status
from nlosctl.methods import bearings_ls, bearings_ml, bearings_stansfield
from nlosctl.models.space.rays import space_lines
from nlosctl.solvers.bearings.line_fits import fit_least_squares, fit_weighted

METHODS = {module.METHOD.name: module.METHOD for module in (bearings_ls, bearings_stansfield, bearings_ml)}


def solved(batch: BearingBatch, name: str, **options):
    """Return the best estimates of a batch."""
    method = METHODS[name]
    return method.solve(batch, method.options(**options)).estimates


def best(estimates):
    """Return the indices of the best estimates."""
    return np.flatnonzero(estimates.alternative == 0)


@pytest.mark.parametrize("name", METHODS)
def test_two_sites_fix_an_object(name: str):
    """Two theodolites of Wang, Ho style fix the object at (3000, 5200, 2400) from compass angles to 1 m."""
    sensor = np.array([[[0.0, 0.0, 120.0], [8200.0, -1500.0, 260.0]]])
    compass, elevation = np.radians([[29.98, 322.18]]), np.radians([[20.80, 14.16]])
    batch = space_batch(sensor, 0.5 * np.pi - compass, elevation, np.radians(0.01), np.radians(0.01))
    np.testing.assert_allclose(solved(batch, name).position_m[0], (2999.5, 5199.5, 2400.0), atol=0.6)


@pytest.mark.parametrize("name", METHODS)
def test_three_arrays_locate_a_speaker(name: str):
    """Three arrays with unit vectors of three digits locate (3, 2, 1) to 1 cm."""
    sensor = np.array([[[0.0, 0.0, 1.2], [5.0, 0.0, 1.2], [2.5, 4.0, 1.2]]])
    unit = np.array([[[0.831, 0.554, -0.055], [-0.705, 0.705, -0.071], [0.241, -0.966, -0.097]]])
    batch = space_batch(sensor, *angles_of(unit), np.radians(1.0), np.radians(1.0))
    np.testing.assert_allclose(solved(batch, name).position_m[0], (3.0, 2.0, 1.0), atol=0.01)


@pytest.mark.parametrize("name", METHODS)
def test_one_height_is_the_plane(name: str):
    """With everything at one height and elevations of 0 position and covariance are those of two dimensions."""
    generator = np.random.default_rng(1)
    sensor = np.concatenate([generator.uniform(-500.0, 500.0, (40, 5, 2)), np.full((40, 5, 1), 30.0)], axis=2)
    source = np.concatenate([generator.uniform(-200.0, 200.0, (40, 2)), np.full((40, 1), 30.0)], axis=1)
    azimuth, elevation = angles_of(source[:, None] - sensor)
    azimuth += np.radians(1.0) * generator.standard_normal(azimuth.shape)
    space = space_batch(sensor, azimuth, elevation, np.radians(1.0), np.radians(2.0))
    plane = replace(space, dimension=2, sensor_z_m=None, elevation_rad=None, elevation_std_rad=None)
    high, flat = solved(space, name), solved(plane, name)
    ok = (flat.status == Status.OK) & (high.status[best(high)] == Status.OK)
    assert ok.sum() > 30
    high_rows = best(high)[ok]
    np.testing.assert_allclose(high.position_m[high_rows, :2], flat.position_m[ok], atol=1e-5)
    np.testing.assert_allclose(high.position_m[high_rows, 2], 30.0, atol=1e-5)
    near = np.abs(high.covariance_m2[high_rows, :3] / flat.covariance_m2[ok] - 1.0)
    assert np.quantile(near, 0.9) < 1e-6


def test_ml_is_the_optimum_of_scipy():
    """ml has the cost of scipy's least squares from the truth plus 1e-6 at most, at the same point to 1e-3 std."""
    batch, source = ring_world(np.random.default_rng(2), 40, 3.0, without_elevation=True)
    estimates = solved(batch, "ml")
    rows = best(estimates)
    lines = space_lines(batch)
    for row in range(40):
        one = lines.take(np.array([row]))

        def scaled(point, one=one):
            return (one.residual(*(np.array([part]) for part in point)) / one.std)[0]

        center = np.array([part[0] for part in one.center])
        fit = least_squares(scaled, source[row] - center, xtol=1e-14, ftol=1e-14, gtol=1e-14)
        assert estimates.cost[rows[row]] <= fit.cost + 1e-6
        shift = estimates.position_m[rows[row]] - center - fit.x
        covariance = dense_covariance(estimates.covariance_m2[rows[row]][None])[0]
        assert shift @ np.linalg.solve(covariance, shift) < 1e-6


def test_closed_forms_are_the_normal_equations():
    """ls and stansfield solve the normal equations of the planes of all angles, as numpy's lstsq does."""
    batch, _ = ring_world(np.random.default_rng(3), 20, 2.0, without_elevation=True)
    lines = space_lines(batch)
    first = fit_least_squares(lines)
    second = fit_weighted(lines, lines.stansfield_width_m(*first.point))
    planes, offsets = lines.planes(slice(None), None)
    normals = np.stack(planes, axis=-1)
    weight = 1.0 / (lines.std * lines.tube_width_m(*first.point))
    for row in range(20):
        plain = np.linalg.lstsq(normals[row], offsets[row], rcond=None)[0]
        np.testing.assert_allclose(np.array(first.point)[:, row], plain, rtol=1e-9, atol=1e-8)
        scaled = weight[row][:, None] * normals[row]
        np.testing.assert_allclose(
            np.array(second.point)[:, row],
            np.linalg.lstsq(scaled, weight[row] * offsets[row], rcond=None)[0],
            rtol=1e-9,
            atol=1e-8,
        )


@pytest.mark.parametrize("without_elevation", [False, True])
@pytest.mark.parametrize("name", METHODS)
def test_covariances_are_the_size_of_errors(name: str, without_elevation: bool):
    """NEES is 3 within its 99.9 % interval and 95 % of ellipsoids hold the source; ml is at the bound."""
    runs = 800
    batch, source = ring_world(np.random.default_rng(4), runs, 2.0, without_elevation=without_elevation)
    estimates = solved(batch, name)
    rows = best(estimates)
    assert (estimates.status[rows] == Status.OK).all()
    error = estimates.position_m[rows] - source
    nees = np.einsum(
        "bi,bi->b", error, np.linalg.solve(dense_covariance(estimates.covariance_m2[rows]), error[..., None])[..., 0]
    )
    assert 2.71 < nees.mean() < 3.30
    assert 0.93 <= (nees <= 7.815).mean() <= 0.975
    if name != "ls":
        lines = space_lines(batch)
        bound = lines.information(*(source[:, axis] - lines.center[axis] for axis in range(3))).inverse().trace
        assert 0.93 < np.sqrt((error**2).sum(axis=1).mean() / bound.mean()) < 1.07


@pytest.mark.parametrize("name", METHODS)
def test_a_single_station_with_a_height_has_a_fix(name: str):
    """One azimuth and elevation meet a measured height where the ray does, for exact and for uncertain heights."""
    sensor, source = np.zeros((1, 1, 3)), np.array([[300.0, 400.0, 250.0]])
    batch = space_batch(sensor, *angles_of(source[:, None] - sensor), np.radians(1.0), np.radians(1.0))
    for std in (0.0, 5.0):
        estimates = solved(with_height(batch, source[:, 2], std), name)
        assert estimates.status.tolist() == [Status.OK]
        np.testing.assert_allclose(estimates.position_m[0], source[0], atol=1e-6)
        assert (estimates.covariance_m2[0, 3:] == 0.0).all() == (std == 0.0)


@pytest.mark.parametrize("name", METHODS)
def test_what_has_no_fix_says_so(name: str):
    """Two scalars are too few; azimuths alone without a height are degenerate; reversed directions are behind."""
    batch, source = ring_world(np.random.default_rng(5), 30, 1.0)
    nothing = np.full(batch.bearing_rad.shape, np.nan)
    alone = replace(batch, elevation_rad=nothing)
    assert set(solved(alone, name).status) == {Status.DEGENERATE}
    fix = solved(with_height(alone, source[:, 2], 1.0), name)
    assert (fix.status[best(fix)] == Status.OK).mean() == 1.0
    one = {
        field: getattr(batch, field)[:, :1]
        for field in (
            "sensor",
            "sensor_xy_m",
            "sensor_z_m",
            "bearing_rad",
            "bearing_std_rad",
            "elevation_rad",
            "elevation_std_rad",
            "path",
            "reflector",
        )
    }
    assert set(solved(replace(batch, **one), name).status) == {Status.TOO_FEW}
    turned = replace(batch, bearing_rad=batch.bearing_rad + np.pi, elevation_rad=-batch.elevation_rad)
    assert set(solved(turned, name).status) == {Status.BEHIND}


def test_a_source_above_a_sensor_needs_a_direction_std():
    """Above a sensor an azimuth's std means nothing: degenerate; with a direction's std the fix is covered."""
    generator = np.random.default_rng(6)
    runs = 600
    corners = [[0.0, 0.0, 0.0], [200.0, 0.0, 0.0], [0.0, 200.0, 0.0], [-150.0, -150.0, 0.0]]
    sensor = np.broadcast_to(corners, (runs, 4, 3))
    source = np.broadcast_to([0.9, 0.0, 100.0], (runs, 3))
    unit = (source[:, None] - sensor) / np.linalg.norm(source[:, None] - sensor, axis=-1, keepdims=True)
    std = np.radians(1.0)
    noisy = unit + std * generator.standard_normal(unit.shape)
    batch = space_batch(sensor, *angles_of(noisy), std, std)
    assert (solved(batch, "ml").status == Status.DEGENERATE).mean() > 0.97
    estimates = solved(replace(batch, direction_std_rad=np.full((runs, 4), std)), "ml")
    rows = best(estimates)
    assert (estimates.status[rows] == Status.OK).all()
    error = estimates.position_m[rows] - source
    nees = np.einsum(
        "bi,bi->b", error, np.linalg.solve(dense_covariance(estimates.covariance_m2[rows]), error[..., None])[..., 0]
    )
    assert 2.67 < nees.mean() < 3.35
    assert 0.93 <= (nees <= 7.815).mean() <= 0.975


@pytest.mark.parametrize("lognormal", [False, True])
def test_ranges_beside_directions_count(lognormal: bool):
    """Ranges beside azimuths and elevations make ml the optimum of both, with a covariance of the size of its error."""
    generator = np.random.default_rng(8)
    runs = 600
    batch, source = ring_world(generator, runs, 2.0, without_elevation=True, rows=4)
    sensor = np.concatenate([batch.sensor_xy_m, batch.sensor_z_m[..., None]], axis=-1)
    distance = np.linalg.norm(source[:, None] - sensor, axis=-1)
    noise = generator.standard_normal(distance.shape)
    measured = distance * np.exp(0.02 * noise) if lognormal else distance + 5.0 * noise
    measured[:, 0] = np.nan
    std = np.where(np.isnan(measured), np.nan, 0.02 * measured if lognormal else 5.0)
    batch = replace(batch, range_m=measured, range_std_m=std)
    noise_law = "lognormal" if lognormal else "gaussian"
    estimates = solved(batch, "ml", range_noise=noise_law)
    rows = best(estimates)
    assert (estimates.status[rows] == Status.OK).all()
    error = estimates.position_m[rows] - source
    covariance = dense_covariance(estimates.covariance_m2[rows])
    nees = np.einsum("bi,bi->b", error, np.linalg.solve(covariance, error[..., None])[..., 0])
    assert 2.67 < nees.mean() < 3.35
    alone = solved(batch, "ml", use_ranges=False)
    assert np.median(np.trace(covariance, axis1=1, axis2=2)) < 0.8 * np.median(
        np.trace(dense_covariance(alone.covariance_m2[best(alone)]), axis1=1, axis2=2)
    )
    one = replace(
        batch,
        **{
            field: getattr(batch, field)[:, 2:3]
            for field in (
                "sensor",
                "sensor_xy_m",
                "sensor_z_m",
                "bearing_rad",
                "bearing_std_rad",
                "elevation_rad",
                "elevation_std_rad",
                "path",
                "reflector",
                "range_m",
                "range_std_m",
            )
        },
    )
    single = solved(one, "ml", range_noise=noise_law)
    error = single.position_m - source
    nees = np.einsum(
        "bi,bi->b", error, np.linalg.solve(dense_covariance(single.covariance_m2), error[..., None])[..., 0]
    )
    assert 2.67 < nees.mean() < 3.35
