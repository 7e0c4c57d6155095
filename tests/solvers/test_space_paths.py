"""Triplets in space: derivatives, optima, chi-square laws, covariances, and what has no answer."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy import stats
from scipy.optimize import least_squares
from space_triplets import draw_space_room, predict, space_batch, without

import nlosctl.methods.triplets_chi2 as chi2
import nlosctl.methods.triplets_ml as ml
from nlosctl.contract.batches import TripletBatch
from nlosctl.contract.statuses import Status
from nlosctl.models.triplets import paths_of
from nlosctl.solvers.triplets.likelihood import TripletProblem
from nlosctl.solvers.triplets.spheroidal_coordinates import _SpheroidalProblem
from nlosctl.solvers.triplets.target_fits import fit_paths


def scaled_residuals(problem, n):
    """Return the residuals of problem ``n`` in standard deviations, as a function of the point, for scipy."""
    one = problem.take(np.array([n]))
    nodes = (one.tx.inverse_std, one.rx.inverse_std, one.inverse_length_std)
    scales = (*nodes, one.tx.inverse_elevation_std, one.rx.inverse_elevation_std)

    def residuals(point):
        parts = one.residuals(*(np.array([part]) for part in point)).values()
        return np.concatenate([np.nan_to_num(part[0]) * scale[0] for part, scale in zip(parts, scales, strict=True)])

    return residuals


def dense(packed):
    """Return covariances (N, 6) as matrices (N, 3, 3)."""
    matrix = np.empty((packed.shape[0], 3, 3))
    for k, (i, j) in enumerate(((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))):
        matrix[:, i, j] = matrix[:, j, i] = packed[:, k]
    return matrix


def normalized_errors(estimates, target):
    """Return the squared errors (N,) in units of the covariances of the estimates that are ok."""
    ok = estimates.status == Status.OK
    error = estimates.position_m[ok] - target[ok]
    return np.einsum("ni,nij,nj->n", error, np.linalg.inv(dense(estimates.covariance_m2[ok])), error)


@pytest.mark.parametrize("spheroidal", [False, True])
def test_derivatives_agree_with_finite_differences(spheroidal):
    """Gradient and, where positive, second derivatives agree with central differences in both coordinates."""
    generator = np.random.default_rng(1)
    batch, target = draw_space_room(generator, 200, degrees=5.0, length_std_m=0.3)
    rows = paths_of(batch)
    problem = TripletProblem.of_paths(rows)
    near = target.T - np.array(rows.frame.center) + generator.uniform(-0.2, 0.2, (3, 200))
    point = list(near)
    if spheroidal:
        problem, w = _SpheroidalProblem.about(problem, rows.frame.length_m, rows.frame.axes, tuple(point))
        point = [w, *generator.uniform(-0.02, 0.02, (2, 200))]
    exact = problem.evaluate(*point)
    assert exact.exact.sum() > 100
    step = 1e-5
    size = sum(np.abs(part) for part in exact.gradient) + 1.0
    spread = exact.hessian.trace
    for i in range(3):
        ahead, back = (
            problem.evaluate(*(part + sign * step * (i == k) for k, part in enumerate(point))) for sign in (1.0, -1.0)
        )
        np.testing.assert_allclose((ahead.cost - back.cost) / (2 * step) / size, exact.gradient[i] / size, atol=1e-4)
        for j in range(3):
            slope = (ahead.gradient[j] - back.gradient[j]) / (2 * step)
            wrong = np.abs(slope - exact.hessian.entry(i, j)) / spread
            assert np.quantile(wrong[exact.exact], 0.95) < 1e-4


@pytest.mark.parametrize("missing", [(), ("doa",), ("dod", "doa")])
def test_noise_free_paths_have_zero_cost(missing):
    """The fit of a noise-free direct path leaves nothing, and is the target where that is the only solution."""
    generator = np.random.default_rng(2)
    batch, target = draw_space_room(generator, 100)
    tx, rx = (np.dstack([xy, z]) for xy, z in ((batch.tx_xy_m, batch.tx_z_m), (batch.rx_xy_m, batch.rx_z_m)))
    exact = without(space_batch(tx, rx, predict(tx, rx, target[:, None]), (0.02, 0.02, 0.1, 0.02, 0.02)), *missing)
    rows = paths_of(exact)
    fits = fit_paths(rows)
    np.testing.assert_allclose(fits.cost, 0.0, atol=1e-10)
    if len(missing) < 2:
        found = np.stack(rows.frame.to_global(*fits.point), axis=1)
        assert np.quantile(np.abs(found - target).max(axis=1), 0.95) < 1e-6


@pytest.mark.parametrize(("indirect", "missing"), [(False, ()), (True, ("dod",))])
def test_no_start_of_scipy_finds_a_lower_chi_square(indirect, missing):
    """Of 12 random starts of scipy's least squares on each path none ends lower."""
    generator = np.random.default_rng(3)
    batch, _ = draw_space_room(generator, 6, indirect=indirect)
    rows = paths_of(without(batch, *missing))
    fits, problem = fit_paths(rows), TripletProblem.of_paths(rows)
    for n in range(6):
        starts = generator.normal(size=(12, 3)) * rows.path_length_m[n] / 4.0
        best = min(least_squares(scaled_residuals(problem, n), start).cost for start in starts)
        assert fits.cost[n] <= best * (1.0 + 1e-6) + 1e-6


