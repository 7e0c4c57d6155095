"""Several targets among unlabelled echoes: direct echoes, number of targets, positions."""

from __future__ import annotations

import dataclasses
import time
from collections import Counter

import numpy as np
import pytest
from batches import range_batch
from range_worlds import (
    PAPER_FIELD,
    EchoWorld,
    echo_world,
    found_sets,
    irregular_world,
    paper_world,
    perimeter,
    solve,
    words,
)
from scipy.stats import binom

from nlosctl.contract.batches import RangeBatch
from nlosctl.contract.fields import BoxField, Field
from nlosctl.contract.statuses import Status
from nlosctl.errors import DataError
from nlosctl.methods import ranges_assignment, ranges_extended_tca, ranges_r_ls, ranges_tca
from nlosctl.scenarios import echo_field, liang
from nlosctl.scenarios.spec import Columns
from nlosctl.solvers.echoes.candidates import usual_sensors

SENSORS = np.array([(-150.0, -120.0), (140.0, -150.0), (160.0, 130.0), (-130.0, 150.0), (10.0, -170.0)])
TARGETS = np.array([(40.0, 60.0), (-90.0, 20.0)])
SCATTERERS = np.array([(200.0, 33.0), (-51.0, 200.0)])


def world(missed: tuple[tuple[int, int], ...] = (), std_m: float = 0.3):  # type: ignore[no-untyped-def]
    """Return two targets observed by five sensors with two scatterers."""
    return echo_world(np.random.default_rng(12), SENSORS, TARGETS, SCATTERERS, std_m, PAPER_FIELD, missed)


def raised(trial: EchoWorld, height_m: float) -> RangeBatch:
    """Return the same echoes from sensors above the targets: slant ranges."""
    return dataclasses.replace(
        trial.batch,
        range_m=np.hypot(trial.batch.range_m, height_m),
        sensor_height_m=np.full_like(trial.batch.range_m, height_m),
    )


def simulated(columns: Columns, snapshots: int, field: Field = PAPER_FIELD) -> RangeBatch:
    """Return the columns of simulated snapshots with the same number of rows as a batch."""
    number = np.unique(columns["sensor"].astype(str), return_inverse=True)[1]
    sensor_xy = np.stack([columns["sensor_x_m"], columns["sensor_y_m"]], axis=-1)
    return range_batch(
        sensor_xy.reshape(snapshots, -1, 2),
        columns["range_m"].reshape(snapshots, -1),
        columns["range_std_m"].reshape(snapshots, -1),
        sensor=number.reshape(snapshots, -1),
        field=field,
    )


METHODS = [(ranges_assignment, {}), (ranges_extended_tca, {"eta": 15.0}), (ranges_tca, {"targets": 2})]


@pytest.mark.parametrize(("module", "options"), METHODS, ids=["assignment", "extended-tca", "tca"])
def test_direct_echoes_are_identified(module, options) -> None:  # type: ignore[no-untyped-def]
    """Each target has exactly its direct echoes, flagged los and used; others have no target and no residual."""
    trial = world()
    solution = solve(module.METHOD, trial.batch, **options)
    assert found_sets(solution) == trial.truth_sets()
    assert solution.flags is not None
    np.testing.assert_array_equal(solution.flags.columns["los"][0], trial.label >= 0)
    np.testing.assert_array_equal(solution.flags.used[0], trial.label >= 0)
    np.testing.assert_array_equal(np.isfinite(solution.flags.columns["residual_m"][0]), trial.label >= 0)
    assert np.nanmax(np.abs(solution.flags.columns["residual_m"])) < 5 * 0.3


@pytest.mark.parametrize(("module", "options"), METHODS, ids=["assignment", "extended-tca", "tca"])
def test_slant_ranges_of_high_sensors_give_the_same_targets(module, options) -> None:  # type: ignore[no-untyped-def]
    """From 60 m above the sets are the same, with the covariance of `r-ls` on their slant ranges."""
    trial = world()
    batch = raised(trial, 60.0)
    solution = solve(module.METHOD, batch, **options)
    assert found_sets(solution) == trial.truth_sets()
    estimates = solution.estimates
    for target, rows in enumerate(sorted(trial.truth_sets(), key=lambda rows: trial.label[min(rows)])):
        alone = solve(
            ranges_r_ls.METHOD,
            range_batch(
                *(array[:, sorted(rows)] for array in (batch.sensor_xy_m, batch.range_m)),
                std_m=batch.range_std_m[:, sorted(rows)],
                height=60.0,
            ),
        ).estimates
        place = int(np.argmin(np.hypot(*(estimates.position_m - TARGETS[target]).T)))
        np.testing.assert_allclose(estimates.position_m[place], alone.position_m[0], atol=1e-4)
        np.testing.assert_allclose(estimates.covariance_m2[place], alone.covariance_m2[0], rtol=1e-4)


