"""The mixture likelihood of arrivals: late rows, statuses, calibrated covariances, pure noise."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from arrival_batches import arrival_batch
from range_worlds import words
from scipy.optimize import least_squares
from scipy.stats import chi2, norm

from nlosctl.contract.batches import ArrivalBatch
from nlosctl.contract.result_checks import contract_violation
from nlosctl.contract.results import Solution
from nlosctl.contract.statuses import Status
from nlosctl.evaluation.consistency import squared_mahalanobis
from nlosctl.methods import arrivals_mixture_ml, arrivals_ml
from nlosctl.solvers.arrivals.outlier_model import arrival_outlier_model
from nlosctl.solvers.optimization.levenberg_marquardt import minimize
from nlosctl.testing.moves import take_rows

Array = np.ndarray
METHOD = arrivals_mixture_ml.METHOD
TURN = 2.0 * np.pi * np.arange(8) / 8
RING = np.stack([500.0 * np.cos(TURN), 500.0 * np.sin(TURN)], axis=1)


@dataclass(frozen=True)
class World:
    """Snapshots of arrivals, some of them late, with the sources (B, D), the direct rows (B, K) and the offsets."""

    batch: ArrivalBatch
    source: Array
    direct: Array
    offset: Array

    @classmethod
    def of(cls, sensors: Array, source: Array, std: Array, share: float, mean_m: float, seed: int) -> World:
        """Return arrivals at sensors (B, K, D), a share of them late by an exponential delay."""
        generator = np.random.default_rng(seed)
        direct = generator.random(std.shape) >= share
        late = np.where(direct, 0.0, generator.exponential(mean_m, std.shape))
        arrival = np.linalg.norm(source[:, None] - sensors, axis=2) + std * generator.normal(size=std.shape) + late
        first, offset = arrival.min(axis=1), generator.uniform(-1e5, 1e5, source.shape[0])
        seeds = np.arange(source.shape[0], dtype=np.uint64)
        batch = arrival_batch(sensors, arrival - first[:, None], std, origin_m=offset + first, seed=seeds)
        return cls(batch, source, direct, offset)


def ring(snapshots: int, *, share: float = 0.25, mean_m: float = 60.0, seed: int = 1) -> World:
    """Return arrivals at eight sensors on a circle of 500 m, of 1 to 3 m, of sources within 400 m."""
    generator = np.random.default_rng(seed)
    radius, turn = 400.0 * np.sqrt(generator.random(snapshots)), generator.uniform(-np.pi, np.pi, snapshots)
    source = np.stack([radius * np.cos(turn), radius * np.sin(turn)], axis=1)
    std = generator.uniform(1.0, 3.0, (snapshots, 8))
    return World.of(np.broadcast_to(RING, (snapshots, 8, 2)), source, std, share, mean_m, seed + 1)


def box(snapshots: int, sensors: int, *, dimension: int = 3, share: float = 0.2, seed: int = 1) -> World:
    """Return arrivals of 1 to 3 m at sensors in a box of 1000 x 1000 x 300 m, late by 60 m on average."""
    generator = np.random.default_rng(seed)
    sides = np.array([1000.0, 1000.0, 300.0])[:dimension]
    places = sides * generator.random((snapshots, sensors, dimension))
    source = sides * generator.random((snapshots, dimension))
    return World.of(places, source, generator.uniform(1.0, 3.0, (snapshots, sensors)), share, 60.0, seed + 1)


def solve(batch: ArrivalBatch, **options: Any) -> Solution:
    """Return the solution with some options."""
    return METHOD.solve(batch, METHOD.options(**options))


def errors(world: World, solution: Solution) -> Array:
    """Return the errors of the best estimates."""
    best = solution.estimates.alternative == 0
    return np.asarray(np.linalg.norm(solution.estimates.position_m[best] - world.source, axis=1))


def squares(world: World, solution: Solution) -> Array:
    """Return the NEES of the fixes that are ``ok``."""
    estimates = solution.estimates
    ok = (estimates.alternative == 0) & (estimates.status == Status.OK)
    error = estimates.position_m[ok] - world.source[estimates.row[ok]]
    return squared_mahalanobis(error, estimates.covariance_m2[ok])


def exact(sensors: Array, point: Any, offset: float = 7.0) -> Array:
    """Return the arrivals (1, K) of a source without noise."""
    return np.asarray(np.linalg.norm(sensors - np.asarray(point, dtype=float), axis=1)[None] + offset)


def test_late_arrivals_do_not_move_the_fix() -> None:
    """With a quarter late 95 % of the errors are within 9 m; with all rows trusted they exceed 60 m."""
    world = ring(300)
    solution = solve(world.batch)
    assert contract_violation(solution, (300, 8), 2) == ""
    error = errors(world, solution)
    assert np.percentile(error, 95) <= 9.0
    assert np.median(error) < 2.0
    trusting = arrivals_ml.METHOD.solve(world.batch, arrivals_ml.METHOD.options())
    assert np.nanpercentile(errors(world, trusting), 95) > 60.0
    assert solution.flags is not None
    ok = solution.estimates.status[solution.estimates.alternative == 0] == Status.OK
    assert np.mean((solution.flags.columns["los"] == world.direct)[ok]) > 0.94


def test_late_arrivals_do_not_move_the_fix_in_space() -> None:
    """With ten sensors in a box, a fifth late, 95 % of the errors are within 35 m."""
    world = box(200, 10)
    assert np.nanpercentile(errors(world, solve(world.batch)), 95) <= 35.0


@pytest.mark.extensive
@pytest.mark.parametrize("world", [ring(1000, seed=5), box(700, 10, seed=6), box(1500, 8, dimension=2, seed=7)])
def test_an_ok_fix_is_a_true_claim(world: World) -> None:
    """The 95 % ellipses hold 93 to 97 % of the sources, .5 % are absurd, probabilities are right within .03."""
    solution = solve(world.batch)
    assert solution.estimates.covariance_kind == "posterior"
    nees = squares(world, solution)
    noise = 2.5 * np.sqrt(0.05 * 0.95 / nees.size)
    assert abs(np.mean(nees < chi2(world.source.shape[1]).ppf(0.95)) - 0.95) <= 0.02 + noise
    assert np.mean(nees > 100.0) <= 0.005
    ok = solution.estimates.status[solution.estimates.alternative == 0] == Status.OK
    assert solution.flags is not None
    probability, right = solution.flags.columns["los_probability"][ok].ravel(), world.direct[ok].ravel()
    bins = np.minimum((10.0 * probability).astype(int), 9)
    gaps = [abs(probability[bins == i].sum() - right[bins == i].sum()) for i in range(10)]
    assert sum(gaps) / right.size <= 0.03


def test_the_covariance_of_inliers_is_too_small_with_late_rows() -> None:
    """It is that of ``ml`` without late rows, and holds less than 92 % of the sources with them."""
    clean = ring(200, share=0.0)
    ours, theirs = solve(clean.batch, covariance="inliers"), arrivals_ml.METHOD.solve(clean.batch, METHOD_ML_OPTIONS)
    assert ours.estimates.covariance_kind == "inliers"
    best, other = ours.estimates.alternative == 0, theirs.estimates.alternative == 0
    ratio = ours.estimates.covariance_m2[best] / theirs.estimates.covariance_m2[other]
    np.testing.assert_allclose(np.median(ratio, axis=0)[[0, 2]], 1.0, atol=0.1)
    gap = np.linalg.norm(ours.estimates.position_m[best] - theirs.estimates.position_m[other], axis=1)
    assert np.median(gap) < 0.3
    for name in ("offset_m", "offset_std_m"):
        left, right = ours.estimates.columns[name][best], theirs.estimates.columns[name][other]
        assert np.median(np.abs(left - right)) < 0.15
    late = ring(1000, seed=3)
    assert np.mean(squares(late, solve(late.batch, covariance="inliers")) < chi2(2).ppf(0.95)) < 0.93


METHOD_ML_OPTIONS = arrivals_ml.METHOD.options()


def test_the_offset_is_calibrated_with_its_covariance() -> None:
    """The NEES of position and offset together has the mean 3, within the noise of 700 fixes and the skewness."""
    world = ring(900, seed=4)
    estimates = solve(world.batch).estimates
    ok = (estimates.alternative == 0) & (estimates.status == Status.OK)
    row, column = estimates.row[ok], {name: values[ok] for name, values in estimates.columns.items()}
    covariance = np.empty((row.size, 3, 3))
    covariance[:, 0, 0], covariance[:, 0, 1], covariance[:, 1, 1] = estimates.covariance_m2[ok].T
    covariance[:, 0, 2], covariance[:, 1, 2] = column["cov_x_offset_m2"], column["cov_y_offset_m2"]
    covariance[:, 2, 2] = column["offset_std_m"] ** 2
    covariance = np.triu(covariance) + np.swapaxes(np.triu(covariance, 1), 1, 2)
    error = np.column_stack([estimates.position_m[ok] - world.source[row], column["offset_m"] - world.offset[row]])
    nees = np.einsum("bi,bij,bj->b", error, np.linalg.inv(covariance), error)
    assert row.size > 600
    assert np.mean(nees < chi2(3).ppf(0.95)) == pytest.approx(0.95, abs=0.04)
    assert np.mean(nees < chi2(3).ppf(0.5)) == pytest.approx(0.55, abs=0.12)


@pytest.mark.parametrize("late_m", [None, 400.0])
def test_the_cost_is_the_likelihood_of_the_density_as_stated(late_m: float | None) -> None:
    """At the fix the cost is that of SciPy's densities; without ``late_m`` of delays of any magnitude."""
    world = ring(20)
    estimates = solve(world.batch, alpha=0.3, least_evidence=-1000.0, **({} if late_m is None else {"late_m": late_m}))
    estimates = estimates.estimates
    best = estimates.alternative == 0
    std, offset = world.batch.arrival_std_m, estimates.columns["offset_m"][best] - world.batch.origin_m
    away = np.linalg.norm(estimates.position_m[best][:, None] - world.batch.sensor_xy_m, axis=2)
    z = (world.batch.arrival_m - away - offset[:, None]) / std
    edge = norm.cdf(z)
    if late_m is None:
        diagonal = np.hypot(3000.0, 3000.0)
        outlier = edge / ((z + norm.pdf(z) / edge + 1.0) * std * np.log1p(diagonal / std))
    else:
        outlier = edge / late_m
    density = 0.7 * norm.pdf(z) / std + 0.3 * outlier
    np.testing.assert_allclose(estimates.cost[best], -np.log(density).sum(axis=1), atol=1e-6)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("late_m", [None, 300.0])
