"""mixture-ml on directions in space, compared with equations of its own, grids and the answers of the plane."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from space_worlds import Array, angles_of, dense_covariance, ring_world, space_batch, with_height

from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.fields import BoxField, CircleField
from nlosctl.contract.results import Solution
from nlosctl.contract.scene import PlaneReflector, Scene
from nlosctl.contract.statuses import Status
from nlosctl.methods import bearings_mixture_ml
from nlosctl.methods.bearings_mixture_ml import MixtureOptions
from nlosctl.solvers.mixture.outlier_model import OutlierModel, grouped_batch, outlier_model

CHI_SQUARE_95 = 7.815
"""The 95 % quantile for three unknowns."""


def with_outliers(generator: np.random.Generator, batch: BearingBatch, share: float) -> BearingBatch:
    """Return a batch with a share of its rows anywhere."""
    bad = generator.random(batch.bearing_rad.shape) < share
    azimuth = np.where(bad, generator.uniform(-np.pi, np.pi, bad.shape), batch.bearing_rad)
    assert batch.elevation_rad is not None
    elevation = np.where(bad, generator.uniform(-0.5 * np.pi, 0.5 * np.pi, bad.shape), batch.elevation_rad)
    elevation = np.where(np.isnan(batch.elevation_rad), np.nan, elevation)
    return replace(batch, bearing_rad=np.asfortranarray(azimuth), elevation_rad=np.asfortranarray(elevation))


def with_ranges(generator: np.random.Generator, batch: BearingBatch, source: Array) -> BearingBatch:
    """Return a batch whose even rows have ranges with a std of 5 m."""
    assert batch.sensor_z_m is not None
    sensor = np.concatenate([batch.sensor_xy_m, batch.sensor_z_m[..., None]], axis=-1)
    distance = np.linalg.norm(source[:, None] - sensor, axis=-1)
    range_m = distance + 5.0 * generator.standard_normal(distance.shape)
    range_m[:, 1::2] = np.nan
    std = np.where(np.isnan(range_m), np.nan, 5.0)
    return replace(batch, range_m=np.asfortranarray(range_m), range_std_m=np.asfortranarray(std))


def in_tangent_plane(batch: BearingBatch) -> BearingBatch:
    """Return a batch whose rows have stds across the ray."""
    return replace(batch, direction_std_rad=batch.elevation_std_rad)


def seen_in_a_mirror(generator: np.random.Generator, batch: BearingBatch, source: Array) -> BearingBatch:
    """Return a batch whose even rows are seen in a tilted plane below the sensors, from equations of its own."""
    normal, point = np.array([0.1, -0.2, 0.97]), np.array([0.0, 0.0, -300.0])
    unit = normal / np.linalg.norm(normal)
    image = source - 2.0 * ((source - point) @ unit)[:, None] * unit
    assert batch.sensor_z_m is not None
    sensor = np.concatenate([batch.sensor_xy_m, batch.sensor_z_m[..., None]], axis=-1)
    azimuth, elevation = angles_of(image[:, None] - sensor)
    reflector = np.full(batch.reflector.shape, -1)
    reflector[:, ::2] = 0
    mirrored = reflector == 0
    noise = 0.01 * generator.standard_normal((2, *mirrored.shape))
    scene = Scene(reflectors=(PlaneReflector(name="floor", point=tuple(point), normal=tuple(normal)),))
    return replace(
        batch,
        scene=scene,
        reflector=np.asfortranarray(reflector),
        bearing_rad=np.asfortranarray(np.where(mirrored, azimuth + noise[0], batch.bearing_rad)),
        elevation_rad=np.asfortranarray(np.where(mirrored, elevation + noise[1], batch.elevation_rad)),
    )


def model_of(batch: BearingBatch, **options: Any) -> OutlierModel:
    """Return the outlier model of a batch."""
    return outlier_model(*grouped_batch(batch), MixtureOptions(**options))


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


@pytest.mark.parametrize("kind", ["angles", "some azimuths", "ranges", "lognormal", "tangent", "mirror", "height"])
def test_derivatives_agree_with_finite_differences(kind: str) -> None:
    """Gradient and second derivatives are those of the cost, whatever the rows measure."""
    generator = np.random.default_rng(5)
    batch, source = ring_world(generator, 20, 2.0, without_elevation=kind == "some azimuths")
    batch = with_outliers(generator, batch, 0.2)
    if kind in ("ranges", "lognormal"):
        batch = with_ranges(generator, batch, source)
    if kind == "tangent":
        batch = in_tangent_plane(batch)
    if kind == "mirror":
        batch = seen_in_a_mirror(generator, batch, source)
    if kind == "height":
        batch = with_height(batch, source[:, 2], 3.0)
    model = model_of(batch, range_noise="lognormal" if kind == "lognormal" else "gaussian")
    point = np.array([part - middle for part, middle in zip(source.T, model.lines.center, strict=True)])
    point += generator.normal(scale=3.0, size=point.shape)
    at, step = model.mixture.evaluate(*point), 1e-3
    scale = sum(np.abs(slope) for slope in at.gradient) + 1.0
    scored = model.mixture.score(*(part[:, None] for part in point))[:, 0]
    np.testing.assert_allclose(scored, at.cost + model.mixture.least_cost, atol=0.02)
    for axis in range(3):
        move = np.zeros((3, 1))
        move[axis] = step
        up, down = model.mixture.evaluate(*(point + move)), model.mixture.evaluate(*(point - move))
        assert np.max(np.abs((up.cost - down.cost) / (2.0 * step) - at.gradient[axis]) / scale) < 1e-5
        assert at.exact is not None
        for other in range(3):
            numeric = (up.gradient[other] - down.gradient[other]) / (2.0 * step)
            error = np.abs(numeric - at.hessian.entry(axis, other)) / at.hessian.trace
            assert np.max(error[at.exact]) < 1e-4
        assert np.count_nonzero(at.exact) > 8


def test_the_cost_is_that_of_the_equations_and_no_grid_point_beats_the_best_mode() -> None:
    """Minus (23) with a density of 1 / (fov pi) for outliers, or 1 / fov without an elevation; best over a grid."""
    generator = np.random.default_rng(8)
    batch, _ = ring_world(generator, 6, 4.0, without_elevation=True, rows=6)
    batch = with_outliers(generator, batch, 0.3)
    box = BoxField(xmin_m=-300.0, xmax_m=300.0, ymin_m=-300.0, ymax_m=300.0, zmin_m=-50.0, zmax_m=250.0)
    batch = replace(batch, field=box)
    estimates = bearings_mixture_ml.solve(batch, MixtureOptions()).estimates
    axes = np.linspace(-300.0, 300.0, 61), np.linspace(-300.0, 300.0, 61), np.linspace(-50.0, 250.0, 31)
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    for row in range(batch.size):
        best = estimates.cost[(estimates.row == row) & (estimates.alternative == 0)][0]
        position = estimates.position_m[(estimates.row == row) & (estimates.alternative == 0)]
        assert best == pytest.approx(equation_23(batch, row, position)[0], abs=1e-6)
        assert best <= equation_23(batch, row, grid).min() + 1e-6


def equation_23(batch: BearingBatch, row: int, points: Array) -> Array:
    """Return minus (23) of a snapshot at points (P, 3) from the equations, with the method's minimum range."""
    assert batch.sensor_z_m is not None
    assert batch.elevation_rad is not None
    assert batch.elevation_std_rad is not None
    total = np.zeros(points.shape[0])
    for k in range(batch.measurements):
        offset = points - np.append(batch.sensor_xy_m[row, k], batch.sensor_z_m[row, k])
        azimuth, elevation = angles_of(offset)
        turn = (azimuth - batch.bearing_rad[row, k] + np.pi) % (2.0 * np.pi) - np.pi
        std = batch.bearing_std_rad[row, k]
        direct = 0.75 * np.exp(-0.5 * (turn / std) ** 2) / (np.sqrt(2.0 * np.pi) * std)
        outlier = 0.25 / np.pi
        if np.isfinite(batch.elevation_rad[row, k]):
            std = batch.elevation_std_rad[row, k]
            rise = elevation - batch.elevation_rad[row, k]
            direct *= np.exp(-0.5 * (rise / std) ** 2) / (np.sqrt(2.0 * np.pi) * std)
            outlier /= np.pi
        level = np.hypot(offset[:, 0], offset[:, 1])
        total -= np.log(np.where((np.abs(turn) < 0.5 * np.pi) & (level > 5.0), direct, 0.0) + outlier)
    return total


