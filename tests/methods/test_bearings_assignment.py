"""``assignment`` on bearings: sets of rows, their weights and choice, fixes, and what it does with bad input."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations, product
from math import log, pi
from typing import Any

import numpy as np
import pytest
from plain_sources import Row, Rule, Snapshot
from scenario_draws import draw_columns
from scipy.optimize import least_squares
from scipy.stats import chi2
from unlabelled_bearings import FIELD, batch_of, blocks, numbered, scored

from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.options import parse_options
from nlosctl.contract.results import Flags, Solution
from nlosctl.contract.statuses import Status
from nlosctl.errors import DataError, UsageError
from nlosctl.methods.bearings_assignment import AssignmentOptions, solve
from nlosctl.solvers.association import source_sets
from nlosctl.solvers.association.pruning import rival_sets
from nlosctl.solvers.echoes.assignment import choose_disjoint

RULE = Rule(field=(-100.0, 1100.0, -100.0, 1100.0), area_m2=1200.0**2, sources=float(np.exp(1.1)), least_range_m=5.0)
HARD = {"targets": 4, "least_targets": 0, "false_bearings": 1.0, "detection_probability": 0.9}


def rows_of(batch: BearingBatch, snapshot: int) -> list[Row]:
    """Return the rows of a snapshot for the plain implementation."""
    numbers = zip(
        batch.sensor[snapshot].tolist(),
        batch.sensor_xy_m[snapshot].tolist(),
        batch.bearing_rad[snapshot].tolist(),
        batch.bearing_std_rad[snapshot].tolist(),
        strict=True,
    )
    return [Row(sensor, *place, bearing, std) for sensor, place, bearing, std in numbers]


def sets_of(flags: Flags | None, snapshot: int) -> set[frozenset[int]]:
    """Return the rows of each target."""
    assert flags is not None
    target = numbered(flags.columns["target"][snapshot])
    return {frozenset(np.flatnonzero(target == number).tolist()) for number in np.unique(target[target >= 0])}


@pytest.mark.extensive
@pytest.mark.parametrize("world", [{"targets": 3}, HARD, {"sensors": 4, "targets": 3, "angle_std_deg": 0.5}])
def test_the_sets_are_those_of_the_plain_implementation(world: dict[str, Any]) -> None:
    """Another implementation of the rule, one snapshot at a time, chooses the same rows."""
    same = total = 0
    for rows, batch in blocks(draw_columns("bearing-field", 12, seed=11, **world)):
        solution = solve(batch, AssignmentOptions())
        for snapshot in range(rows.shape[0]):
            chosen, _ = Snapshot(rows_of(batch, snapshot), RULE).find()
            same += sets_of(solution.flags, snapshot) == set(map(frozenset, chosen))
            total += 1
    assert total >= 10
    assert same >= total - 1


def test_tiny_snapshots_have_the_best_of_all_partitions() -> None:
    """With three sensors the choice is the heaviest of all choices of disjoint triples, by brute force and scipy."""
    columns = draw_columns("bearing-field", 6, seed=4, sensors=3, targets=2, angle_std_deg=2.0, false_bearings=0.2)
    found = 0
    for rows, batch in blocks(columns):
        solution = solve(batch, AssignmentOptions())
        for snapshot in range(rows.shape[0]):
            best = best_triples(rows_of(batch, snapshot))
            assert sets_of(solution.flags, snapshot) == best
            found += len(best)
    assert found >= 6


def best_triples(rows: list[Row]) -> set[frozenset[int]]:
    """Return the heaviest disjoint triples of rows of three sensors, all of them tried."""
    owned = [[index for index, row in enumerate(rows) if row.sensor == sensor] for sensor in range(3)]
    clutter = max(len(rows) / 3.0, 1.0) / (2.0 * pi)
    weights = {}
    for triple in product(*owned):
        own = [rows[index] for index in triple]
        fits = [least_squares(scaled_residuals, start, args=(own,), xtol=1e-12, ftol=1e-12) for start in STARTS]
        best = min(fits, key=lambda fit: fit.cost)
        if 2.0 * best.cost <= chi2.isf(1e-5, 1) and all(row.points_at(*best.x) for row in own) and RULE.inside(*best.x):
            gradients = np.array([np.array(row.gradient(*best.x)) / row.std for row in own])
            spread = log(2.0 * pi) - 0.5 * log(np.linalg.det(gradients.T @ gradients))
            seen = sum(log(0.9 / clutter) - log(np.sqrt(2.0 * pi) * row.std) for row in own)
            weights[frozenset(triple)] = seen - best.cost + log(RULE.sources / RULE.area_m2) + spread
    weights = {triple: weight for triple, weight in weights.items() if weight > 0.0}
    choices = [
        choice
        for size in range(4)
        for choice in combinations(weights, size)
        if sum(map(len, choice)) == len(frozenset().union(*choice))
    ]
    return set(max(choices, key=lambda choice: sum(weights[triple] for triple in choice)))


STARTS = ((500.0, 500.0), (250.0, 750.0))


def scaled_residuals(point: Any, rows: list[Row]) -> list[float]:
    """Return the residuals over their standard deviations."""
    return [row.residual(*point) / row.std for row in rows]


def test_the_order_of_rows_does_not_matter() -> None:
    """Rows in another order have the same targets, and their estimates the same bits."""
    generator = np.random.default_rng(3)
    for rows, batch in blocks(draw_columns("bearing-field", 30, seed=5, **HARD)):
        order = np.stack([generator.permutation(rows.shape[1]) for _ in rows])
        columns = draw_columns("bearing-field", 30, seed=5, **HARD)
        shuffled = batch_of(columns, np.take_along_axis(rows, order, axis=1))
        first, second = solve(batch, AssignmentOptions()), solve(shuffled, AssignmentOptions())
        assert first.flags is not None
        assert second.flags is not None
        moved = np.take_along_axis(first.flags.columns["target"], order, axis=1)
        np.testing.assert_array_equal(moved, second.flags.columns["target"])
        np.testing.assert_array_equal(first.estimates.position_m, second.estimates.position_m)


def test_each_target_is_the_maximum_of_its_rows() -> None:
    """Positions minimize the chi-square of the flagged rows; covariances invert their information."""
    checked = 0
    for _, batch in blocks(draw_columns("bearing-field", 40, seed=8, **HARD)):
        solution = solve(batch, AssignmentOptions())
        estimates, flags = solution.estimates, solution.flags
        assert flags is not None
        for index in np.flatnonzero(estimates.status == Status.OK):
            snapshot, place = int(estimates.row[index]), estimates.position_m[index]
            mine = numbered(flags.columns["target"][snapshot]) == estimates.target[index]
            own = [row for row, is_mine in zip(rows_of(batch, snapshot), mine, strict=True) if is_mine]
            assert len({row.sensor for row in own}) == len(own) == estimates.n_used[index] >= 3
            gradients = np.array([np.array(row.gradient(*place)) / row.std for row in own])
            scaled = np.array([row.residual(*place) / row.std for row in own])
            covariance = np.linalg.inv(gradients.T @ gradients)
            slope = gradients.T @ scaled
            assert slope @ covariance @ slope < 1e-4**2
            np.testing.assert_allclose(estimates.covariance_m2[index], covariance[[0, 0, 1], [0, 1, 1]], rtol=1e-2)
            residual = flags.columns["residual_rad"][snapshot][mine]
            np.testing.assert_allclose(residual, [row.residual(*place) for row in own], atol=1e-9)
            checked += 1
        assert (flags.used == (numbered(flags.columns["target"]) >= 0)).all()
    assert checked > 40


@pytest.mark.extensive
@pytest.mark.parametrize(
    ("world", "exact", "number", "gospa_m"),
    [
        ({"targets": 3}, 0.72, 0.97, 12.8),
        (HARD, 0.57, 0.87, 13.8),
        (
            {"sensors": 4, "targets": 3, "least_targets": 1, "angle_std_deg": 0.5, "false_bearings": 0.5},
            0.85,
            0.96,
            8.4,
        ),
    ],
)
def test_several_sources_are_identified(world: dict[str, Any], exact: float, number: float, gospa_m: float) -> None:
    """Exact identification, number and GOSPA hold the limits; NEES of pure targets is that of two unknowns."""
    scores, nees = scored(AssignmentOptions(), 150, seed=21, **world)
    assert scores.exact >= exact - 0.04
    assert scores.number_right >= number - 0.02
    assert scores.gospa_m <= gospa_m + 0.7
    assert scores.los_precision >= 0.95
    assert scores.los_recall >= 0.95
    assert 1.6 < nees < 2.5


def test_azimuths_and_elevations_find_sources_in_space() -> None:
    """With elevations nearly every snapshot is identified exactly, and the NEES is that of three unknowns."""
    world = {"dimensions": 3, "targets": 3, "false_bearings": 1.0, "detection_probability": 0.9}
    scores, nees = scored(AssignmentOptions(), 60, seed=2, **world)
    assert scores.exact > 0.85
    assert scores.number_right > 0.97
    assert 2.4 < nees < 3.6


def test_flags_in_space_have_both_residuals() -> None:
    """Residuals of azimuths and elevations are columns of the flags in space, also where no source is found."""
    for targets in (0, 2):
        world = {"dimensions": 3, "targets": targets, "false_bearings": 0.5, "angle_std_deg": 0.2}
        for _, batch in blocks(draw_columns("bearing-field", 2, seed=3, **world)):
            flags = solve(batch, AssignmentOptions()).flags
            assert flags is not None
            assert set(flags.columns) == {"los", "target", "residual_rad", "residual_elevation_rad"}
            for name in ("residual_rad", "residual_elevation_rad"):
                assert (np.isfinite(flags.columns[name]) == flags.columns["los"]).all()


def test_few_sensors_have_no_target() -> None:
    """One or two sensors, whose rays always cross, and a least number of sensors that is not there: no_target."""
    for sensors, options in ((1, {}), (2, {}), (6, {"min_sensors": 7})):
        columns = draw_columns("bearing-field", 5, sensors=sensors)
        for rows, batch in blocks(columns):
            assert_no_target(solve(batch, AssignmentOptions(**options)), rows.shape)


def assert_no_target(solution: Solution, shape: tuple[int, ...]) -> None:
    """Assert one estimate a snapshot, without a target, and no direct row."""
    assert solution.flags is not None
    assert solution.estimates.row.tolist() == list(range(shape[0]))
    assert (solution.estimates.status == Status.NO_TARGET).all()
    assert not solution.flags.columns["los"].any()
    assert np.isnan(solution.flags.columns["target"]).all()


def test_clutter_and_empty_fields_have_no_target() -> None:
    """Clutter alone, and a field that contains no crossing, have one estimate: no_target."""
    columns = draw_columns("bearing-field", 20, seed=6, targets=0, false_bearings=0.5)
    empty = [solve(batch, AssignmentOptions()).estimates.status for _, batch in blocks(columns)]
    assert np.mean(np.concatenate(empty) == Status.NO_TARGET) > 0.9
    for rows, batch in blocks(draw_columns("bearing-field", 5)):
        away = replace(FIELD, xmin_m=9000.0, xmax_m=9100.0)
        assert_no_target(solve(replace(batch, field=away), AssignmentOptions()), rows.shape)


def test_rays_have_a_direction() -> None:
    """Bearings turned round point away from each other: no_target."""
    for rows, batch in blocks(draw_columns("bearing-field", 10, angle_std_deg=0.2)):
        turned = replace(batch, bearing_rad=batch.bearing_rad + pi)
        assert_no_target(solve(turned, AssignmentOptions()), rows.shape)


def test_one_bearing_twice_has_two_owners_at_most() -> None:
    """A repeated row is another row of its sensor, which the same source does not take too."""
    columns = draw_columns("bearing-field", 1, targets=1, angle_std_deg=0.3)
    (rows, _), *_ = blocks(columns)
    solution = solve(batch_of(columns, np.concatenate([rows, rows], axis=1)), AssignmentOptions())
    target = numbered(solution.flags.columns["target"][0]) if solution.flags is not None else np.empty(0)
    assert [np.count_nonzero(target == number) for number in (0, 1)] == [6, 6]
    assert (np.sort(target.reshape(2, -1), axis=0) == [[0], [1]]).all()


def test_a_sensor_is_a_name_and_a_place() -> None:
    """A sensor that moves within a snapshot may see a source from each of its places."""
    (_, batch), *_ = blocks(draw_columns("bearing-field", 1, targets=1, angle_std_deg=0.3))
    solution = solve(replace(batch, sensor=np.zeros_like(batch.sensor)), AssignmentOptions())
    assert solution.estimates.n_used.tolist() == [6]


def test_too_many_bearings_of_a_sensor_are_an_error() -> None:
    """More than ``max_echoes`` rows of a sensor stop the run with the number and the cure."""
    for _, batch in blocks(draw_columns("bearing-field", 1, targets=3)):
        with pytest.raises(DataError, match="3 bearings in one snapshot, more than max_echoes=2"):
            solve(batch, AssignmentOptions(max_echoes=2))


def test_too_many_sets_are_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """Hundreds of sensors in a snapshot stop the run with their number, not with the end of the memory."""
    (_, batch), *_ = blocks(draw_columns("bearing-field", 1, targets=2))
    monkeypatch.setattr(source_sets, "_MOST_NUMBERS", 100)
    with pytest.raises(DataError, match=f"{batch.measurements} bearings of 6 sensors has more sets"):
        solve(batch, AssignmentOptions())


def test_sets_with_fewer_sensors_do_not_depend_on_the_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each set of enough sensors without one and without two of those it has, a few sets at a time."""
    rows = np.random.default_rng(1).integers(-1, 9, (40, 6))
    found = list(zip(*source_sets._with_fewer_sensors(rows, 3), strict=True))
    monkeypatch.setattr(source_sets, "_MOST_NUMBERS", 300)
    for (source, fewer), (own, other) in zip(
        found, zip(*source_sets._with_fewer_sensors(rows, 3), strict=True), strict=True
    ):
        assert source == own
        assert fewer.tolist() == other.tolist()
    expected = sum(
        np.count_nonzero(row >= 0) - size >= 3
        for row in rows
        for size in (1, 2)
        for some in combinations(range(6), size)
        if (row[list(some)] >= 0).all()
    )
    assert len(found) == expected


def test_a_pair_of_sensors_is_refused() -> None:
    """Two sensors always agree: ``min_sensors`` below 3 is a usage error."""
    with pytest.raises(UsageError, match="min_sensors"):
        parse_options(AssignmentOptions, {"min_sensors": 2}, owner="assignment")


@pytest.mark.parametrize("seed", range(6))
def test_pruned_sets_hold_the_best_choice(seed: int) -> None:
    """Sets that prices rule out are in no heavier choice than the one that stays."""
    generator = np.random.default_rng(seed)
    rows = generator.integers(-1, 4, (60, 5))
    rows[rows >= 0] += np.broadcast_to(4 * np.arange(5), rows.shape)[rows >= 0]
    rows = rows[(rows >= 0).sum(axis=1) >= 3]
    weight = generator.exponential(3.0, rows.shape[0]) * (rows >= 0).sum(axis=1)
    chosen, rivals = rival_sets(rows, weight)
    whole = choose_disjoint(rows, weight, 10**6)
    left = np.union1d(chosen, rivals)
    part = choose_disjoint(rows[left], weight[left], 10**6)
    assert whole.proven
    assert weight[left][part.indices].sum() == pytest.approx(weight[whole.indices].sum())
    assert left.size < rows.shape[0]