def test_derivatives_are_those_of_the_cost(dimension: int, late_m: float | None) -> None:
    """Gradient and exact second derivatives are finite differences, also of early and very late arrivals."""
    world = box(30, 6, dimension=dimension, share=0.5)
    mixture = arrival_outlier_model(world.batch, alpha=0.25, late_m=late_m).mixture
    generator = np.random.default_rng(2)
    sensors = np.concatenate(
        [world.batch.sensor_xy_m, (world.batch.sensor_z_m if dimension == 3 else np.zeros((30, 6)))[..., None]], axis=2
    )
    middle = sensors.mean(axis=1)[:, :dimension]
    start = world.source - middle + 4.0 * generator.normal(size=(30, dimension))
    point = [*start.T, world.offset - world.batch.origin_m + 3.0 * generator.normal(size=30)]
    at, step = mixture.evaluate(*point), 1e-4
    score = mixture.score(*(part[:, None] for part in point))[:, 0]
    np.testing.assert_allclose(at.cost + mixture.least_cost, score, rtol=1e-9, atol=1e-9)
    exact_rows = at.exact
    assert exact_rows is not None
    for axis in range(dimension + 1):
        ends = [
            mixture.evaluate(*(part + sign * step * (i == axis) for i, part in enumerate(point))) for sign in (1, -1)
        ]
        slope = (ends[0].cost - ends[1].cost) / (2.0 * step)
        np.testing.assert_allclose(at.gradient[axis], slope, rtol=1e-5, atol=1e-6)
        for other in range(dimension + 1):
            bend = (ends[0].gradient[other] - ends[1].gradient[other]) / (2.0 * step)
            found = at.hessian.entry(axis, other)
            np.testing.assert_allclose(found[exact_rows], bend[exact_rows], rtol=1e-5, atol=1e-6)


