"""The mixture likelihood of ranges: outliers, alternatives, competing paths, covariances."""

from __future__ import annotations

import numpy as np
import pytest
from batches import range_batch
from range_worlds import FloatArray, exact_ranges, solve, words
from scipy.stats import exponnorm, norm

import nlosctl
from nlosctl.contract.batches import RangeBatch
from nlosctl.contract.fields import BoxField, Field
from nlosctl.contract.results import Estimates
from nlosctl.contract.statuses import Status
from nlosctl.evaluation.consistency import squared_mahalanobis
from nlosctl.methods import ranges_mixture_ml, ranges_r_ls

SENSORS = [(0.0, 0.0), (40.0, 0.0), (45.0, 30.0), (0.0, 35.0), (20.0, -10.0), (-10.0, 15.0)]


def polluted(
    snapshots: int, share: float, seed: int = 1, std: float = 0.2
) -> tuple[RangeBatch, FloatArray, FloatArray]:
    """Return ranges, some with errors of up to 30 m, the sources, and which rows are inliers."""
    generator = np.random.default_rng(seed)
    sources = generator.uniform((2.0, 2.0), (38.0, 28.0), (snapshots, 2))
    away = np.hypot(*np.moveaxis(sources[:, None] - np.array(SENSORS), -1, 0))
    right = generator.random(away.shape) >= share
    wrong = generator.uniform(3.0, 30.0, away.shape)
    sign = np.where((generator.random(away.shape) < 0.4) & (away > wrong + 1.0), -1.0, 1.0)
    ranges = away + std * generator.normal(size=away.shape) + np.where(right, 0.0, sign * wrong)
    return range_batch(SENSORS, np.abs(ranges), std), sources, right


def first_errors(batch: RangeBatch, sources: FloatArray, **options: object) -> FloatArray:
    """Return the errors of the best fixes, infinite without a fix."""
    estimates = solve(ranges_mixture_ml.METHOD, batch, **options).estimates
    best = estimates.position_m[estimates.alternative == 0]
    return np.where(np.isfinite(best[:, 0]), np.hypot(*(best - sources).T), np.inf)


def test_without_outliers_it_is_range_least_squares() -> None:
    """Without outliers the fix is that of r-ls to a small part of its std."""
    batch, _, _ = polluted(100, 0.0)
    ours, theirs = (solve(module.METHOD, batch).estimates for module in (ranges_mixture_ml, ranges_r_ls))
    gap = ours.position_m[ours.alternative == 0] - theirs.position_m[theirs.alternative == 0]
    assert np.median(np.hypot(*gap.T)) < 0.01


def test_outliers_are_rejected() -> None:
    """With 25 % outliers the median error is that of the inliers; r-ls is metres off."""
    batch, sources, right = polluted(400, 0.25)
    error = first_errors(batch, sources)
    assert np.median(error) < 0.25
    assert (error < 1.0).mean() > 0.9
    plain = solve(ranges_r_ls.METHOD, batch).estimates
    assert np.median(np.hypot(*(plain.position_m[plain.alternative == 0] - sources).T)) > 2.0
    solution = solve(ranges_mixture_ml.METHOD, batch)
    assert solution.flags is not None
    los = solution.flags.used
    found = error < 1.0
    assert (los == right)[found].mean() > 0.97


def test_the_density_of_outliers_is_a_parameter() -> None:
    """A higher outlier density flags fewer rows as direct, and adds its logarithm to the cost."""
    batch = range_batch(SENSORS, exact_ranges(SENSORS, (11.0, 12.0)))
    costs = [solve(ranges_mixture_ml.METHOD, batch, nlos_density_per_m=d).estimates.cost[0] for d in (1e-3, 1e-2)]
    # every row direct: the cost is that of Gaussians, (1 - alpha) and a density that hardly matter
    assert costs[0] == pytest.approx(costs[1], abs=0.05)
    assert costs[0] == pytest.approx(-6.0 * np.log(0.75 / (0.1 * np.sqrt(2.0 * np.pi))), abs=0.05)
    doubtful = range_batch(SENSORS, exact_ranges(SENSORS, (11.0, 12.0)) + np.array([[0.3, 0.0, 0.0, 0.0, 0.0, 0.0]]))
    used = [solve(ranges_mixture_ml.METHOD, doubtful, nlos_density_per_m=d).estimates.n_used[0] for d in (1e-4, 1.0)]
    assert used == [6, 5]


