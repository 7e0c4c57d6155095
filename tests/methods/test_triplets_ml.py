"""Maximum likelihood on triplets: estimates, covariances, statuses."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scenario_draws import draw_columns
from triplet_worlds import batch_of, one_path

from nlosctl.contract.batches import TripletBatch
from nlosctl.contract.statuses import Status
from nlosctl.evaluation.consistency import squared_mahalanobis
from nlosctl.methods import triplets_ml


def solve(batch, **options):
    """Return the solution."""
    return triplets_ml.solve(batch, triplets_ml.MaximumLikelihoodOptions(**options))


def test_covariance_is_calibrated():
    """Over direct paths with little noise the NEES has mean 2."""
    columns = draw_columns("shen", 3000, seed=1, indirect_fraction=0.0, power_dbm=20.0, region_m=(-8.0, 8.0, 2.0, 10.0))
    estimates = solve(batch_of(columns)).estimates
    error = estimates.position_m - np.stack([columns["truth_x_m"], columns["truth_y_m"]], axis=1)
    nees = squared_mahalanobis(error, estimates.covariance_m2)
    assert np.isfinite(nees).mean() > 0.999
    assert np.nanmean(nees) == pytest.approx(2.0, abs=0.15)


@pytest.mark.parametrize(("deg", "length_std"), [(1.0, 0.1), (5.0, 0.1), (10.0, 0.1), (10.0, 1.0)])
def test_single_path_covariance_follows_the_curved_likelihood(deg, length_std):
    """The covariance of a path is the second moment about the estimate of a dense integration over the plane.

    The 95 % ellipses hold .905 or more of the truths (3 sigma of 2000); with the Fisher information .47 at 10 deg.
    """
    batch, truth = _paths(2000, deg, length_std)
    estimates = solve(batch).estimates
    joint = solve(batch, joint=True).estimates
    np.testing.assert_allclose(joint.covariance_m2, estimates.covariance_m2, rtol=1e-9)
    ok = estimates.status == Status.OK
    nees = squared_mahalanobis(estimates.position_m - truth, estimates.covariance_m2)[ok]
    assert ok.mean() > 0.95
    assert (nees < 5.991).mean() > 0.905 - 3.0 * np.sqrt(0.095 * 0.905 / 2000)
    assert (nees > 100.0).mean() <= 0.005
    ratios = [_brute_trace(batch, estimates, i) / estimates.covariance_m2[i, [0, 2]].sum() for i in range(4) if ok[i]]
    assert np.median(np.abs(np.log(ratios))) < 0.05
    assert np.max(np.abs(np.log(ratios))) < 0.25


def _paths(count, deg, length_std):
    """Return snapshots of one direct path each in a square of 100 m, and their targets."""
    from nlosctl.models.triplets import predict_triplets

    generator = np.random.default_rng(11)
    tx, rx, target = generator.uniform(-50.0, 50.0, (3, count, 2))
    stds = (np.radians(deg), np.radians(deg), length_std)
    exact = predict_triplets(tx, rx, target)
    measured = [part + std * generator.normal(size=count) for part, std in zip(exact, stds, strict=True)]
    names = ("dod_rad", "doa_rad", "path_length_m")
    arrays = {name: np.asfortranarray(part[:, None]) for name, part in zip(names, measured, strict=True)}
    arrays |= {
        name.replace("_rad", "_std_rad").replace("_m", "_std_m"): np.full((count, 1), std, order="F")
        for name, std in zip(names, stds, strict=True)
    }
    batch = TripletBatch(
        seed=np.zeros(count, dtype=np.uint64), tx_xy_m=tx[:, None, :], rx_xy_m=rx[:, None, :], **arrays
    )
    return batch, target


def _brute_trace(batch, estimates, i):
    """Return the trace of the posterior's second moment about an estimate, from 200,000 random points near it."""
    from nlosctl.models.triplets import predict_triplets

    generator = np.random.default_rng(i)
    spread = 7.0 * np.sqrt(estimates.covariance_m2[i, [0, 2]].max())
    offset = generator.uniform(-spread, spread, (200_000, 2))
    dod, doa, length = predict_triplets(batch.tx_xy_m[i], batch.rx_xy_m[i], estimates.position_m[i] + offset)
    chi_square = (np.angle(np.exp(1j * (dod - batch.dod_rad[i]))) / batch.dod_std_rad[i]) ** 2
    chi_square += (np.angle(np.exp(1j * (doa - batch.doa_rad[i]))) / batch.doa_std_rad[i]) ** 2
    chi_square += ((length - batch.path_length_m[i]) / batch.path_length_std_m[i]) ** 2
    weight = np.exp(-0.5 * (chi_square - chi_square.min()))
    return (weight * (offset**2).sum(axis=1)).sum() / weight.sum()


def test_single_path_estimates_name_their_path():
    """Every path has an estimate and target of its own, and its index in the snapshot."""
    columns = draw_columns("room", 5, seed=2, receivers=2, paths=3, blocked_fraction=0.0)
    estimates = solve(_block(columns, 5, 6)).estimates
    assert estimates.row.tolist() == np.repeat(np.arange(5), 6).tolist()
    assert estimates.measurement.tolist() == estimates.target.tolist() == np.tile(np.arange(6), 5).tolist()
    assert (estimates.n_used <= 1).all()


