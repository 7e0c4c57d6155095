"""The robust methods: flags, covariances, statuses and edge cases."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from batches import bearing_batch
from outlier_worlds import ring_batch, without_flags

from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.fields import BoxField, CircleField
from nlosctl.contract.options import parse_options
from nlosctl.contract.results import Estimates
from nlosctl.contract.scene import Scene, SegmentReflector
from nlosctl.contract.statuses import Status
from nlosctl.errors import UsageError
from nlosctl.methods import bearings_mixture_ml, bearings_ml, bearings_sequential, bearings_suppress
from nlosctl.methods.bearings_mixture_ml import MixtureOptions
from nlosctl.solvers.sequential import suppression as suppressed_fixes
from nlosctl.solvers.sequential.hypotheses import grow_hypotheses
from nlosctl.testing import check_method

_ROBUST = [bearings_mixture_ml, bearings_suppress]
_ALL = [*_ROBUST, bearings_sequential]


def _errors(estimates: Estimates, truth: np.ndarray) -> np.ndarray:
    return np.hypot(*(estimates.position_m[estimates.alternative == 0] - truth).T)


def _bearings(sensor_xy: list[tuple[float, float]], bearing_deg: list[float], **columns: object) -> BearingBatch:
    """Return one snapshot of direct bearings with a std of 1 degree, each from a different sensor."""
    return bearing_batch([sensor_xy], np.radians([bearing_deg]), np.radians(1.0), **columns)


@pytest.mark.extensive
@pytest.mark.parametrize("method", _ALL, ids=lambda module: module.METHOD.name)
def test_robust_methods_obey_the_laws(method: object) -> None:
    """Each method obeys the laws of all methods, with random mirrors and several paths per sensor."""
    check_method(method.METHOD, seed=3)  # type: ignore[attr-defined]


@pytest.mark.extensive
def test_laws_hold_for_the_posterior_covariance() -> None:
    """The covariance from posterior grids obeys the laws too."""
    check_method(bearings_mixture_ml.METHOD, options=MixtureOptions(covariance="posterior"))


@pytest.mark.parametrize("std_deg", [1.0, 4.0])
def test_robust_methods_are_efficient_without_outliers(std_deg: float) -> None:
    """Without outliers the default has at most 5 % more RMS error than maximum likelihood."""
    truth, batch, _ = ring_batch(1, 5000, bearing_std_deg=std_deg, sources="disc")
    batch = without_flags(batch)
    robust = _errors(bearings_mixture_ml.solve(batch, MixtureOptions()).estimates, truth)
    plain = _errors(bearings_ml.solve(batch, bearings_ml.MaximumLikelihoodOptions()).estimates, truth)
    assert np.sqrt(np.mean(robust**2)) < 1.05 * np.sqrt(np.mean(plain**2))


def test_a_quarter_of_outliers_on_a_500_m_ring() -> None:
    """8 sensors, 2 deg, 2 of 8 bearings uniform: 95 % of the errors are below 32 m, medians near 11 m."""
    truth, batch, _ = ring_batch(
        2, 4000, radius_m=500.0, bearing_std_deg=2.0, nlos_receivers=2, nlos_span_deg=360.0, sources="disc"
    )
    field = BoxField(xmin_m=-500.0, xmax_m=500.0, ymin_m=-500.0, ymax_m=500.0)
    batch = dataclasses.replace(without_flags(batch), field=field)
    estimates = bearings_mixture_ml.solve(batch, MixtureOptions(field_of_view_deg=360.0)).estimates
    assert np.percentile(_errors(estimates, truth), 95) < 32.0
    assert np.median(_errors(estimates, truth)) < 12.0


@pytest.mark.parametrize("module", _ROBUST, ids=lambda module: module.METHOD.name)
def test_flags_separate_direct_rows_from_outliers(module: object) -> None:
    """At small spread nearly all outliers far from the true bearing are flagged, nearly no direct row."""
    _, batch, direct = ring_batch(3, 500, bearing_std_deg=0.5, nlos_receivers=2, sources="disc")
    flags = module.METHOD.solve(batch, module.METHOD.options()).flags  # type: ignore[attr-defined]
    assert np.mean(flags.used[direct]) > 0.98
    assert np.mean(flags.used[~direct]) < 0.05
    probability = flags.columns["los_probability"]
    assert np.nanmedian(probability[direct]) > 0.95
    assert np.nanmedian(probability[~direct]) < 0.05


@pytest.mark.extensive
@pytest.mark.parametrize(("outliers", "low", "high"), [(0, 0.92, 0.98), (2, 0.92, 0.98)])
def test_posterior_covariance_is_calibrated(outliers: int, low: float, high: float) -> None:
    """The 95 % posterior ellipse covers 92 to 98 %; with outliers that of the inliers does not."""
    truth, batch, _ = ring_batch(4, 3000, bearing_std_deg=4.0, nlos_receivers=outliers)
    coverage = {}
    for kind in ("inliers", "posterior"):
        options = MixtureOptions(alpha=max(outliers / 8, 0.05), covariance=kind)  # type: ignore[arg-type]
        estimates = bearings_mixture_ml.solve(without_flags(batch), options).estimates
        assert estimates.covariance_kind == kind
        first = estimates.alternative == 0
        d = estimates.position_m[first] - truth
        xx, xy, yy = estimates.covariance_m2[first].T
        distance = (yy * d[:, 0] ** 2 - 2.0 * xy * d[:, 0] * d[:, 1] + xx * d[:, 1] ** 2) / (xx * yy - xy * xy)
        coverage[kind] = np.mean(distance < 5.991)
    assert low <= coverage["posterior"] <= high
    if outliers:
        assert coverage["inliers"] < 0.9


@pytest.mark.parametrize("module", _ROBUST, ids=lambda module: module.METHOD.name)
def test_walls_exclude_virtual_sources(module: object) -> None:
    """With unordered paths a virtual source is as likely as the source; walls can exclude it."""
    wall = SegmentReflector(name="wall", start=(-400.0, 0.0), end=(900.0, 0.0))
    source, image = np.array([250.0, 150.0]), np.array([250.0, -150.0])
    places = [(0.0, 400.0), (170.0, 450.0), (330.0, 450.0), (500.0, 400.0)]
    sensors = [place for place in places for _ in range(2)]
    seen = [source, image] * 4
    bearing = [np.degrees(np.arctan2(*(point - place)[::-1])) for place, point in zip(sensors, seen, strict=True)]
    batch = _bearings(
        sensors,
        bearing,
        sensor=np.repeat(np.arange(4), 2)[None, :],
        path=np.tile([0, 1], 4)[None, :],
        scene=Scene(reflectors=(wall,)),
        field=BoxField(xmin_m=-500.0, xmax_m=1000.0, ymin_m=-500.0, ymax_m=1000.0),
    )
    solve, options = module.METHOD.solve, module.METHOD.options  # type: ignore[attr-defined]
    estimates = solve(batch, options()).estimates
    assert estimates.status[0] == Status.AMBIGUOUS
    two = estimates.position_m[:2]
    for point in (source, image):
        assert np.hypot(*(two - point).T).min() < 1.0
    kept = solve(batch, options(exclude_behind_walls=True)).estimates
    assert np.all(kept.position_m[:, 1] > 0.0)
    assert np.hypot(*(kept.position_m[0] - source)) < 1.0


@pytest.mark.parametrize("module", _ROBUST, ids=lambda module: module.METHOD.name)
def test_a_position_with_one_row_fewer_may_be_the_source(module: object) -> None:
    """Paths over a mirror may reach more sensors than direct ones: ambiguous, if requested."""
    places = [(0.0, 400.0), (170.0, 450.0), (330.0, 450.0), (500.0, 400.0), (90.0, 480.0)]
    sensors = [place for place in places for _ in range(2)]
    seen = [(250.0, 150.0), (250.0, -150.0)] * 4 + [(250.0, 150.0), (-400.0, 300.0)]
    bearing = [np.degrees(np.arctan2(y - b, x - a)) for (a, b), (x, y) in zip(sensors, seen, strict=True)]
    batch = _bearings(
        sensors,
        bearing,
        sensor=np.repeat(np.arange(5), 2)[None, :],
        path=np.tile([0, 1], 5)[None, :],
        bearing_std_rad=np.full((1, 10), np.radians(0.1)),
        field=BoxField(xmin_m=-500.0, xmax_m=1000.0, ymin_m=-500.0, ymax_m=1000.0),
    )

    def found(**options: object) -> Estimates:
        estimates: Estimates = module.METHOD.solve(batch, module.METHOD.options(**options)).estimates  # type: ignore
        return estimates

    estimates = found()
    np.testing.assert_allclose(estimates.position_m[0], seen[0], atol=1.0)
    assert estimates.cost[1] > estimates.cost[0] + 2.0
    assert estimates.status[0] == Status.AMBIGUOUS
    assert found(ambiguous_rows=1).status[0] == Status.AMBIGUOUS
    assert found(ambiguous_rows=0).status[0] == Status.OK
    assert found(path_prior="falling").status[0] == Status.OK


def test_acceptance_by_likelihood_finds_likelier_fixes() -> None:
    """With many outliers, growing inlier sets by likelihood gives likelier fixes than by thresholds."""
    _, batch, _ = ring_batch(10, 300, bearing_std_deg=2.0, nlos_receivers=3, sources="disc")
    costs = []
    for acceptance in ("threshold", "likelihood"):
        options = bearings_suppress.SuppressOptions(acceptance=acceptance, alpha=0.4)  # type: ignore[arg-type]
        estimates = bearings_suppress.solve(without_flags(batch), options).estimates
        costs.append(estimates.cost[estimates.alternative == 0])
    assert np.nanmean(costs[1]) < np.nanmean(costs[0]) - 0.05


@pytest.mark.parametrize("module", _ROBUST, ids=lambda module: module.METHOD.name)
def test_no_crossing_in_the_field_is_no_candidate(module: object) -> None:
    """If no two rays cross within the search region the status is no_candidate."""
    batch = _bearings([(0.0, 0.0), (10.0, 0.0)], [45.0, 135.0], field=CircleField(x_m=50.0, y_m=0.0, radius_m=5.0))
    estimates = module.METHOD.solve(batch, module.METHOD.options()).estimates  # type: ignore[attr-defined]
    assert estimates.status.tolist() == [Status.NO_CANDIDATE]
    assert np.isnan(estimates.position_m).all()


@pytest.mark.parametrize("module", _ROBUST, ids=lambda module: module.METHOD.name)
@pytest.mark.parametrize(
    ("batch", "status"),
    [
        (_bearings([(0.0, 0.0)] * 3, [10.0, 50.0, 90.0]), Status.DEGENERATE),
        (_bearings([(0.0, 0.0), (0.0, 5.0), (0.0, 9.0)], [0.0] * 3), Status.DEGENERATE),
        (_bearings([(0.0, 0.0), (10.0, 0.0)], [45.0, 135.0]), Status.OK),
    ],
    ids=["identical sensors", "all parallel", "two rows"],
)
def test_statuses_of_degenerate_snapshots(module: object, batch: BearingBatch, status: Status) -> None:
    """Identical sensors and parallel rays are degenerate; two rows that cross have a fix if no consensus is needed."""
    spec = module.METHOD  # type: ignore[attr-defined]
    estimates = spec.solve(batch, spec.options(least_evidence=-1000.0)).estimates
    assert estimates.status[0] == status


@pytest.mark.parametrize("module", _ROBUST, ids=lambda module: module.METHOD.name)
@pytest.mark.parametrize("alpha", ["0", "1", "-0.1", "nan"])
def test_alpha_must_be_inside_the_unit_interval(module: object, alpha: str) -> None:
    """An alpha of 0 or 1 or beyond is a usage error that states the range."""
    with pytest.raises(UsageError, match="alpha"):
        parse_options(module.METHOD.options, {"alpha": alpha}, module.METHOD.name)  # type: ignore[attr-defined]


@pytest.mark.parametrize("module", _ROBUST, ids=lambda module: module.METHOD.name)
def test_snapshots_of_outliers_leave_others_unchanged(module: object) -> None:
    """A snapshot of outliers only may have an answer or not; results of the others are unchanged to the bit."""
    _, batch, _ = ring_batch(5, 12, sources="disc")
    bearing = np.asfortranarray(batch.bearing_rad.copy())
    bearing[::2] = np.random.default_rng(1).uniform(-np.pi, np.pi, bearing[::2].shape)
    solve, options = module.METHOD.solve, module.METHOD.options()  # type: ignore[attr-defined]
    clean = solve(batch, options).estimates
    mixed = solve(dataclasses.replace(batch, bearing_rad=bearing), options).estimates
    for row in range(1, 12, 2):
        assert np.array_equal(clean.position_m[clean.row == row], mixed.position_m[mixed.row == row])


def test_mode_gap_selects_the_crossings_followed() -> None:
    """``mode_gap`` is per row: a crossing of fewer rays is an alternative from that gap on, not below it."""
    sensors = [(0.0, 0.0), (100.0, 0.0), (0.0, 100.0), (100.0, 100.0), (50.0, -20.0)]
    meet = [(40.0, 55.0)] * 3 + [(75.0, 20.0)] * 2
    bearing = [np.degrees(np.arctan2(y - b, x - a)) for (a, b), (x, y) in zip(sensors, meet, strict=True)]
    batch = _bearings(sensors, bearing, bearing_std_rad=np.full((1, 5), 1e-4))

    def found(**options: float) -> Estimates:
        estimates: Estimates = bearings_mixture_ml.solve(batch, MixtureOptions(**options)).estimates  # type: ignore
        return estimates

    wide = found(mode_gap=100.0)
    apart = np.hypot(*(wide.position_m - meet[-1]).T)
    gap = (wide.cost[np.argmin(apart)] - wide.cost[0]) / 5
    assert apart.min() < 0.1
    assert gap > 0.1
    for share, expected in ((0.8, False), (1.2, True)):
        near = np.hypot(*(found(mode_gap=share * gap).position_m - meet[-1]).T) < 0.1
        assert near.any() == expected


def test_hundred_bearings_in_one_snapshot() -> None:
    """100 rows are solved, by all pairs or by a seeded sample of them."""
    truth, batch, _ = ring_batch(6, 2, sensors=100, bearing_std_deg=4.0, nlos_receivers=30, sources="disc")
    exact, sampled = (
        bearings_mixture_ml.solve(batch, MixtureOptions(max_pairs=pairs)).estimates for pairs in (5000, 500)
    )
    assert np.all(_errors(exact, truth) < 0.1)
    np.testing.assert_allclose(_errors(sampled, truth), _errors(exact, truth), atol=1e-6)


def test_all_pairs_are_tried_once_without_a_candidate(monkeypatch: pytest.MonkeyPatch) -> None:
    """Forty bearings that cross behind the sensors only: rounds double until every pair was tried, then behind."""
    rounds = []

    def watched(model: object, first: np.ndarray, second: np.ndarray, **options: object) -> object:
        rounds.append(100 * np.minimum(first[0], second[0]) + np.maximum(first[0], second[0]))
        return grow_hypotheses(model, first, second, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(suppressed_fixes, "grow_hypotheses", watched)
    batch = _bearings([(float(x), 0.0) for x in range(40)], np.linspace(130.0, 50.0, 40).tolist())
    batch = dataclasses.replace(batch, field=BoxField(xmin_m=-1e4, xmax_m=-9e3, ymin_m=-1e4, ymax_m=-9e3))
    estimates = bearings_suppress.solve(batch, bearings_suppress.SuppressOptions(rivals=0)).estimates
    assert estimates.status.tolist() == [Status.BEHIND]
    assert len(rounds) <= 9
    tried = np.concatenate(rounds)
    assert tried.size == np.unique(tried).size == 780


def test_modes_outside_the_field_end_at_its_edge() -> None:
    """If every descent leaves the search region the fix is on its edge, without a covariance."""
    _, batch, _ = ring_batch(7, 300, bearing_std_deg=4.0, nlos_receivers=2, sources="disc", source_share=1.0)
    field = CircleField(x_m=0.0, y_m=0.0, radius_m=0.6)
    estimates = bearings_mixture_ml.solve(dataclasses.replace(batch, field=field), MixtureOptions()).estimates
    held = estimates.status == Status.BOUNDARY
    assert held.sum() > 5
    assert np.isnan(estimates.covariance_m2[held]).all()
    distance = np.hypot(*estimates.position_m[held].T)
    assert np.all(distance <= 0.6)
    assert np.median(distance) > 0.55


@pytest.mark.parametrize("noise", ["gaussian", "lognormal"])
def test_ranges_improve_every_method(noise: str) -> None:
    """2 % ranges reduce the error several times compared with bearings of 4 deg, and the covariance reports it."""
    truth, batch, _ = ring_batch(8, 400, bearing_std_deg=4.0, range_std_share=0.02, sources="disc")
    for module in (*_ALL, bearings_ml):
        spec = module.METHOD
        both, alone = (
            spec.solve(batch, spec.options(use_ranges=use, range_noise=noise)).estimates for use in (True, False)
        )
        assert np.median(_errors(both, truth)) < 0.5 * np.median(_errors(alone, truth))
        assert np.median(both.covariance_m2[:, 0]) < 0.25 * np.median(alone.covariance_m2[:, 0])


def test_one_row_with_a_range_is_an_answer_for_the_mixture() -> None:
    """A single bearing with its range gives a fix, if no consensus is needed; without the range it is too_few."""
    batch = _bearings([(1.0, 2.0)], [30.0], field=CircleField(x_m=0.0, y_m=0.0, radius_m=100.0))
    assert bearings_mixture_ml.solve(batch, MixtureOptions()).estimates.status[0] == Status.TOO_FEW
    ranged = dataclasses.replace(batch, range_m=np.array([[10.0]]), range_std_m=np.array([[0.1]]))
    estimates = bearings_mixture_ml.solve(ranged, MixtureOptions(least_evidence=-1000.0)).estimates
    assert estimates.status[0] == Status.OK
    expected = [1.0 + 10.0 * np.cos(np.radians(30.0)), 2.0 + 10.0 * np.sin(np.radians(30.0))]
    np.testing.assert_allclose(estimates.position_m[0], expected, atol=1e-6)


def test_a_prior_replaces_the_bootstrap_pair() -> None:
    """With a prior one bearing is enough; the file's prior overrides the parameters'; half a prior is refused."""
    batch = _bearings([(0.0, 0.0)], [90.0])
    options = bearings_sequential.SequentialOptions
    assert bearings_sequential.solve(batch, options()).estimates.status[0] == Status.TOO_FEW
    prior = options(prior_x_m=1.0, prior_y_m=50.0, prior_std_m=5.0)
    estimates = bearings_sequential.solve(batch, prior).estimates
    assert estimates.status[0] == Status.OK
    assert abs(estimates.position_m[0, 0]) < 0.2
    own = dataclasses.replace(batch, prior_xy_m=np.array([[[3.0, 80.0]]]), prior_std_m=np.array([[7.0]]))
    same = options(prior_x_m=3.0, prior_y_m=80.0, prior_std_m=7.0)
    for name in ("position_m", "covariance_m2"):
        found, expected = (
            getattr(bearings_sequential.solve(*pair).estimates, name) for pair in ((own, prior), (batch, same))
        )
        np.testing.assert_array_equal(found, expected)
    half = dataclasses.replace(own, prior_std_m=None)
    assert bearings_sequential.solve(half, options()).estimates.status[0] == Status.TOO_FEW
    with pytest.raises(UsageError, match=r"^a prior needs all of prior_x_m, prior_y_m and prior_std_m$"):
        bearings_sequential.solve(batch, options(prior_x_m=1.0))


def test_two_bearings_are_enough_for_sequential() -> None:
    """Two rays without a prior give their crossing, one too_few without a range; no flags unless requested."""
    batch = _bearings([(0.0, 0.0), (10.0, 0.0)], [45.0, 135.0])
    options = bearings_sequential.SequentialOptions()
    estimates = bearings_sequential.solve(batch, options).estimates
    assert estimates.status.tolist() == [Status.OK]
    np.testing.assert_allclose(estimates.position_m, [[5.0, 5.0]], atol=1e-9)
    few = _bearings([(0.0, 0.0)], [45.0])
    ranged = dataclasses.replace(few, range_m=np.full((1, 1), 9.0), range_std_m=np.ones((1, 1)))
    cases = (few, Status.TOO_FEW, ["residual_rad"]), (ranged, Status.OK, ["residual_rad", "residual_m"])
    for part, status, names in cases:
        assert bearings_sequential.solve(dataclasses.replace(part, want_flags=False), options).flags is None
        solution = bearings_sequential.solve(part, options)
        assert solution.estimates.status.tolist() == [status]
        assert solution.flags is not None
        assert list(solution.flags.columns) == names
        assert solution.flags.used.tolist() == [[status == Status.OK]]
        residuals = np.array([column[0, 0] for column in solution.flags.columns.values()])
        assert np.isnan(residuals).all() if status != Status.OK else np.allclose(residuals, 0.0, atol=1e-9)


@pytest.mark.parametrize(("x", "y", "std"), [(np.nan, 80.0, 5.0), (1.0, np.nan, 5.0), (1.0, 80.0, np.nan)])
def test_incomplete_priors_are_ignored(x: float, y: float, std: float) -> None:
    """A file's prior without x, y or std is replaced by that of the parameters; without one, one bearing is too_few."""
    options = bearings_sequential.SequentialOptions
    batch = _bearings([(0.0, 0.0)], [90.0])
    own = dataclasses.replace(batch, prior_xy_m=np.array([[[x, y]]]), prior_std_m=np.array([[std]]))
    prior = options(prior_x_m=1.0, prior_y_m=50.0, prior_std_m=5.0)
    expected, found = (bearings_sequential.solve(part, prior).estimates for part in (batch, own))
    np.testing.assert_array_equal(found.position_m, expected.position_m)
    assert found.status.tolist() == [Status.OK]
    assert bearings_sequential.solve(own, options()).estimates.status.tolist() == [Status.TOO_FEW]


