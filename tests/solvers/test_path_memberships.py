"""Densities of direct and indirect paths against scipy, integrals and finite differences."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats
from triplet_rooms import ANGLE_STD_RAD, LENGTH_STD_M, draw_room

from nlosctl.models.triplets import predict_triplets
from nlosctl.solvers.triplets.likelihood import TripletProblem
from nlosctl.solvers.triplets.path_memberships import TargetModel, path_density

MODEL = TargetModel(prior_indirect=0.4, clutter=0.01, targets=1)
STDS = np.array([ANGLE_STD_RAD, ANGLE_STD_RAD, LENGTH_STD_M])


def problem_of(batch, radius_m=0.0):
    """Return the problem about the origin."""
    zero = np.zeros(batch.size)
    return TripletProblem.of_snapshots(batch, (zero, zero), radius_m)


def density_at(batch, k, point, radius_m=0.0):
    """Return the density of path k at points (B, 2)."""
    scale = np.full(batch.size, 8.0)
    return path_density(problem_of(batch, radius_m), k, (point[:, 0], point[:, 1]), MODEL, scale)


@pytest.mark.parametrize("radius_m", [0.0, 0.4])
def test_a_direct_path_is_normal_about_the_prediction(radius_m):
    """Its covariance is that of the errors plus r^2 / 2 times J J^T, the Jacobian by finite differences."""
    batch, _, target = draw_room(np.random.default_rng(1), 5)
    density = density_at(batch, 0, target[:, 0], radius_m)
    step = 1e-6
    for row in range(5):
        tx, rx, at = batch.tx_xy_m[row, 0], batch.rx_xy_m[row, 0], target[row, 0]
        predicted = np.array(predict_triplets(tx, rx, at))
        jacobian = np.stack(
            [
                (np.array(predict_triplets(tx, rx, at + move)) - predict_triplets(tx, rx, at - move)) / (2.0 * step)
                for move in step * np.eye(2)
            ],
            axis=1,
        )
        covariance = np.diag(STDS**2) + 0.5 * radius_m**2 * jacobian @ jacobian.T
        measured = np.array([batch.dod_rad[row, 0], batch.doa_rad[row, 0], batch.path_length_m[row, 0]])
        residual = measured - predicted
        residual[:2] = (residual[:2] + np.pi) % (2.0 * np.pi) - np.pi
        expected = stats.multivariate_normal(cov=covariance).logpdf(residual) + np.log(0.6)
        assert density.log_direct[row] == pytest.approx(expected, rel=1e-6)
        inverse = np.linalg.inv(covariance)
        assert density.chi_square[row] == pytest.approx(residual @ inverse @ residual, rel=1e-6)
        information = jacobian.T @ inverse @ jacobian
        ours = [part[row] for part in density.information]
        np.testing.assert_allclose(ours, [information[0, 0], information[0, 1], information[1, 1]], rtol=1e-5)


def test_the_density_of_indirect_paths_integrates_to_one():
    """Over both angles and lengths it is the prior share: 0.4 (less the clutter beyond four times the scale)."""
    batch, _, target = draw_room(np.random.default_rng(2), 1)
    point = target[:, 0]
    dod, doa, length = predict_triplets(batch.tx_xy_m[0, 0], batch.rx_xy_m[0, 0], point[0])
    generator = np.random.default_rng(3)
    count = 100_000
    # Half of the angles near the target's direction, so that both parts of the density are sampled.
    near = generator.random((2, count)) < 0.5
    wide = 5.0 * ANGLE_STD_RAD
    angles = np.where(near, generator.uniform(-wide, wide, near.shape), generator.uniform(-np.pi, np.pi, near.shape))
    weight = 1.0 / (0.5 / (2.0 * np.pi) + 0.5 * (np.abs(angles) < wide) / (2.0 * wide))
    lengths = generator.uniform(0.0, 32.0, count)
    rows = np.zeros(count, dtype=np.int64)
    problem = problem_of(batch).take(rows)
    for node, values in ((problem.tx, dod + angles[0]), (problem.rx, doa + angles[1])):
        node.cosine[:, 0], node.sine[:, 0] = np.cos(values), np.sin(values)
    problem.path_length_m[:, 0] = lengths
    density = path_density(problem, 0, (point[rows, 0], point[rows, 1]), MODEL, np.full(count, 8.0))
    values = np.exp(density.log_indirect) * weight[0] * weight[1] * 32.0
    # The exponential law reaches beyond 32 m with a small share.
    beyond = 0.99 * np.exp(-(32.0 - length) / 4.0)
    assert values.mean() == pytest.approx(0.4 * (1.0 - beyond), abs=4.0 * values.std() / np.sqrt(count))


def test_the_pull_is_the_gradient_of_the_log_density():
    """Finite differences agree except for the law of the excess: at most 1 / (half the scale) per metre."""
    batch, _, target = draw_room(np.random.default_rng(4), 40)
    at = target[:, 0] + [0.02, -0.01]
    step = 1e-5

    def log_total(point, k):
        density = density_at(batch, k, point)
        return np.logaddexp(density.log_direct, density.log_indirect)

    for k in range(4):
        density, total = density_at(batch, k, at), log_total(at, k)
        excess = batch.path_length_m[:, k] - predict_triplets(batch.tx_xy_m[:, k], batch.rx_xy_m[:, k], at)[2]
        clear = (np.exp(density.log_direct - total) > 0.999) | (excess > 1.0)
        assert clear.sum() > 20
        for ours, move in zip(density.pull(total)[0], step * np.eye(2), strict=True):
            theirs = (log_total(at - move, k) - log_total(at + move, k)) / (2.0 * step)
            np.testing.assert_allclose(ours[clear], theirs[clear], atol=0.55, rtol=1e-4)


def test_missing_information_is_the_variance_of_the_gradient_over_memberships():
    """A path certain to be direct lacks none; one that is as likely direct as towards lacks a positive amount."""
    batch, _, target = draw_room(np.random.default_rng(5), 200)
    at = target[:, 0] + [0.1, 0.08]
    for k in range(4):
        density = density_at(batch, k, at)
        total = np.logaddexp(density.log_direct, density.log_indirect)
        parts = [(density.log_direct, density.gradient[0])]
        towards = [(part, direction.angles[0]) for part, direction in density.towards]
        parts += [(part, azimuth.value * azimuth.slope[0]) for part, azimuth in towards]
        shares = np.array([np.exp(log_part - total) for log_part, _ in parts])
        slopes = np.array([slope for _, slope in parts])
        shares, slopes = np.vstack([shares, 1.0 - shares.sum(axis=0)]), np.vstack([slopes, np.zeros(200)])
        mean = (shares * slopes).sum(axis=0)
        expected = (shares * (slopes - mean) ** 2).sum(axis=0)
        ours = density.missing_information(total).xx
        np.testing.assert_allclose(ours, expected, rtol=1e-6, atol=1e-9 * np.abs(slopes).max() ** 2)