def test_azimuths_at_a_known_height_are_the_plane() -> None:
    """With the height exactly known, rows of azimuth alone have the fixes, covariances and statuses of the plane."""
    generator = np.random.default_rng(9)
    batch, _ = ring_world(generator, 60, 2.0, rows=6)
    flat = replace(
        batch, sensor_z_m=np.full_like(batch.sensor_z_m, 12.0), elevation_rad=np.full_like(batch.bearing_rad, np.nan)
    )
    bad = generator.random(batch.bearing_rad.shape) < 0.2
    azimuth = np.where(bad, generator.uniform(-np.pi, np.pi, bad.shape), batch.bearing_rad)
    flat = replace(flat, bearing_rad=np.asfortranarray(azimuth))
    held = with_height(flat, np.full(60, 12.0), 0.0)
    plane = replace(flat, dimension=2, sensor_z_m=None, elevation_rad=None, elevation_std_rad=None, target_z_m=None)
    for covariance in ("inliers", "posterior"):
        options = MixtureOptions(covariance=covariance)  # type: ignore[arg-type]
        ours, theirs = (bearings_mixture_ml.solve(part, options).estimates for part in (held, plane))
        assert np.array_equal(ours.status, theirs.status)
        np.testing.assert_allclose(ours.position_m[:, :2], theirs.position_m, atol=1e-5)
        np.testing.assert_allclose(ours.position_m[:, 2][np.isfinite(ours.position_m[:, 0])], 12.0)
        np.testing.assert_allclose(ours.covariance_m2[:, :3], theirs.covariance_m2, rtol=1e-6)
        known = np.isfinite(ours.covariance_m2[:, 0])
        assert not ours.covariance_m2[known, 3:].any()


