"""Robust methods: a fix only where the rows agree, within the search region, at a point that the scene allows."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from batches import bearing_batch
from outlier_worlds import ring_batch, without_flags

import nlosctl
from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.fields import BoxField, SensorsField
from nlosctl.contract.methods import MethodSpec
from nlosctl.contract.results import Estimates
from nlosctl.contract.statuses import Status
from nlosctl.methods import bearings_mixture_ml, bearings_ml, bearings_suppress
from nlosctl.methods.bearings_mixture_ml import MixtureOptions
from nlosctl.solvers.mixture.bearing_candidates import BearingCandidates
from nlosctl.solvers.mixture.consensus import log_evidence, outlier_gain
from nlosctl.solvers.mixture.modes import find_modes
from nlosctl.solvers.mixture.outlier_model import grouped_batch, outlier_model
from nlosctl.solvers.mixture.ranked_estimates import rank_modes

_AGREED = (Status.OK, Status.AMBIGUOUS)
_KEEP_ALL = {"least_evidence": -1000.0, "search_outside": False}


def _random_bearings(seed: int, snapshots: int, sensors: int, std_deg: float, distance_m: float | None) -> tuple:
    """Return sources (B, 2) and bearings from sensors anywhere in a square kilometre.

    The sources are at a distance from its middle, anywhere in it (0), or do not exist (None).
    """
    generator = np.random.default_rng(seed)
    sensor = generator.uniform(-500.0, 500.0, (snapshots, sensors, 2))
    turn = generator.uniform(-np.pi, np.pi, snapshots)
    source = (distance_m or 0.0) * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    if distance_m == 0.0:
        source = generator.uniform(-500.0, 500.0, (snapshots, 2))
    std = np.radians(std_deg)
    offset = source[:, None, :] - sensor
    bearing = np.arctan2(offset[..., 1], offset[..., 0]) + std * generator.normal(size=sensor.shape[:2])
    if distance_m is None:
        bearing = generator.uniform(-np.pi, np.pi, bearing.shape)
    batch = bearing_batch(sensor, (bearing + np.pi) % (2.0 * np.pi) - np.pi, std)
    return source, dataclasses.replace(batch, field=SensorsField(factor=1.0), want_flags=False)


@pytest.fixture(params=[bearings_mixture_ml, bearings_suppress], ids=lambda module: module.METHOD.name)
def robust(request: pytest.FixtureRequest) -> MethodSpec:
    """Each robust method for bearings in turn."""
    spec: MethodSpec = request.param.METHOD
    return spec


def _best(robust: MethodSpec, batch: BearingBatch, **options: object) -> Estimates:
    """Return the best alternatives."""
    estimates = robust.solve(batch, robust.options(**options)).estimates
    first = estimates.alternative == 0
    fields = ("row", "target", "alternative", "position_m", "covariance_m2", "cost", "n_used", "status")
    return Estimates(**{name: getattr(estimates, name)[first] for name in fields})


def _share(status: np.ndarray, *words: Status) -> float:
    return float(np.isin(status, words).mean())


def _evidence_by_grid(batch: BearingBatch, row: int, middle: np.ndarray, reach: float, alpha: float) -> float:
    """Return the log evidence of a source over outliers on the full circle: the mean likelihood over the region."""
    x, y = np.meshgrid(*(center + np.linspace(-reach, reach, 601) for center in middle), indexing="ij")
    ratio = np.ones(x.shape)
    for sensor in np.unique(batch.sensor[row]):
        paths = np.flatnonzero(batch.sensor[row] == sensor)
        direct = np.zeros(x.shape)
        for k in paths:
            sensor_x, sensor_y = batch.sensor_xy_m[row, k]
            error = batch.bearing_rad[row, k] - np.arctan2(y - sensor_y, x - sensor_x)
            error = (error + np.pi) % (2.0 * np.pi) - np.pi
            std = batch.bearing_std_rad[row, k]
            direct += np.exp(-0.5 * (error / std) ** 2) / (np.sqrt(2.0 * np.pi) * std) * 2.0 * np.pi
        ratio *= alpha + (1.0 - alpha) * direct / paths.size
    field = batch.field
    assert isinstance(field, BoxField)
    area = (field.xmax_m - field.xmin_m) * (field.ymax_m - field.ymin_m)
    return float(np.log(ratio.sum() * (2.0 * reach / 600.0) ** 2 / area))


@pytest.mark.parametrize(("paths", "outliers"), [(1, 0), (1, 2), (2, 0)])
def test_the_evidence_is_that_of_a_grid(paths: int, outliers: int) -> None:
    """Peak times volume is the integral of the likelihood over the region, over that of outliers alone."""
    _, batch, _ = ring_batch(
        11, 12, sensors=6, radius_m=500.0, bearing_std_deg=0.5, nlos_receivers=outliers, paths=paths, sources="disc"
    )
    batch = dataclasses.replace(batch, field=BoxField(xmin_m=-800.0, xmax_m=700.0, ymin_m=-600.0, ymax_m=600.0))
    options = MixtureOptions(alpha=0.2)
    grouped, groups = grouped_batch(batch)
    model = outlier_model(grouped, groups, options)
    candidates = BearingCandidates.of(grouped, model, max_pairs=5000, exclude_behind_walls=False)
    modes = find_modes(model.mixture, candidates.points, candidates.count, candidates.allowed, most=20, gap=6.0)
    fixes, probability = rank_modes(model.mixture, modes)
    hessian = modes.hessian.at(slice(None), 0)
    found = log_evidence(
        model.mixture, fixes.cost[:, 0], probability, hessian, model.region.volume, outlier_gain(np.pi)
    )
    x, y = fixes.best_point
    middle = np.stack([x + model.lines.center_x, y + model.lines.center_y], axis=1)
    reach = 6.0 / np.sqrt(hessian.eigenvalues()[0])
    expected = [_evidence_by_grid(grouped, row, middle[row], reach[row], 0.2) for row in range(12)]
    np.testing.assert_allclose(found, expected, atol=0.25)  # a mode is not quite Gaussian
    assert np.median(np.abs(found - expected)) < 0.03


def test_a_narrow_field_of_view_is_that_of_the_sensor() -> None:
    """Without a source a bearing is uniform over the full circle, or over a field of view below 180 degrees."""
    assert [outlier_gain(np.radians(angle)) for angle in (90.0, 180.0, 240.0, 360.0)] == pytest.approx([1, 2, 1.5, 1])


@pytest.mark.parametrize(("sensors", "std_deg"), [(4, 5.0), (6, 1.0), (8, 5.0), (20, 5.0)])
def test_pure_noise_is_no_fix(robust: MethodSpec, sensors: int, std_deg: float) -> None:
    """Of bearings uniform over the circle at most 2 % give ok or ambiguous; x, y are kept without a covariance."""
    _, batch = _random_bearings(1, 600, sensors, std_deg, None)
    found = _best(robust, batch)
    assert _share(found.status, *_AGREED) <= 0.02
    assert _share(_best(robust, batch, **_KEEP_ALL).status, *_AGREED) > 0.5
    apart = found.status == Status.NO_CONSENSUS
    assert apart.mean() > 0.4
    assert np.isfinite(found.position_m[apart]).all()
    assert np.isnan(found.covariance_m2[apart]).all()
    before = _best(robust, batch, **_KEEP_ALL)
    same = apart & (before.status != Status.DEGENERATE)
    assert same.sum() > 0.9 * apart.sum()
    np.testing.assert_array_equal(found.position_m[same], before.position_m[same])


@pytest.mark.parametrize(("sensors", "std_deg"), [(5, 1.0), (5, 3.0), (8, 3.0)])
def test_clean_bearings_keep_their_fix(robust: MethodSpec, sensors: int, std_deg: float) -> None:
    """Without outliers 99 % of the snapshots of five bearings or more keep their status."""
    _, batch = _random_bearings(2, 1500, sensors, std_deg, 0.0)
    assert np.mean(_best(robust, batch).status == _best(robust, batch, **_KEEP_ALL).status) >= 0.99


def test_two_rows_have_no_consensus(robust: MethodSpec) -> None:
    """Two rays always cross: they agree no better than outliers do, unless every fix is to be kept."""
    batch = bearing_batch([[(0.0, 0.0), (10.0, 0.0)]], np.radians([[45.0, 135.0]]), np.radians(1.0))
    for least, status in ((3.0, Status.NO_CONSENSUS), (-1000.0, Status.OK)):
        found = _best(robust, batch, least_evidence=least)
        assert found.status.tolist() == [status]
        np.testing.assert_allclose(found.position_m, [[5.0, 5.0]], atol=1e-6)


def test_without_a_consensus_no_row_is_line_of_sight(robust: MethodSpec) -> None:
    """The flags los and los_probability are null: there is no source for a row to be direct from."""
    _, batch = _random_bearings(3, 50, 6, 2.0, None)
    solution = robust.solve(dataclasses.replace(batch, want_flags=True), robust.options())
    apart = solution.estimates.status[solution.estimates.alternative == 0] == Status.NO_CONSENSUS
    assert apart.sum() > 20
    assert solution.flags is not None
    assert all(value is None for value in solution.flags.columns["los"][apart].ravel())
    assert np.isnan(solution.flags.columns["los_probability"][apart]).all()


@pytest.mark.parametrize("sensors", [4, 8])
def test_a_source_outside_the_region_is_reported(robust: MethodSpec, sensors: int) -> None:
    """Sources 2.5 km from sensors in a square kilometre: outside_field at the maximum of the likelihood, never ok."""
    source, batch = _random_bearings(4, 400, sensors, 2.0, 2500.0)
    found = _best(robust, batch)
    outside = found.status == Status.OUTSIDE_FIELD
    assert outside.mean() > 0.94
    assert _share(found.status, *_AGREED) <= 0.01
    assert np.isnan(found.covariance_m2[outside]).all()
    every = outside & (found.n_used == sensors)
    assert every.mean() > 0.5
    best = bearings_ml.solve(batch, bearings_ml.MaximumLikelihoodOptions()).estimates.position_m
    distance = np.hypot(*(found.position_m - best)[every].T)
    assert np.nanmedian(distance / np.hypot(*source[every].T)) < 0.05
    before = _best(robust, batch, **_KEEP_ALL)
    assert _share(before.status, Status.OK) > 0.1, "the case that is to be caught"
    wide = _best(robust, dataclasses.replace(batch, field=SensorsField(factor=10.0)))
    assert _share(wide.status, Status.OK) >= {"mixture-ml": 0.95, "suppress": 0.93}[robust.name]


def test_sources_inside_are_not_sought_outside(robust: MethodSpec) -> None:
    """Clean and contaminated bearings of sources inside the region are outside_field in at most half a per cent."""
    for outliers in (0, 2):
        _, batch, _ = ring_batch(12, 3000, bearing_std_deg=2.0, nlos_receivers=outliers, sources="disc")
        batch = dataclasses.replace(without_flags(batch), field=SensorsField(factor=1.0))
        assert _share(_best(robust, batch).status, Status.OUTSIDE_FIELD) <= 0.005


def test_a_mirror_image_outside_does_not_win(robust: MethodSpec) -> None:
    """With paths in unknown order an image outside that one row more agrees on leaves the fix inside."""
    places = [(0.0, 400.0), (170.0, 450.0), (330.0, 450.0), (500.0, 400.0), (90.0, 480.0), (410.0, 470.0)]
    inside, image = (250.0, 150.0), (250.0, -350.0)
    sensors = [place for place in places for _ in range(2)]
    seen = [inside, image] * 5 + [(-400.0, 300.0), image]
    bearing = [np.degrees(np.arctan2(y - b, x - a)) for (a, b), (x, y) in zip(sensors, seen, strict=True)]
    batch = bearing_batch(
        [sensors],
        np.radians([bearing]),
        np.radians(0.1),
        sensor=np.repeat(np.arange(6), 2)[None, :],
        path=np.tile([0, 1], 6)[None, :],
        field=BoxField(xmin_m=-100.0, xmax_m=600.0, ymin_m=0.0, ymax_m=600.0),
    )
    for rows, status, point in ((2, Status.OK, inside), (0, Status.OUTSIDE_FIELD, image)):
        found = _best(robust, batch, ambiguous_rows=rows)
        assert found.status.tolist() == [status]
        np.testing.assert_allclose(found.position_m[0], point, atol=2.0)


def test_no_fix_is_under_ground(robust: MethodSpec) -> None:
    """Bearings by the ionosphere at 3 deg: optima below the surface are infeasible, as for ml."""
    table = nlosctl.simulate("song-circle", trials=400, seed=5, bearing_std_deg=3.0)
    estimates = nlosctl.localize(table, method=robust.name).estimates.to_pandas()
    under = np.hypot(estimates.x_m, estimates.y_m) < 6371e3
    assert (under & (estimates.status == "infeasible")).sum() > 5
    assert not (under & estimates.status.isin(["ok", "ambiguous"])).any()


def test_no_fix_is_at_the_minimum_range_of_a_sensor(robust: MethodSpec) -> None:
    """Where the likelihood still rises towards a sensor the status is degenerate, not ok."""
    _, batch, _ = ring_batch(1, 4000, sensors=6, layout="random", bearing_std_deg=4.0, nlos_receivers=2, sources="disc")
    batch = without_flags(batch)
    before, found = _best(robust, batch, **_KEEP_ALL), _best(robust, batch)
    extent = np.ptp(batch.sensor_xy_m, axis=1).max(axis=1)

    def at_sensor(estimates: Estimates) -> np.ndarray:
        nearest = np.hypot(*np.moveaxis(estimates.position_m[:, None] - batch.sensor_xy_m, -1, 0)).min(axis=1)
        return np.isin(estimates.status, _AGREED) & (nearest < 1.01 * 0.005 * extent)

    assert not at_sensor(found).any()
    assert (before.status == Status.DEGENERATE).sum() > 5


@pytest.mark.extensive
def test_fixes_beside_massive_rivals_are_ambiguous() -> None:
    """Eight bearings at 4 deg, a quarter outliers: at most .5 % of the ok fixes have a squared error above 100."""
    source, batch = _random_bearings(6, 16000, 8, 4.0, 0.0)
    generator = np.random.default_rng(7)
    astray = generator.random(batch.bearing_rad.shape) < 0.25
    bearing = np.where(astray, generator.uniform(-np.pi, np.pi, astray.shape), batch.bearing_rad)
    batch = dataclasses.replace(batch, bearing_rad=np.asfortranarray(bearing))
    batch = dataclasses.replace(batch, field=BoxField(xmin_m=-500.0, xmax_m=500.0, ymin_m=-500.0, ymax_m=500.0))
    found = _best(bearings_mixture_ml.METHOD, batch)
    dx, dy = (found.position_m - source).T
    xx, xy, yy = found.covariance_m2.T
    nees = (yy * dx * dx - 2.0 * xy * dx * dy + xx * dy * dy) / (xx * yy - xy * xy)
    ok = found.status == Status.OK
    assert ok.mean() > 0.65
    assert np.mean(nees[ok] > 100.0) <= 0.005


@pytest.mark.extensive
def test_clean_fixes_on_which_all_rows_agree_need_heavier_rivals() -> None:
    """Eight clean bearings at 3 deg: 95 % are ok; 91 % if rivals of 14 % of the mass counted on all rows too."""
    _, batch = _random_bearings(6, 4000, 8, 3.0, 0.0)
    batch = dataclasses.replace(batch, field=BoxField(xmin_m=-500.0, xmax_m=500.0, ymin_m=-500.0, ymax_m=500.0))
    assert _share(_best(bearings_mixture_ml.METHOD, batch).status, Status.OK) > 0.945


def test_uncertain_crossings_are_degenerate(robust: MethodSpec) -> None:
    """Rays that nearly coincide: a standard deviation beyond the farthest sensor is degenerate, as for ml."""
    batch = bearing_batch([[(0.0, 0.0), (0.0, 5.0), (0.0, 10.0)]], np.radians([[0.3, 0.0, -0.3]]), np.radians(1.0))
    batch = dataclasses.replace(batch, field=BoxField(xmin_m=-1e5, xmax_m=1e5, ymin_m=-1e5, ymax_m=1e5))
    plain = bearings_ml.solve(batch, bearings_ml.MaximumLikelihoodOptions()).estimates
    assert plain.status.tolist() == [Status.DEGENERATE]
    assert _best(robust, batch, least_evidence=-1000.0).status.tolist() == [Status.DEGENERATE]


@pytest.mark.parametrize(("sensors", "share"), [(2, 0.9), (3, 0.95), (8, 0.99)])
def test_bearings_of_the_opposite_sense_are_behind(robust: MethodSpec, sensors: int, share: float) -> None:
    """If the lines meet behind the sensors the status is behind, as for ls and ml."""
    _, batch, _ = ring_batch(13, 200, sensors=sensors, bearing_std_deg=1.0, sources="disc", source_share=0.6)
    reversed_rad = (batch.bearing_rad + 2.0 * np.pi) % (2.0 * np.pi) - np.pi
    batch = dataclasses.replace(without_flags(batch), bearing_rad=np.asfortranarray(reversed_rad))
    assert _share(_best(robust, batch).status, Status.BEHIND) > share
