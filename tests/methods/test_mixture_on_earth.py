"""mixture-ml and suppress on azimuths of geodesics: long-range direction finding with outliers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pyproj
import pytest
from space_worlds import Array, dense_covariance, space_batch

from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.results import Solution
from nlosctl.contract.statuses import Status
from nlosctl.errors import UsageError
from nlosctl.geometry.earth_centred import local_axes, to_earth_centred, to_geodetic
from nlosctl.methods import bearings_mixture_ml, bearings_ml, bearings_suppress
from nlosctl.solvers.mixture.outlier_model import OutlierModel, grouped_batch, outlier_model

GEOD = pyproj.Geod(ellps="WGS84")
STATIONS = np.array([[48, 2], [52, 13], [41, 12], [60, 10], [38, -6], [55, -4], [46, 22], [64, 26]])
METHODS = {module.METHOD.name: module.METHOD for module in (bearings_mixture_ml, bearings_suppress, bearings_ml)}


def azimuths_deg(latitude: Array, longitude: Array, stations: int) -> Array:
    """Return the azimuths (B, K) of geodesics from the stations to places in degrees."""
    shape = latitude.shape[0], stations
    ends = (np.broadcast_to(part[:, None], shape) for part in (longitude, latitude))
    starts = (np.broadcast_to(STATIONS[:stations, axis], shape) for axis in (1, 0))
    return np.asarray(GEOD.inv(*starts, *ends)[0])


def batch_of(azimuth_deg: Array, std_deg: float) -> BearingBatch:
    """Return the earth-centred batch of azimuths (B, K) from north at the stations."""
    shape = azimuth_deg.shape
    places = [np.broadcast_to(np.radians(STATIONS[: shape[1], axis]), shape) for axis in range(2)]
    sensor = np.stack(to_earth_centred(*places, np.zeros(shape)), axis=-1)
    batch = space_batch(sensor, np.radians(90.0 - azimuth_deg), np.full(shape, np.nan), np.radians(std_deg), 1.0)
    frame = np.asfortranarray(local_axes(*places))
    return replace(batch, elevation_rad=None, elevation_std_rad=None, sensor_frame=frame)


def draw(size: int, seed: int, std_deg: float, share: float, stations: int = 8) -> tuple[BearingBatch, Array, Array]:
    """Return azimuths with a share of them anywhere, the sources (B, 2) in degrees, and the outliers (B, K)."""
    generator = np.random.default_rng(seed)
    source = generator.uniform([38.0, -8.0], [62.0, 28.0], (size, 2))
    azimuth = azimuths_deg(*source.T, stations)
    azimuth = azimuth + std_deg * generator.standard_normal(azimuth.shape)
    wrong = generator.random(azimuth.shape) < share
    return batch_of(np.where(wrong, generator.uniform(0.0, 360.0, wrong.shape), azimuth), std_deg), source, wrong


def on_ground(solution: Solution, source: Array) -> tuple[Array, Array, Array]:
    """Return statuses, errors (B, 2) in metres east and north, and covariances (B, 2, 2) at the fixes."""
    estimates = solution.estimates
    best = estimates.alternative == 0
    latitude, longitude, _ = to_geodetic(*estimates.position_m[best].T)
    azimuth, _, length = GEOD.inv(*source.T[::-1], np.degrees(longitude), np.degrees(latitude))
    error = np.stack([length * np.sin(np.radians(azimuth)), length * np.cos(np.radians(azimuth))], axis=1)
    axes = local_axes(latitude, longitude)
    whole = np.einsum("bij,bjk,blk->bil", axes, dense_covariance(estimates.covariance_m2[best]), axes)
    return estimates.status[best], error, whole[:, :2, :2]


@pytest.mark.parametrize("name", ["mixture-ml", "suppress"])
def test_fixes_are_those_of_the_rows_that_agree(name: str) -> None:
    """With exact azimuths and one of five anywhere the fix is the source, with the covariance of ml without it."""
    _, source, _ = draw(40, 1, 0.1, 0.0)
    azimuth = azimuths_deg(*source.T, 5)
    azimuth[:, 4] = np.random.default_rng(2).uniform(0.0, 360.0, 40)
    options = METHODS[name].options()
    status, error, covariance = on_ground(METHODS[name].solve(batch_of(azimuth, 0.1), options), source)
    trusted = bearings_ml.solve(batch_of(azimuth[:, :4], 0.1), METHODS["ml"].options())
    _, _, expected = on_ground(trusted, source)
    ok = status == Status.OK
    assert ok.mean() > 0.8
    assert np.abs(error[ok]).max() < (0.1 if name == "mixture-ml" else 100.0)
    np.testing.assert_allclose(covariance[ok], expected[ok], rtol=5e-3, atol=5e-3 * np.abs(expected).max())


@pytest.mark.parametrize("name", ["mixture-ml", "suppress"])
def test_covariances_are_the_size_of_errors_with_a_quarter_of_outliers(name: str) -> None:
    """NEES is 2 in its 99.9 % interval, 95 % ellipses hold, and direct rows are recognized."""
    batch, source, wrong = draw(400, 77, 0.1, 0.25)
    solution = METHODS[name].solve(batch, METHODS[name].options())
    status, error, covariance = on_ground(solution, source)
    ok = status == Status.OK
    assert ok.mean() > 0.94
    squared = np.einsum("bi,bij,bj->b", error[ok], np.linalg.inv(covariance[ok]), error[ok])
    assert 1.68 < squared.mean() < 2.35
    assert 0.93 <= (squared < 5.991).mean() <= 0.975
    assert solution.flags is not None
    los = solution.flags.columns["los"][ok] == True  # noqa: E712
    assert np.mean(los == ~wrong[ok]) > 0.97


@pytest.mark.parametrize("name", ["mixture-ml", "suppress"])
@pytest.mark.parametrize("stations", [4, 8])
def test_azimuths_of_no_source_have_no_consensus(name: str, stations: int) -> None:
    """At most 2 % of snapshots in which every row is an outlier are ok."""
    batch, _, _ = draw(150, 5, 0.5, 1.0, stations)
    solution = METHODS[name].solve(batch, METHODS[name].options())
    assert np.mean(solution.estimates.status[solution.estimates.alternative == 0] == Status.OK) <= 0.02


def model_of(batch: BearingBatch) -> OutlierModel:
    """Return the outlier model of a batch."""
    return outlier_model(*grouped_batch(batch), bearings_mixture_ml.MixtureOptions())


def equation_23(model: OutlierModel, azimuth_deg: Array, std_deg: float, point: tuple[Array, ...]) -> Array:
    """Return minus (23) at points (B,) east and north of the middle of the sensors, by pyproj alone."""
    middle = np.degrees(model.lines.longitude), np.degrees(model.lines.latitude)
    away = np.degrees(np.arctan2(point[0], point[1])), np.hypot(*point)
    longitude, latitude, _ = GEOD.fwd(*middle, *away)
    turn = azimuths_deg(latitude, longitude, azimuth_deg.shape[1]) - azimuth_deg
    turn, std = np.radians((turn + 180.0) % 360.0 - 180.0), np.radians(std_deg)
    density = np.exp(-0.5 * (turn / std) ** 2) / (np.sqrt(2.0 * np.pi) * std)
    return np.asarray(-np.log(0.75 * np.where(np.abs(turn) < 0.5 * np.pi, density, 0.0) + 0.25 / np.pi).sum(axis=1))


def test_the_cost_is_that_of_the_geodesics_and_its_gradient_is_its_derivative() -> None:
    """Minus (23) by pyproj's azimuths; scores at many points agree; gradients agree with differences of 80 m."""
    batch, source, _ = draw(30, 7, 1.0, 0.3)
    model = model_of(batch)
    azimuth = 90.0 - np.degrees(batch.bearing_rad)
    middle = np.degrees(model.lines.longitude), np.degrees(model.lines.latitude)
    toward, _, length = GEOD.inv(*middle, *source.T[::-1])
    noise = np.random.default_rng(8).normal(scale=3e4, size=(2, 30))
    point = np.array([length * np.sin(np.radians(toward)), length * np.cos(np.radians(toward))]) + noise
    at = model.mixture.evaluate(*point)
    expected = equation_23(model, azimuth, 1.0, tuple(point))
    np.testing.assert_allclose(at.cost + model.mixture.least_cost, expected, atol=1e-6)
    scored = model.mixture.score(*(np.repeat(part[:, None], 2, axis=1) for part in point))
    np.testing.assert_allclose(scored[:, 1], expected, atol=1e-6)
    for axis in range(2):
        move = 40.0 * np.eye(2)[:, axis, None]
        up, down = (equation_23(model, azimuth, 1.0, tuple(point + sign * move)) for sign in (1.0, -1.0))
        np.testing.assert_allclose(at.gradient[axis], (up - down) / 80.0, atol=2e-4 * np.abs(at.gradient).max())