@pytest.mark.parametrize(("module", "options"), METHODS, ids=["assignment", "extended-tca", "tca"])
def test_targets_are_located_by_range_least_squares(module, options) -> None:  # type: ignore[no-untyped-def]
    """The estimate of each target is that of r-ls on its echoes alone."""
    trial = world()
    solution = solve(module.METHOD, trial.batch, **options)
    assert solution.flags is not None
    best = solution.estimates.alternative == 0
    assert solution.estimates.target[best].tolist() == [0, 1]
    for target, position, covariance in zip(
        solution.estimates.target, solution.estimates.position_m, solution.estimates.covariance_m2, strict=True
    ):
        rows = np.flatnonzero(solution.flags.columns["target"][0] == target)
        batch = trial.batch
        alone = solve(
            ranges_r_ls.METHOD, range_batch(batch.sensor_xy_m[:, rows], batch.range_m[:, rows], 0.3)
        ).estimates
        nearest = np.hypot(*(alone.position_m - position).T).argmin()
        np.testing.assert_allclose(position, alone.position_m[nearest], atol=1e-4)
        np.testing.assert_allclose(covariance, alone.covariance_m2[nearest], rtol=1e-4)


def test_echoes_without_a_target_give_one_empty_row() -> None:
    """Echoes that fit no target give one row without a position, and no flags."""
    generator = np.random.default_rng(3)
    number = np.repeat(np.arange(5), 4)
    batch = range_batch(SENSORS[number][None], generator.uniform(300.0, 900.0, (1, 20)), sensor=number[None])
    solution = solve(ranges_assignment.METHOD, batch)
    assert words(solution) == ["no_target"]
    assert solution.estimates.target.tolist() == [0]
    assert solution.flags is not None
    assert not solution.flags.columns["los"].any()
    assert np.isnan(solution.flags.columns["target"]).all()


@pytest.mark.parametrize("missed", [((2, 0),), ((2, 0), (4, 1))])
def test_a_sensor_may_miss_a_target(missed: tuple[tuple[int, int], ...]) -> None:
    """A target that a sensor misses is found by default, and not if ``min_sensors`` requires all."""
    trial = world(missed)
    assert found_sets(solve(ranges_assignment.METHOD, trial.batch)) == trial.truth_sets()
    assert found_sets(solve(ranges_assignment.METHOD, trial.batch, min_sensors=4)) == trial.truth_sets()
    assert len(found_sets(solve(ranges_assignment.METHOD, trial.batch, min_sensors=5))) < 2


@pytest.mark.parametrize(("detection", "least"), [(0.95, {3: 3, 4: 3, 5: 3, 6: 4, 7: 5, 8: 6}), (0.985, {6: 5, 8: 7})])
def test_the_usual_number_of_sensors(detection: float, least: dict[int, int]) -> None:
    """By default so many sensors must see a target that 99 % of targets are seen by them, and at least three."""
    for sensors, number in least.items():
        assert usual_sensors(sensors, detection) == number
        assert number == 3 or binom.sf(number - 1, sensors, detection) >= 0.99
        assert binom.sf(number, sensors, detection) < 0.99


def test_a_target_has_a_probability_of_existence() -> None:
    """Every target has a probability above a half; a clear one's is near 1; no_target has none."""
    solution = solve(ranges_assignment.METHOD, world().batch)
    existence = solution.estimates.columns["existence_probability"]
    assert existence.shape == solution.estimates.status.shape
    assert (existence > 0.99).all()
    assert (existence <= 1.0).all()


def test_pure_clutter_has_no_target() -> None:
    """Echoes with the ranges of real ones but without targets give at most .05 false targets a snapshot."""
    field = BoxField(xmin_m=0.0, xmax_m=1000.0, ymin_m=0.0, ymax_m=600.0)
    ghosts = 0
    for sensors in (3, 4, 6):
        options = echo_field.EchoFieldOptions(sensors=sensors, targets=0, false_echoes=10.0)
        columns = echo_field.generate(options, np.random.default_rng(sensors), 40)
        for number in range(40):
            here = {name: values[columns["snapshot"] == number] for name, values in columns.items()}
            ghosts += words(solve(ranges_assignment.METHOD, simulated(here, 1, field))).count("ok")
    assert ghosts <= 0.05 * 120


def test_sensors_without_echoes_are_ignored() -> None:
    """A snapshot in which a sensor has no row is solved by the others."""
    trial = world()
    keep = np.flatnonzero(trial.batch.sensor[0] != 3)
    batch = trial.batch
    less = range_batch(
        batch.sensor_xy_m[:, keep], batch.range_m[:, keep], 0.3, sensor=batch.sensor[:, keep], field=PAPER_FIELD
    )
    for module, options in METHODS:
        found = found_sets(solve(module.METHOD, less, **options))
        assert found == {frozenset(np.flatnonzero(trial.label[keep] == k).tolist()) for k in (0, 1)}


