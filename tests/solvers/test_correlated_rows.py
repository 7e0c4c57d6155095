"""Fixes of rows with shared errors against dense generalized least squares."""

from __future__ import annotations

import numpy as np
import pytest
from batches import range_batch
from calibration_worlds import HALL
from scipy.optimize import least_squares

from nlosctl.models.shared_causes.causes import SensorCauses, SharedCauses
from nlosctl.models.shared_causes.joint_rows import JointRows, joint_rows
from nlosctl.solvers.optimization.correlated_rows import (
    correlated_equations,
    covariance_by_gain,
    covariance_of_fix,
    inverse_or_nan,
    least_square,
    linear_fix,
    refine_positions,
    rescaled_covariance,
    sandwich_of_weights,
)

SNAPSHOTS, ROWS = 5, 6


def random_rows(seed, nuisances=0):
    """Return random rows whose errors have two causes in common, and the dense covariance over the stds."""
    rng = np.random.default_rng(seed)
    slopes = tuple(rng.normal(size=(SNAPSHOTS, ROWS)) for _ in range(2 + nuisances))
    errors = rng.normal(size=(SNAPSHOTS, ROWS, 2))
    shared = errors @ np.swapaxes(errors, 1, 2)
    row = np.broadcast_to(np.arange(ROWS), (SNAPSHOTS, ROWS))
    return JointRows(rng.normal(size=(SNAPSHOTS, ROWS)), slopes, shared, row, nuisances), np.eye(ROWS) + shared


@pytest.mark.parametrize("nuisances", [0, 1])
def test_equations_are_those_of_the_whole_covariance(nuisances: int) -> None:
    """A'R^-1 A, A'R^-1 r and r'R^-1 r are those of a dense inverse of R, an unknown offset at its likeliest value."""
    rows, covariance = random_rows(1, nuisances)
    information, gradient, square = correlated_equations(rows)
    whole, step = covariance_of_fix(rows)
    for number, inverse in enumerate(np.linalg.inv(covariance)):
        slopes = np.stack([slope[number] for slope in rows.slopes], axis=1)
        residual = rows.residual[number]
        np.testing.assert_allclose(whole[number], np.linalg.inv(slopes.T @ inverse @ slopes), rtol=1e-8)
        np.testing.assert_allclose(information[number], np.linalg.inv(whole[number][:2, :2]), rtol=1e-8)
        if nuisances:
            of_offset = slopes[:, 2]
            likeliest = -(of_offset @ inverse @ residual) / (of_offset @ inverse @ of_offset)
            np.testing.assert_allclose(step[number], likeliest, rtol=1e-9)
            residual = residual + likeliest * of_offset
        np.testing.assert_allclose(gradient[number], slopes[:, :2].T @ inverse @ residual, atol=1e-9)
        np.testing.assert_allclose(square[number], residual @ inverse @ residual, rtol=1e-9)


def test_a_sandwich_is_that_of_dense_matrices() -> None:
    """The covariance of a fix whose weights ignore the correlations is (A'WA)^-1 A'W R W A (A'WA)^-1."""
    rows, covariance = random_rows(2)
    weight = np.random.default_rng(3).uniform(0.3, 1.0, rows.residual.shape)
    plain, sandwich = sandwich_of_weights(rows, weight)
    for number in range(SNAPSHOTS):
        slopes = np.stack([slope[number] for slope in rows.slopes], axis=1)
        inverse = np.linalg.inv(slopes.T @ (weight[number][:, None] * slopes))
        gain = inverse @ (weight[number][:, None] * slopes).T
        np.testing.assert_allclose(plain[number], inverse, rtol=1e-9)
        np.testing.assert_allclose(sandwich[number], gain @ covariance[number] @ gain.T, rtol=1e-9)


