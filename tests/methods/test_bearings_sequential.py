"""``sequential``: starting pairs, second round, priors passed from receiver to receiver, statuses."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from batches import bearing_batch
from bearing_worlds import words

import nlosctl
from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.results import Estimates
from nlosctl.contract.scene import LineReflector, Scene
from nlosctl.errors import UsageError
from nlosctl.methods import bearings_ml, bearings_sequential
from nlosctl.solvers.sequential import orders, starting_pairs
from nlosctl.solvers.sequential.polar_updates import SourceState

PUBLISHED = {"pairs": "random", "bootstraps": 1, "relinearize": False}


def estimate(batch: BearingBatch, **options: Any) -> Estimates:
    """Return the estimates of ``sequential``."""
    return bearings_sequential.solve(batch, bearings_sequential.METHOD.options(**options)).estimates


def draw(snapshots: int, sensors: int, std_deg: tuple[float, float], seed: int = 1) -> tuple[BearingBatch, np.ndarray]:
    """Return direct bearings of sensors in a square of 1 km, with log-uniform stds, and the sources (B, 2)."""
    generator = np.random.default_rng(seed)
    sensor_xy = generator.uniform(-500.0, 500.0, (snapshots, sensors, 2))
    source = generator.uniform(-500.0, 500.0, (snapshots, 2))
    away = source[:, None] - sensor_xy
    std = np.radians(np.exp(generator.uniform(*np.log(std_deg), (snapshots, sensors))))
    bearing = np.arctan2(away[..., 1], away[..., 0]) + std * generator.standard_normal(std.shape)
    seeds = generator.integers(0, 2**63, snapshots).astype(np.uint64)
    return bearing_batch(sensor_xy, bearing, std, seed=seeds, want_flags=False), source


def nees(estimates: Estimates, source: np.ndarray) -> np.ndarray:
    """Return the normalized squared errors of the fixes that are ok."""
    ok = estimates.status == 0
    dx, dy = (estimates.position_m - source)[ok].T
    xx, xy, yy = estimates.covariance_m2[ok].T
    return np.asarray((yy * dx * dx - 2.0 * xy * dx * dy + xx * dy * dy) / (xx * yy - xy * xy))


def take(batch: BearingBatch, rows: np.ndarray, **fields: Any) -> BearingBatch:
    """Return the measurements of indices ``rows`` (B, n) of each snapshot."""

    def pick(array: np.ndarray) -> np.ndarray:
        index = rows if array.ndim == 2 else rows[..., None]
        return np.asfortranarray(np.take_along_axis(array, index, axis=1))

    names = ("sensor", "sensor_xy_m", "bearing_rad", "bearing_std_rad", "path", "reflector")
    return dataclasses.replace(batch, **{name: pick(getattr(batch, name)) for name in names}, **fields)


def test_every_seed_starts_from_the_most_precise_pair() -> None:
    """Four bearings of .2 to 7.6 deg, whose random pairs end at costs of 2, 65 and 148: 2.04 for every seed, as ml."""
    sensors = [(-960.0, -400.0), (-250.0, -210.0), (-710.0, -150.0), (860.0, -40.0)]
    bearing, std = np.radians([-65.1, -124.5, -91.8, -166.6]), np.radians([0.9, 0.2, 1.6, 7.6])
    batch = bearing_batch([sensors] * 20, [bearing] * 20, [std] * 20, seed=np.arange(20, dtype=np.uint64))
    best = bearings_ml.solve(batch, bearings_ml.METHOD.options()).estimates
    for options in ({}, {"bootstraps": 1}):
        found = estimate(batch, **options)
        assert set(words(found)) == {"ok"}
        np.testing.assert_allclose(found.cost, 2.0439, atol=1e-3)
        np.testing.assert_allclose(found.position_m, best.position_m, atol=1.0)
    assert np.nanmax(estimate(batch, **PUBLISHED).cost) > 60.0


@pytest.mark.parametrize(
    ("sensors", "std_deg"), [(3, (0.1, 10.0)), (4, (0.2, 8.0)), (8, (3.0, 3.0)), (8, (10.0, 10.0)), (30, (0.1, 10.0))]
)
def test_the_covariance_is_the_size_of_the_error(sensors: int, std_deg: tuple[float, float]) -> None:
    """Of 4000 snapshots 92 to 97 % of the 95 % ellipses hold the source, and at most .3 % of NEES exceed 100."""
    batch, source = draw(4000, sensors, std_deg)
    found = nees(estimate(batch), source)
    assert found.size > 3900
    assert 0.92 < np.mean(found < 5.991) < 0.97
    assert np.mean(found > 100.0) <= 0.003
    assert np.mean(found) == pytest.approx(2.0, rel=0.25)


def test_as_published_the_covariance_is_too_small_at_large_errors() -> None:
    """One run from a random pair without a second round: at 10 deg fewer than 85 % of the ellipses hold the source."""
    batch, source = draw(2000, 8, (10.0, 10.0))
    found = nees(estimate(batch, **PUBLISHED), source)
    assert np.mean(found < 5.991) < 0.85


def test_the_pairs_examined_are_linear_in_the_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    """At most six pairs a row, all different rows, every row among them; all pairs of a few rows."""
    examined: list[np.ndarray] = []

    def watched(first: Any, second: Any, *, lognormal: bool) -> SourceState:
        examined.append(np.stack([first.origin_x, second.origin_x], axis=-1))
        return orders.pair_state(first, second, lognormal=lognormal)

    monkeypatch.setattr(starting_pairs, "pair_state", watched)
    for rows in (2, 5, 12, 13, 14, 20, 80, 200):
        batch, _ = draw(2, rows, (1.0, 1.0), seed=rows)
        examined.clear()
        assert "ok" in words(estimate(batch))
        pairs = np.sort(np.concatenate(examined, axis=0)[0], axis=-1)
        assert len(np.unique(pairs, axis=0)) == len(pairs) <= 6 * rows
        assert np.all(pairs[:, 0] < pairs[:, 1])
        assert np.unique(pairs).size == rows
        if rows <= 12:
            assert len(pairs) == rows * (rows - 1) // 2


def test_the_two_most_precise_of_many_rows_are_a_pair() -> None:
    """Among 40 bearings of 8 deg two of .1 deg start the run: the error is theirs, whatever the seed."""
    batch, source = draw(300, 40, (8.0, 8.0))
    std = batch.bearing_std_rad.copy()
    std[:, [7, 31]] = np.radians(0.1)
    away = source[:, None] - batch.sensor_xy_m
    exact = np.arctan2(away[..., 1], away[..., 0])
    bearing = exact + (batch.bearing_rad - exact) / batch.bearing_std_rad * std
    precise = dataclasses.replace(batch, bearing_rad=bearing, bearing_std_rad=std)
    found = estimate(precise, bootstraps=1, relinearize=False)
    assert np.mean(nees(found, source) > 100.0) < 0.02
    assert np.mean(nees(estimate(precise, **PUBLISHED), source) > 100.0) > 0.1


def test_the_second_round_is_a_step_of_gauss_and_newton() -> None:
    """The fix is that of one linear solve about the first round's, and its covariance the inverse information."""
    batch, _ = draw(50, 5, (2.0, 4.0), seed=3)
    first, second = (estimate(batch, bootstraps=1, relinearize=again) for again in (False, True))
    moved = 0
    for b in np.flatnonzero((first.status == 0) & (second.status == 0)):

        def linearized(point: np.ndarray, b: int = b) -> tuple[np.ndarray, np.ndarray]:
            away = point - batch.sensor_xy_m[b]
            slope = np.stack([-away[:, 1], away[:, 0]], axis=1) / (away**2).sum(axis=1)[:, None]
            left = np.angle(np.exp(1j * (batch.bearing_rad[b] - np.arctan2(away[:, 1], away[:, 0]))))
            std = batch.bearing_std_rad[b]
            return slope / std[:, None], left / std

        design, left = linearized(first.position_m[b])
        expected = first.position_m[b] + np.linalg.solve(design.T @ design, design.T @ left)
        if 0.5 * (linearized(expected)[1] ** 2).sum() > first.cost[b]:
            expected = first.position_m[b]
        moved += not np.allclose(expected, first.position_m[b])
        np.testing.assert_allclose(second.position_m[b], expected, rtol=1e-9, atol=1e-6)
        design, left = linearized(expected)
        assert second.cost[b] == pytest.approx(0.5 * (left**2).sum(), rel=1e-9)
        covariance = np.linalg.inv(design.T @ design)
        if np.hypot(*(expected - batch.sensor_xy_m[b]).T).min() ** 2 > 9.0 * np.linalg.eigvalsh(covariance)[-1]:
            np.testing.assert_allclose(second.covariance_m2[b], covariance[[0, 0, 1], [0, 1, 1]], rtol=1e-9)
    assert moved > 30