def test_no_descent_from_the_truth_finds_a_better_mode() -> None:
    """With eight sensors the best mode is the best that a descent from the true source reaches."""
    world = ring(300, seed=8)
    model = arrival_outlier_model(world.batch, alpha=0.25, late_m=None)
    truth = [world.source[:, axis] - model.arrivals.center[axis] for axis in range(2)]
    end = minimize(model.mixture, *truth, world.offset - world.batch.origin_m)
    estimates = solve(world.batch).estimates
    best = estimates.cost[estimates.alternative == 0]
    assert np.all(best <= end.cost + model.mixture.least_cost + 1e-6)


def test_it_beats_a_robust_loss() -> None:
    """The 90 % quantile of errors is at most a third of that of a Cauchy loss from the best of a grid."""
    world = ring(60, seed=9)
    grid = np.stack(np.meshgrid(np.linspace(-450, 450, 7), np.linspace(-450, 450, 7)), axis=-1).reshape(-1, 2)
    found = []
    for row in range(60):
        arrival, std = world.batch.arrival_m[row], world.batch.arrival_std_m[row]

        def residual(state: Array, arrival: Array = arrival, std: Array = std) -> Array:
            return np.asarray((arrival - np.linalg.norm(state[:2] - RING, axis=1) - state[2]) / std)

        offsets = np.median(arrival - np.linalg.norm(grid[:, None] - RING, axis=2), axis=1)
        starts = np.column_stack([grid, offsets])
        cost = [np.log1p(residual(start) ** 2).sum() for start in starts]
        fits = [least_squares(residual, starts[i], loss="cauchy") for i in np.argsort(cost)[:4]]
        found.append(min(fits, key=lambda fit: fit.cost).x[:2])
    theirs = np.linalg.norm(np.array(found) - world.source, axis=1)
    ours = errors(world, solve(world.batch))
    assert np.percentile(ours, 90) < np.percentile(theirs, 90) / 3.0


