"""Methods for ranges by mirrors and circles: exact fixes, global optima, calibration, outliers, statuses."""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt
import pytest
from batches import range_batch
from range_worlds import solve, words
from scipy.optimize import least_squares

from nlosctl.contract.batches import RangeBatch
from nlosctl.contract.fields import CircleField
from nlosctl.contract.scene import CircleReflector, LineReflector, Scene, SegmentReflector
from nlosctl.methods.ranges_mixture_ml import METHOD as MIXTURE
from nlosctl.methods.ranges_r_ls import ML
from nlosctl.models.ranges.circles import range_circles
from nlosctl.models.ranges.predictions import predict_ranges
from nlosctl.scenarios.mixed_ranges import MixedRangesOptions, draw_paths, valley
from nlosctl.testing.moves import take_rows

FloatArray = npt.NDArray[np.float64]

HALL = Scene(
    reflectors=(
        LineReflector(name="wall", point=(0.0, 600.0), direction=(1.0, 0.1)),
        CircleReflector(name="dome", center=(0.0, 0.0), radius=1000.0),
        SegmentReflector(name="board", start=(-100.0, -700.0), end=(500.0, -700.0)),
    )
)
SENSORS = np.array([(-300.0, -200.0), (300.0, -250.0), (250.0, 300.0), (-280.0, 260.0), (0.0, -350.0)])
PATHS = np.array([-1, 0, 1, 0, 1])


def hall(
    seed: int, snapshots: int, std_m: float, paths: npt.NDArray[np.int64] = PATHS
) -> tuple[RangeBatch, FloatArray]:
    """Return noisy ranges in a hall with a wall and a dome, and the sources (B, 2)."""
    generator = np.random.default_rng(seed)
    source = generator.uniform(-200.0, 200.0, (snapshots, 2))
    sensors = SENSORS[np.arange(paths.size) % SENSORS.shape[0]]
    return noisy(generator, sensors, source, np.tile(paths, (snapshots, 1)), HALL, std_m), source


def valley_batch(seed: int, snapshots: int, std_m: float) -> tuple[RangeBatch, FloatArray]:
    """Return noisy ranges of the scenario ``mixed-ranges``, and the sources (B, 2)."""
    generator = np.random.default_rng(seed)
    options = MixedRangesOptions()
    world = valley(options.sensors, options.baseline_m)
    source, reflector = draw_paths(generator, (snapshots, options.sensors), options.baseline_m, options.shares)
    sensors = np.array([sensor.position for sensor in world.sensors])
    return noisy(generator, sensors, source, reflector, world, std_m), source


def noisy(
    generator: np.random.Generator,
    sensors: FloatArray,
    source: FloatArray,
    reflector: npt.NDArray[np.int64],
    scene: Scene,
    std_m: float,
) -> RangeBatch:
    """Return ranges with Gaussian errors from sensors (K, 2)."""
    position = np.broadcast_to(sensors, (*reflector.shape, 2))
    everywhere = np.broadcast_to(source[:, None], position.shape)
    exact = predict_ranges(position, np.zeros(reflector.shape), everywhere, reflector, scene)
    batch = range_batch(position, exact + std_m * generator.normal(size=exact.shape), max(std_m, 1e-3))
    seed = generator.integers(0, 2**63, reflector.shape[0]).astype(np.uint64)
    return dataclasses.replace(batch, scene=scene, reflector=np.asfortranarray(reflector), seed=seed)


@pytest.mark.parametrize("world", [hall, valley_batch])
@pytest.mark.parametrize("method", [ML, MIXTURE])
def test_exact_ranges_give_the_source(method, world) -> None:  # type: ignore[no-untyped-def]
    """Noise-free ranges of direct and reflected rows together give the source to a centimetre, and a good status."""
    batch, source = world(1, 60, 0.0)
    solution = solve(method, batch)
    best = solution.estimates.alternative == 0
    off = np.hypot(*(solution.estimates.position_m[best] - source).T)
    assert np.count_nonzero(off < 1e-2) >= 59  # rows by one mirror alone have a second point
    assert set(words(solution)) <= {"ok", "ambiguous"}