def test_a_prior_is_in_the_coordinates_of_the_file() -> None:
    """Moving sensors and prior by 100 km moves the fix along."""
    move = np.array([1e5, -3e5])
    here = _bearings([(0.0, 0.0), (10.0, 0.0)], [90.0, 92.0])
    here = dataclasses.replace(here, prior_xy_m=np.full((1, 2, 2), 40.0), prior_std_m=np.full((1, 2), 20.0))
    there = dataclasses.replace(here, sensor_xy_m=here.sensor_xy_m + move, prior_xy_m=here.prior_xy_m + move)
    fixes = [
        bearings_sequential.solve(part, bearings_sequential.SequentialOptions()).estimates for part in (here, there)
    ]
    np.testing.assert_allclose(fixes[1].position_m - move, fixes[0].position_m, atol=1e-6)
    assert fixes[0].status.tolist() == fixes[1].status.tolist() == [Status.OK]


def test_the_trace_records_every_step() -> None:
    """The trace counts the rows used, names each once, shrinks, and ends at the estimate."""
    _, batch, _ = ring_batch(9, 20, sources="disc")
    wanted = dataclasses.replace(batch, want_trace=True)
    solution = bearings_sequential.solve(wanted, bearings_sequential.SequentialOptions(bootstraps=3))
    trace = solution.trace
    assert trace is not None
    assert trace.row.dtype == trace.step.dtype == np.int64
    for row in range(20):
        mine = trace.row == row
        assert trace.step[mine].tolist() == list(range(2, 9))
        assert len(set(trace.measurement[mine])) == 7
        spread = trace.covariance_m2[mine][:, 0] + trace.covariance_m2[mine][:, 2]
        assert spread[-1] < spread[0]
        assert np.array_equal(trace.position_m[mine][-1], solution.estimates.position_m[row])
    assert bearings_sequential.solve(batch, bearings_sequential.SequentialOptions()).trace is None