@pytest.mark.parametrize(("sensors", "dimension"), [(4, 2), (5, 2), (8, 2), (20, 2), (5, 3), (8, 3)])
def test_uniform_arrivals_are_no_fix(sensors: int, dimension: int) -> None:
    """Of arrivals anywhere within the size of the array at most 2 % give ok or ambiguous."""
    generator = np.random.default_rng(sensors)
    size = 600 if sensors < 20 else 100
    places = generator.random((size, sensors, dimension)) * np.array([1000.0, 1000.0, 300.0])[:dimension]
    noise = arrival_batch(places, generator.uniform(0.0, 1000.0, (size, sensors)), 2.0, want_flags=False)
    estimates = solve(noise, covariance="inliers").estimates
    status = estimates.status[estimates.alternative == 0]
    assert np.mean(status <= Status.AMBIGUOUS) <= 0.02
    free = solve(noise, covariance="inliers", least_evidence=-1000.0).estimates
    assert np.mean(free.status[free.alternative == 0] <= Status.AMBIGUOUS) > 0.1


def test_clean_arrivals_keep_their_fix() -> None:
    """Eight clean rows have a fix in 99 %, five in 90 %; as many rows as unknowns are ambiguous."""
    for sensors, least in ((8, 0.99), (5, 0.9)):
        world = box(400, sensors, dimension=2, share=0.0, seed=sensors)
        estimates = solve(world.batch).estimates
        assert np.mean(estimates.status[estimates.alternative == 0] <= Status.AMBIGUOUS) >= least
    three = box(100, 3, dimension=2, share=0.0)
    assert Status.OK not in solve(three.batch).estimates.status
    assert Status.AMBIGUOUS in solve(three.batch).estimates.status


def test_few_ok_fixes_of_few_rows_are_far_from_their_ellipse() -> None:
    """With a quarter late at most .5 % of the ok fixes of four and five sensors have a squared error over 100."""
    for sensors in (4, 5):
        world = box(2500, sensors, dimension=2, share=0.25, seed=20 + sensors)
        nees = squares(world, solve(world.batch))
        assert nees.size > 400
        assert np.mean(nees > 100.0) <= 0.005 + 2.0 * np.sqrt(0.005 / nees.size)