def late_ranges(snapshots: int, mean_std: float, seed: int = 3) -> tuple[RangeBatch, FloatArray, FloatArray]:
    """Return ranges of six random sensors, a quarter late by exponential biases, the sources, and the direct rows."""
    generator = np.random.default_rng(seed)
    sensors, std = generator.uniform(0.0, 30.0, (snapshots, 6, 2)), 0.3
    sources = generator.uniform(0.0, 30.0, (snapshots, 2))
    away = np.hypot(*np.moveaxis(sources[:, None] - sensors, -1, 0))
    direct = generator.random(away.shape) >= 0.25
    bias = np.where(direct, 0.0, generator.exponential(mean_std * std, away.shape))
    return range_batch(sensors, np.abs(away + bias + std * generator.normal(size=away.shape)), std), sources, direct


def held(estimates: Estimates, sources: FloatArray) -> FloatArray:
    """Return the NEES of the fixes that are ``ok``."""
    ok = (estimates.alternative == 0) & (estimates.status == Status.OK)
    return squared_mahalanobis(estimates.position_m[ok] - sources[estimates.row[ok]], estimates.covariance_m2[ok])


@pytest.mark.parametrize("mean_std", [1.0, 3.0, 10.0, 20.0])
def test_with_positive_biases_the_ellipse_holds_the_source(mean_std: float) -> None:
    """With the mean bias given, 93 to 97 % of the 95 % ellipses hold the source, within the noise of 400 trials.

    A uniform law of the outliers, ``both``, has .76 to .87 (.71 to .89 in other geometries).
    """
    batch, sources, _ = late_ranges(400, mean_std)
    noise = 2.5 * np.sqrt(0.06 * 0.94 / 400)
    solution = solve(ranges_mixture_ml.METHOD, batch, bias="positive", bias_mean_m=0.3 * mean_std)
    assert solution.estimates.covariance_kind == "posterior"
    nees = held(solution.estimates, sources)
    assert nees.size > 0.7 * 400
    assert 0.93 - noise < (nees < 5.991).mean() < 0.97 + noise
    assert (nees > 100.0).sum() <= 2
    assert (held(solve(ranges_mixture_ml.METHOD, batch).estimates, sources) < 5.991).mean() < 0.9


def calibration_error(probability: FloatArray, right: FloatArray) -> float:
    """Return the expected calibration error in ten bins."""
    bins = np.minimum((10.0 * probability).astype(int), 9)
    return float(sum(abs(probability[bins == i].sum() - right[bins == i].sum()) for i in range(10)) / right.size)


def test_the_probability_of_late_ranges_is_calibrated() -> None:
    """With the mean bias given the expected calibration error is at most .05; a square root of it would have .1."""
    batch, _, direct = late_ranges(500, 3.0, seed=5)
    solution = solve(ranges_mixture_ml.METHOD, batch, bias="positive", bias_mean_m=0.9)
    assert solution.flags is not None
    ok = solution.estimates.status[solution.estimates.alternative == 0] == Status.OK
    probability = solution.flags.columns["los_probability"][ok].ravel()
    assert calibration_error(probability, direct[ok].ravel()) < 0.05
    assert calibration_error(np.sqrt(probability), direct[ok].ravel()) > 0.08