def test_everything_at_one_height_has_the_fix_of_the_plane() -> None:
    """Rows without outliers, all at one height with elevations of 0, have x and y of the plane to 1e-5 m."""
    generator = np.random.default_rng(10)
    batch, _ = ring_world(generator, 40, 0.05, rows=6)
    flat = replace(
        batch, sensor_z_m=np.full_like(batch.sensor_z_m, 7.0), elevation_rad=np.zeros_like(batch.bearing_rad)
    )
    plane = replace(flat, dimension=2, sensor_z_m=None, elevation_rad=None, elevation_std_rad=None)
    options = MixtureOptions(alpha=1e-12)
    (_, ours, covariance), (_, theirs, expected) = (
        best_of(bearings_mixture_ml.solve(part, options)) for part in (flat, plane)
    )
    np.testing.assert_allclose(ours[:, 2], 7.0, atol=1e-5)
    np.testing.assert_allclose(ours[:, :2], theirs, atol=1e-5)
    np.testing.assert_allclose(covariance[:, :3], expected, rtol=1e-6)


def test_outliers_cost_as_little_as_in_the_notes() -> None:
    """Eight sensors of 1 to 3 degrees, a quarter of the rows anywhere: errors of at most 12.5, 22.5 and 27 m.

    Median, 90 and 95 per cent; scipy's cauchy loss from the best 4 of 605 grid points has 12.4, 28.9 and 45.0 m.
    """
    generator = np.random.default_rng(3)
    batch, source = ring_world(generator, 1500, 1.0)
    std, elevation_std = np.radians(generator.uniform(1.0, 3.0, (2, *batch.bearing_rad.shape)))
    assert batch.sensor_z_m is not None
    sensor = np.concatenate([batch.sensor_xy_m, batch.sensor_z_m[..., None]], axis=-1)
    azimuth, elevation = angles_of(source[:, None] - sensor)
    azimuth = azimuth + std * generator.standard_normal(std.shape)
    elevation = elevation + elevation_std * generator.standard_normal(std.shape)
    batch = with_outliers(generator, space_batch(sensor, azimuth, elevation, std, elevation_std), 0.25)
    solution = bearings_mixture_ml.solve(batch, MixtureOptions())
    status, position, _ = best_of(solution)
    error = np.linalg.norm(position - source, axis=1)
    assert (np.nanpercentile(error, [50, 90, 95]) < [12.5, 22.5, 27.0]).all()
    assert np.mean(status == Status.OK) > 0.94
    assert 0.93 <= np.mean(squared_errors(solution, source) < CHI_SQUARE_95) <= 0.975