def _passed_on(batch: BearingBatch, order: np.ndarray, full: bool = True, **options: Any) -> Estimates:
    """Return the last estimates of receivers that each combine their row with the state received from the one before.

    The first two rows start; ``full`` passes on the covariance, else a standard deviation of the same variance.
    """
    state = estimate(take(batch, order[:, :2]), **options)
    for k in range(2, order.shape[1]):
        xy, covariance = state.position_m[:, None], state.covariance_m2[:, None]
        prior: dict[str, Any] = {"prior_xy_m": xy, "prior_cov_m2": covariance}
        if not full:
            prior = {"prior_xy_m": xy, "prior_std_m": np.sqrt(0.5 * (covariance[..., 0] + covariance[..., 2]))}
        state = estimate(take(batch, order[:, k : k + 1], **prior), **options)
    return state


def test_a_chain_of_receivers_is_one_run() -> None:
    """As published, one-row runs that pass on position and covariance give the fix of one run to rounding."""
    batch, _ = draw(200, 8, (0.5, 4.0), seed=2)
    solution = bearings_sequential.solve(
        dataclasses.replace(batch, want_trace=True), bearings_sequential.METHOD.options(**PUBLISHED)
    )
    trace = solution.trace
    assert trace is not None
    whole = np.flatnonzero(np.bincount(trace.row, minlength=200) == 7)
    order = np.stack([trace.measurement[trace.row == b] for b in whole])
    first = np.array([(set(range(8)) - set(rows)).pop() for rows in order])
    order = np.concatenate([first[:, None], order], axis=1)
    part = dataclasses.replace(batch, seed=batch.seed[whole])
    names = ("sensor", "sensor_xy_m", "bearing_rad", "bearing_std_rad", "path", "reflector")
    part = dataclasses.replace(part, **{name: np.asfortranarray(getattr(batch, name)[whole]) for name in names})
    chain, one = _passed_on(part, order, **PUBLISHED), solution.estimates
    both = (chain.status == 0) & (one.status[whole] == 0)
    assert both.sum() > 150
    np.testing.assert_allclose(chain.position_m[both], one.position_m[whole][both], rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(chain.covariance_m2[both], one.covariance_m2[whole][both], rtol=1e-6)


def test_a_chain_needs_the_whole_covariance() -> None:
    """A chain has the median error of one run within 5 %; with a standard deviation in its place far more."""
    batch, source = draw(1500, 8, (1.0, 4.0), seed=4)
    order = np.tile(np.arange(8), (1500, 1))

    def median(estimates: Estimates) -> float:
        return float(np.nanmedian(np.hypot(*(estimates.position_m - source).T)))

    one = median(estimate(batch))
    assert median(_passed_on(batch, order)) < 1.05 * one
    assert median(_passed_on(batch, order, full=False)) > 1.2 * one


def test_a_prior_with_a_covariance_adds_its_information() -> None:
    """One precise bearing and a prior: position and covariance of the linear solution; the file's prior goes first."""
    prior, covariance = np.array([300.0, 400.0]), np.array([[400.0, 150.0], [150.0, 100.0]])
    std = 1e-5
    bearing = np.arctan2(prior[1] + 0.01, prior[0])
    batch = bearing_batch([[(0.0, 0.0)]], [[bearing]], std, want_flags=False)
    names = ("prior_x_m", "prior_y_m", "prior_cov_xx_m2", "prior_cov_xy_m2", "prior_cov_yy_m2")
    values = (*prior, *covariance[[0, 0, 1], [0, 1, 1]])
    slope = np.array([-prior[1], prior[0]]) / (prior @ prior)
    information = np.linalg.inv(covariance) + np.outer(slope, slope) / std**2
    left = bearing - np.arctan2(prior[1], prior[0])
    expected = prior + np.linalg.solve(information, slope * left / std**2)
    own = dataclasses.replace(batch, prior_xy_m=prior[None, None], prior_cov_m2=np.array(values[2:])[None, None])
    for found in (
        estimate(batch, **dict(zip(names, values, strict=True))),
        estimate(own),
        estimate(own, prior_x_m=9.0, prior_y_m=9.0, prior_std_m=1.0),
    ):
        assert words(found) == ["ok"]
        np.testing.assert_allclose(found.position_m[0], expected, atol=1e-4)
        np.testing.assert_allclose(found.covariance_m2[0], np.linalg.inv(information)[[0, 0, 1], [0, 1, 1]], rtol=1e-3)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"prior_cov_xx_m2": 4.0}, "a prior needs all of prior_x_m, prior_y_m, prior_cov_xx_m2, prior_cov_xy_m2 and"),
        (
            dict.fromkeys(("prior_std_m", "prior_cov_xx_m2", "prior_cov_xy_m2", "prior_cov_yy_m2"), 4.0),
            r"prior_cov_yy_m2, without prior_std_m$",
        ),
        ({"prior_cov_xx_m2": 4.0, "prior_cov_xy_m2": 6.0, "prior_cov_yy_m2": 9.0}, "its square must be below"),
    ],
)
def test_half_a_covariance_is_a_usage_error(given: dict[str, float], message: str) -> None:
    """An incomplete, doubled or singular prior is refused."""
    batch = bearing_batch([[(0.0, 0.0)]], [[0.5]])
    with pytest.raises(UsageError, match=message):
        estimate(batch, prior_x_m=1.0, prior_y_m=2.0, **given)


