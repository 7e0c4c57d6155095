"""The normal equations of offsets against dense least squares, and what they leave undetermined."""

from __future__ import annotations

import numpy as np
import pytest

from nlosctl.models.scaled_residuals import ScaledResiduals
from nlosctl.solvers.calibration.elimination import offset_equations, row_pairs
from nlosctl.solvers.calibration.offset_solution import solve_offsets
from nlosctl.solvers.calibration.places import cells_of, count_places

SNAPSHOTS, ROWS = 7, 6


def scalars(unknowns, seed=1, blocks=1):
    """Return random scalars of rows; the first block depends on offsets."""
    rng = np.random.default_rng(seed)
    made = []
    for block in range(blocks):
        slopes = [rng.normal(size=(SNAPSHOTS, ROWS)) for _ in range(unknowns)]
        per_offset = -rng.uniform(0.5, 2.0, (SNAPSHOTS, ROWS)) if block == 0 else None
        made.append(ScaledResiduals.of(rng.normal(size=(SNAPSHOTS, ROWS)), *slopes, per_offset=per_offset))
    return made


def dense_equations(blocks, weight, snapshot, offset_of_row):
    """Return N and g of one snapshot by dense elimination of its position; rows have the offsets ``offset_of_row``."""
    count = max(offset_of_row) + 1
    jacobian, residual = [], []
    for scalar in blocks:
        for row in range(ROWS):
            by_offset = np.zeros(count)
            by_offset[offset_of_row[row]] = 0.0 if scalar.per_offset is None else scalar.per_offset[snapshot, row]
            root = np.sqrt(weight[snapshot, row])
            jacobian.append(root * np.concatenate([[slope[snapshot, row] for slope in scalar.slopes], by_offset]))
            residual.append(root * scalar.residual[snapshot, row])
    jacobian, residual, unknowns = np.array(jacobian), np.array(residual), len(blocks[0].slopes)
    normal, right = jacobian.T @ jacobian, -jacobian.T @ residual
    first, second = slice(None, unknowns), slice(unknowns, None)
    gain = normal[second, first] @ np.linalg.inv(normal[first, first])
    return normal[second, second] - gain @ normal[first, second], right[second] - gain @ right[first]


@pytest.mark.parametrize(("unknowns", "blocks"), [(2, 1), (2, 2), (3, 1), (4, 2), (1, 1)])
def test_equations_are_those_of_dense_elimination(unknowns: int, blocks: int) -> None:
    """N, g and the leverages are those of dense least squares, snapshot by snapshot, also with further scalars."""
    made, weight = scalars(unknowns, blocks=blocks), np.random.default_rng(2).uniform(0.1, 1.0, (SNAPSHOTS, ROWS))
    equations = offset_equations(made, weight, np.ones(SNAPSHOTS, dtype=bool), 2)
    later, earlier = row_pairs(ROWS)
    for snapshot in range(SNAPSHOTS):
        normal, right = dense_equations(made, weight, snapshot, list(range(ROWS)))
        assert equations.information[snapshot] == pytest.approx(normal[later, earlier], abs=1e-11)
        assert equations.gradient[snapshot] == pytest.approx(right, abs=1e-11)
    leverages = (blocks - equations.degrees / weight).sum(axis=1)
    assert leverages == pytest.approx(np.full(SNAPSHOTS, unknowns))
    assert equations.alone == pytest.approx(weight * made[0].per_offset ** 2)


def test_known_positions_leave_the_diagonal() -> None:
    """With known positions no row has a part in another's offset, and the step is the weighted mean residual."""
    made = [scalar.at_known_position(2) for scalar in scalars(2)]
    weight = np.random.default_rng(2).uniform(0.1, 1.0, (SNAPSHOTS, ROWS))
    equations = offset_equations(made, weight, np.ones(SNAPSHOTS, dtype=bool), 2)
    later, earlier = row_pairs(ROWS)
    assert not equations.information[:, later != earlier].any()
    assert equations.degrees == pytest.approx(weight)
    step = equations.gradient.sum(axis=0) / equations.alone.sum(axis=0)
    precision = weight * made[0].per_offset ** 2
    mean = np.sum(precision * made[0].residual / -made[0].per_offset, axis=0) / precision.sum(axis=0)
    assert step == pytest.approx(mean)


def test_snapshots_without_a_position_add_nothing() -> None:
    """A snapshot that is not located, one of parallel slopes and one without a finite row add zeros."""
    (made,) = scalars(2)
    made.slopes[1][3] = 2.0 * made.slopes[0][3]
    made.measured[4] = made.residual[4] = made.slopes[0][4] = made.slopes[1][4] = 0.0
    located = np.ones(SNAPSHOTS, dtype=bool)
    located[2] = False
    equations = offset_equations([made], np.ones((SNAPSHOTS, ROWS)), located, 2)
    assert np.flatnonzero(equations.located).tolist() == [0, 1, 5, 6]
    for values in vars(equations).values():
        assert not np.any(values[[2, 3, 4]])


def test_two_rows_determine_nothing() -> None:
    """A snapshot of as many rows as unknowns has no information about offsets beyond rounding."""
    (many,) = scalars(2)
    two = [part[:, :2] for part in (many.residual, *many.slopes)]
    made = [ScaledResiduals.of(*two, per_offset=-np.ones((SNAPSHOTS, 2)))]
    equations = offset_equations(made, np.ones((SNAPSHOTS, 2)), np.ones(SNAPSHOTS, dtype=bool), 2)
    assert np.abs(equations.information).max() < 1e-11


