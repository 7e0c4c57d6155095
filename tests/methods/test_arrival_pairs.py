"""Independent differences of pairs of sensors: global minima, statuses, both solutions, calibrated covariances."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from arrival_batches import pair_batch
from range_worlds import words
from scipy.optimize import least_squares

from nlosctl.contract.batches import ArrivalBatch
from nlosctl.contract.result_checks import contract_violation
from nlosctl.contract.results import Solution
from nlosctl.contract.statuses import Status
from nlosctl.methods import arrivals_ml
from nlosctl.models.arrivals import arrival_rows
from nlosctl.solvers.arrivals.pair_graph import arrivals_of_pairs, number_places

Array = np.ndarray


def solve(batch: ArrivalBatch) -> Solution:
    """Return the solution of ml with its default options."""
    return arrivals_ml.METHOD.solve(batch, arrivals_ml.METHOD.options())


def differences(one: Array, other: Array, point: Any) -> Array:
    """Return the differences (K,) of the distances of a point from two sets of sensors."""
    place = np.asarray(point, dtype=float)
    return np.asarray(np.linalg.norm(one - place, axis=-1) - np.linalg.norm(other - place, axis=-1))


def of_ring(count: int, dimension: int = 2) -> Array:
    """Return sensors (N, D) on a circle of 100 m, in space at heights of 0 and 60 m in turn."""
    angle = 2.0 * np.pi * np.arange(count) / count
    ring = 100.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    return ring if dimension == 2 else np.column_stack([ring, 60.0 * (np.arange(count) % 2)])


def _draw(seed: int) -> tuple[Array, Array, Array, Array, Array]:
    """Return sensors and references (K, D), the source, stds and differences: a linked graph, or disjoint pairs."""
    generator = np.random.default_rng(seed)
    dimension = 2 + seed % 2
    count = dimension + 1 + seed // 2 % 4
    if seed % 5 == 0:
        ends = generator.uniform(-1.0, 1.0, (2, count, dimension))
    else:
        places = generator.uniform(-1.0, 1.0, (count, dimension))
        ends = np.stack([places, np.roll(places, 1 + seed % 2 * (count > 4), axis=0)])
    ends[..., -1] *= 0.3 if seed % 3 == 0 else 1.0
    point = generator.uniform(-1.0, 1.0, dimension) * generator.choice([0.7, 1.5])
    std = generator.uniform(0.5, 2.0, count) * generator.choice([1e-4, 3e-3, 1e-2])
    return ends[0], ends[1], point, std, differences(ends[0], ends[1], point) + std * generator.normal(size=count)


@pytest.mark.parametrize(
    "snapshots", [pytest.param(20, id="few"), pytest.param(300, marks=[pytest.mark.slow, pytest.mark.extensive])]
)
def test_ml_is_the_global_minimum(snapshots: int) -> None:
    """ML costs no more than the best of 25 scipy searches within 1e3 array sizes; at most one in a hundred differs."""
    worse = compared = 0
    for seed in range(snapshots):
        one, other, point, std, measured = _draw(seed)
        estimates = solve(pair_batch(one, other, measured[None], std)).estimates
        if not np.isfinite(estimates.cost[0]):
            continue

        def residuals(at: Array, a: Array = one, b: Array = other, d: Array = measured, s: Array = std) -> Array:
            return np.asarray((d - differences(a, b, at)) / s)

        starts = np.vstack([point, np.random.default_rng(seed).uniform(-3.0, 3.0, (25, point.size))])
        searches = [least_squares(residuals, start, x_scale="jac") for start in starts]
        least = min(search.cost for search in searches if np.abs(search.x).max() < 1e3)
        compared += 1
        worse += bool(estimates.cost[0] > least + 1e-6 * (1.0 + least))
    assert compared > 0.7 * snapshots
    assert worse <= snapshots // 100


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_tree_of_pairs_with_one_reference_is_that_of_exact_arrivals(dimension: int) -> None:
    """Without noise differences to one sensor, to the next one, or of disjoint pairs have the same fix."""
    places, point = of_ring(8, dimension), np.array([20.0, -30.0, 25.0])[:dimension]
    links = {
        "star": (np.arange(1, 8), np.zeros(7, dtype=int)),
        "ring": (np.arange(8), (np.arange(8) + 1) % 8),
        "disjoint": (np.arange(0, 8, 2), np.arange(1, 8, 2)),
    }
    for own, other in links.values():
        measured = differences(places[own], places[other], point)
        solution = solve(pair_batch(places[own], places[other], measured[None], 0.01))
        assert contract_violation(solution, (1, own.size), dimension) == ""
        assert words(solution)[0] == "ok"
        np.testing.assert_allclose(solution.estimates.position_m[0], point, atol=1e-6)
        assert np.isnan(list(solution.estimates.columns.values())).all()


def test_the_arrivals_of_a_graph_are_those_of_least_squares() -> None:
    """Arrivals at the places minimize the weighted squares of the differences; disjoint pairs are not connected."""
    generator = np.random.default_rng(8)
    places, own = generator.uniform(-1.0, 1.0, (4, 2)), np.array([0, 1, 2, 3, 0])
    other, std, measured = np.array([1, 2, 3, 0, 2]), generator.uniform(0.5, 2.0, 5), generator.normal(size=5)
    rows = arrival_rows(pair_batch(places[own], places[other], measured[None], std))
    place = number_places(rows)
    arrivals, connected = arrivals_of_pairs(rows, place)
    assert connected.all()
    incidence = np.zeros((5, 4))
    incidence[np.arange(5), place[0, :5]] += 1.0
    incidence[np.arange(5), place[0, 5:]] -= 1.0
    expected = np.linalg.lstsq(incidence / std[:, None], measured / std, rcond=None)[0]
    np.testing.assert_allclose(arrivals.arrival_m[0], expected, atol=1e-6)
    apart = arrival_rows(pair_batch(places[[0, 1]], places[[2, 3]], measured[None, :2], std[:2]))
    assert not arrivals_of_pairs(apart, number_places(apart))[1].any()


SQUARE = np.array([(0, 0), (10, 0), (10, 10), (0, 10)], dtype=float)
LINE = np.array([(0, 0), (3, 0), (7, 0), (12, 0)], dtype=float)


@pytest.mark.parametrize(
    ("places", "point", "status"),
    [
        (SQUARE, (3.0, 4.0), "ok"),
        (LINE, (4.0, 5.0), "ambiguous"),
        (LINE, (5.0, 0.0), "degenerate"),
        (LINE, (20.0, 0.0), "degenerate"),
        (np.column_stack([SQUARE, np.zeros(4)]), (3.0, 4.0, 5.0), "ambiguous"),
        (np.column_stack([SQUARE, np.zeros(4)]), (5.0, 5.0, 5.0), "degenerate"),
        (SQUARE, (3e4, 4e4), "degenerate"),
        (SQUARE[:2], (3.0, 4.0), "degenerate"),
        (SQUARE[:1], (3.0, 4.0), "too_few"),
    ],
    ids=["square", "aside", "between", "beyond", "above", "axis", "far", "one-pair-both-ways", "one-place"],
)
def test_statuses_of_arrays(places: Array, point: Any, status: str) -> None:
    """Mirror images are ambiguous with both answers; what leaves a coordinate open is degenerate, or too few."""
    other = np.roll(places, -1, axis=0)
    solution = solve(pair_batch(places, other, differences(places, other, point)[None], 0.01))
    assert contract_violation(solution, (1, len(places)), places.shape[1]) == ""
    assert words(solution)[0] == status
    if status == "ambiguous":
        mirrored = np.array([*point[:-1], -point[-1]])
        for answer in (np.asarray(point), mirrored):
            assert np.linalg.norm(solution.estimates.position_m - answer, axis=1).min() < 1e-6


def test_a_difference_longer_than_its_baseline_is_degenerate() -> None:
    """A difference of 15 m between sensors 10 m apart, of std 1 cm, fits no point."""
    measured = differences(SQUARE, np.roll(SQUARE, 1, axis=0), (3.0, 4.0))
    measured[1] = 15.0
    assert words(solve(pair_batch(SQUARE, np.roll(SQUARE, 1, axis=0), measured[None], 0.01))) == ["degenerate"]


def test_one_difference_is_too_few_and_as_many_as_unknowns_have_both_solutions() -> None:
    """Two rows suffice in the plane; hyperbolas that meet twice give ambiguous with both points."""
    places, point = np.array([(0.0, 0.0), (100.0, 0.0), (0.0, 100.0)]), np.array([-40.0, -10.0])
    own, other = places[1:], places[[0, 0]]
    assert words(solve(pair_batch(own[:1], other[:1], differences(own[:1], other[:1], point)[None]))) == ["too_few"]
    other = places[[0, 1]]
    solution = solve(pair_batch(own, other, differences(own, other, point)[None], 0.01))
    assert words(solution) == ["ambiguous", "ambiguous"]
    found = solution.estimates.position_m
    for fix in found:
        np.testing.assert_allclose(differences(own, other, fix), differences(own, other, point), atol=1e-6)
    assert np.linalg.norm(found - point, axis=1).min() < 1e-6
    assert np.linalg.norm(found[0] - found[1]) > 1.0


@pytest.mark.parametrize(
    ("dimension", "count", "pairs", "std", "z_std"),
    [(2, 6, 9, 0.5, None), (2, 10, 5, 0.5, None), (3, 8, 12, 0.5, None), (3, 6, 8, 0.5, 2.0), (3, 6, 8, 0.5, 0.0)],
    ids=["plane", "disjoint", "space", "height", "held"],
)
def test_errors_are_as_large_as_stated(dimension: int, count: int, pairs: int, std: float, z_std: float | None) -> None:
    """600 runs: NEES, RMSE over the stated one and the 95 % region are calibrated."""
    generator = np.random.default_rng(12)
    places = of_ring(count, dimension)
    if count == 2 * pairs:
        own, other = np.arange(pairs), (np.arange(pairs) + pairs) % count
    else:
        possible = np.stack(np.triu_indices(count, 1))
        own, other = possible[:, generator.permutation(possible.shape[1])[:pairs]]
    sources = generator.uniform(-60.0, 60.0, (600, dimension))
    heights: dict[str, Any] = {}
    if dimension == 3:
        sources[:, 2] = generator.uniform(0.0, 40.0, 600)
    if z_std is not None:
        heights = {"z_m": sources[:, 2] + z_std * generator.normal(size=600), "z_std_m": z_std}
    stds = std * generator.uniform(0.5, 2.0, pairs)
    exact = np.array([differences(places[own], places[other], source) for source in sources])
    measured = exact + stds * generator.normal(size=exact.shape)
    estimates = solve(pair_batch(places[own], places[other], measured, stds, **heights)).estimates
    best = (estimates.alternative == 0) & (estimates.status == Status.OK)
    row, unknowns = estimates.row[best], dimension - (z_std == 0.0)
    assert row.size > 590
    error = (estimates.position_m[best] - sources[row])[:, :unknowns]
    index = np.array([[0, 1, 3], [1, 2, 4], [3, 4, 5]])[:unknowns, :unknowns]
    covariance = estimates.covariance_m2[best][:, index]
    nees = np.einsum("bi,bij,bj->b", error, np.linalg.inv(covariance), error)
    assert abs(nees.mean() - unknowns) < 3.3 * np.sqrt(2.0 * unknowns / 600.0)
    assert 0.93 < (nees < {2: 5.991, 3: 7.815}[unknowns]).mean() < 0.975
    rms = np.sqrt((error**2).sum() / np.trace(covariance, axis1=1, axis2=2).sum())
    assert 0.93 < rms < 1.07
    chi_square = 2.0 * estimates.cost[best]
    spare = pairs + (z_std == 2.0) - dimension + (z_std == 0.0)
    assert abs(chi_square.mean() - spare) < 3.3 * np.sqrt(2.0 * spare / 600.0)