def test_with_the_mean_bias_estimated_the_probability_is_calibrated() -> None:
    """The mean is that of the late rows; coverage is .93 to .97, the calibration error at most .03, and noise."""
    batch, sources, direct = late_ranges(150, 3.0, seed=8)
    size, count = direct.shape
    table = {"snapshot": np.repeat(np.arange(size), count), "sensor": np.tile(np.arange(count), size)}
    table |= {f"sensor_{axis}_m": batch.sensor_xy_m[..., n].ravel() for n, axis in enumerate("xy")}
    table |= {"range_m": batch.range_m.ravel(), "range_std_m": batch.range_std_m.ravel()}
    result = nlosctl.localize(table, method="mixture-ml", bias="positive", bias_mean_m="estimate")
    assert result.report.learned["mixture-ml"].values["bias_mean_m"] == pytest.approx(0.9, rel=0.25)
    columns = result.estimates.to_pydict()
    ok = np.array(columns["status"]) == "ok"
    covariance = np.array([columns[f"cov_{part}_m2"] for part in ("xx", "xy", "yy")], dtype=float).T[ok]
    position = np.array([columns["x_m"], columns["y_m"]], dtype=float).T[ok]
    nees = squared_mahalanobis(position - sources[ok], covariance)
    assert abs((nees < 5.991).mean() - 0.95) < 0.02 + 2.5 * np.sqrt(0.06 * 0.94 / 150)
    probability = np.array(result.flags["los_probability"].to_pylist(), dtype=float).reshape(direct.shape)[ok]
    assert calibration_error(probability.ravel(), direct[ok].ravel()) < 0.03 + 0.015


def test_the_covariance_of_inliers_is_the_inverse_information() -> None:
    """Without outliers it is that of r-ls within a few per cent, and half the errors are within the 50 % ellipse."""
    batch, sources, _ = polluted(600, 0.0, seed=2)
    ours, theirs = (solve(module.METHOD, batch).estimates for module in (ranges_mixture_ml, ranges_r_ls))
    ok = ours.status[ours.alternative == 0] == Status.OK
    ratio = ours.covariance_m2[ours.alternative == 0][ok] / theirs.covariance_m2[theirs.alternative == 0][ok]
    np.testing.assert_allclose(np.median(ratio[:, [0, 2]], axis=0), 1.0, atol=0.05)
    nees = held(ours, sources)
    assert nees.size > 500
    assert (nees < 1.386).mean() == pytest.approx(0.5, abs=0.07)


def test_a_rival_within_two_nats_makes_a_fix_ambiguous() -> None:
    """``ambiguous_within`` is two nats: an image that costs 1.9 more is a rival, one that costs 2.1 more is not."""
    line = [(0.0, 0.0), (10.0, 0.0), (20.0, 0.0), (30.0, 0.0), (15.0, 0.1)]
    ranges = exact_ranges(line, (12.0, 20.0))

    def gap_and_word(shift: float) -> tuple[float, str]:
        moved = ranges.copy()
        moved[0, 4] += shift
        solution = solve(ranges_mixture_ml.METHOD, range_batch(line, moved, 0.1))
        return float(np.diff(solution.estimates.cost)[0]), words(solution)[0]

    gaps = [gap_and_word(shift) for shift in np.linspace(-0.17, 0.03, 21)]
    assert {word for gap, word in gaps if 0.7 < gap < 1.9} == {"ambiguous"}
    assert {word for gap, word in gaps if 2.1 < gap < 4.0} == {"ok"}


def test_the_cost_of_late_ranges_is_their_likelihood() -> None:
    """With one mean bias the cost is that of SciPy's densities at the fix."""
    batch, _, _ = late_ranges(20, 5.0)
    options = {"bias": "positive", "bias_mean_m": 1.5, "nlos_density_per_m": 0.01, "alpha": 0.3}
    estimates = solve(ranges_mixture_ml.METHOD, batch, **options).estimates
    best = estimates.alternative == 0
    away = np.hypot(*np.moveaxis(estimates.position_m[best][:, None] - batch.sensor_xy_m, -1, 0))
    excess = batch.range_m - away
    outlier = 0.95 * exponnorm(5.0, scale=0.3).pdf(excess) + 0.05 * 0.01
    density = 0.7 * norm.pdf(excess, scale=0.3) + 0.3 * outlier
    np.testing.assert_allclose(estimates.cost[best], -np.log(density).sum(axis=1), atol=1e-6)


def test_without_a_bias_every_row_is_direct() -> None:
    """With ``bias=none`` the fix is the maximum of the likelihood of all rows, as by r-ls."""
    batch, _, _ = late_ranges(50, 3.0)
    solution = solve(ranges_mixture_ml.METHOD, batch, bias="none")
    assert solution.flags is not None
    theirs = solve(ranges_r_ls.METHOD, batch).estimates
    ours, best = solution.estimates, solution.estimates.alternative == 0
    near = np.hypot(*(ours.position_m[best] - theirs.position_m[theirs.alternative == 0]).T) < 1e-4
    all_used = solution.flags.used.all(axis=1)
    assert all_used.mean() > 0.8
    assert near[all_used].mean() > 0.95


