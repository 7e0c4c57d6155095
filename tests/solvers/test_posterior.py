"""The posterior of a position: second moments and probabilities of rows against sums over a fine grid, calibration."""

from __future__ import annotations

import dataclasses
from itertools import product

import numpy as np
import numpy.typing as npt
import pytest
from batches import bearing_batch

from nlosctl.contract.batches import BearingBatch, RangeBatch
from nlosctl.contract.fields import BoxField, SensorsField
from nlosctl.contract.results import Solution
from nlosctl.contract.statuses import Status
from nlosctl.methods import bearings_mixture_ml, bearings_suppress, ranges_mixture_ml
from nlosctl.methods.bearings_mixture_ml import MixtureOptions
from nlosctl.methods.ranges_mixture_ml import RangeMixtureOptions
from nlosctl.solvers.mixture.posterior import _RULES
from nlosctl.solvers.mixture.proposal import unit_vectors

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

_SIDE = 1000.0
_FIELD = BoxField(xmin_m=0.0, xmax_m=_SIDE, ymin_m=0.0, ymax_m=_SIDE)


@dataclasses.dataclass(frozen=True)
class World:
    """Sensors and a source anywhere in a square, ``share`` of the bearings uniform over the circle."""

    sensors: int
    share: float
    std_deg: tuple[float, float] = (1.0, 5.0)
    paths: int = 1

    def draw(self, snapshots: int, seed: int) -> tuple[BearingBatch, FloatArray, BoolArray]:
        """Return a batch, the sources (B, 2), and which rows (B, K) are direct."""
        generator = np.random.default_rng(seed)
        sensor = generator.uniform(0.0, _SIDE, (snapshots, self.sensors, 2))
        source = generator.uniform(0.0, _SIDE, (snapshots, 2))
        std = np.radians(generator.uniform(*self.std_deg, (snapshots, 1)))
        offset = source[:, None] - sensor
        bearing = np.arctan2(offset[..., 1], offset[..., 0]) + std * generator.normal(size=offset.shape[:2])
        random = generator.random(bearing.shape) < self.share
        paths = [np.where(random, generator.uniform(-np.pi, np.pi, bearing.shape), bearing)]
        paths += [generator.uniform(-np.pi, np.pi, bearing.shape) for _ in range(self.paths - 1)]
        rows = (snapshots, self.sensors * self.paths)

        def dense(values: npt.NDArray[np.generic]) -> npt.NDArray[np.generic]:
            return np.asfortranarray(np.repeat(np.broadcast_to(values, (snapshots, self.sensors)), self.paths, axis=1))

        nothing = np.full(rows, -1, order="F")
        batch = BearingBatch(
            seed=np.arange(snapshots, dtype=np.uint64),
            field=_FIELD,
            sensor=dense(np.arange(self.sensors)),  # type: ignore[arg-type]
            sensor_xy_m=np.asfortranarray(np.repeat(sensor, self.paths, axis=1)),
            bearing_rad=np.asfortranarray(np.stack(paths, axis=2).reshape(rows)),
            bearing_std_rad=np.asfortranarray(np.broadcast_to(std, rows)),
            path=nothing
            if self.paths == 1
            else np.asfortranarray(np.tile(np.arange(self.paths), (snapshots, self.sensors))),
            reflector=nothing,
        )
        return batch, source, dense(~random) & np.tile(np.arange(self.paths) == 0, self.sensors)  # type: ignore[return-value]

    def options(self, **changes: object) -> MixtureOptions:
        """Return the options with the right share of outliers; no snapshot is without a consensus or outside."""
        fixed = {"alpha": max(self.share, 0.02), "field_of_view_deg": 360.0}
        fixed |= {"least_evidence": -1000.0, "search_outside": False}
        return MixtureOptions(**{**fixed, **changes})  # type: ignore[arg-type]


def solve(world: World, batch: BearingBatch, **options: object) -> Solution:
    """Return the solution of a batch with the right share of outliers."""
    return bearings_mixture_ml.solve(batch, world.options(**options))