@pytest.mark.parametrize(("module", "options"), METHODS, ids=["assignment", "extended-tca", "tca"])
def test_fewer_than_three_sensors_are_too_few(module, options) -> None:  # type: ignore[no-untyped-def]
    """Echoes of two sensors give too_few."""
    number = np.array([[0, 0, 1, 1]])
    batch = range_batch(SENSORS[number], [[100.0, 200.0, 150.0, 300.0]], sensor=number)
    assert words(solve(module.METHOD, batch, **options)) == ["too_few"]


@pytest.mark.parametrize(("module", "options"), METHODS, ids=["assignment", "extended-tca", "tca"])
def test_collinear_sensors_give_both_sides(module, options) -> None:  # type: ignore[no-untyped-def]
    """Targets of collinear sensors are ambiguous: position and mirror image, if both are in the search region."""
    line = np.array([(-150.0, 0.0), (-20.0, 0.0), (90.0, 0.0), (170.0, 0.0)])
    trial = echo_world(np.random.default_rng(4), line, TARGETS[:1], np.empty((0, 2)), 0.1, PAPER_FIELD)
    options = {**options, **({"targets": 1} if "targets" in options else {})}
    solution = solve(module.METHOD, trial.batch, **options)
    first = solution.estimates.target == 0
    assert set(words(solution)) == {"ambiguous"}
    np.testing.assert_allclose(np.sort(np.abs(solution.estimates.position_m[first]), axis=0)[0], (40.0, 60.0), atol=1.0)
    upper = BoxField(xmin_m=-200.0, xmax_m=200.0, ymin_m=5.0, ymax_m=200.0)
    half = echo_world(np.random.default_rng(4), line, TARGETS[:1], np.empty((0, 2)), 0.1, upper)
    solution = solve(module.METHOD, half.batch, **options)
    assert words(solution) == ["ok"]
    np.testing.assert_allclose(solution.estimates.position_m[0], (40.0, 60.0), atol=1.0)


def test_the_number_of_echoes_has_a_limit() -> None:
    """More echoes at a sensor than ``max_echoes`` is an error that names the parameter."""
    number = np.concatenate([np.zeros(300, dtype=np.int64), [1, 2, 3]])
    batch = range_batch(SENSORS[number][None], np.linspace(50.0, 400.0, 303)[None], sensor=number[None])
    with pytest.raises(DataError, match=r"300 echoes .* max_echoes=100"):
        solve(ranges_assignment.METHOD, batch)
    assert solve(ranges_assignment.METHOD, batch, max_echoes=300).estimates.row.size >= 1


def test_the_largest_snapshots_are_solved_in_seconds() -> None:
    """Snapshots at the default limit of echoes are solved in seconds."""
    generator = np.random.default_rng(6)
    number = np.repeat(np.arange(4), 100)
    ranges = generator.uniform(50.0, 500.0, (1, 400))
    batch = range_batch(SENSORS[number][None], ranges, 0.05, sensor=number[None], field=PAPER_FIELD)
    start = time.perf_counter()
    solve(ranges_assignment.METHOD, batch)
    assert time.perf_counter() - start < 60.0


def test_candidates_beyond_the_limit_leave_the_best_and_no_proof(monkeypatch: pytest.MonkeyPatch) -> None:
    """With fewer candidates than there are, the best remain: not_proven, with position and covariance."""
    trial = world()
    free = solve(ranges_assignment.METHOD, trial.batch)
    monkeypatch.setenv("NLOSCTL_MAX_CANDIDATES", "2")
    limited = solve(ranges_assignment.METHOD, trial.batch)
    assert set(words(limited)) == {"not_proven"}
    assert np.isfinite(limited.estimates.covariance_m2).all()
    assert found_sets(limited) <= found_sets(free)
    assert set(words(free)) == {"ok"}


def test_a_truncated_search_is_not_proven() -> None:
    """If ``max_nodes`` is exceeded the best targets found are not_proven, with position and covariance."""
    options = liang.LiangOptions(sensors=5, targets=4, scatterers=4, nlos_range="half")
    columns = liang.generate(options, np.random.default_rng(3), 12)
    counts = Counter[str]()
    for limit in (1, 100_000):
        solution = solve(ranges_assignment.METHOD, simulated(columns, 12), max_nodes=limit, scatterers=False)
        counts.update(f"{limit} {word}" for word in words(solution))
        unproven = solution.estimates.status == Status.NOT_PROVEN
        assert np.isfinite(solution.estimates.position_m[unproven]).all()
        assert np.isfinite(solution.estimates.covariance_m2[unproven]).all()
    assert counts["1 not_proven"] > 0
    assert counts["100000 not_proven"] == 0
    assert counts["1 no_target"] == counts["100000 no_target"]