def test_paths_at_one_height_are_those_of_the_plane():
    """With all nodes at one height and elevations of zero the targets are those of two dimensions, at that height."""
    batch, _ = draw_space_room(np.random.default_rng(4), 200)
    level = np.zeros_like(batch.dod_rad)
    changes = {"tx_z_m": level + 1.5, "rx_z_m": level + 1.5, "dod_elevation_rad": level, "doa_elevation_rad": level}
    space = fit_paths(paths_of(dataclasses.replace(batch, **changes)))
    nothing = dict.fromkeys([*TripletBatch.SPACE_SOURCES])
    plane_rows = paths_of(dataclasses.replace(batch, dimension=2, **nothing))
    plane = fit_paths(plane_rows)
    x, y = plane_rows.frame.to_global(*plane.point)
    found = np.stack(paths_of(dataclasses.replace(batch, **changes)).frame.to_global(*space.point))
    likely = plane.cost < 8.0
    np.testing.assert_allclose(space.cost[likely], plane.cost[likely], atol=1e-7)
    np.testing.assert_allclose(found[:, likely].T, np.stack([x, y, 0.0 * x + 1.5], axis=1)[likely], atol=1e-5)


@pytest.mark.parametrize("missing", [(), ("doa",)])
def test_p_values_of_direct_paths_are_uniform(missing):
    """Chi-square has 2 degrees of freedom, 1 with an elevation missing: p-values pass a Kolmogorov-Smirnov test."""
    batch, _ = draw_space_room(np.random.default_rng(5), 2000)
    flags = chi2.solve(without(batch, *missing), chi2.ConsistencyOptions()).flags
    assert stats.kstest(flags.columns["p_value"][:, 0], "uniform").pvalue > 1e-3


def test_paths_over_one_wall_are_found():
    """At a false alarm of .05 .97 of the paths over one wall are flagged, .77 with an elevation missing."""
    batch, _ = draw_space_room(np.random.default_rng(6), 1500, indirect=True)
    for missing, least in (((), 0.97), (("doa",), 0.77), (("dod",), 0.77)):
        flags = chi2.solve(without(batch, *missing), chi2.ConsistencyOptions()).flags
        assert flags.columns["ip"].mean() > least


def test_without_elevations_a_path_is_not_judged():
    """Three scalars fit any target: no p-value, no flag, and no covariance of two mirror images."""
    batch, _ = draw_space_room(np.random.default_rng(7), 200, indirect=True)
    solution = chi2.solve(without(batch, "dod", "doa"), chi2.ConsistencyOptions())
    assert np.isnan(solution.flags.columns["p_value"]).all()
    assert not solution.flags.columns["ip"].any()
    assert (solution.estimates.degrees_of_freedom == 0).all()
    assert np.isin(solution.estimates.status, [Status.AMBIGUOUS, Status.DEGENERATE]).all()


@pytest.mark.parametrize("degrees", [1.0, 5.0])
def test_covariances_are_those_of_the_errors(degrees):
    """The 95 % ellipsoid of single paths holds .93 to .975 of the targets, as far as the angles are coarse."""
    batch, target = draw_space_room(np.random.default_rng(8), 1500, degrees=degrees)
    estimates = ml.solve(batch, ml.MaximumLikelihoodOptions()).estimates
    errors = normalized_errors(estimates, target)
    assert errors.size > 1450
    assert 0.93 < np.mean(errors < stats.chi2.ppf(0.95, 3)) < 0.975
    assert abs(np.median(errors) - stats.chi2.median(3)) < 0.25


def test_targets_above_a_node_have_no_covariance():
    """Within three standard deviations of the vertical an azimuth is no Gaussian angle: degenerate."""
    tx, rx = np.zeros((3, 1, 3)), np.full((3, 1, 3), [6.0, 0.0, 0.0])
    elevation = np.radians([80.0, 88.0, 89.5])
    target = 3.0 * np.stack([np.cos(elevation), 0.0 * elevation, np.sin(elevation)], axis=1)[:, None]
    batch = space_batch(tx, rx, predict(tx, rx, target), np.radians([1.0, 1.0, 2.0, 1.0, 1.0]))
    for joint in (False, True):
        status = ml.solve(batch, ml.MaximumLikelihoodOptions(joint=joint)).estimates.status
        assert status.tolist() == [Status.OK, Status.DEGENERATE, Status.DEGENERATE]