@pytest.mark.parametrize(("world", "std_m", "count"), [(hall, 2.0, 400), (valley_batch, 30.0, 800)])
@pytest.mark.parametrize("method", [ML, MIXTURE])
def test_errors_match_the_covariance(method, world, std_m: float, count: int) -> None:  # type: ignore[no-untyped-def]
    """The mean normalized squared error of fixes is 2, and 95 % ellipses contain 93 to 97.5 % of the sources."""
    batch, source = world(2, count, std_m)
    solution = solve(method, batch)
    best = np.flatnonzero((solution.estimates.alternative == 0) & (np.array(words(solution)) == "ok"))
    assert best.size > 0.98 * count
    error = solution.estimates.position_m[best] - source[solution.estimates.row[best]]
    xx, xy, yy = solution.estimates.covariance_m2[best].T
    squared = (yy * error[:, 0] ** 2 - 2.0 * xy * error[:, 0] * error[:, 1] + xx * error[:, 1] ** 2) / (xx * yy - xy**2)
    assert squared.max() < 40.0
    assert abs(squared.mean() - 2.0) < 3.3 * 2.0 / np.sqrt(best.size)
    assert 0.93 <= np.mean(squared <= 5.991) <= 0.975


def test_the_fix_is_the_global_optimum() -> None:
    """The cost of ``ml`` is the least that scipy reaches from the best of a grid of points in the hall."""
    batch, _ = hall(3, 12, 20.0)
    grid_x, grid_y = np.array(np.meshgrid(np.linspace(-550.0, 550.0, 61), np.linspace(-550.0, 550.0, 61))).reshape(
        2, -1
    )
    solution = solve(ML, batch)
    best = solution.estimates.alternative == 0
    circles = range_circles(batch)
    for row in range(12):
        one = circles.take(np.array([row]))

        def residual(point: FloatArray, one=one) -> FloatArray:  # type: ignore[no-untyped-def]
            scaled = one.residual_m(point[:1], point[1:])[0] / one.std_m[0]
            return np.where(np.isfinite(scaled), scaled, 1e3)

        lengths = [one.length_m(k, grid_x[None], grid_y[None])[0] for k in range(PATHS.size)]
        order = np.argsort(((np.array(lengths) - one.range_m.T) ** 2).sum(axis=0))[:2]
        costs = [least_squares(residual, [grid_x[at], grid_y[at]]).cost for at in order]
        assert solution.estimates.cost[best][row] <= min(costs) + 1e-6


def test_a_reflected_row_is_recognized_as_an_outlier() -> None:
    """A row by the dome whose range is 150 m too long is not line of sight; the fix and the other rows are unharmed."""
    batch, source = hall(4, 100, 2.0, np.array([-1, 0, 1, 0, 1, -1, 1]))
    late = batch.range_m.copy(order="F")
    late[:, 2] += 150.0
    field = CircleField(x_m=0.0, y_m=0.0, radius_m=900.0)
    solution = solve(MIXTURE, dataclasses.replace(batch, range_m=late, field=field))
    assert solution.flags is not None
    best = solution.estimates.alternative == 0
    los = solution.flags.columns["los"].astype(bool)
    assert np.count_nonzero(~los[:, 2]) >= 98
    assert np.delete(los, 2, axis=1).mean() > 0.97
    assert np.median(np.hypot(*(solution.estimates.position_m[best] - source).T)) < 4.0
    assert np.abs(np.median(solution.flags.columns["residual_m"][:, 2]) - 150.0) < 10.0