def test_irregular_layouts_are_identified() -> None:
    """With 4 to 7 sensors and 1 to 5 targets, assignment finds the number of targets and their echoes."""
    right = exact = 0
    for trial in range(40):
        irregular = irregular_world(np.random.default_rng([trial, 3]))
        found = found_sets(solve(ranges_assignment.METHOD, irregular.batch))
        right += len(found) == irregular.targets.shape[0]
        exact += found == irregular.truth_sets()
    assert right >= 39
    assert exact >= 37


def test_many_sensors_need_only_some_of_their_crossings(monkeypatch: pytest.MonkeyPatch) -> None:
    """With 40 sensors, some blind to a target, 20 sensors' crossings lead to what those of all lead to."""
    for trial in range(3):
        generator = np.random.default_rng([trial, 40])
        sensors = generator.uniform(-200.0, 200.0, (40, 2))
        targets = generator.uniform(-150.0, 150.0, (3, 2))
        missed = tuple((int(sensor), k) for k in range(3) for sensor in generator.choice(40, 2, replace=False))
        many = echo_world(generator, sensors, targets, perimeter(generator, 2), 0.3, PAPER_FIELD, missed)
        found = found_sets(solve(ranges_assignment.METHOD, many.batch))
        with monkeypatch.context() as patch:
            patch.setattr(ranges_assignment, "_SEEDING_SENSORS", 40)
            assert found_sets(solve(ranges_assignment.METHOD, many.batch)) == found
        assert len(found) == 3


def test_a_shared_row_is_that_of_the_nearest_target() -> None:
    """Two targets that share a circle (``unique=points``): its flag and residual belong to the target it fits best.

    A target whose sensor has no flagged row shares a row of that sensor with a target that is at least as near to it.
    """
    generator = np.random.default_rng(3)
    scatterers = perimeter(generator, 3)
    shared = 0
    for _ in range(20):
        batch = paper_world(generator, 4, 3.0, scatterers).batch
        solution = solve(ranges_tca.METHOD, batch, targets=3)
        assert solution.flags is not None
        best = solution.estimates.alternative == 0
        apart = solution.estimates.position_m[best][:, None] - batch.sensor_xy_m[0]
        residual = np.abs(batch.range_m[0] - np.hypot(*np.moveaxis(apart, -1, 0)))  # (targets, rows)
        flagged = solution.flags.columns["target"][0]
        for target in range(best.sum()):
            for sensor in np.unique(batch.sensor[0]):
                rows = np.flatnonzero((batch.sensor[0] == sensor) & np.isfinite(flagged))
                if not (flagged[rows] == target).any():
                    owners = flagged[rows].astype(int)
                    assert (residual[owners, rows] <= residual[target, rows]).any()
                    shared += 1
        used = np.flatnonzero(solution.flags.used[0])
        stated = np.abs(solution.flags.columns["residual_m"][0, used])
        np.testing.assert_allclose(stated, residual[flagged[used].astype(int), used], atol=1e-6)
    assert shared >= 5


def test_the_papers_scene_is_identified() -> None:
    """Five sensors at 0 dB: assignment finds three targets and, in most trials, all their echoes."""
    generator = np.random.default_rng(21)
    scatterers = perimeter(generator, 3)
    exact = 0
    for _ in range(30):
        trial = paper_world(generator, 5, 1.0, scatterers)
        found = found_sets(solve(ranges_assignment.METHOD, trial.batch))
        assert len(found) == 3
        exact += found == trial.truth_sets()
    assert exact >= 24


def test_delays_times_half_the_speed_of_light_are_identified() -> None:
    """Where scattered ranges are half the sum of the legs, scatterers explain them: two in three trials are exact."""
    exact = {True: 0, False: 0}
    for seed in (0, 1):
        options = liang.LiangOptions(nlos_range="half", scatterer_seed=seed)
        columns = liang.generate(options, np.random.default_rng(seed), 15)
        target = np.where(columns["truth_los"], columns["truth_target"], np.nan).reshape(15, -1)
        for scatterers in exact:
            solution = solve(ranges_assignment.METHOD, simulated(columns, 15), scatterers=scatterers)
            assert solution.flags is not None
            for ours, true in zip(solution.flags.columns["target"], target, strict=True):
                sets = [{frozenset(np.flatnonzero(row == k)) for k in row[np.isfinite(row)]} for row in (ours, true)]
                exact[scatterers] += sets[0] == sets[1]
    assert exact[True] >= 20
    assert exact[True] >= exact[False] + 3