def test_front_and_back_are_alternatives() -> None:
    """For nearly collinear sensors a source and its mirror image are both reported, as ambiguous."""
    line = [(0.0, 0.0), (1.0, 0.02), (2.0, 0.0), (3.0, 0.01)]
    solution = solve(ranges_mixture_ml.METHOD, range_batch(line, exact_ranges(line, (4.0, 20.0))))
    assert set(words(solution)) == {"ambiguous"}
    apart = np.hypot(*(solution.estimates.position_m[:, None] - [(4.0, 20.0), (4.0, -20.0)]).transpose(2, 0, 1))
    assert (apart.min(axis=0) < 1.5).all()


def test_the_search_region_excludes_the_mirror_image() -> None:
    """With a search region on one side of the line only that side is an answer."""
    line = [(0.0, 0.0), (1.0, 0.02), (2.0, 0.0), (3.0, 0.01)]
    field = BoxField(xmin_m=-30.0, xmax_m=30.0, ymin_m=1.0, ymax_m=30.0)
    solution = solve(ranges_mixture_ml.METHOD, range_batch(line, exact_ranges(line, (4.0, 20.0)), field=field))
    assert words(solution)[0] == "ok"
    assert solution.estimates.position_m[0, 1] > 0.0


def test_numbered_paths_of_a_sensor_compete() -> None:
    """At most one numbered path of a sensor is direct, and ``first`` considers the first arrival only."""
    sensors = np.array([*SENSORS[:4], SENSORS[0], SENSORS[1]])
    ranges = exact_ranges(sensors, (11.0, 12.0))
    ranges[0, 4:] += [7.0, 9.0]
    batch = range_batch(sensors, ranges, sensor=np.array([[0, 1, 2, 3, 0, 1]]))
    numbered = type(batch)(**{**vars(batch), "path": np.asfortranarray([[0, 0, 0, 0, 1, 1]])})
    for prior in ("uniform", "first", "falling"):
        solution = solve(ranges_mixture_ml.METHOD, numbered, path_prior=prior)
        assert solution.flags is not None
        np.testing.assert_array_equal(solution.flags.used[0], [True] * 4 + [False] * 2)
        np.testing.assert_allclose(solution.estimates.position_m[0], (11.0, 12.0), atol=1e-3)


def test_a_position_with_one_row_fewer_may_be_the_source() -> None:
    """Unordered echoes over a wall may reach more sensors than direct ones: ambiguous, if requested."""
    sensors = np.repeat(np.array(SENSORS[:5]), 2, axis=0)
    ranges = exact_ranges(sensors, (11.0, 12.0))
    ranges[0, 1::2] = exact_ranges(sensors[1::2], (30.0, 70.0))[0]
    ranges[0, 9] += 25.0
    field = BoxField(xmin_m=-100.0, xmax_m=100.0, ymin_m=-100.0, ymax_m=100.0)
    batch = range_batch(sensors, ranges, sensor=np.repeat(np.arange(5), 2)[None], field=field)
    numbered = type(batch)(**{**vars(batch), "path": np.asfortranarray([[0, 1] * 5])})
    estimates = solve(ranges_mixture_ml.METHOD, numbered).estimates
    np.testing.assert_allclose(estimates.position_m[0], (11.0, 12.0), atol=0.1)
    assert estimates.cost[1] > estimates.cost[0] + 2.0
    for options, status in (
        ({}, "ambiguous"),
        ({"ambiguous_rows": 1}, "ambiguous"),
        ({"ambiguous_rows": 0}, "ok"),
        ({"path_prior": "falling"}, "ok"),
    ):
        assert words(solve(ranges_mixture_ml.METHOD, numbered, **options))[0] == status