def grid_posterior(
    world: World, batch: BearingBatch, row: int, about: FloatArray, steps: int
) -> tuple[FloatArray, FloatArray]:
    """Return the second moment (2, 2) about a point and each row's probability, summed over a grid of the field."""
    axis = (np.arange(steps) + 0.5) * _SIDE / steps
    x, y = np.meshgrid(axis, axis)
    alpha, sensor, std = world.options().alpha, batch.sensor_xy_m[row], batch.bearing_std_rad[row]
    largest = np.ptp(sensor, axis=0).max()
    likelihood, terms = np.ones_like(x), []
    for first in range(0, sensor.shape[0], world.paths):
        group = []
        for k in range(first, first + world.paths):
            dx, dy = x - sensor[k, 0], y - sensor[k, 1]
            error = (batch.bearing_rad[row, k] - np.arctan2(dy, dx) + np.pi) % (2.0 * np.pi) - np.pi
            density = np.exp(-0.5 * (error / std[k]) ** 2) / (np.sqrt(2.0 * np.pi) * std[k])
            density[np.hypot(dx, dy) < 0.005 * largest] = 0.0
            group.append((1.0 - alpha) / world.paths * density * 2.0 * np.pi)
        total = alpha + np.sum(group, axis=0)
        likelihood *= total
        terms += [term / total for term in group]
    dx, dy = x - about[0], y - about[1]
    mass = likelihood.sum()
    xx, xy, yy = ((likelihood * product).sum() / mass for product in (dx * dx, dx * dy, dy * dy))
    return np.array([[xx, xy], [xy, yy]]), np.array([(likelihood * term).sum() / mass for term in terms])


@pytest.mark.parametrize(
    "world",
    [
        World(3, 0.25, (2.0, 6.0)),
        pytest.param(World(5, 0.4, (2.0, 8.0)), marks=pytest.mark.extensive),
        pytest.param(World(3, 0.3, (2.0, 6.0), 2), marks=pytest.mark.extensive),
    ],
)
def test_the_moments_are_those_of_a_fine_grid(world: World) -> None:
    """Of seven snapshots one trace at most is off by over 5 %, none by over 10 %, nor any entry."""
    batch, _, _ = world.draw(20, seed=5)
    estimates = solve(world, batch, covariance="posterior").estimates
    best = np.flatnonzero((estimates.alternative == 0) & np.isfinite(estimates.covariance_m2[:, 0]))
    off = []
    for number in best[:7]:
        row = int(estimates.row[number])
        xx, xy, yy = estimates.covariance_m2[number]
        moment, _ = grid_posterior(world, batch, row, estimates.position_m[number], 500)
        off.append(abs((xx + yy) / np.trace(moment) - 1.0))
        np.testing.assert_allclose([[xx, xy], [xy, yy]], moment, atol=0.1 * np.trace(moment))
    assert len(off) >= 5
    assert max(off) < 0.1
    assert np.count_nonzero(np.array(off) > 0.05) <= 1


@pytest.mark.parametrize(
    "world", [World(4, 0.25, (2.0, 6.0)), World(8, 0.25, (3.0, 6.0)), World(3, 0.3, (2.0, 6.0), 2)]
)
def test_probabilities_are_those_of_a_fine_grid(world: World) -> None:
    """The mean difference from sums over a fine grid is below .03; the rows used by the fix are twice as far off."""
    batch, _, _ = world.draw(14, seed=8)
    solution = solve(world, batch)
    assert solution.flags is not None
    off = []
    for row in np.flatnonzero(np.isfinite(solution.flags.columns["los_probability"][:, 0])):
        _, probability = grid_posterior(world, batch, row, np.zeros(2), 300)
        stated = solution.flags.columns["los_probability"][row], solution.flags.used[row]
        off.append([np.abs(values - probability).mean() for values in stated])
    assert len(off) >= 8
    integrated, at_fix = np.mean(off, axis=0)
    assert integrated < 0.03
    assert at_fix > 2.0 * integrated


@pytest.mark.parametrize("kind", ["inliers", "posterior"])
def test_nearly_parallel_lines_are_degenerate(kind: str) -> None:
    """Two lines at .2 degrees have no fix with either covariance."""
    batch = bearing_batch(
        [[(0.0, 0.0), (184.0, 186.0)]], np.radians([[45.0, 44.8]]), np.radians(1.0), field=SensorsField(factor=5.0)
    )
    estimates = bearings_mixture_ml.solve(batch, MixtureOptions(covariance=kind)).estimates  # type: ignore[arg-type]
    assert estimates.status.tolist() == [Status.DEGENERATE]