def test_a_linear_fix_solves_its_equations_in_one_step() -> None:
    """From any point, residuals that are linear end where A'R^-1 r = 0; its covariance is that of its gain."""
    rows, covariance = random_rows(6)
    start = np.random.default_rng(7).normal(size=(SNAPSHOTS, 2))
    fix, gain = linear_fix(rows, start)
    spread = np.random.default_rng(8).uniform(0.5, 2.0, rows.residual.shape)
    given = covariance_by_gain(rows, gain, spread)
    for number, inverse in enumerate(np.linalg.inv(covariance)):
        slopes = np.stack([slope[number] for slope in rows.slopes], axis=1)
        residual = rows.residual[number] + slopes @ (fix[number] - start[number])
        np.testing.assert_allclose(slopes.T @ inverse @ residual, 0.0, atol=1e-9)
        np.testing.assert_allclose(least_square(rows)[number], residual @ inverse @ residual, rtol=1e-9)
        wide = spread[number][:, None] * covariance[number] * spread[number]
        own = np.linalg.inv(slopes.T @ inverse @ slopes) @ slopes.T @ inverse
        np.testing.assert_allclose(given[number], own @ wide @ own.T, rtol=1e-8)


def test_refined_positions_are_those_of_generalized_least_squares() -> None:
    """From a fix that ignores correlations, the steps end where scipy's do with whitened residuals."""
    rng = np.random.default_rng(4)
    truth = rng.uniform([5, 5], [25, 15], (6, 2))
    root = 0.3 * rng.normal(size=(4, 4))
    ranges = np.hypot(*np.moveaxis(truth[:, None] - HALL, -1, 0)) + rng.normal(size=(6, 4)) @ root.T
    batch = range_batch(HALL, ranges, 0.1)
    exact = SensorCauses.exact(batch.sensor)
    causes = SharedCauses(SensorCauses(*list(vars(exact).values())[:4], batch.sensor), root @ root.T)

    def model(index, position_m):
        return joint_rows("ranges", batch, causes, np.repeat(position_m, 1, axis=0), with_ranges=False).take(index)

    def whole(index, position_m):
        every = truth.copy()
        every[index] = position_m
        return model(index, every)

    found, settled = refine_positions(whole, truth)
    square = correlated_equations(whole(np.arange(6), found))[2]
    assert settled.all()
    whiten = np.linalg.inv(np.linalg.cholesky(0.01 * np.eye(4) + root @ root.T))
    for number in range(6):

        def residuals(point, number=number):
            return whiten @ (ranges[number] - np.hypot(*(point - HALL).T))

        fit = least_squares(residuals, truth[number], xtol=1e-14)
        np.testing.assert_allclose(found[number], fit.x, atol=1e-4)
        np.testing.assert_allclose(square[number], 2.0 * fit.cost, rtol=1e-6)


def test_a_rescaled_covariance() -> None:
    """One that equals the matrix before becomes that after; one four times as large stays four times as large."""
    rng = np.random.default_rng(5)
    before, after = (root @ np.swapaxes(root, 1, 2) for root in rng.normal(size=(2, 4, 2, 2)))
    np.testing.assert_allclose(rescaled_covariance(before, before, after), after, rtol=1e-9)
    np.testing.assert_allclose(rescaled_covariance(4.0 * before, before, after), 4.0 * after, rtol=1e-9)


def test_singular_matrices_have_no_inverse() -> None:
    """NaN for a matrix that is singular, not definite or not finite; the others are inverted."""
    matrices = np.array(
        [[[1.0, 1.0], [1.0, 1.0]], [[2.0, 0.0], [0.0, 4.0]], [[-1.0, 0.0], [0.0, 1.0]], [[np.nan, 0.0]] * 2]
    )
    inverse = inverse_or_nan(matrices)
    np.testing.assert_array_equal(np.isnan(inverse).any(axis=(1, 2)), [True, False, True, True])
    np.testing.assert_allclose(inverse[1], [[0.5, 0.0], [0.0, 0.25]])