def test_the_order_of_paths_moves_the_likelihood() -> None:
    """If the second of two paths fits, ``first`` makes the sensor an outlier, ``falling`` gives it a third."""
    sensors = np.array([*SENSORS, SENSORS[0]])
    ranges = exact_ranges(sensors, (11.0, 12.0))
    ranges[0, 0] -= 8.0
    batch = range_batch(sensors, ranges, sensor=np.array([[0, 1, 2, 3, 4, 5, 0]]))
    numbered = type(batch)(**{**vars(batch), "path": np.asfortranarray([[0] * 6 + [1]])})
    found = {p: solve(ranges_mixture_ml.METHOD, numbered, path_prior=p) for p in ("uniform", "first", "falling")}
    used = {prior: int(solution.flags.used.sum()) for prior, solution in found.items() if solution.flags is not None}
    assert used == {"uniform": 6, "first": 5, "falling": 6}
    cost = {prior: solution.estimates.cost[0] for prior, solution in found.items()}
    assert cost["falling"] - cost["uniform"] == pytest.approx(np.log((1.0 / 2.0) / (1.0 / 3.0)), abs=0.05)
    assert cost["first"] > cost["falling"] + 1.0


def test_mode_gap_selects_the_crossings_followed() -> None:
    """``mode_gap`` is per row: a crossing of fewer circles is an alternative from that gap on, not below it."""
    ranges = exact_ranges(SENSORS, (11.0, 12.0))
    ranges[0, 3:5] = exact_ranges(SENSORS[3:5], (33.0, 21.0))
    field = BoxField(xmin_m=0.0, xmax_m=40.0, ymin_m=0.0, ymax_m=30.0)
    batch = range_batch(SENSORS, ranges, 1e-3, field=field)

    def away(**options: float) -> tuple[FloatArray, FloatArray]:
        estimates = solve(ranges_mixture_ml.METHOD, batch, **options).estimates
        return np.hypot(*(estimates.position_m - (33.0, 21.0)).T), estimates.cost

    apart, cost = away(mode_gap=100.0)
    gap = (cost[np.argmin(apart)] - cost[0]) / 6
    assert apart.min() < 1e-3
    assert gap > 0.1
    for share, expected in ((0.8, False), (1.2, True)):
        assert (away(mode_gap=share * gap)[0] < 1e-3).any() == expected


def test_modes_outside_the_field_end_at_its_edge() -> None:
    """If every descent leaves the search region the fix is on its edge, without a covariance."""
    noise = np.random.default_rng(9).normal(size=(100, 6))
    field = BoxField(xmin_m=5.0, xmax_m=11.0, ymin_m=5.0, ymax_m=20.0)
    batch = range_batch(SENSORS, exact_ranges(SENSORS, (11.0, 12.0)) + noise, 1.0, field=field)
    solution = solve(ranges_mixture_ml.METHOD, batch)
    held = np.array(words(solution)) == "boundary"
    assert held.sum() > 20
    assert np.isnan(solution.estimates.covariance_m2[held]).all()
    x, y = solution.estimates.position_m[held].T
    assert ((x <= 11.0) & (np.abs(y - 12.0) < 3.0)).all()
    assert np.median(x) > 10.9


def lone_rows(count: int, snapshots: int, std: float, field: Field | None = None) -> RangeBatch:
    """Return ranges without a source: uniform up to 100 m, from sensors in a square of 100 m."""
    generator = np.random.default_rng(count)
    sensors = generator.uniform(0.0, 100.0, (snapshots, count, 2))
    return range_batch(sensors, generator.uniform(0.0, 100.0, (snapshots, count)), std, field=field)


@pytest.mark.parametrize("bias", ["both", "positive"])
@pytest.mark.parametrize(("count", "std"), [(4, 0.3), (4, 3.0), (5, 3.0), (5, 10.0), (6, 1.0), (12, 3.0), (50, 3.0)])
def test_ranges_without_a_source_have_no_consensus(count: int, std: float, bias: str) -> None:
    """At most 2 % of snapshots of uniform ranges are ok or ambiguous, within the noise of the number of trials."""
    snapshots = 2000 // count if bias == "both" else 600 // count
    batch = lone_rows(count, snapshots, std)
    solution = solve(ranges_mixture_ml.METHOD, batch, bias=bias)
    best = solution.estimates.alternative == 0
    status = solution.estimates.status[best]
    assert (status <= Status.AMBIGUOUS).mean() < 0.02 + 3.0 * np.sqrt(0.02 * 0.98 / snapshots)
    none = status == Status.NO_CONSENSUS
    assert none.mean() > 0.9
    assert np.isfinite(solution.estimates.position_m[best][none]).all()
    assert np.isnan(solution.estimates.covariance_m2[best][none]).all()
    assert solution.flags is not None
    assert np.isnan(solution.flags.columns["los_probability"][none]).all()
    kept = solve(ranges_mixture_ml.METHOD, batch, bias=bias, least_evidence=-1000.0).estimates.status
    assert (kept <= Status.AMBIGUOUS).mean() > 0.5