def test_a_wrong_alpha_moves_few_fixes() -> None:
    """With alpha of .1 or .5 in place of .25 the 90 % quantile of errors grows by at most a quarter."""
    world = ring(300, seed=12)
    right = np.percentile(errors(world, solve(world.batch)), 90)
    for alpha in (0.1, 0.5):
        assert np.percentile(errors(world, solve(world.batch, alpha=alpha)), 90) <= 1.25 * right


SQUARE = np.array([(0, 0, 0), (10, 0, 0), (10, 10, 0), (0, 10, 0)], dtype=float)
LINE = np.array([(0, 0), (3, 0), (7, 0), (12, 0), (15, 0), (20, 0)], dtype=float)


@pytest.mark.parametrize(
    ("sensors", "point", "status"),
    [
        (SQUARE, (5.0, 5.0, 7.0), "degenerate"),
        (np.vstack([SQUARE, (4.0, 7.0, 0.0), (2.0, 1.0, 0.0)]), (3.0, 8.0, 6.0), "ambiguous"),
        (np.vstack([SQUARE, (4.0, 7.0, 0.0), (2.0, 1.0, 0.0)]), (3.0, 8.0, 0.0), "degenerate"),
        (LINE, (4.0, 5.0), "ambiguous"),
        (LINE, (5.0, 0.0), "degenerate"),
        (LINE[:4], (20.0, 0.0), "degenerate"),
        (np.outer([0.0, 1.0, 3.0, 7.0, 9.0], [1.0, 2.0, 0.5]), (4.0, 5.0, 3.0), "degenerate"),
        (np.array([(0, 0), (0, 0), (10, 3)], dtype=float), (2.0, 3.0), "degenerate"),
        (SQUARE[:3], (3.0, 4.0, 5.0), "too_few"),
        (np.zeros((5, 2)), (3.0, 4.0), "too_few"),
        (SQUARE[:, :2], (30.0, 60.0), "outside_field"),
    ],
    ids=[
        "axis",
        "plane",
        "in-plane",
        "aside",
        "on-line",
        "beyond",
        "line-in-space",
        "one-place",
        "three",
        "one",
        "out",
    ],
)
def test_statuses_of_arrays(sensors: Array, point: Any, status: str) -> None:
    """Arrays that leave a coordinate unobservable are degenerate, mirror images ambiguous with both answers."""
    std = 1e-4 if status == "outside_field" else 0.02
    extra = np.vstack([sensors, [(4.0, 7.0), (1.0, 3.0), (8.0, 2.0)]]) if status == "outside_field" else sensors
    solution = solve(arrival_batch(extra, exact(extra, point), std))
    assert words(solution)[0] == status
    if status == "ambiguous":
        away = np.linalg.norm(solution.estimates.position_m - np.asarray(point), axis=1)
        assert away.min() < 1e-3
        mirrored = np.array([*point[:-1], -point[-1]])
        assert np.linalg.norm(solution.estimates.position_m - mirrored, axis=1).min() < 1e-3
    if status == "outside_field":
        np.testing.assert_allclose(solution.estimates.position_m[0], point, atol=0.05)
        assert np.isnan(solution.estimates.covariance_m2[0]).all()


@pytest.mark.parametrize("distance", [30.0, 3e3, 1e6, 1e9, 1e15])
def test_far_sources_are_degenerate(distance: float) -> None:
    """A source tens to 1e15 array sizes away, whose arrivals are those of a plane wave, has no position."""
    generator = np.random.default_rng(4)
    sensors = generator.uniform(-1.0, 1.0, (6, 2))
    wave = -sensors @ np.array([0.6, 0.8]) if distance > 1e12 else exact(sensors, distance * np.array([0.6, 0.8]))[0]
    batch = arrival_batch(sensors, (wave - wave[0] + 1e-3 * generator.normal(size=6))[None], 1e-3)
    assert words(solve(batch)) == ["degenerate"]


