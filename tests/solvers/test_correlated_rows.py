"""Fixes of rows with shared errors against dense generalized least squares."""

from __future__ import annotations

import numpy as np
from batches import range_batch
from calibration_worlds import HALL
from scipy.optimize import least_squares

from nlosctl.models.scaled_residuals import SCALED_RESIDUALS, ScaledResiduals
from nlosctl.solvers.optimization.correlated_rows import (
    correlated_equations,
    inverse_or_nan,
    refine_positions,
    rescaled_covariance,
    sandwich_of_weights,
)


def random_scalars(seed, snapshots=5, rows=6):
    """Return random scalars of rows, shared errors with two causes, and the dense covariance over the stds."""
    rng = np.random.default_rng(seed)
    slopes = [rng.normal(size=(snapshots, rows)) for _ in range(2)]
    per_offset = -rng.uniform(0.5, 2.0, (snapshots, rows))
    scalars = ScaledResiduals.of(rng.normal(size=(snapshots, rows)), *slopes, per_offset=per_offset)
    shared = rng.normal(size=(snapshots, rows, 2))
    errors = per_offset[:, :, None] * shared
    return scalars, shared, np.eye(rows) + errors @ np.swapaxes(errors, 1, 2)


def test_equations_are_those_of_the_whole_covariance() -> None:
    """A'R^-1 A, A'R^-1 r and r'R^-1 r are those of a dense inverse of R."""
    scalars, shared, covariance = random_scalars(1)
    information, gradient, square = correlated_equations([scalars], shared)
    for number, inverse in enumerate(np.linalg.inv(covariance)):
        slopes = np.stack([slope[number] for slope in scalars.slopes], axis=1)
        np.testing.assert_allclose(information[number], slopes.T @ inverse @ slopes, atol=1e-10)
        np.testing.assert_allclose(gradient[number], slopes.T @ inverse @ scalars.residual[number], atol=1e-10)
        np.testing.assert_allclose(square[number], scalars.residual[number] @ inverse @ scalars.residual[number])


def test_a_sandwich_is_that_of_dense_matrices() -> None:
    """The covariance of a fix whose weights ignore the correlations is (A'WA)^-1 A'W R W A (A'WA)^-1."""
    scalars, shared, _ = random_scalars(2)
    own = np.random.default_rng(3).uniform(0.3, 1.0, scalars.residual.shape)
    information, sandwich = sandwich_of_weights([scalars], np.ones(own.shape), own, shared)
    for number in range(own.shape[0]):
        slopes = np.stack([slope[number] for slope in scalars.slopes], axis=1)
        errors = scalars.per_offset[number][:, None] * shared[number]
        gain = np.linalg.inv(slopes.T @ slopes) @ slopes.T
        expected = gain @ (np.diag(own[number]) + errors @ errors.T) @ gain.T
        np.testing.assert_allclose(information[number], slopes.T @ slopes, atol=1e-12)
        np.testing.assert_allclose(sandwich[number], expected, atol=1e-12)


def test_refined_positions_are_those_of_generalized_least_squares() -> None:
    """From a fix that ignores correlations, the steps end where scipy's do with whitened residuals."""
    rng = np.random.default_rng(4)
    truth = rng.uniform([5, 5], [25, 15], (6, 2))
    root = 0.3 * rng.normal(size=(4, 4))
    ranges = np.hypot(*np.moveaxis(truth[:, None] - HALL, -1, 0)) + rng.normal(size=(6, 4)) @ root.T
    batch = range_batch(HALL, ranges, 0.1)
    shared = np.broadcast_to(root, (6, 4, 4))

    def model(position_m):
        return SCALED_RESIDUALS["ranges"](batch, position_m, with_ranges=False)

    found, square = refine_positions(model, truth, shared)
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