def test_the_posterior_covariance_is_that_of_a_grid() -> None:
    """The second moment about the mode is that of the posterior on a grid of the region, to 15 %."""
    batch, _, _ = draw(5, 9, 6.0, 0.2, stations=5)
    options = bearings_mixture_ml.MixtureOptions(covariance="posterior", least_evidence=-1000.0, search_outside=False)
    solution = bearings_mixture_ml.solve(batch, options)
    model = model_of(batch)
    lower, upper = model.region.bounds_m
    inliers = bearings_mixture_ml.solve(batch, replace(options, covariance="inliers"))
    compared = 0
    for row in range(5):
        best = np.flatnonzero((solution.estimates.row == row) & (solution.estimates.alternative == 0))[0]
        if not np.isfinite(solution.estimates.covariance_m2[best, 0]):
            continue
        axes = [np.linspace(low[row], high[row], 161) for low, high in zip(lower, upper, strict=True)]
        grid = [part.ravel()[None] for part in np.meshgrid(*axes, indexing="ij")]
        weight = np.exp(-model.mixture.take(np.array([row])).score(*grid)[0] + solution.estimates.cost[best])
        place = model.lines.take(np.full(grid[0].size, row)).absolute(grid[0][0], grid[1][0])
        away = np.stack(place, axis=1) - solution.estimates.position_m[best]
        latitude, longitude, _ = to_geodetic(*solution.estimates.position_m[best])
        level = away @ local_axes(np.array([latitude]), np.array([longitude]))[0, :2].T
        moment = np.sum(weight[:, None] * level * level) / weight.sum()
        found = np.trace(dense_covariance(solution.estimates.covariance_m2[best : best + 1])[0])
        assert found == pytest.approx(moment, rel=0.15)
        assert found > 1.05 * np.trace(dense_covariance(inliers.estimates.covariance_m2[best : best + 1])[0])
        compared += 1
    assert compared > 2


def test_ranges_beside_azimuths_are_refused() -> None:
    """Ranges beside azimuths of geodesics have no model: a usage error says what to set."""
    batch, _, _ = draw(3, 10, 1.0, 0.0)
    ranged = replace(batch, range_m=np.full(batch.bearing_rad.shape, 1e6), range_std_m=np.ones(batch.bearing_rad.shape))
    with pytest.raises(UsageError, match="use_ranges=false"):
        bearings_mixture_ml.solve(ranged, bearings_mixture_ml.MixtureOptions())
