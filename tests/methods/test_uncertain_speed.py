"""An uncertain speed of the wave: the direct solution with one more unknown, and covariances that include its error."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from arrival_batches import arrival_batch, pair_batch
from scipy.optimize import least_squares

from nlosctl.contract.batches import ArrivalBatch
from nlosctl.contract.results import Solution
from nlosctl.contract.statuses import Status
from nlosctl.errors import UsageError
from nlosctl.methods import arrivals_ml
from nlosctl.models.arrivals import arrival_rows
from nlosctl.models.uncertain_speed import UncertainSpeed

Array = np.ndarray
_PARTS = np.array([[0, 1, 3], [1, 2, 4], [3, 4, 5]])


def solve(batch: ArrivalBatch) -> Solution:
    """Return the solution of ml with its default options."""
    return arrivals_ml.METHOD.solve(batch, arrivals_ml.METHOD.options())


def worlds(dimension: int, runs: int, share: float, seed: int) -> tuple[Array, Array, Array, Array]:
    """Return 8 sensors, sources (B, D), scale errors (B,) and the distances (B, 8) times the nominal over the speed."""
    generator = np.random.default_rng(seed)
    angle = np.pi / 4.0 * np.arange(8)
    sensors = 100.0 * np.column_stack([np.cos(angle), np.sin(angle), 0.7 * (np.arange(8) % 2)])[:, :dimension]
    sources = generator.uniform(-60.0, 60.0, (runs, dimension))
    if dimension == 3:
        sources[:, 2] = generator.uniform(0.0, 60.0, runs)
    error = share * generator.normal(size=runs)
    away = np.linalg.norm(sources[:, None] - sensors, axis=2)
    return sensors, sources, error, away / (1.0 + error[:, None])


def test_whitening_is_the_root_of_the_inverse_covariance() -> None:
    """L L = (I + g^2 u u')^-1, also for g = 0, and the likeliest error minimizes its two squares."""
    generator = np.random.default_rng(1)
    std, effect, residual = np.array([0.0, 0.01, 0.2]), 30.0 * generator.normal(size=(3, 5)), generator.normal(size=5)
    speed = UncertainSpeed.of(std, effect)
    root = np.stack([speed.whitened(np.tile(row, (3, 1))) for row in np.eye(5)], axis=1)
    covariance = np.eye(5) + std[:, None, None] ** 2 * effect[:, :, None] * effect[:, None, :]
    np.testing.assert_allclose(root @ root @ covariance, np.tile(np.eye(5), (3, 1, 1)), atol=1e-9)
    values = np.tile(residual, (3, 1))
    error = speed.error(values)
    assert error[0] == 0.0
    cost = np.einsum("i,bij,j->b", residual, np.linalg.inv(covariance), residual)
    corrected = speed.corrected(values)
    np.testing.assert_allclose((corrected**2).sum(axis=1) + speed.scaled_error(corrected) ** 2, cost)
    np.testing.assert_allclose(error[1:] / std[1:], speed.scaled_error(corrected)[1:])
    np.testing.assert_allclose(-speed.eliminated(speed.whitened(values)), error, atol=1e-15)


@pytest.mark.parametrize("pairs", [False, True], ids=["arrivals", "pairs"])
@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("share", [0.003, 0.02])
def test_ml_is_the_direct_solution_with_the_speed_as_unknown(dimension: int, share: float, pairs: bool) -> None:
    """Position, cost and covariance are those of scipy with the scale error as one more unknown with a prior."""
    generator = np.random.default_rng(2)
    sensors, sources, _, away = worlds(dimension, 10, share, 3)
    std = generator.uniform(0.1, 0.4, 8)
    own, other = np.arange(8), np.roll(np.arange(8), 3)
    exact = away[:, own] - away[:, other] if pairs else away + 3.0
    measured = exact + std * generator.normal(size=exact.shape)
    speed = {"speed_std": np.full(10, share)}
    if pairs:
        estimates = solve(pair_batch(sensors[own], sensors[other], measured, std, **speed)).estimates
    else:
        estimates = solve(arrival_batch(sensors, measured, std, **speed)).estimates
    assert (estimates.status == Status.OK).all()
    for k in range(10):

        def residuals(at: Array, t: Array = measured[k]) -> Array:
            ranges = np.linalg.norm(at[:dimension] - sensors, axis=1)
            predicted = ranges[own] - ranges[other] if pairs else ranges + at[dimension + 1]
            return np.append(((1.0 + at[dimension]) * t - predicted) / std, at[dimension] / share)

        start = np.concatenate([sources[k], [0.0], [] if pairs else [3.0]])
        found = least_squares(residuals, start, x_scale="jac", xtol=1e-15, ftol=1e-15, gtol=1e-15)
        covariance = np.linalg.inv(found.jac.T @ found.jac)
        spread = np.sqrt(np.trace(covariance[:dimension, :dimension]))
        assert np.linalg.norm(estimates.position_m[k] - found.x[:dimension]) < 1e-3 * spread
        assert estimates.cost[k] == pytest.approx(found.cost, rel=1e-6)
        mine = estimates.covariance_m2[k][_PARTS[:dimension, :dimension]]
        np.testing.assert_allclose(mine, covariance[:dimension, :dimension], rtol=1e-4, atol=1e-4 * spread**2)
        if not pairs:
            offset = found.x[dimension + 1] / (1.0 + found.x[dimension])
            turn = np.zeros(dimension + 2)
            turn[dimension:] = -offset / (1.0 + found.x[dimension]), 1.0 / (1.0 + found.x[dimension])
            deviation = np.sqrt(turn @ covariance @ turn)
            assert estimates.columns["offset_m"][k] == pytest.approx(offset, abs=1e-3 * deviation)
            assert estimates.columns["offset_std_m"][k] == pytest.approx(deviation, rel=0.05)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("share", [0.003, 0.02])
def test_errors_are_as_large_as_stated(dimension: int, share: float) -> None:
    """600 runs with the speed drawn: NEES of the position alone and with the offset, 95 % region, chi-square.

    The errors are smaller than with the speed taken as exact.
    """
    generator = np.random.default_rng(5)
    sensors, sources, _, away = worlds(dimension, 600, share, 6)
    std = 0.1 * generator.uniform(0.5, 2.0, 8)
    offset = generator.uniform(-1e3, 1e3, 600)
    arrivals = away + offset[:, None] + std * generator.normal(size=away.shape)
    estimates = solve(arrival_batch(sensors, arrivals, std, speed_std=np.full(600, share))).estimates
    ok = (estimates.alternative == 0) & (estimates.status == Status.OK)
    row = estimates.row[ok]
    assert row.size > 590
    error = estimates.position_m[ok] - sources[row]
    columns = {key: values[ok] for key, values in estimates.columns.items()}
    whole = np.empty((row.size, dimension + 1, dimension + 1))
    whole[:, :dimension, :dimension] = estimates.covariance_m2[ok][:, _PARTS[:dimension, :dimension]]
    cross = np.stack([columns[f"cov_{axis}_offset_m2"] for axis in "xyz"[:dimension]], axis=1)
    whole[:, :dimension, dimension] = whole[:, dimension, :dimension] = cross
    whole[:, dimension, dimension] = columns["offset_std_m"] ** 2
    both = np.column_stack([error, columns["offset_m"] - offset[row]])
    nees = np.einsum("bi,bij,bj->b", error, np.linalg.inv(whole[:, :dimension, :dimension]), error)
    joint = np.einsum("bi,bij,bj->b", both, np.linalg.inv(whole), both)
    assert abs(nees.mean() - dimension) < 3.3 * np.sqrt(2.0 * dimension / 600.0)
    assert abs(joint.mean() - dimension - 1) < 3.3 * np.sqrt(2.0 * (dimension + 1) / 600.0)
    assert 0.82 < (both[:, -1] ** 2 / whole[:, dimension, dimension]).mean() < 1.20
    assert 0.93 < (nees < {2: 5.991, 3: 7.815}[dimension]).mean() < 0.975
    chi_square = 2.0 * estimates.cost[ok]
    spare = 7 - dimension
    assert abs(chi_square.mean() - spare) < 3.3 * np.sqrt(2.0 * spare / 600.0)
    plain = solve(arrival_batch(sensors, arrivals, std)).estimates
    best = plain.alternative == 0
    worse = plain.position_m[best] - sources[plain.row[best]]
    assert (error**2).sum() < (worse**2).sum()


@pytest.mark.parametrize("dimension", [2, 3])
def test_pairs_have_the_same_scale_error(dimension: int) -> None:
    """600 runs of 12 differences with the speed drawn, 1 % std: NEES and the 95 % region."""
    generator = np.random.default_rng(7)
    sensors, sources, _, away = worlds(dimension, 600, 0.01, 8)
    own, other = np.stack(np.triu_indices(8, 1))[:, generator.permutation(28)[:12]]
    std = 0.1 * generator.uniform(0.5, 2.0, 12)
    measured = away[:, own] - away[:, other] + std * generator.normal(size=(600, 12))
    batch = pair_batch(sensors[own], sensors[other], measured, std, speed_std=np.full(600, 0.01))
    estimates = solve(batch).estimates
    ok = (estimates.alternative == 0) & (estimates.status == Status.OK)
    assert ok.sum() > 590
    error = estimates.position_m[ok] - sources[estimates.row[ok]]
    covariance = estimates.covariance_m2[ok][:, _PARTS[:dimension, :dimension]]
    nees = np.einsum("bi,bij,bj->b", error, np.linalg.inv(covariance), error)
    assert abs(nees.mean() - dimension) < 3.3 * np.sqrt(2.0 * dimension / 600.0)
    assert 0.93 < (nees < {2: 5.991, 3: 7.815}[dimension]).mean() < 0.975


def test_an_exact_speed_changes_nothing() -> None:
    """A std of 0 gives the estimates of a known speed."""
    sensors, _, _, away = worlds(2, 5, 0.0, 6)
    known = solve(arrival_batch(sensors, away, 0.1)).estimates
    same = solve(arrival_batch(sensors, away, 0.1, speed_std=np.zeros(5))).estimates
    np.testing.assert_allclose(same.position_m, known.position_m, atol=1e-9)
    np.testing.assert_allclose(same.covariance_m2, known.covariance_m2, rtol=1e-9)


def test_a_long_difference_may_be_of_a_fast_wave() -> None:
    """A difference 3 % longer than the distance of its sensors contradicts a known speed, not one of 2 % std."""
    sensors, point = np.array([(0.0, 0.0), (100.0, 0.0), (50.0, 80.0), (20.0, -60.0)]), np.array([-30.0, 1.0])
    arrivals = 1.03 * np.linalg.norm(sensors - point, axis=1)[None]
    assert arrival_rows(arrival_batch(sensors, arrivals, 0.01)).far_apart().all()
    assert not arrival_rows(arrival_batch(sensors, arrivals, 0.01, speed_std=np.full(1, 0.02))).far_apart().any()


def test_unknown_stds_cannot_be_estimated_beside_it() -> None:
    """A single factor would scale the stated std of the speed, too."""
    sensors, _, _, away = worlds(2, 5, 0.0, 6)
    more: dict[str, Any] = {"std": "unknown", "speed_std": np.full(5, 0.01)}
    with pytest.raises(UsageError, match="`speed_std_m_s` needs stated standard deviations of the arrivals"):
        solve(arrival_batch(sensors, away, 1.0, **more))
