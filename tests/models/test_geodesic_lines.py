"""Tests of azimuths on the earth: geodesics of WGS 84, as pyproj.Geod has them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pyproj
import pytest
from space_worlds import dense_covariance, space_batch

from nlosctl.contract.statuses import Status
from nlosctl.geometry.earth_centred import geodesic_between, local_axes, to_earth_centred, to_geodetic
from nlosctl.methods import bearings_ls, bearings_ml, bearings_stansfield
from nlosctl.models.sight import bearing_lines

GEOD = pyproj.Geod(ellps="WGS84")
METHODS = {module.METHOD.name: module.METHOD for module in (bearings_ls, bearings_stansfield, bearings_ml)}
STATIONS = np.radians([[48.0, 2.0], [52.0, 13.0], [41.0, 12.0]])


def long_range(size: int, std_deg: float, noise: float, seed: int = 1):
    """Return azimuths at three stations of sources 300 to 4000 km away, and the sources' latitudes and longitudes."""
    generator = np.random.default_rng(seed)
    latitude, longitude = np.radians(generator.uniform([28.0, -30.0], [60.0, 45.0], (size, 2))).T
    shape = (size, 3)
    stations = [np.broadcast_to(STATIONS[:, axis], shape) for axis in range(2)]
    ends = [np.broadcast_to(part[:, None], shape) for part in (latitude, longitude)]
    azimuth, _, _ = GEOD.inv(*(np.degrees(part) for part in (stations[1], stations[0], ends[1], ends[0])))
    bearing = np.radians(90.0 - azimuth) + noise * np.radians(std_deg) * generator.standard_normal(shape)
    place = np.stack(to_earth_centred(*stations, np.zeros(shape)), axis=-1)
    batch = space_batch(place, bearing, np.full(shape, np.nan), np.radians(std_deg), 1.0)
    frame = np.asfortranarray(local_axes(*stations))
    return replace(batch, elevation_rad=None, elevation_std_rad=None, sensor_frame=frame), latitude, longitude


@pytest.mark.parametrize("name", METHODS)
def test_exact_azimuths_meet_at_the_source(name: str):
    """Three stations' exact azimuths of pyproj give the source to a centimetre, where a flat plane is off by km."""
    batch, latitude, longitude = long_range(60, 0.1, 0.0)
    estimates = METHODS[name].solve(batch, METHODS[name].options()).estimates
    ok = estimates.status == Status.OK
    assert ok.mean() > 0.9
    found = to_geodetic(*estimates.position_m[ok].T)
    _, distance = geodesic_between(latitude[ok], longitude[ok], found[0], found[1])
    assert distance.max() < 0.01
    assert np.abs(found[2]).max() < 1e-3


def test_covariances_are_the_size_of_errors_on_the_ground():
    """NEES of ml in local east and north is 2 within its 99.9 % interval, and 95 % of ellipses hold the source."""
    batch, latitude, longitude = long_range(1500, 0.1, 1.0, seed=2)
    estimates = bearings_ml.METHOD.solve(batch, bearings_ml.METHOD.options()).estimates
    ok = estimates.status == Status.OK
    assert ok.mean() > 0.9
    position, covariance = estimates.position_m[ok], dense_covariance(estimates.covariance_m2[ok])
    axes = local_axes(latitude[ok], longitude[ok])
    truth = np.stack(to_earth_centred(latitude[ok], longitude[ok], np.zeros(ok.sum())), axis=1)
    error = np.einsum("bij,bj->bi", axes, position - truth)[:, :2]
    plane = np.einsum("bij,bjk,blk->bil", axes, covariance, axes)[:, :2, :2]
    nees = np.einsum("bi,bi->b", error, np.linalg.solve(plane, error[..., None])[..., 0])
    assert 1.8 < nees.mean() < 2.25
    assert 0.93 <= (nees <= 5.991).mean() <= 0.975


def test_slopes_agree_with_finite_differences():
    """The derivatives of the residuals agree with differences of pyproj's azimuths over 200 m."""
    batch, _, _ = long_range(20, 1.0, 1.0, seed=3)
    lines = bearing_lines(batch)
    point = (np.full(20, 3000.0), np.full(20, -2000.0))
    for axis, slope in enumerate(lines.slopes(*point)):
        ahead, back = ([part + sign * 200.0 * (i == axis) for i, part in enumerate(point)] for sign in (1.0, -1.0))
        numeric = (lines.residual(*ahead) - lines.residual(*back)) / (400.0 * lines.std)
        np.testing.assert_allclose(slope, numeric, rtol=1e-4, atol=1e-9)


def test_earth_centred_axes_are_north_and_up():
    """East, north and up are orthogonal, up is the way of growing height, north that of growing latitude."""
    latitude, longitude = np.radians([10.0, -60.0]), np.radians([200.0, 30.0])
    axes = local_axes(latitude, longitude)
    np.testing.assert_allclose(np.einsum("bij,bkj->bik", axes, axes), np.broadcast_to(np.eye(3), (2, 3, 3)), atol=1e-15)
    low, high = (np.stack(to_earth_centred(latitude, longitude, np.full(2, h)), axis=1) for h in (0.0, 1.0))
    np.testing.assert_allclose(high - low, axes[:, 2], atol=1e-8)
    moved = np.stack(to_earth_centred(latitude + 1e-7, longitude, np.zeros(2)), axis=1) - low
    np.testing.assert_allclose(moved / np.linalg.norm(moved, axis=1)[:, None], axes[:, 1], atol=1e-6)
