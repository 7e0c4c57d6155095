"""What a method returns in three dimensions, and its check."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from nlosctl.contract.result_checks import contract_violation
from nlosctl.contract.results import Estimates, Solution, no_estimates
from nlosctl.contract.statuses import Status
from nlosctl.geometry.symmetric import SymmetricMatrix

SIZE, ROWS = 20, 4


def solution_of(covariance: np.ndarray, dimension: int = 3) -> Solution:
    """Return SIZE fixes with one covariance (D, D)."""
    parts = [np.full(SIZE, covariance[i, j]) for i in range(dimension) for j in range(i + 1)]
    position = tuple(np.zeros(SIZE) for _ in range(dimension))
    status = np.full(SIZE, Status.OK, dtype=np.uint8)
    return Solution(estimates=Estimates.of(status, position, SymmetricMatrix(*parts), np.zeros(SIZE), ROWS))


@pytest.mark.parametrize("seed", range(30))
def test_covariances_in_space_are_semidefinite(seed: int) -> None:
    """A covariance keeps the contract exactly where NumPy's eigenvalues are not negative."""
    draws = np.random.default_rng(seed)
    axes = np.linalg.qr(draws.normal(size=(3, 3)))[0]
    least = draws.choice([-0.3, -1e-3, 0.0, 1e-3, 0.3])
    covariance = axes @ np.diag([least, *draws.uniform(1.0, 3.0, 2)]) @ axes.T
    fault = contract_violation(solution_of(covariance), (SIZE, ROWS), 3)
    assert (fault == "") == (least >= 0.0), fault


def test_a_held_height_has_the_covariances_zero() -> None:
    """Zeros of z keep the contract; a covariance of x and z beside them does not."""
    held = np.diag([2.0, 1.0, 0.0])
    assert contract_violation(solution_of(held), (SIZE, ROWS), 3) == ""
    held[2, 0] = held[0, 2] = 1e-3
    assert "semidefinite" in contract_violation(solution_of(held), (SIZE, ROWS), 3)


def test_positions_have_the_dimension_of_the_batch() -> None:
    """Estimates of the plane for a batch in space, and the reverse, break the contract."""
    plane, space = solution_of(np.eye(2), 2), solution_of(np.eye(3))
    assert f"position_m has shape {(SIZE, 2)}, expected {(SIZE, 3)}" in contract_violation(plane, (SIZE, ROWS), 3)
    assert f"position_m has shape {(SIZE, 3)}, expected {(SIZE, 2)}" in contract_violation(space, (SIZE, ROWS))


def test_a_height_without_a_status_for_it_breaks_the_contract() -> None:
    """In space too, numbers are NaN exactly where the status requires it."""
    assert contract_violation(Solution(estimates=no_estimates(SIZE, 3, Status.TOO_FEW)), (SIZE, ROWS), 3) == ""
    estimates = solution_of(np.eye(3)).estimates
    estimates.position_m[3, 2] = np.nan
    fault = contract_violation(Solution(estimates=estimates), (SIZE, ROWS), 3)
    assert "the position is [0.0, 0.0, nan] where the status is ok" in fault
    kept = dataclasses.replace(no_estimates(SIZE, 3), covariance_m2=np.zeros((SIZE, 6)))
    assert "the covariance is" in contract_violation(Solution(estimates=kept), (SIZE, ROWS), 3)