@pytest.mark.parametrize("without_elevation", [False, True])
def test_clean_rows_have_a_true_covariance(without_elevation: bool) -> None:
    """Without outliers the mean normalized squared error is 3 within its 99.9 % interval; 95 % are in the ellipsoid."""
    generator = np.random.default_rng(12)
    batch, source = ring_world(generator, 600, 1.0, without_elevation=without_elevation)
    squared = squared_errors(bearings_mixture_ml.solve(batch, MixtureOptions()), source)
    assert squared.size > 590
    assert 2.68 <= squared.mean() <= 3.34
    assert 0.93 <= np.mean(squared < CHI_SQUARE_95) <= 0.975


def test_the_posterior_covariance_is_that_of_a_grid() -> None:
    """The second moments of the posterior in the search region are sums over a fine grid."""
    generator = np.random.default_rng(14)
    batch, _ = ring_world(generator, 8, 8.0, without_elevation=True, rows=5)
    batch = with_outliers(generator, batch, 0.2)
    box = BoxField(xmin_m=-400.0, xmax_m=400.0, ymin_m=-400.0, ymax_m=400.0, zmin_m=-100.0, zmax_m=300.0)
    batch = replace(batch, field=box)
    solution = bearings_mixture_ml.solve(batch, MixtureOptions(covariance="posterior", least_evidence=-1000.0))
    _, position, covariance = best_of(solution)
    steps = [(np.arange(count) + 0.5) / count for count in (80, 80, 40)]
    axes = -400.0 + 800.0 * steps[0], -400.0 + 800.0 * steps[1], -100.0 + 400.0 * steps[2]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    compared = 0
    for row in np.flatnonzero(np.isfinite(covariance[:, 0])):
        cost = equation_23(batch, row, grid)
        weight = np.exp(cost.min() - cost)
        away = grid - position[row]
        moments = np.einsum("p,pi,pj->ij", weight / weight.sum(), away, away)
        found = dense_covariance(covariance[row][None])[0]
        assert np.trace(found) == pytest.approx(np.trace(moments), rel=0.15)
        compared += 1
    assert compared >= 5


def test_a_measured_height_is_one_more_row() -> None:
    """Two rows of azimuth alone and a height of 2 m std determine x, y and z; without the height they do not."""
    generator = np.random.default_rng(16)
    batch, source = ring_world(generator, 300, 0.5, rows=5)
    alone = replace(batch, elevation_rad=np.full_like(batch.bearing_rad, np.nan))
    measured = with_height(alone, source[:, 2] + 2.0 * generator.standard_normal(300), 2.0)
    squared = squared_errors(bearings_mixture_ml.solve(measured, MixtureOptions()), source)
    assert squared.size > 280
    assert 0.93 <= np.mean(squared < CHI_SQUARE_95) <= 0.98
    status, _, _ = best_of(bearings_mixture_ml.solve(alone, MixtureOptions()))
    assert not np.isin(status, [Status.OK, Status.AMBIGUOUS]).any()


def test_mirrors_and_ranges_join_the_likelihood() -> None:
    """Rows in a plane mirror and rows with ranges, a fifth of them outliers, give fixes of a few metres."""
    generator = np.random.default_rng(18)
    batch, source = ring_world(generator, 200, 0.5)
    for kind in ("mirror", "ranges"):
        changed = (
            seen_in_a_mirror(generator, batch, source) if kind == "mirror" else with_ranges(generator, batch, source)
        )
        changed = with_outliers(generator, changed, 0.2)
        status, position, _ = best_of(bearings_mixture_ml.solve(changed, MixtureOptions()))
        error = np.linalg.norm(position - source, axis=1)
        assert np.mean(status == Status.OK) > 0.9, kind
        assert np.nanmedian(error) < 6.0, kind