def test_heights_of_the_source() -> None:
    """A measured height removes the mirror image of receivers on the ground, an exact one has no variance."""
    generator = np.random.default_rng(3)
    receivers = np.column_stack([generator.uniform(-3e4, 3e4, (6, 2)), np.zeros(6)])
    arrivals = exact(receivers, (4000.0, -7000.0, 9000.0)) + 5.0 * generator.normal(size=(1, 6))
    arrivals[0, 2] += 400.0
    free = solve(arrival_batch(receivers, arrivals, 5.0)).estimates
    assert Status(free.status[0]) == Status.AMBIGUOUS
    measured = solve(arrival_batch(receivers, arrivals, 5.0, 9020.0, 50.0)).estimates
    assert Status(measured.status[0]) == Status.OK
    np.testing.assert_allclose(measured.position_m[0], (4000.0, -7000.0, 9000.0), atol=100.0)
    held = solve(arrival_batch(receivers, arrivals, 5.0, 9000.0, 0.0))
    assert contract_violation(held, (1, 6), 3) == ""
    assert words(held)[0] == "ok"
    assert (held.estimates.covariance_m2[0, 3:] == 0.0).all()
    assert held.estimates.columns["cov_z_offset_m2"][0] == 0.0
    assert held.flags is not None
    np.testing.assert_array_equal(held.flags.used[0], [True, True, False, True, True, True])
    np.testing.assert_allclose(held.flags.columns["residual_m"][0, 2], 400.0, atol=20.0)


def test_it_does_not_depend_on_the_origin_or_an_offset() -> None:
    """Adding 1e7 m to all arrivals and 6e6 m to all coordinates moves the fix by less than 1e-3 standard deviations."""
    generator = np.random.default_rng(5)
    sensors = generator.uniform(0.0, 500.0, (8, 3))
    arrivals = exact(sensors, (200.0, 300.0, 90.0)) + generator.normal(size=(1, 8))
    one = solve(arrival_batch(sensors, arrivals, 1.0)).estimates
    two = solve(arrival_batch(sensors + 6e6, arrivals + 1e7, 1.0)).estimates
    np.testing.assert_allclose(two.position_m - 6e6, one.position_m, atol=1e-4)
    np.testing.assert_allclose(two.columns["offset_m"] - 1e7, one.columns["offset_m"], atol=1e-4)
    np.testing.assert_allclose(two.covariance_m2, one.covariance_m2, rtol=1e-4)


def test_random_subsets_do_not_depend_on_the_batch() -> None:
    """With more subsets than ``max_subsets`` a snapshot has the same bits alone, and the best of all subsets."""
    world = box(12, 14, dimension=3, seed=3)
    whole = solve(world.batch, max_subsets=200)
    for row in (0, 7):
        alone = solve(take_rows(world.batch, np.array([row])), max_subsets=200).estimates
        mine = whole.estimates.row == row
        np.testing.assert_array_equal(whole.estimates.position_m[mine], alone.position_m)
        np.testing.assert_array_equal(whole.estimates.covariance_m2[mine], alone.covariance_m2)
    every = solve(world.batch, max_subsets=2000).estimates
    cost = [part.cost[part.alternative == 0] for part in (whole.estimates, every)]
    np.testing.assert_allclose(cost[0], cost[1], atol=1e-6)


def test_the_likeliest_offset_at_known_positions_is_that_of_a_fine_grid() -> None:
    """No offset on a grid over all arrivals is likelier than the one at the true position, with late rows too."""
    world = ring(10, seed=17)
    model = arrival_outlier_model(world.batch, alpha=0.25, late_m=None)
    point = tuple(part - middle for part, middle in zip(world.source.T, model.arrivals.center, strict=True))
    offset = model.likeliest_offset(*point)
    grid = np.linspace(-1200.0, 1200.0, 12001)
    for snapshot in range(10):
        one = model.take(np.array([snapshot]))
        at = tuple(np.full((1, grid.size), part[snapshot]) for part in point)
        least = one.mixture.score(*at, grid[None, :]).min()
        found = one.mixture.score(*(part[:, :1] for part in at), np.array([[offset[snapshot]]]))[0, 0]
        assert found < least + 1e-2
    position, direct = METHOD.direct_rows(world.batch, METHOD.options(), world.source)
    assert position is world.source
    assert np.mean((direct > 0.5) == world.direct) > 0.9
