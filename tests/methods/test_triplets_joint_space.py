"""``joint`` in space: false alarms, detections, targets and their covariances, and what stands behind walls."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy import integrate
from space_triplets import SCALARS, SIDES_M, draw_joint_room, predict, space_batch, without

import nlosctl.methods.triplets_joint as joint
from nlosctl.contract.scene import LineReflector, PlaneReflector, Scene
from nlosctl.contract.statuses import Status
from nlosctl.solvers.triplets.likelihood import TripletProblem
from nlosctl.solvers.triplets.path_memberships import TargetModel, path_density

WALLS = Scene(
    reflectors=(
        PlaneReflector(name="floor", point=(0.0, 0.0, 0.0), normal=(0.0, 0.0, 1.0)),
        PlaneReflector(name="ceiling", point=(0.0, 0.0, SIDES_M[2]), normal=(0.0, 0.0, 2.0)),
        LineReflector(name="south", point=(0.0, 0.0), direction=(1.0, 0.0)),
        LineReflector(name="north", point=(0.0, SIDES_M[1]), direction=(1.0, 0.0)),
        LineReflector(name="west", point=(0.0, 0.0), direction=(0.0, 1.0)),
        LineReflector(name="east", point=(SIDES_M[0], 0.0), direction=(0.0, 1.0)),
    )
)


@pytest.fixture(scope="module")
def solved():
    """Return batch, truth and solution of 300 snapshots of three receivers with four paths each."""
    batch, indirect, target = draw_joint_room(np.random.default_rng(1), 300)
    return batch, indirect, target, joint.solve(batch, joint.JointOptions())


@pytest.mark.parametrize("false_alarm", [0.01, 0.05, 0.1])
def test_false_alarms_of_direct_paths_are_at_their_level(solved, false_alarm):
    """900 direct paths are flagged at the nominal rate, to four standard errors and a fifth."""
    _, indirect, _, solution = solved
    rate = (solution.flags.columns["p_value"][~indirect] < false_alarm).mean()
    assert abs(rate - false_alarm) < 4.0 * np.sqrt(false_alarm / 900) + 0.2 * false_alarm


def test_indirect_paths_are_flagged_and_targets_have_true_covariances(solved):
    """.96 of the paths over walls and floor are flagged; the 95 % ellipsoid holds .92 to .985 of the targets."""
    _, indirect, target, solution = solved
    assert solution.flags.columns["ip"][indirect].mean() > 0.96
    estimates = solution.estimates
    ok = estimates.status == Status.OK
    assert ok.mean() > 0.85
    matrix = np.empty((ok.sum(), 3, 3))
    for k, (i, j) in enumerate(((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))):
        matrix[:, i, j] = matrix[:, j, i] = estimates.covariance_m2[ok, k]
    error = estimates.position_m[ok] - target[estimates.row[ok]]
    inside = np.einsum("ni,nij,nj->n", error, np.linalg.inv(matrix), error) < 7.815
    assert 0.92 < inside.mean() < 0.985


def test_without_any_elevation_membership_alone_flags(solved):
    """Paths without elevations have no p-value; they are flagged if hardly likely to be direct."""
    batch, _, _, _ = solved
    flags = joint.solve(without(batch, "dod", "doa"), joint.JointOptions()).flags.columns
    assert np.isnan(flags["p_value"]).all()
    np.testing.assert_array_equal(flags["ip"], flags["direct_probability"] < 0.05)
    assert 0.05 < flags["ip"].mean() < 0.9


def test_targets_behind_walls_are_ambiguous():
    """If all direct paths are blocked, images behind a wall of the scene are not ok."""
    batch, _, _ = draw_joint_room(np.random.default_rng(2), 200, blocked=1.0)
    alone = joint.solve(batch, joint.JointOptions()).estimates.status
    walls = joint.solve(dataclasses.replace(batch, scene=WALLS), joint.JointOptions()).estimates.status
    assert (walls == Status.OK).sum() <= 0.5 * (alone == Status.OK).sum()
    assert (walls == Status.OK).mean() < 0.04


def test_densities_of_directions_integrate_to_one():
    """The direct density integrates to its prior over the DOD, the other scalars at their predictions."""
    tx, rx, target = np.zeros((1, 1, 3)), np.full((1, 1, 3), [6.0, 0.0, 1.0]), np.array([2.0, 3.0, 0.5])
    exact = predict(tx, rx, target)
    stds = (0.05, 0.05, 0.1, 0.04, 0.04)
    model = TargetModel(prior_indirect=0.4, clutter=0.01, targets=1)
    point = tuple(np.array([part]) for part in target)

    def density(rise, turn):
        values = exact.copy()
        values[0] += turn
        values[3] += rise
        problem = TripletProblem.of_snapshots(space_batch(tx, rx, values, stds), (np.zeros(1),) * 3)
        return float(np.exp(path_density(problem, 0, point, model, np.array([8.0])).log_direct[0]))

    whole = integrate.dblquad(density, -0.3, 0.3, -0.25, 0.25, epsabs=1e-2, epsrel=1e-5)[0]
    others = 1.0 / np.sqrt(2.0 * np.pi) ** 3 / (0.05 * 0.1 * 0.04)
    assert whole == pytest.approx(0.6 * others, rel=1e-4)


@pytest.mark.parametrize("radius_m", [0.3, 3.0])
def test_extended_targets_have_the_covariance_of_their_scattering(radius_m):
    """The direct density is normal with covariance S + r^2 / 3 J J^T, the Jacobian by finite differences."""
    generator = np.random.default_rng(3)
    batch, _, target = draw_joint_room(generator, 4, receivers=1, paths=1)
    zero = (np.zeros(4),) * 3
    problem = TripletProblem.of_snapshots(batch, zero, radius_m)
    point = target + generator.normal(scale=0.1, size=target.shape)
    density = path_density(
        problem, 0, tuple(point.T), TargetModel(prior_indirect=0.5, clutter=0.01, targets=1), np.full(4, 8.0)
    )
    for n in range(4):
        tx, rx = np.append(batch.tx_xy_m[n, 0], batch.tx_z_m[n]), np.append(batch.rx_xy_m[n, 0], batch.rx_z_m[n])
        measured = np.array([getattr(batch, name)[n, 0] for name in SCALARS])
        residual = measured - predict(tx, rx, point[n])
        residual[[0, 1]] = (residual[[0, 1]] + np.pi) % (2.0 * np.pi) - np.pi
        steps = 1e-6 * np.eye(3)
        jacobian = np.stack(
            [(predict(tx, rx, point[n] + s) - predict(tx, rx, point[n] - s)) / 2e-6 for s in steps], axis=1
        )
        angle = np.radians(1.0)
        covariance = (
            np.diag(np.array([angle, angle, 0.1, angle, angle]) ** 2) + radius_m**2 / 3.0 * jacobian @ jacobian.T
        )
        chi_square = residual @ np.linalg.solve(covariance, residual)
        log_density = -0.5 * (chi_square + np.linalg.slogdet(2.0 * np.pi * covariance)[1])
        assert density.chi_square[n] == pytest.approx(chi_square, rel=1e-5)
        assert density.log_direct[n] == pytest.approx(np.log(0.5) + log_density, rel=1e-6)
        information = jacobian.T @ np.linalg.solve(covariance, jacobian)
        np.testing.assert_allclose(
            density.information.at(n).dense(), information, rtol=1e-5, atol=1e-6 * np.abs(information).max()
        )


@pytest.mark.parametrize("missing", [("doa",), ("dod", "doa")])
def test_targets_of_paths_without_elevations_are_not_ok(missing):
    """Without the elevations of a side floor detours pass for direct paths: no target is ok."""
    batch, _, _ = draw_joint_room(np.random.default_rng(5), 40)
    solution = joint.solve(without(batch, *missing), joint.JointOptions())
    assert (solution.estimates.status != Status.OK).all()
    assert (solution.estimates.status == Status.AMBIGUOUS).mean() > 0.5


def measured(batch, height_m, std_m):
    """Return a batch with measured heights (B,) of the targets."""
    return dataclasses.replace(batch, target_z_m=height_m, target_z_std_m=np.full(height_m.shape, std_m))


def test_a_height_that_is_hardly_known_changes_nothing(solved):
    """With a height to 10,000 km memberships and estimates are those without one; it is one more scalar for fits."""
    batch, _, target, plain = solved
    loose = joint.solve(measured(batch, target[:, 2] + 1.0, 1e7), joint.JointOptions())
    same = loose.estimates.status == plain.estimates.status
    assert same.mean() > 0.99
    assert set(plain.estimates.status[~same]) <= {Status.NO_TARGET}
    shares = [part.flags.columns["direct_probability"] for part in (loose, plain)]
    np.testing.assert_allclose(*shares, atol=1e-5)
    np.testing.assert_allclose(loose.estimates.position_m[same], plain.estimates.position_m[same], atol=1e-6)
    np.testing.assert_allclose(
        loose.estimates.covariance_m2[same], plain.estimates.covariance_m2[same], rtol=1e-5, atol=1e-9
    )
    ok = same & (plain.estimates.status == Status.OK)
    freedom = [part.estimates.degrees_of_freedom[ok] for part in (loose, plain)]
    np.testing.assert_array_equal(freedom[0], freedom[1] + 1)
    np.testing.assert_allclose(loose.estimates.chi_square[ok], plain.estimates.chi_square[ok], atol=1e-5)


@pytest.mark.parametrize("std_m", [0.0, 0.02])
def test_targets_use_a_measured_height(solved, std_m):
    """Fixes are nearer, more detours are flagged, direct paths at their level, and covariances are true."""
    batch, indirect, target, plain = solved
    height = target[:, 2] + std_m * np.random.default_rng(7).standard_normal(target.shape[0])
    solution = joint.solve(measured(batch, height, std_m), joint.JointOptions())
    estimates, unknowns = solution.estimates, 3 if std_m else 2
    ok = estimates.status == Status.OK
    assert ok.mean() > 0.9
    error = (estimates.position_m - target[estimates.row])[ok]
    before = plain.estimates.status == Status.OK
    worse = (plain.estimates.position_m - target[plain.estimates.row])[before]
    assert np.sqrt((error**2).sum(axis=1).mean()) < 0.85 * np.sqrt((worse**2).sum(axis=1).mean())
    assert solution.flags.columns["ip"][indirect].mean() > plain.flags.columns["ip"][indirect].mean() + 0.01
    rate = (solution.flags.columns["p_value"][~indirect] < 0.05).mean()
    assert abs(rate - 0.05) < 4.0 * np.sqrt(0.05 / 900) + 0.01
    matrix = np.empty((ok.sum(), 3, 3))
    for k, (i, j) in enumerate(((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))):
        matrix[:, i, j] = matrix[:, j, i] = estimates.covariance_m2[ok, k]
    error, matrix = error[:, :unknowns], matrix[:, :unknowns, :unknowns]
    squared = np.einsum("ni,nij,nj->n", error, np.linalg.inv(matrix), error)
    assert 0.92 < (squared < (7.815 if std_m else 5.991)).mean() < 0.985
    if not std_m:
        np.testing.assert_array_equal(estimates.covariance_m2[ok, 3:], 0.0)
        np.testing.assert_allclose(estimates.position_m[ok, 2], height[estimates.row[ok]], atol=1e-12)


def test_a_wrong_height_leaves_no_target(solved):
    """A height that is a metre off, to 5 cm, agrees with no target: hardly one is ok."""
    batch, _, target, _ = solved
    wrong = joint.solve(measured(batch, target[:, 2] + 1.0, 0.05), joint.JointOptions())
    assert (wrong.estimates.status == Status.OK).mean() < 0.05