def test_flags_of_directions() -> None:
    """The flags of the best fix mark the rows that are anywhere, and have residuals of both angles."""
    generator = np.random.default_rng(20)
    batch, _ = ring_world(generator, 200, 0.5)
    spoiled = with_outliers(generator, batch, 0.25)
    solution = bearings_mixture_ml.solve(spoiled, MixtureOptions())
    flags = solution.flags
    assert flags is not None
    inlier = spoiled.bearing_rad == batch.bearing_rad
    judged = np.asarray(flags.columns["los"] != None)  # noqa: E711 - element by element
    direct = flags.columns["los"] == True  # noqa: E712
    assert np.mean(direct[judged] == inlier[judged]) > 0.98
    assert batch.sensor_z_m is not None
    residual = np.asarray(flags.columns["residual_elevation_rad"], dtype=np.float64)
    _, position, _ = best_of(solution)
    sensor = np.concatenate([batch.sensor_xy_m, batch.sensor_z_m[..., None]], axis=-1)
    _, elevation = angles_of(position[:, None] - sensor)
    known = np.isfinite(residual)
    assert spoiled.elevation_rad is not None
    np.testing.assert_allclose(residual[known], (spoiled.elevation_rad - elevation)[known], atol=1e-9)


@pytest.mark.parametrize("kind", ["angles", "height"])
def test_a_turned_frame_turns_the_answer(kind: str) -> None:
    """Turned about the vertical in a round region, probabilities of rows and costs stay, as far as rounding goes."""
    generator = np.random.default_rng(2)
    sensor, source = generator.uniform(-500.0, 500.0, (200, 2, 3)), generator.uniform(-300.0, 300.0, (200, 3))
    azimuth, elevation = angles_of(source[:, None] - sensor)
    azimuth += 0.03 * generator.standard_normal(azimuth.shape)
    elevation += 0.03 * generator.standard_normal(azimuth.shape)
    field, turn = CircleField(x_m=0.0, y_m=0.0, radius_m=1500.0), 2.0
    cosine, sine = np.cos(turn), np.sin(turn)
    turned = sensor @ np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]]).T
    solutions = []
    for places, angle in ((sensor, azimuth), (turned, (azimuth + turn + np.pi) % (2.0 * np.pi) - np.pi)):
        batch = space_batch(places, angle, elevation, 0.03, 0.03, field=field)
        batch = with_height(batch, source[:, 2] + 5.0, 20.0) if kind == "height" else batch
        solutions.append(bearings_mixture_ml.solve(batch, MixtureOptions()))
    one, other = solutions
    assert one.flags is not None
    assert other.flags is not None
    shares = [np.asarray(flags.columns["los_probability"], dtype=np.float64) for flags in (one.flags, other.flags)]
    np.testing.assert_allclose(*shares, atol=1e-7)
    np.testing.assert_allclose(one.estimates.cost, other.estimates.cost, atol=1e-6)


@pytest.mark.parametrize(("apart_m", "status"), [(1.0, Status.AMBIGUOUS), (150.0, Status.OK)])
def test_sensors_at_one_place_agree_on_an_image_once(apart_m: float, status: Status) -> None:
    """Three rows on an image and two on the source are ambiguous if two of the three have nearly the same place."""
    source, image = np.array([30.0, 40.0, 60.0]), np.array([-120.0, 160.0, 40.0])
    places = [[-400.0, 0.0, 10.0], [0.0, -400.0, 20.0], [200.0, 250.0, 5.0], [200.0, 250.0 + apart_m, 5.0]]
    sensor = np.array([*places, [300.0, -200.0, 0.0]])
    seen = np.stack([source, source, image, image, image]) - sensor
    batch = space_batch(sensor[None], *(part[None] for part in angles_of(seen)), 0.02, 0.02)
    solution = bearings_mixture_ml.solve(batch, MixtureOptions(mode_gap=4.0))
    found, position, _ = best_of(solution)
    assert found.tolist() == [status]
    assert np.linalg.norm(position[0] - image) < 1.0