@pytest.mark.parametrize(
    ("count", "std", "lost"),
    [(4, 1.0, 0.02), (5, 0.3, 0.003), (5, 1.0, 0.005), (5, 3.0, 0.04), (6, 3.0, 0.01), (8, 3.0, 0.003), (12, 3.0, 0.0)],
)
def test_clean_ranges_keep_their_consensus(count: int, std: float, lost: float) -> None:
    """Of snapshots without outliers hardly any lose their status; 1000 trials each."""
    generator = np.random.default_rng(7)
    sensors, sources = generator.uniform(0.0, 100.0, (1000, count, 2)), generator.uniform(0.0, 100.0, (1000, 1, 2))
    away = np.hypot(*np.moveaxis(sources - sensors, -1, 0))
    batch = range_batch(sensors, np.abs(away + std * generator.normal(size=away.shape)), std)
    estimates = solve(ranges_mixture_ml.METHOD, batch).estimates
    assert (estimates.status[estimates.alternative == 0] == Status.NO_CONSENSUS).mean() <= lost


@pytest.mark.parametrize(("count", "std"), [(4, 1.0), (5, 1.0), (5, 3.0)])
def test_the_evidence_of_agreement_is_an_integral(count: int, std: float) -> None:
    """Of clean rows the log evidence is that without outliers, by sums over a grid, less what is not needed."""
    generator = np.random.default_rng(count)
    sensors, source = generator.uniform(0.0, 100.0, (10, count, 2)), generator.uniform(20.0, 80.0, (10, 1, 2))
    ranges = np.hypot(*np.moveaxis(source - sensors, -1, 0)) + 0.5 * std * generator.normal(size=(10, count))
    field = BoxField(xmin_m=0.0, xmax_m=100.0, ymin_m=0.0, ymax_m=100.0)
    axis = np.arange(0.0, 100.0, 0.25) + 0.125
    x, y = np.meshgrid(axis, axis)
    for number in range(10):
        density = np.ones(x.shape)
        for (sensor_x, sensor_y), read in zip(sensors[number], ranges[number], strict=True):
            density *= norm.pdf(np.hypot(x - sensor_x, y - sensor_y), read, std) * ranges[number].max()
        chance = (6.0 * std / 100.0) ** (count - 2)
        least = np.log(density.mean()) + min(2.0 * np.log(0.015 / chance), 2.8)
        one = range_batch(sensors[number], ranges[number : number + 1], std, field=field)
        for margin, lost in ((0.25, False), (-0.25, True)):
            status = solve(ranges_mixture_ml.METHOD, one, least_evidence=least - margin).estimates.status[0]
            assert (status == Status.NO_CONSENSUS) == lost


def test_few_ok_fixes_are_far_from_their_ellipse() -> None:
    """With a quarter of outliers at most .6 % of the ok fixes of five sensors have a squared error above 100."""
    generator = np.random.default_rng(5)
    sensors, sources = generator.uniform(0.0, 100.0, (10_000, 5, 2)), generator.uniform(0.0, 100.0, (10_000, 2))
    away = np.hypot(*np.moveaxis(sources[:, None] - sensors, -1, 0))
    outlier = generator.random(away.shape) < 0.25
    ranges = np.where(outlier, generator.uniform(0.0, 140.0, away.shape), away + generator.normal(size=away.shape))
    estimates = solve(ranges_mixture_ml.METHOD, range_batch(sensors, np.abs(ranges), 1.0)).estimates
    ok = np.flatnonzero((estimates.alternative == 0) & (estimates.status == Status.OK))
    assert ok.size > 0.47 * 10_000
    nees = squared_mahalanobis(estimates.position_m[ok] - sources[estimates.row[ok]], estimates.covariance_m2[ok])
    assert np.mean(nees > 100.0) <= 0.006