def test_joint_estimate_uses_all_paths():
    """With joint=true direct paths of several pairs give one estimate, better than any single one."""
    columns = draw_columns("room", 100, seed=3, receivers=4, paths=1, blocked_fraction=0.0)
    batch = _block(columns, 100, 4)
    joint, single = solve(batch, joint=True).estimates, solve(batch).estimates
    truth = np.stack([columns["truth_x_m"], columns["truth_y_m"]], axis=1)[::4]
    assert (joint.n_used == 4).all()
    joint_error = np.hypot(*(joint.position_m - truth).T)
    single_error = np.hypot(*(single.position_m - truth[single.row]).T)
    assert np.median(joint_error) < 0.7 * np.nanmedian(single_error)
    nees = squared_mahalanobis(joint.position_m - truth, joint.covariance_m2)
    assert nees.mean() == pytest.approx(2.0, abs=0.7)


@pytest.mark.parametrize("joint", [False, True])
def test_the_origin_does_not_matter(joint):
    """Snapshots a hundred kilometres away have the same fixes, to a micrometre, and the same statuses."""
    columns = draw_columns("room", 40, seed=5, receivers=3, paths=1, blocked_fraction=0.0)
    moved = dict(columns)
    for name in ("tx_x_m", "rx_x_m"):
        moved[name] = columns[name] + 1e5
    for name in ("tx_y_m", "rx_y_m"):
        moved[name] = columns[name] - 2e5
    here, there = (solve(_block(world, 40, 3), joint=joint).estimates for world in (columns, moved))
    np.testing.assert_array_equal(here.status, there.status)
    assert np.isfinite(here.position_m).all(axis=1).mean() > 0.9
    np.testing.assert_allclose(there.position_m - [1e5, -2e5], here.position_m, atol=1e-6)


def test_residuals_are_measured_minus_predicted():
    """Residuals are those of the estimate in the coordinates of the file."""
    columns = draw_columns("room", 20, seed=4, receivers=3, paths=1, blocked_fraction=0.0)
    solution = solve(_block(columns, 20, 3), joint=True)
    from nlosctl.models.triplets import predict_triplets

    tx = np.stack([columns["tx_x_m"], columns["tx_y_m"]], axis=1)
    rx = np.stack([columns["rx_x_m"], columns["rx_y_m"]], axis=1)
    dod, doa, length = predict_triplets(tx, rx, solution.estimates.position_m[np.repeat(np.arange(20), 3)])
    flags = solution.flags.columns
    turn = np.angle(np.exp(1j * (columns["dod_rad"] - dod)))
    np.testing.assert_allclose(flags["residual_dod_rad"].ravel(), turn, atol=1e-9)
    np.testing.assert_allclose(
        flags["residual_doa_rad"].ravel(), np.angle(np.exp(1j * (columns["doa_rad"] - doa))), atol=1e-9
    )
    np.testing.assert_allclose(flags["residual_m"].ravel(), columns["path_length_m"] - length, atol=1e-9)


@pytest.mark.parametrize(
    ("path", "status"),
    [
        ({"dod": 0.0, "doa": np.pi, "length": 5.0}, Status.DEGENERATE),
        ({"dod": 0.7, "doa": 1.6, "length": 9.0}, Status.OK),
    ],
)
def test_statuses(path, status):
    """A target on the baseline has no covariance: degenerate; others are ok."""
    estimates = solve(one_path(**path)).estimates
    assert estimates.status[0] == status
    assert np.isnan(estimates.position_m).all() == (status == Status.DEGENERATE)


def test_the_joint_cost_is_half_the_chi_square_of_the_residuals():
    """The cost is half the sum of squared scaled residuals; no flags are returned unless requested."""
    batch = _block(draw_columns("room", 20, seed=5, receivers=3, paths=1, blocked_fraction=0.0), 20, 3)
    solution = solve(batch, joint=True)
    flags = solution.flags.columns
    parts = (
        flags["residual_dod_rad"] / batch.dod_std_rad,
        flags["residual_doa_rad"] / batch.doa_std_rad,
        flags["residual_m"] / batch.path_length_std_m,
    )
    expected = 0.5 * sum((part**2).sum(axis=1) for part in parts)
    assert np.isfinite(expected).sum() > 15
    np.testing.assert_allclose(solution.estimates.cost, expected, rtol=1e-9)
    for joint in (False, True):
        assert solve(dataclasses.replace(batch, want_flags=False), joint=joint).flags is None


@pytest.mark.parametrize("joint", [False, True])
def test_too_few_iterations_are_not_converged(joint):
    """With ``max_iterations=1`` noisy paths are not_converged."""
    batch = _block(draw_columns("room", 20, seed=5, receivers=3, paths=1, blocked_fraction=0.0), 20, 3)
    assert (solve(batch, joint=joint, max_iterations=1).estimates.status == Status.NOT_CONVERGED).mean() > 0.5


def _block(columns, snapshots, paths):
    arrays = {}
    for name, parts in TripletBatch.SOURCES.items():
        values = [np.asfortranarray(columns[part].reshape(snapshots, paths)) for part in parts]
        arrays[name] = values[0] if len(values) == 1 else np.asfortranarray(np.stack(values, axis=-1))
    return TripletBatch(seed=np.zeros(snapshots, dtype=np.uint64), **arrays)