def test_a_long_posterior_is_integrated_within_the_region() -> None:
    """The covariance of a far source agrees with a grid of the region; that of the inliers does not."""
    sensor = [(0.0, 0.0), (61.0, 60.0), (121.0, 125.0), (184.0, 186.0)]
    bearing = np.array([np.arctan2(300.0 - y, 850.0 - x) for x, y in sensor]) + np.radians([0.5, -0.4, 0.6, -0.3])
    bounds = (-920.0, 1104.0, -920.0, 1106.0)
    batch = bearing_batch(
        [sensor],
        bearing[None],
        np.radians(1.0),
        field=BoxField(xmin_m=-920.0, xmax_m=1104.0, ymin_m=-920.0, ymax_m=1106.0),
    )
    inliers, posterior = (
        bearings_mixture_ml.solve(batch, MixtureOptions(covariance=kind)).estimates  # type: ignore[arg-type]
        for kind in ("inliers", "posterior")
    )
    x, y = np.meshgrid(np.linspace(*bounds[:2], 900), np.linspace(*bounds[2:], 900))
    likelihood = np.ones_like(x)
    for (sensor_x, sensor_y), angle in zip(sensor, bearing, strict=True):
        dx, dy = x - sensor_x, y - sensor_y
        error = (np.degrees(np.arctan2(dy, dx) - angle) + 180.0) % 360.0 - 180.0
        density = np.exp(-0.5 * error**2) / np.sqrt(2.0 * np.pi) * (np.abs(error) < 90.0) * (np.hypot(dx, dy) > 0.93)
        likelihood *= 0.25 / 180.0 + 0.75 * density
    fix = inliers.position_m[0]
    trace = (likelihood * ((x - fix[0]) ** 2 + (y - fix[1]) ** 2)).sum() / likelihood.sum()
    assert posterior.covariance_m2[0, [0, 2]].sum() == pytest.approx(trace, rel=0.05)
    assert not 0.8 < inliers.covariance_m2[0, [0, 2]].sum() / trace < 1.25


@pytest.mark.parametrize("sensors", [2, 3, 8])
def test_every_posterior_covariance_is_positive_definite(sensors: int) -> None:
    """Where there is a fix of any rank, its covariance is positive definite, at stds of .01 to 20 degrees."""
    for std_deg in ((0.01, 0.02), (10.0, 20.0)):
        world = World(sensors, 0.3, std_deg)
        estimates = solve(world, world.draw(150, seed=2)[0], covariance="posterior").estimates
        xx, xy, yy = estimates.covariance_m2[np.isfinite(estimates.covariance_m2[:, 0])].T
        assert xx.size > 10
        assert ((xx > 0.0) & (yy > 0.0) & (xx * yy > xy * xy)).all()


def test_the_status_does_not_depend_on_the_covariance() -> None:
    """Bearings and ranges have the same positions and statuses with either covariance."""
    world = World(3, 0.3)
    batch = world.draw(200, seed=3)[0]
    ranges = RangeBatch(
        seed=batch.seed,
        field=_FIELD,
        sensor=batch.sensor,
        sensor_xy_m=batch.sensor_xy_m,
        range_m=np.asfortranarray(np.random.default_rng(4).uniform(50.0, 900.0, batch.sensor.shape)),
        range_std_m=np.full(batch.sensor.shape, 5.0, order="F"),
        path=batch.path,
        sensor_height_m=np.zeros(batch.sensor.shape, order="F"),
    )
    for kind, options in ((bearings_mixture_ml, MixtureOptions()), (ranges_mixture_ml, RangeMixtureOptions())):
        data = batch if kind is bearings_mixture_ml else ranges
        one, other = (
            kind.solve(data, dataclasses.replace(options, covariance=covariance))  # type: ignore[arg-type,type-var]
            for covariance in ("inliers", "posterior")
        )
        first, second = (part.estimates.alternative == 0 for part in (one, other))
        np.testing.assert_array_equal(one.estimates.status[first], other.estimates.status[second])
        assert one.flags is not None
        assert other.flags is not None
        np.testing.assert_array_equal(one.flags.columns["los"], other.flags.columns["los"])


@pytest.mark.parametrize("module", [bearings_mixture_ml, bearings_suppress], ids=lambda module: module.METHOD.name)
def test_los_is_a_probability_above_a_half(module: object) -> None:
    """The flag and the probability never contradict, and both are there or neither."""
    batch, _, _ = World(4, 0.4, (2.0, 8.0)).draw(400, seed=6)
    flags = module.METHOD.solve(batch, module.METHOD.options(field_of_view_deg=360.0)).flags  # type: ignore[attr-defined]
    los, probability = flags.columns["los"], flags.columns["los_probability"]
    known = np.isfinite(probability)
    assert known.any()
    assert (los[known] == (probability[known] > 0.5)).all()
    assert all(value is None for value in los[~known])


def coverage(world: World, snapshots: int, seed: int) -> float:
    """Return the share of sources in the 95 % ellipse, where an answer is given."""
    batch, source, _ = world.draw(snapshots, seed)
    batch = dataclasses.replace(batch, want_flags=False)
    estimates = solve(world, batch, covariance="posterior").estimates
    best = np.flatnonzero((estimates.alternative == 0) & np.isfinite(estimates.covariance_m2[:, 0]))
    dx, dy = (estimates.position_m[best] - source[estimates.row[best]]).T
    xx, xy, yy = estimates.covariance_m2[best].T
    squared = (yy * dx * dx - 2.0 * xy * dx * dy + xx * dy * dy) / (xx * yy - xy * xy)
    assert best.size > 0.5 * snapshots
    return float(np.mean(squared < -2.0 * np.log(0.05)))


