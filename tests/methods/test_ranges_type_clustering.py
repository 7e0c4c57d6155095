"""Type-based clustering, compared with a slow implementation in plain Python."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import pytest
from plain_type_clustering import PlainClustering, PlainSet, elbow
from range_worlds import EchoWorld, found_sets, irregular_world, join_batches, paper_world, perimeter, solve

from nlosctl.contract.fields import BoxField
from nlosctl.methods import ranges_extended_tca, ranges_tca
from nlosctl.models.search_regions import search_region
from nlosctl.solvers.echoes.echoes import read_echoes
from nlosctl.solvers.echoes.structured_sets import cluster_echoes
from nlosctl.solvers.echoes.type_sets import Gate


def plain(world: EchoWorld, margin: float = 20.0, gap: float = 20.0) -> tuple[PlainClustering, list[list[int]]]:
    """Return the reference result of a trial and the rows of each sensor's ranges."""
    batch, box = world.batch, world.batch.field
    assert isinstance(box, BoxField)
    number, rows, ranges, places = batch.sensor[0], [], [], []
    for sensor in np.unique(number):
        own = np.flatnonzero(number == sensor)
        own = own[np.argsort(batch.range_m[0, own])]
        rows.append(own.tolist())
        ranges.append(batch.range_m[0, own].tolist())
        places.append(tuple(batch.sensor_xy_m[0, own[0]].tolist()))
    edges = (box.xmin_m - margin, box.xmax_m + margin, box.ymin_m - margin, box.ymax_m + margin)
    return PlainClustering(places, ranges, edges, gap), rows


def row_sets(kept: list[PlainSet], rows: list[list[int]]) -> set[frozenset[int]]:
    """Return the rows of each set."""
    return {frozenset(rows[n][c] for n, c in enumerate(one.circles)) for one in kept}


def worlds() -> list[EchoWorld]:
    """Return small trials of the paper's scene and of irregular layouts."""
    generator = np.random.default_rng(8)
    scatterers = perimeter(generator, 2)
    return [paper_world(generator, n, s, scatterers) for n, s in ((4, 0.1), (4, 3.0), (5, 1.0))]


@pytest.mark.parametrize("unique", ["points", "circles"])
@pytest.mark.parametrize("number", range(3))
def test_sets_agree_with_the_reference(number: int, unique: str) -> None:
    """Targets before the elbow, or a known number, have the circles of the plain implementation."""
    world = worlds()[number]
    reference, rows = plain(world)
    kept = reference.unique(unique)
    if unique == "circles":
        for eta in (10.0, 35.0):
            solution = solve(ranges_extended_tca.METHOD, world.batch, eta=eta, unique=unique)
            assert found_sets(solution) == row_sets(elbow(kept, eta), rows)
        solution = solve(ranges_tca.METHOD, world.batch, targets=2, unique=unique)
        assert found_sets(solution) == row_sets(kept[:2], rows)
    sets, places = clustered(world, unique)
    ours = list(places)
    np.testing.assert_allclose(sets.spread_m[ours], [one.spread for one in kept], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("seed", [8, 9, 10])
def test_points_are_chosen_about_the_mean_of_the_points_twice(seed: int) -> None:
    """With ranges of 15 m the roots nearest to the seed are not those nearest to the centre, nor is one step enough."""
    generator = np.random.default_rng(seed)
    world = paper_world(generator, 5, 15.0, perimeter(generator, 2))
    kept = plain(world)[0].unique("points")
    sets, places = clustered(world, "points")
    np.testing.assert_allclose(sets.spread_m[list(places)], [one.spread for one in kept], rtol=1e-9, atol=1e-9)


def clustered(world: EchoWorld, unique: str):  # type: ignore[no-untyped-def]
    """Return the structured sets and the unique sets of a trial."""
    options = ranges_tca.METHOD.options(targets=1, unique=unique)
    echoes = read_echoes(world.batch, 0, 100)
    center = np.array([echoes.center_x]), np.array([echoes.center_y])
    sensors = (world.batch.sensor_xy_m[..., 0], world.batch.sensor_xy_m[..., 1])
    region = search_region(world.batch.field, sensors, center)
    return cluster_echoes(echoes, Gate(region, options.field_margin_m), options)


def test_the_order_of_rows_does_not_matter() -> None:
    """Shuffling the rows leaves targets and estimates unchanged to the bit."""
    generator = np.random.default_rng(2)
    world = irregular_world(generator)
    first = solve(ranges_extended_tca.METHOD, world.batch, eta=25.0)
    order = generator.permutation(world.label.shape[0])
    batch = world.batch
    fields = ("sensor", "sensor_xy_m", "range_m", "range_std_m", "path", "sensor_height_m")
    shuffled = type(batch)(
        seed=batch.seed,
        field=batch.field,
        **{name: np.asfortranarray(getattr(batch, name)[:, order]) for name in fields},
    )
    second = solve(ranges_extended_tca.METHOD, shuffled, eta=25.0)
    np.testing.assert_array_equal(first.estimates.position_m, second.estimates.position_m)
    assert first.flags is not None
    assert second.flags is not None
    np.testing.assert_array_equal(first.flags.columns["target"][0, order], second.flags.columns["target"][0])


@pytest.mark.slow
def test_plain_python_is_at_least_twenty_times_slower() -> None:
    """The plain implementation takes at least twenty times as long per snapshot (K = L = 3, N = 6)."""
    generator = np.random.default_rng(4)
    scatterers = perimeter(generator, 3)
    trials = [paper_world(generator, 6, 1.0, scatterers) for _ in range(50)]
    batch = join_batches([trial.batch for trial in trials])
    ours = min(seconds(lambda: solve(ranges_extended_tca.METHOD, batch, eta=35.0)) for _ in range(5)) / len(trials)
    theirs = [seconds(lambda trial=trial: elbow(plain(trial)[0].unique("points"), 35.0)) for trial in trials[:15]]
    assert np.median(theirs) > 20.0 * ours


def seconds(work: Callable[[], object]) -> float:
    """Return how long some work takes."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start