@pytest.mark.parametrize("method", [ML, MIXTURE])
def test_the_mirror_image_under_the_ground_is_not_the_fix(method) -> None:  # type: ignore[no-untyped-def]
    """Sensors on nearly straight ground: the image of the source below it is neither fix nor alternative."""
    world, generator = valley(6, 10e3), np.random.default_rng(6)
    source, _ = draw_paths(generator, (100, 6), 10e3, (1.0, 0.0, 0.0))
    sensors = np.array([sensor.position for sensor in world.sensors])
    batch = noisy(generator, sensors, source, np.full((100, 6), -1), world, 60.0)
    solution = solve(method, batch)
    assert set(words(solution)) == {"ok"}
    assert (solution.estimates.position_m[:, 1] > 0.0).all()


def test_the_crossing_beyond_the_mirror_is_not_the_fix() -> None:
    """Of two crossings the one that the scene allows is the fix, without ambiguity."""
    sensors = np.array([(0.0, 49.9), (100.0, 49.0)])  # the line to the image of the second is beside the wall
    mirror = Scene(reflectors=(LineReflector(name="wall", point=(0.0, 50.0), direction=(1.0, 0.0)),))
    batch = noisy(np.random.default_rng(0), sensors, np.array([[30.0, 40.0]]), np.array([[-1, 0]]), mirror, 0.0)
    solution = solve(ML, batch)
    assert words(solution) == ["ok"]
    np.testing.assert_allclose(solution.estimates.position_m[0], [30.0, 40.0], atol=1e-6)


@pytest.mark.parametrize("method", [ML, MIXTURE])
def test_a_source_where_the_scene_allows_none_is_infeasible(method) -> None:  # type: ignore[no-untyped-def]
    """A reflection point beyond the end of a segment, and a direct path across one, make the fix infeasible."""
    source, generator = np.array([[-150.0, -300.0]]), np.random.default_rng(0)
    sensors = np.array([(-400.0, -300.0), (-300.0, 200.0), (200.0, 0.0), (100.0, -200.0)])
    past_the_end = noisy(generator, sensors, source, np.array([[2, -1, -1, -1]]), HALL, 0.0)
    # the reflection point on the line of the board is at x = -275, its end at x = -100
    assert words(solve(method, past_the_end))[0] == "infeasible"
    across = noisy(generator, sensors, np.array([[100.0, -900.0]]), np.array([[-1, -1, -1, -1]]), HALL, 0.0)
    assert words(solve(method, across))[0] == "infeasible"


@pytest.mark.parametrize("method", [ML, MIXTURE])
def test_snapshots_do_not_influence_each_other(method) -> None:  # type: ignore[no-untyped-def]
    """A snapshot has the same bits alone and among others with and without rows by circles."""
    batch, _ = hall(5, 9, 2.0)
    assert batch.reflector is not None
    mixed = batch.reflector.copy(order="F")
    mixed[::3] = -1
    mixed[1::3] = np.where(mixed[1::3] == 1, 0, mixed[1::3])
    batch = dataclasses.replace(batch, reflector=mixed)
    together = solve(method, batch).estimates
    for row in range(9):
        alone = solve(method, take_rows(batch, np.array([row]))).estimates
        mine = together.row == row
        for name in ("position_m", "covariance_m2", "cost", "status"):
            np.testing.assert_array_equal(getattr(together, name)[mine], getattr(alone, name))


def test_slant_ranges_by_an_upright_mirror() -> None:
    """Sensors above the plane of the source: the range by a wall is the slant distance from the sensor's image."""
    sensors, source = np.array([(0.0, 0.0), (80.0, 10.0), (20.0, 30.0)]), np.array([50.0, 20.0])
    wall = Scene(reflectors=(LineReflector(name="wall", point=(0.0, 60.0), direction=(1.0, 0.0)),))
    image = np.array([(0.0, 120.0, 12.0), (80.0, 10.0, 8.0), (20.0, 90.0, 5.0)])
    ranges = np.linalg.norm(image - [*source, 0.0], axis=1)[None]
    batch = range_batch(sensors, ranges, 0.01, height=image[:, 2])
    solution = solve(ML, dataclasses.replace(batch, scene=wall, reflector=np.array([[0, -1, 0]])))
    np.testing.assert_allclose(solution.estimates.position_m[0], source, atol=1e-6)