@pytest.mark.parametrize("sensors", [3, pytest.param(5, marks=pytest.mark.extensive)])
def test_ellipses_hold_the_source(sensors: int) -> None:
    """With a quarter of outliers the 95 % ellipses contain 93 to 97 % of the sources (1 % for chance)."""
    assert 0.92 < coverage(World(sensors, 0.25), 1000, seed=21) < 0.98


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.0, 0.1, 0.25, 0.4])
@pytest.mark.parametrize("sensors", [3, 4, 5, 8, 15])
def test_ellipses_hold_the_source_in_every_world(sensors: int, share: float) -> None:
    """The 95 % ellipses contain 93 to 97 % of the sources for 3 to 15 sensors and shares of outliers to .4."""
    assert 0.93 <= coverage(World(sensors, share, (0.5, 6.0)), 4000, seed=22) <= 0.97


def calibration_error(stated: FloatArray, truth: BoolArray) -> float:
    """Return the expected calibration error of probabilities, in ten bins."""
    number = np.minimum((stated * 10.0).astype(np.int64), 9)
    return float(np.abs(np.bincount(number, stated - truth, minlength=10)).sum() / stated.size)


@pytest.mark.parametrize(
    "world", [World(4, 0.25), pytest.param(World(5, 0.4, (1.0, 8.0)), marks=pytest.mark.extensive)]
)
def test_probabilities_of_rows_are_calibrated(world: World) -> None:
    """The expected calibration error is at most .03 for ok and ambiguous snapshots alike."""
    batch, _, direct = world.draw(5000, seed=31)
    solution = solve(world, batch)
    assert solution.flags is not None
    status = solution.estimates.status[solution.estimates.alternative == 0]
    for word in (Status.OK, Status.AMBIGUOUS):
        rows = status == word
        assert rows.sum() > 200
        probability = solution.flags.columns["los_probability"][rows].ravel()
        assert calibration_error(probability, direct[rows].ravel()) <= 0.03


def test_the_rule_of_space_has_degree_five() -> None:
    """Means of all monomials up to degree 5 over a normal distribution of three dimensions are exact."""
    rule = _RULES[3]
    weight = rule.weight * np.exp(-0.5 * sum(part**2 for part in rule.point))
    moments = {0: 1.0, 1: 0.0, 2: 1.0, 3: 0.0, 4: 3.0, 5: 0.0}
    for powers in product(range(6), repeat=3):
        if sum(powers) <= 5:
            found = (weight * np.prod([part**n for part, n in zip(rule.point, powers, strict=True)], axis=0)).sum()
            assert found == pytest.approx(np.prod([moments[n] for n in powers]), abs=1e-12)


def test_unit_vectors_are_spread_over_the_sphere() -> None:
    """Their mean is 0 and their second moment 1/3; a first number of 0 is the pole."""
    generator = np.random.default_rng(1)
    uniform = list(generator.uniform(size=(2, 20_000)))
    pole = tuple(np.full(20_000, value) for value in (1.0, -2.0, 0.5))
    vectors = np.array(unit_vectors(uniform, pole))
    np.testing.assert_allclose(np.linalg.norm(vectors, axis=0), 1.0)
    np.testing.assert_allclose(vectors.mean(axis=1), 0.0, atol=0.02)
    np.testing.assert_allclose(vectors @ vectors.T / 20_000, np.eye(3) / 3.0, atol=0.02)
    first = np.array(unit_vectors([np.zeros(1), np.zeros(1)], tuple(part[:1] for part in pole)))[:, 0]
    np.testing.assert_allclose(first, np.array([1.0, -2.0, 0.5]) / np.sqrt(5.25), atol=1e-12)


def test_unit_vectors_are_spread_over_four_dimensions() -> None:
    """Second moments are a quarter, fourth moments those of the sphere; a pole turned about z turns the vectors."""
    generator = np.random.default_rng(3)
    uniform = list(generator.random((3, 200_000)))
    pole = tuple(np.full(200_000, part) for part in (0.6, -0.8, 2.0, 1.0))
    vectors = np.array(unit_vectors(uniform, pole))
    np.testing.assert_allclose(np.linalg.norm(vectors, axis=0), 1.0, rtol=1e-12)
    np.testing.assert_allclose(vectors @ vectors.T / 200_000, 0.25 * np.eye(4), atol=5e-3)
    np.testing.assert_allclose((vectors**4).mean(axis=1), 1.0 / 8.0, atol=5e-3)
    turned = np.array(unit_vectors(uniform, (-pole[1], pole[0], pole[2], pole[3])))
    np.testing.assert_allclose(turned, [-vectors[1], vectors[0], vectors[2], vectors[3]], atol=1e-12)