def world(seed=3, size=5):
    """Return N with the common offset as its only null combination, g within its range, and D."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(3 * size, size))
    root -= root.mean(axis=1, keepdims=True)
    normal = root.T @ root
    return normal, normal @ rng.normal(size=size), np.full(size, 3.0 * size)


def test_a_lost_combination_keeps_zero_mean() -> None:
    """Step and covariance are those of the pseudo-inverse; the lost combination is named, with all of its offsets."""
    normal, gradient, alone = world()
    solution = solve_offsets(normal, gradient, alone, np.zeros(5))
    inverse = np.linalg.pinv(normal, hermitian=True)
    assert solution.covariance == pytest.approx(inverse, abs=1e-12)
    assert solution.step == pytest.approx(inverse @ gradient)
    assert abs(solution.step.mean()) < 1e-12
    assert [(part.offsets, part.common) for part in solution.lost] == [((0, 1, 2, 3, 4), True)]
    assert solution.freedom == pytest.approx(4.0)
    assert solution.determined.all()


def test_an_offset_without_information_has_none() -> None:
    """It has step 0, no variance and its own name; the others are solved as if it were not there."""
    normal, gradient, _ = world()
    larger, right = np.zeros((7, 7)), np.zeros(7)
    index = [0, 1, 3, 4, 6]
    larger[np.ix_(index, index)], right[index] = normal, gradient
    larger[2, 2] = 1e-14
    solution = solve_offsets(larger, right, np.array([15.0, 15.0, 15.0, 15.0, 15.0, 0.0, 15.0]), np.zeros(7))
    assert np.flatnonzero(~solution.determined).tolist() == [2, 5]
    assert [part.offsets for part in solution.lost] == [(2,), (5,), tuple(index)]
    assert solution.covariance[np.ix_(index, index)] == pytest.approx(np.linalg.pinv(normal, hermitian=True), abs=1e-12)
    assert not solution.step[[2, 5]].any()
    assert not solution.covariance[[2, 5]].any()


def test_groups_that_no_measurement_connects_lose_their_own_combination() -> None:
    """Each group's common offset is lost, and named with that group alone."""
    normal, gradient, alone = world(3)
    other, right, _ = world(4)
    nothing = np.zeros((5, 5))
    both = np.block([[normal, nothing], [nothing, other]])
    solution = solve_offsets(both, np.concatenate([gradient, right]), np.tile(alone, 2), np.zeros(10))
    assert [part.offsets for part in solution.lost] == [(0, 1, 2, 3, 4), (5, 6, 7, 8, 9)]
    assert solution.step[5:] == pytest.approx(np.linalg.pinv(other, hermitian=True) @ right)


def test_a_prior_is_one_more_row_of_each_offset() -> None:
    """Step and covariance are those of least squares with the prior's rows; it determines what the data lose."""
    normal, gradient, alone = world()
    offsets, std = np.arange(5.0), 0.3
    solution = solve_offsets(normal, gradient, alone, offsets, std)
    whole = normal + np.eye(5) / std**2
    assert solution.covariance == pytest.approx(np.linalg.inv(whole), abs=1e-12)
    assert solution.step == pytest.approx(np.linalg.solve(whole, gradient - offsets / std**2))
    (lost,) = solution.lost
    assert lost.std == pytest.approx(std / np.sqrt(5.0))
    assert solution.freedom == pytest.approx(np.trace(normal @ np.linalg.inv(whole)))


def test_a_weak_combination_is_named_with_its_std() -> None:
    """A common offset with a share of 1e-5 of its information is solved, and named as weak."""
    normal, gradient, alone = world()
    weak = normal + 1e-5 * 15.0 / 5.0 * np.ones((5, 5))
    solution = solve_offsets(weak, gradient, alone, np.zeros(5))
    assert solution.covariance == pytest.approx(np.linalg.inv(weak))
    assert not solution.lost
    (combination,) = solution.weak
    assert combination.offsets == (0, 1, 2, 3, 4)
    assert combination.share == pytest.approx(1e-5, rel=1e-3)
    assert combination.std == pytest.approx(np.sqrt(np.full(5, 0.2) @ np.linalg.inv(weak) @ np.full(5, 0.2)), rel=1e-3)


def cells(position_m, size_m, std_m):
    """Return the cells of positions as tuples."""
    count = len(position_m)
    return list(map(tuple, cells_of(np.array(position_m), np.full(count, size_m), np.full(count, std_m)).tolist()))


def test_scattered_fixes_of_five_places_are_about_five_places() -> None:
    """Fixes that scatter about five places by less than their distance are at five to ten places."""
    rng = np.random.default_rng(1)
    places = rng.uniform(0.0, 10.0, (5, 2)).repeat(200, axis=0)
    assert 5 <= count_places(cells(places + rng.normal(size=places.shape) * 0.1, 7.0, 0.14)) <= 9
    assert count_places(cells(places, 7.0, 0.0)) == 5


def test_a_walk_is_at_many_places_and_noise_at_few() -> None:
    """A walk through the array is at many places, however they are counted; a noisy fix of one place at a few."""
    rng = np.random.default_rng(2)
    walk = np.stack([np.linspace(0.0, 10.0, 500), np.sin(np.linspace(0.0, 10.0, 500))], axis=1)
    counted = count_places(cells(walk, 7.0, 0.0))
    assert 10 <= counted <= 25
    assert count_places(reversed(cells(walk, 7.0, 0.0))) == counted
    noise = rng.normal(size=(500, 2)) * 3.0
    assert count_places(cells(noise, 7.0, 4.2)) < 10
    assert count_places([]) == 0