def test_two_ranges_keep_both_crossings() -> None:
    """Two circles always cross, so that a consensus can't be tested: both crossings are reported."""
    batch = range_batch(SENSORS[:2], exact_ranges(SENSORS[:2], (11.0, 12.0)))
    assert words(solve(ranges_mixture_ml.METHOD, batch)) == ["ambiguous"] * 2


def test_a_fix_on_a_sensor_is_degenerate() -> None:
    """As for ml: on a sensor, or with a standard deviation beyond the farthest one."""
    exact = exact_ranges(SENSORS, SENSORS[0])
    exact[0, 0] = 1e-9
    assert words(solve(ranges_mixture_ml.METHOD, range_batch(SENSORS, exact, 0.01)))[0] == "degenerate"
    line = [(0.0, 0.0), (10.0, 0.0), (20.0, 0.0), (30.0, 0.0)]
    batch = range_batch(line, exact_ranges(line, (60.0, 0.0)), 1.0)
    assert words(solve(ranges_mixture_ml.METHOD, batch, least_evidence=-1000.0))[0] in {"degenerate", "ambiguous"}


def test_coincident_sensors_are_too_few() -> None:
    """Any number of coincident sensors is too_few."""
    batch = range_batch((0.0, 0.0), [[5.0, 5.1, 4.9]])
    assert words(solve(ranges_mixture_ml.METHOD, batch)) == ["too_few"]


@pytest.mark.extensive
def test_the_posterior_covariance_is_calibrated() -> None:
    """With outliers, 90 to 99 % of the errors are within the 95 % posterior ellipse."""
    batch, sources, _ = polluted(1500, 0.2, seed=4)
    estimates = solve(ranges_mixture_ml.METHOD, batch, covariance="posterior").estimates
    best = estimates.alternative == 0
    dx, dy = (estimates.position_m[best] - sources).T
    xx, xy, yy = estimates.covariance_m2[best].T
    inliers = solve(ranges_mixture_ml.METHOD, batch).estimates
    assert np.nanmean(xx + yy) > 1.2 * np.nanmean(
        inliers.covariance_m2[inliers.alternative == 0][:, [0, 2]].sum(axis=1)
    )
    nees = (yy * dx * dx - 2.0 * xy * dx * dy + xx * dy * dy) / (xx * yy - xy * xy)
    answered = np.isfinite(nees)  # a sixth has no_consensus: too few of its six rows agree
    assert answered.mean() > 0.8
    assert 0.90 < (nees[answered] < 5.991).mean() < 0.99


@pytest.mark.parametrize(("sensors", "std_m"), [(4, 0.3), (6, 1.0), (12, 1.0)])
def test_uniform_ranges_are_no_fix(sensors: int, std_m: float) -> None:
    """Of ranges uniform up to 140 m at most 2 % give ok or ambiguous; six clean ranges or more keep their fix."""
    generator = np.random.default_rng(sensors)
    places = generator.uniform(0.0, 100.0, (1000, sensors, 2))
    source = generator.uniform(0.0, 100.0, (1000, 1, 2))
    noise = range_batch(places, generator.uniform(0.1, 140.0, (1000, sensors)), std_m)
    right = np.hypot(*np.moveaxis(places - source, -1, 0)) + std_m * generator.normal(size=(1000, sensors))
    clean = range_batch(places, np.maximum(right, 0.1), std_m)

    def status(batch: RangeBatch, **options: float) -> np.ndarray:
        estimates = solve(ranges_mixture_ml.METHOD, batch, **options).estimates
        return estimates.status[estimates.alternative == 0]

    assert np.mean(status(noise) <= Status.AMBIGUOUS) <= 0.02
    assert np.mean(status(noise, least_evidence=-1000.0) <= Status.AMBIGUOUS) > 0.9
    if sensors > 4:
        assert np.mean(status(clean) == status(clean, least_evidence=-1000.0)) >= 0.99