def test_an_uncertain_prior_is_not_a_degenerate_fix() -> None:
    """A prior of 1 km and one bearing of a sensor 100 m away are a fix; without a prior that much is degenerate."""
    batch = bearing_batch([[(0.0, 0.0)]], [[0.0]])
    found = estimate(batch, prior_x_m=100.0, prior_y_m=0.0, prior_std_m=1000.0)
    assert words(found) == ["ok"]
    assert found.covariance_m2[0, 0] == pytest.approx(1e6, rel=1e-6)
    nearly_parallel = bearing_batch([[(0.0, 0.0), (0.0, 10.0)]], [[0.01, 0.0]], std_rad=0.02)
    assert words(estimate(nearly_parallel)) == ["degenerate"]


def test_statuses_are_those_of_the_other_methods() -> None:
    """Behind a mirror is infeasible; bearings of the opposite sense are behind, however badly a fix in front fits."""
    wall = Scene(reflectors=(LineReflector(name="wall", point=(3.0, 0.0), direction=(0.0, 1.0)),))
    sensors = [(0.0, 0.0), (1.0, -5.0), (1.0, 5.0)]
    bearing = [[np.arctan2(1.0, 1.0), np.arctan2(6.0, 4.0), np.arctan2(-4.0, 4.0)]]
    found = estimate(bearing_batch([sensors], bearing, reflector=[[0, -1, -1]], scene=wall))
    assert words(found) == ["infeasible"]
    np.testing.assert_allclose(found.position_m, [(5.0, 1.0)], atol=1e-9)
    batch, _ = draw(1000, 5, (5.0, 5.0))
    turned = dataclasses.replace(batch, bearing_rad=(batch.bearing_rad + 2.0 * np.pi) % (2.0 * np.pi) - np.pi)
    assert np.mean(np.array(words(estimate(turned))) == "behind") > 0.99
    two = bearing_batch([[(0.0, 0.0), (0.0, 1000.0)]], [[-2.641593, 2.641593]], std_rad=0.01)
    assert words(estimate(two)) == ["behind"]


def test_no_fix_is_under_ground() -> None:
    """Bearings of 3 deg by a circle about an opaque one: what is under ground or hidden is infeasible, never ok."""
    found = nlosctl.localize(
        nlosctl.simulate("song-circle", trials=300, seed=1, bearing_std_deg=3.0), method="sequential"
    ).estimates
    status = np.array(found["status"].to_pylist())
    height_m = np.hypot(*(found[name].to_numpy() for name in ("x_m", "y_m"))) - 6_371_000.0
    assert (height_m[status == "ok"] > 0.0).all()
    assert (height_m[status == "infeasible"] < 0.0).any()
    assert (status == "ok").mean() > 0.8
