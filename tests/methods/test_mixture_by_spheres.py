"""mixture-ml, suppress and ml on directions by spheres, azimuths alone and ranges beside them included."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from space_worlds import Array, dense_covariance, space_batch

from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.fields import parse_field
from nlosctl.contract.results import Solution
from nlosctl.contract.scene import Scene
from nlosctl.contract.statuses import Status
from nlosctl.methods import bearings_mixture_ml, bearings_ml, bearings_suppress
from nlosctl.models.sight import bearing_lines
from nlosctl.models.space.paths import predict_directions, predict_path_vectors
from nlosctl.scenarios.catalogue import scenarios
from nlosctl.solvers.mixture.outlier_model import grouped_batch, outlier_model

EARTH_M = 6371e3
METHODS = {module.METHOD.name: module.METHOD for module in (bearings_mixture_ml, bearings_suppress, bearings_ml)}
MIXTURE = bearings_mixture_ml.MixtureOptions()


def draw_skywave(
    runs: int, seed: int, std_deg: float, share: float, *, stations: int = 8, elevations: int | None = None
) -> tuple[BearingBatch, Array]:
    """Return directions by the ionosphere, a share of them anywhere, and the sources; the last ``elevations`` stay."""
    spec = scenarios()["skywave"]
    options = spec.options(angle_std_deg=std_deg, outlier_fraction=share, sensors=stations)
    columns = spec.generate(options, np.random.default_rng(seed), runs)
    block = {name: values.reshape(runs, -1) for name, values in columns.items() if values.dtype.kind == "f"}
    elevation = block["elevation_rad"].copy(order="F")
    if elevations is not None:
        elevation[:, : stations - elevations] = np.nan
    batch = space_batch(
        np.stack([block[f"sensor_{axis}_m"] for axis in "xyz"], axis=-1),
        block["bearing_rad"],
        elevation,
        block["bearing_std_rad"],
        block["elevation_std_rad"],
        scene=spec.scene(options),
        reflector=np.zeros((runs, stations), dtype=np.int64, order="F"),
    )
    return batch, np.stack([block[f"truth_{axis}_m"][:, 0] for axis in "xyz"], axis=1)


def ground_height_m(source: Array) -> Array:
    """Return the heights (B,) of sources (B, 3) above the globe."""
    return np.asarray(np.linalg.norm(source - [0.0, 0.0, -EARTH_M], axis=1) - EARTH_M)


def above_ground(batch: BearingBatch, height_m: Array, std_m: float) -> BearingBatch:
    """Return a batch with measured heights (B,) above the globe."""
    ones = np.ones(height_m.shape)
    return replace(batch, target_z_m=height_m, target_z_std_m=std_m * ones, target_above_ground=ones)


def best_of(solution: Solution) -> tuple[Array, Array, Array]:
    """Return statuses, positions and covariances of the best estimates."""
    estimates = solution.estimates
    best = estimates.alternative == 0
    return estimates.status[best], estimates.position_m[best], estimates.covariance_m2[best]


def squared_errors(solution: Solution, source: Array) -> Array:
    """Return the normalized squared errors of the ok fixes."""
    status, position, covariance = best_of(solution)
    ok = status == Status.OK
    away = position[ok] - source[ok]
    return np.asarray(np.einsum("bi,bij,bj->b", away, np.linalg.inv(dense_covariance(covariance[ok])), away))


def solve(name: str, batch: BearingBatch, **options: object) -> Solution:
    """Return the solution of a method."""
    return METHODS[name].solve(batch, METHODS[name].options(**options))


@pytest.mark.parametrize("elevations", [8, 4])
@pytest.mark.parametrize("name", ["mixture-ml", "suppress"])
def test_covariances_are_the_size_of_errors_with_a_quarter_of_outliers(name: str, elevations: int) -> None:
    """Of 600 snapshots .83 are ok, NEES is 3 in its 99.9 % interval, 95 % ellipsoids hold, and 95 % are near."""
    batch, source = draw_skywave(600, 7, 0.5, 0.25, elevations=elevations)
    solution = solve(name, batch)
    squared = squared_errors(solution, source)
    assert squared.size > 0.83 * 600
    assert 2.68 < squared.mean() < 3.34
    assert 0.93 <= (squared < 7.815).mean() <= 0.975
    _, position, _ = best_of(solution)
    assert np.nanpercentile(np.linalg.norm(position - source, axis=1), 95.0) < (13e3 if elevations == 8 else 18e3)


def test_the_posterior_covariance_holds_with_few_stations() -> None:
    """Of five stations with a quarter of outliers, 95 % ellipsoids of the whole posterior hold the source."""
    batch, source = draw_skywave(600, 9, 0.5, 0.25, stations=5)
    squared = squared_errors(solve("mixture-ml", batch, covariance="posterior"), source)
    assert squared.size > 0.75 * 600
    assert 0.93 <= (squared < 7.815).mean() <= 0.985


@pytest.mark.parametrize("name", ["mixture-ml", "suppress"])
@pytest.mark.parametrize("stations", [4, 8])
def test_directions_of_no_source_have_no_consensus(name: str, stations: int) -> None:
    """At most 2 % of snapshots in which every row is an outlier are ok."""
    batch, _ = draw_skywave(300, 11, 0.5, 1.0, stations=stations)
    status, _, _ = best_of(solve(name, batch))
    assert np.mean(status == Status.OK) <= 0.02


@pytest.mark.parametrize("kind", ["directions", "azimuths", "open", "ranges", "height"])
def test_the_cost_is_that_of_the_true_paths(kind: str) -> None:
    """The cost of a fix is minus (23) with the directions and lengths of the paths; its gradient is its derivative."""
    batch, source = draw_skywave(40, 3, 0.5, 0.25, elevations=4 if kind == "azimuths" else 8)
    if kind == "open":
        (sphere,) = batch.scene.reflectors
        batch = replace(batch, scene=Scene(reflectors=(replace(sphere, blocker_radius=None),)))
    if kind == "ranges":
        along = np.linalg.norm(np.stack(path_vectors(batch, source)), axis=0)
        ranges = along + 2e3 * np.random.default_rng(4).standard_normal(along.shape)
        ranges[:, 1::2] = np.nan
        batch = replace(batch, range_m=np.asfortranarray(ranges), range_std_m=np.where(np.isnan(ranges), np.nan, 2e3))
    if kind == "height":
        batch = above_ground(batch, ground_height_m(source) + 50.0, 100.0)
    model = outlier_model(*grouped_batch(batch), MIXTURE)
    noise = np.random.default_rng(5).normal(scale=4e3, size=(3, 40))
    point = np.array([part - middle for part, middle in zip(source.T, model.lines.center, strict=True)]) + noise
    at = model.mixture.evaluate(*point)
    cost = equation_23(batch, source + noise.T, model.extent_m, model.minimum_range_m)
    np.testing.assert_allclose(at.cost + model.mixture.least_cost, cost, atol=1e-5)
    scored = model.mixture.score(*(np.repeat(part[:, None], 3, axis=1) for part in point))
    np.testing.assert_allclose(scored, np.repeat(cost[:, None], 3, axis=1), atol=0.05)
    scale = sum(np.abs(slope) for slope in at.gradient) + 1e-4
    for axis in range(3):
        move = np.zeros((3, 1))
        move[axis] = 3.0
        up, down = model.mixture.evaluate(*(point + move)), model.mixture.evaluate(*(point - move))
        assert np.max(np.abs((up.cost - down.cost) / 6.0 - at.gradient[axis]) / scale) < 2e-4


def path_vectors(batch: BearingBatch, source: Array) -> tuple[Array, ...]:
    """Return the vectors from sensors along paths to sources (B, 3), as long as the paths."""
    assert batch.sensor_z_m is not None
    sensor = (batch.sensor_xy_m[..., 0], batch.sensor_xy_m[..., 1], batch.sensor_z_m)
    everywhere = tuple(np.broadcast_to(source[:, axis, None], batch.reflector.shape) for axis in range(3))
    return predict_path_vectors(sensor, everywhere, batch.reflector, batch.scene)


def equation_23(batch: BearingBatch, source: Array, extent_m: Array, minimum_m: Array) -> Array:
    """Return minus (23) at points (B, 3) from the predicted paths; outliers are anywhere within ``extent_m`` (B,)."""
    assert batch.elevation_rad is not None
    assert batch.elevation_std_rad is not None
    vector = path_vectors(batch, source)
    azimuth, elevation = np.arctan2(vector[1], vector[0]), np.arctan2(vector[2], np.hypot(vector[0], vector[1]))
    turn = (azimuth - batch.bearing_rad + np.pi) % (2.0 * np.pi) - np.pi
    density = np.exp(-0.5 * (turn / batch.bearing_std_rad) ** 2) / (np.sqrt(2.0 * np.pi) * batch.bearing_std_rad)
    outlier = np.full(turn.shape, 1.0 / np.pi)
    rise, std = elevation - batch.elevation_rad, batch.elevation_std_rad
    known = np.isfinite(batch.elevation_rad)
    density *= np.where(known, np.exp(-0.5 * (rise / std) ** 2) / (np.sqrt(2.0 * np.pi) * std), 1.0)
    outlier /= np.where(known, np.pi, 1.0)
    if batch.range_m is not None and batch.range_std_m is not None:
        known, off = np.isfinite(batch.range_m), batch.range_m - np.linalg.norm(np.stack(vector), axis=0)
        own = np.exp(-0.5 * (off / batch.range_std_m) ** 2) / (np.sqrt(2.0 * np.pi) * batch.range_std_m)
        density *= np.where(known, own, 1.0)
        outlier /= np.where(known, extent_m[:, None], 1.0)
    possible = (np.abs(turn) < 0.5 * np.pi) & (np.hypot(vector[0], vector[1]) > minimum_m[:, None])
    cost = -np.log(0.75 * np.where(possible, density, 0.0) + 0.25 * outlier).sum(axis=1)
    if batch.target_z_m is not None and batch.target_z_std_m is not None:
        cost += 0.5 * ((ground_height_m(source) - batch.target_z_m) / batch.target_z_std_m) ** 2
    return np.asarray(cost)


@pytest.mark.parametrize("name", ["ml", "mixture-ml", "suppress"])
def test_azimuths_alone_and_a_height_above_ground_determine_a_source(name: str) -> None:
    """Four azimuths by the ionosphere and a height to 300 m: nearly all fixes are ok, with a NEES of 3."""
    batch, source = draw_skywave(600, 13, 0.5, 0.0, stations=4, elevations=0)
    noise = 300.0 * np.random.default_rng(14).standard_normal(600)
    batch = above_ground(batch, ground_height_m(source) + noise, 300.0)
    squared = squared_errors(solve(name, batch), source)
    assert squared.size > 0.96 * 600
    assert 2.68 < squared.mean() < 3.34
    assert 0.93 <= (squared < 7.815).mean() <= 0.975


def test_one_station_needs_a_height_and_a_region() -> None:
    """One direction and a height above ground locate by mixture-ml where ml does; a region of one sensor is a point."""
    batch, source = draw_skywave(50, 15, 0.2, 0.0, stations=1)
    field = f"{-2e6},{2e6},{-2e6},{2e6}"
    batch = above_ground(batch, ground_height_m(source), 100.0)
    status, _, _ = best_of(solve("mixture-ml", batch))
    assert set(status) == {Status.NO_CANDIDATE}
    batch = replace(batch, field=parse_field(field))
    _, robust, _ = best_of(solve("mixture-ml", batch))
    status, trusted, _ = best_of(solve("ml", batch))
    assert np.mean(status == Status.OK) > 0.9
    np.testing.assert_allclose(robust, trusted, atol=5.0)


def test_of_several_paths_of_a_station_one_is_direct() -> None:
    """With the true path among three of each station, unordered, fixes are as good as with that path alone."""
    one, source = draw_skywave(80, 17, 0.2, 0.0, stations=5)
    generator = np.random.default_rng(18)
    shape = (80, 15)

    def spread(values: Array) -> Array:
        return np.asfortranarray(np.repeat(values, 3, axis=1))

    wrong = np.arange(15) % 3 != generator.integers(0, 3, (80, 1))
    azimuth = np.where(wrong, generator.uniform(-np.pi, np.pi, shape), spread(one.bearing_rad))
    assert one.elevation_rad is not None
    assert one.elevation_std_rad is not None
    elevation = np.where(wrong, generator.uniform(0.0, 1.2, shape), spread(one.elevation_rad))
    batch = replace(
        one,
        sensor=spread(one.sensor),
        sensor_xy_m=np.asfortranarray(np.repeat(one.sensor_xy_m, 3, axis=1)),
        sensor_z_m=spread(one.sensor_z_m),
        bearing_rad=np.asfortranarray(azimuth),
        bearing_std_rad=spread(one.bearing_std_rad),
        elevation_rad=np.asfortranarray(elevation),
        elevation_std_rad=spread(one.elevation_std_rad),
        path=np.asfortranarray(np.broadcast_to(np.arange(15) % 3, shape)),
        reflector=np.zeros(shape, dtype=np.int64, order="F"),
    )
    for name in ("mixture-ml", "suppress"):
        solution = solve(name, batch)
        squared = squared_errors(solution, source)
        assert squared.size > 0.8 * 80
        assert 2.0 < squared.mean() < 4.2
        assert solution.flags is not None
        status, _, _ = best_of(solution)
        judged = np.flatnonzero(status == Status.OK)
        los = solution.flags.columns["los"][judged] == True  # noqa: E712
        assert np.mean(los == ~wrong[judged]) > 0.98


@pytest.mark.parametrize("elevations", [0, 4])
def test_sensors_with_axes_of_their_own_take_the_same_paths(elevations: int) -> None:
    """Without a blocker a row takes the path nearest to its direction, also by azimuths in a sensor's own axes."""
    batch, source = draw_skywave(60, 19, 0.2, 0.0, stations=4, elevations=elevations)
    (sphere,) = batch.scene.reflectors
    open_sky = Scene(reflectors=(replace(sphere, blocker_radius=None, center=(0.0, 0.0, 0.0)),))
    center, turn = np.array(sphere.center), np.linalg.qr(np.random.default_rng(20).normal(size=(3, 3)))[0]
    turn[:, 0] *= np.linalg.det(turn)
    assert batch.sensor_z_m is not None
    sensor = np.concatenate([batch.sensor_xy_m, batch.sensor_z_m[..., None]], axis=-1) - center
    fixes = []
    for matrix in (np.eye(3), turn):
        turned = np.asfortranarray(sensor @ matrix.T)
        moved = replace(
            batch,
            scene=open_sky,
            sensor_xy_m=turned[..., :2],
            sensor_z_m=turned[..., 2],
            sensor_frame=np.broadcast_to(matrix.T, (60, 4, 3, 3)),
        )
        lines = bearing_lines(moved)
        local = [part - middle for part, middle in zip(matrix @ (source - center).T, lines.center, strict=True)]
        fixes.append(lines.residual(*local))
    np.testing.assert_allclose(fixes[0], fixes[1], atol=1e-9)
    assert np.abs(fixes[0][:, :4]).max() < 0.05


def test_predicted_directions_are_those_of_the_rows() -> None:
    """Noise-free rows by the sphere have a chi-square of zero at the source, azimuths alone included."""
    batch, source = draw_skywave(30, 21, 0.5, 0.0, elevations=4)
    assert batch.sensor_z_m is not None
    sensor = (batch.sensor_xy_m[..., 0], batch.sensor_xy_m[..., 1], batch.sensor_z_m)
    everywhere = tuple(np.broadcast_to(source[:, axis, None], batch.reflector.shape) for axis in range(3))
    azimuth, elevation = predict_directions(sensor, everywhere, batch.reflector, batch.scene)
    exact = replace(
        batch, bearing_rad=azimuth, elevation_rad=np.where(np.isnan(batch.elevation_rad), np.nan, elevation)
    )
    model = outlier_model(*grouped_batch(exact), MIXTURE)
    point = [part - middle for part, middle in zip(source.T, model.lines.center, strict=True)]
    half = [model.direct.half_chi_square(k, *(part[:, None] for part in point)) for k in range(8)]
    assert np.max(half) < 1e-12
