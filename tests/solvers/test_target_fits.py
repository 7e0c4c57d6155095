"""Fits of single paths and of snapshots: derivatives, optima, speed of the descent."""

from __future__ import annotations

import numpy as np
import pytest
from scenario_draws import draw_columns
from scipy.optimize import least_squares
from triplet_worlds import batch_of

from nlosctl.models.triplets import path_rows
from nlosctl.solvers.triplets.elliptic_coordinates import _EllipticProblem
from nlosctl.solvers.triplets.likelihood import TripletProblem
from nlosctl.solvers.triplets.target_fits import fit_paths, fit_snapshots


def _problem(count=300, seed=1):
    rows = path_rows(batch_of(draw_columns("shen", count, seed=seed)))
    return rows, TripletProblem.of_paths(rows)


def _numeric(evaluate, x, y, step):
    """Return gradient and second derivatives by central differences of costs and gradients."""
    right, left = evaluate(x + step, y), evaluate(x - step, y)
    up, down = evaluate(x, y + step), evaluate(x, y - step)
    gradient = ((right.cost - left.cost) / (2 * step), (up.cost - down.cost) / (2 * step))
    xx = (right.gradient_x - left.gradient_x) / (2 * step)
    xy = (up.gradient_x - down.gradient_x) / (2 * step)
    yy = (up.gradient_y - down.gradient_y) / (2 * step)
    return gradient, (xx, xy, yy)


@pytest.mark.parametrize("elliptic", [False, True])
def test_derivatives_agree_with_finite_differences(elliptic):
    """Gradient and, where positive, Hessian agree with finite differences in both coordinate systems."""
    rows, problem = _problem()
    generator = np.random.default_rng(2)
    x, y = generator.uniform(-6.0, 6.0, 300), generator.uniform(1.0, 9.0, 300)
    if elliptic:
        problem = _EllipticProblem(problem, rows.rays.baseline_m)
        x, y = problem.from_plane(x, y)
    exact = problem.evaluate(x, y)
    gradient, second = _numeric(problem.evaluate, x, y, 1e-5)
    scale = np.abs(exact.gradient_x) + np.abs(exact.gradient_y) + 1.0
    np.testing.assert_allclose(gradient[0] / scale, exact.gradient_x / scale, atol=1e-5)
    np.testing.assert_allclose(gradient[1] / scale, exact.gradient_y / scale, atol=1e-5)
    positive = (second[0] > 0.0) & (second[0] * second[2] - second[1] ** 2 > 0.3 * second[0] * second[2])
    assert positive.sum() > 60
    for numeric, ours in zip(second, (exact.hessian.xx, exact.hessian.xy, exact.hessian.yy), strict=True):
        size = (np.abs(second[0]) + np.abs(second[2]))[positive]
        close = np.abs(numeric[positive] - ours[positive]) / size < 1e-4
        # Elsewhere the Gauss-Newton matrix stands in.
        assert close.mean() > 0.8


def test_elliptic_coordinates_round_trip():
    """Elliptic coordinates round-trip, on the baseline and with a baseline of zero too."""
    rows, plane = _problem(6)
    x, y = np.array([1.0, -1.0, 0.0, 3.0, -4.0, 0.5]), np.array([2.0, -2.0, 0.0, 0.0, 0.0, 1e-9])
    for baseline in (rows.rays.baseline_m, np.zeros(6)):
        problem = _EllipticProblem(plane, baseline)
        back = problem.to_plane(*problem.from_plane(x, y))
        np.testing.assert_allclose(back, [x, y], atol=1e-8)


@pytest.mark.extensive
def test_no_start_finds_a_lower_chi_square():
    """No path has a lower chi-square from a grid of starts by scipy."""
    rows, problem = _problem(40, seed=3)
    fits = fit_paths(rows)
    assert fits.converged.all()
    angle = np.linspace(0.1, 2.0 * np.pi, 12)
    for n in range(40):
        one = problem.take(np.array([n]))

        def residuals(p, one=one):
            parts = one.residuals(p[:1], p[1:]).values()
            inverse = (one.tx.inverse_std, one.rx.inverse_std, one.inverse_length_std)
            return np.array([part[0, 0] * scale[0, 0] for part, scale in zip(parts, inverse, strict=True)])

        length = rows.rays.path_length_m[n]
        costs = [least_squares(residuals, 0.5 * length * np.array([np.cos(a), np.sin(a)])).cost for a in angle]
        assert fits.cost[n] <= min(costs) * (1.0 + 1e-6) + 1e-6


def test_noise_free_direct_paths_have_zero_cost():
    """The fit of a noise-free direct path is the target, with cost zero."""
    columns = draw_columns("shen", 200, seed=4, indirect_fraction=0.0)
    rows = path_rows(batch_of(columns))
    from nlosctl.models.triplets import predict_triplets

    tx, rx = np.array([[-2.5, 0.0]]), np.array([[2.5, 0.0]])
    target = np.stack([columns["truth_x_m"], columns["truth_y_m"]], axis=1)
    dod, doa, length = predict_triplets(tx, rx, target)
    exact = path_rows(batch_of({**columns, "dod_rad": dod, "doa_rad": doa, "path_length_m": length}))
    fits = fit_paths(exact)
    assert rows.shape == exact.shape
    np.testing.assert_allclose(fits.cost, 0.0, atol=1e-12)
    far = target[:, 1] > 0.5
    np.testing.assert_allclose(np.stack([fits.x, fits.y], axis=1)[far], target[far], atol=1e-6)


def test_joint_fits_agree_with_scipy():
    """The joint fit of a snapshot from its single-path fits agrees with scipy's optimum from the truth."""
    columns = draw_columns("room", 30, seed=5, receivers=4, paths=1, blocked_fraction=0.0)
    flat = path_rows(batch_of(columns))
    fits = fit_paths(flat)
    x, y = flat.frame.to_global(fits.x, fits.y)
    from nlosctl.contract.batches import TripletBatch

    arrays = {}
    for name, parts in TripletBatch.SOURCES.items():
        values = [np.asfortranarray(columns[part].reshape(30, 4)) for part in parts]
        arrays[name] = values[0] if len(values) == 1 else np.asfortranarray(np.stack(values, axis=-1))
    batch = TripletBatch(seed=np.zeros(30, dtype=np.uint64), **arrays)
    problem = TripletProblem.of_snapshots(batch, (np.zeros(30), np.zeros(30)))
    found = fit_snapshots(problem, x.reshape(30, 4), y.reshape(30, 4))
    assert found.converged.all()
    alone = fit_snapshots(problem.take(np.array([7])), x.reshape(30, 4)[7:8], y.reshape(30, 4)[7:8])
    assert (alone.x[0], alone.y[0], alone.cost[0]) == (found.x[7], found.y[7], found.cost[7])
    stds = (problem.tx.inverse_std, problem.rx.inverse_std, problem.inverse_length_std)
    for n in range(30):
        one = problem.take(np.array([n]))

        def residuals(p, one=one, n=n):
            parts = one.residuals(p[:1], p[1:]).values()
            return np.concatenate([part[0] * std[n] for part, std in zip(parts, stds, strict=True)])

        best = least_squares(residuals, [columns["truth_x_m"][4 * n], columns["truth_y_m"][4 * n]], xtol=1e-12)
        assert found.cost[n] == pytest.approx(best.cost, rel=1e-6)
        np.testing.assert_allclose([found.x[n], found.y[n]], best.x, atol=1e-5)