def test_monostatic_paths_and_paths_shorter_than_their_baseline_are_finite():
    """A node that is both transmitter and receiver, and a path without ellipsoid, give statuses instead of errors."""
    tx = np.zeros((2, 1, 3))
    rx = np.array([[[0.0, 0.0, 0.0]], [[6.0, 0.0, 1.0]]])
    values = predict(tx, rx, np.full((2, 1, 3), [2.0, 3.0, 0.5]))
    values[2, 1] = 5.0
    solution = chi2.solve(space_batch(tx, rx, values, (0.01, 0.01, 0.05, 0.01, 0.01)), chi2.ConsistencyOptions())
    assert np.isfinite(solution.flags.columns["p_value"]).all()
    assert solution.flags.columns["reason"].words[solution.flags.columns["reason"].code[0, 0]] == "monostatic"
    np.testing.assert_allclose(solution.estimates.position_m[0], [2.0, 3.0, 0.5], atol=1e-6)


@pytest.mark.parametrize("std_m", [None, 0.2, 0.0])
def test_one_target_of_all_paths_agrees_with_scipy(std_m):
    """With joint=true, also with a height that is measured or exact, cost, position and covariance are scipy's."""
    generator = np.random.default_rng(9)
    batch, target = draw_space_room(generator, 12, 3)
    if std_m is not None:
        heights = target[:, 2] + std_m * generator.normal(size=12)
        batch = dataclasses.replace(batch, target_z_m=heights, target_z_std_m=np.full(12, std_m))
    estimates = ml.solve(batch, ml.MaximumLikelihoodOptions(joint=True)).estimates
    spare = 15 - 3 + {None: 0, 0.2: 1, 0.0: 1}[std_m]
    assert (estimates.degrees_of_freedom[estimates.status == Status.OK] == spare).all()
    problem = TripletProblem.of_snapshots(batch, (np.zeros(12),) * 3)
    for n in np.flatnonzero(estimates.status == Status.OK):
        paths = scaled_residuals(problem, n)

        def residuals(point, n=n, paths=paths):
            if std_m is None:
                return paths(point)
            if std_m == 0.0:
                return paths([*point[:2], batch.target_z_m[n]])
            return np.append(paths(point), (point[2] - batch.target_z_m[n]) / std_m)

        start = target[n][: 2 if std_m == 0.0 else 3]
        best = least_squares(residuals, start, xtol=1e-13, ftol=1e-13)
        point = np.append(best.x, batch.target_z_m[n]) if std_m == 0.0 else best.x
        assert estimates.cost[n] == pytest.approx(best.cost, rel=1e-6)
        np.testing.assert_allclose(estimates.position_m[n], point, atol=1e-5)
        covariance = np.linalg.inv(best.jac.T @ best.jac)
        size = covariance.shape[0]
        ours = dense(estimates.covariance_m2[[n]])[0]
        np.testing.assert_allclose(ours[:size, :size], covariance, atol=1e-3 * np.trace(covariance))
        assert std_m != 0.0 or (ours[2] == 0.0).all()


@pytest.mark.parametrize("std_m", [0.2, 0.0])
def test_single_paths_use_the_height_of_the_target(std_m):
    """A height measured or exact is one more scalar of each path; noise-free paths then are at their targets."""
    batch, target = draw_space_room(np.random.default_rng(10), 60)
    tx, rx = (np.dstack([xy, z]) for xy, z in ((batch.tx_xy_m, batch.tx_z_m), (batch.rx_xy_m, batch.rx_z_m)))
    heights = {"target_z_m": target[:, 2].copy(), "target_z_std_m": np.full(60, std_m)}
    exact = space_batch(tx, rx, predict(tx, rx, target[:, None]), (0.02, 0.02, 0.1, 0.02, 0.02), **heights)
    for missing, spare in (((), 3), (("dod", "doa"), 1)):
        estimates = ml.solve(without(exact, *missing), ml.MaximumLikelihoodOptions()).estimates
        ok = estimates.status == Status.OK
        assert ok.mean() > (0.9 if not missing else 0.4)
        assert (estimates.degrees_of_freedom[ok] == spare).all()
        assert np.quantile(np.abs(estimates.position_m[ok] - target[ok]).max(axis=1), 0.9) < 1e-4
