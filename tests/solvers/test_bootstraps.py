"""Number of bootstraps, (27)-(31), and thresholds, (25)."""

from __future__ import annotations

import math
from itertools import combinations, product

import numpy as np
import pytest

from nlosctl.solvers.sequential.hypotheses import bearing_threshold_rad, range_threshold_m
from nlosctl.solvers.sequential.starting_pairs import (
    bootstrap_failure,
    count_bootstraps,
    count_path_bootstraps,
    few_direct_sensors,
    path_bootstrap_failure,
    shuffled_pairs,
)


@pytest.mark.parametrize(("outliers", "bootstraps"), [(1, 2), (2, 1), (2, 3), (3, 2)])
def test_failure_probability_counts_sets_of_bad_pairs(outliers: int, bootstraps: int) -> None:
    """(27), printed upside down, is the share of sets of pairs in which every pair contains an outlier."""
    pairs = list(combinations(range(8), 2))
    chosen = list(combinations(pairs, bootstraps))
    bad = sum(all(min(pair) < outliers for pair in choice) for choice in chosen)
    assert bootstrap_failure(8, outliers / 8, bootstraps) == pytest.approx(bad / len(chosen))


@pytest.mark.parametrize("outliers", [1, 2, 3, 4])
def test_failure_probability_is_between_its_bounds(outliers: int) -> None:
    """(31) is below and (30) above, as long as there are fewer bootstraps than bad pairs."""
    pairs = math.comb(8, 2)
    bad = pairs - math.comb(8 - outliers, 2)
    for bootstraps in range(1, bad + 1):
        failure = bootstrap_failure(8, outliers / 8, bootstraps)
        low = ((bad - bootstraps + 1) / (pairs - bootstraps + 1)) ** bootstraps
        assert low <= failure * (1.0 + 1e-12)
        assert failure <= (bad / pairs) ** bootstraps * (1.0 + 1e-12)


def test_erratum_bootstraps_for_a_failure_probability_of_1e_3() -> None:
    """Erratum: the paper's {4, 7, 11, 15} give more than 1e-3; the smallest that do not are {5, 8, 12, 18}."""
    assert [count_bootstraps(8, k / 8, 1e-3) for k in (1, 2, 3, 4)] == [5, 8, 12, 18]
    printed = [bootstrap_failure(8, k / 8, m) for k, m in zip((1, 2, 3, 4), (4, 7, 11, 15), strict=True)]
    np.testing.assert_allclose(printed, [1.7e-3, 1.4e-3, 1.5e-3, 4.5e-3], rtol=0.05)


@pytest.mark.parametrize("bootstraps", [1, 2, 3])
def test_failure_probability_of_several_paths_counts_pairs_of_direct_paths(bootstraps: int) -> None:
    """3 sensors with 2 paths: the share of sets of pairs without two direct paths, over all blockings of sensors."""
    alpha, paths = 0.3, [(sensor, path) for sensor in range(3) for path in range(2)]
    pairs = [pair for pair in combinations(paths, 2) if pair[0][0] != pair[1][0]]
    chosen = list(combinations(pairs, bootstraps))
    failed = possible = 0.0
    for seen in product([False, True], repeat=3):  # the direct path of a sensor that is not blocked is path 0
        weight = math.prod(1.0 - alpha if direct else alpha for direct in seen)
        if sum(seen) < 2:
            continue
        good = {pair for pair in pairs if all(seen[sensor] and path == 0 for sensor, path in pair)}
        possible += weight
        failed += weight * sum(good.isdisjoint(choice) for choice in chosen) / len(chosen)
    assert few_direct_sensors(3, alpha) == pytest.approx(1.0 - possible)
    assert path_bootstrap_failure(3, len(pairs), alpha, bootstraps) == pytest.approx(failed / possible)


@pytest.mark.parametrize(
    ("sensors", "paths", "alpha", "least"), [(4, 2, 0.1, 24), (6, 3, 0.1, 91), (10, 4, 0.25, 349), (2, 1, 0.25, 1)]
)
def test_bootstraps_with_several_paths(sensors: int, paths: int, alpha: float, least: int) -> None:
    """The count is the least with a failure probability of at most 1e-3: 4 sensors with 2 paths need all pairs."""
    pairs = math.comb(sensors, 2) * paths**2
    assert count_path_bootstraps(sensors, pairs, alpha, 1e-3) == least
    assert path_bootstrap_failure(sensors, pairs, alpha, least) <= 1e-3
    assert least == 1 or path_bootstrap_failure(sensors, pairs, alpha, least - 1) > 1e-3


def test_bootstraps_of_thousands_of_sensors() -> None:
    """Of 3000 sensors with 4 paths nearly the share (1 - alpha)^2 / 16 of the pairs is right: powers of the rest."""
    pairs, right = math.comb(3000, 2) * 16, (0.75 / 4.0) ** 2
    assert path_bootstrap_failure(3000, pairs, 0.25, 50) == pytest.approx((1.0 - right) ** 50, rel=0.01)
    assert abs(count_path_bootstraps(3000, pairs, 0.25, 1e-3) - math.log(1e-3) / math.log1p(-right)) < 2.0


def test_all_pairs_are_different_and_differ_by_seed() -> None:
    """The pairs of a snapshot are a permutation of all pairs, drawn from the seed of the snapshot."""
    first, second = shuffled_pairs(np.array([1, 2, 1], dtype=np.uint64), 6, 5000)
    for row in range(3):
        assert sorted(zip(first[row], second[row], strict=True)) == list(combinations(range(6), 2))
    assert np.array_equal(first[0], first[2])
    assert not np.array_equal(first[0], first[1])


@pytest.mark.parametrize("alpha", [0.05, 0.25, 0.5])
def test_bearing_threshold_is_where_both_densities_are_equal(alpha: float) -> None:
    """At (25), corrected to sqrt(2) alpha, a direct row is as likely as an outlier."""
    std = np.radians([0.5, 4.0, 10.0])
    angle = bearing_threshold_rad(std, alpha, 180.0)
    inside = np.array([math.erf(math.pi / (2.0 * math.sqrt(2.0) * s)) for s in std])
    direct = (1.0 - alpha) * np.exp(-0.5 * (angle / std) ** 2) / (std * np.sqrt(2.0 * np.pi) * inside)
    np.testing.assert_allclose(direct, alpha / np.pi, rtol=1e-12)


def test_thresholds_are_zero_if_outliers_are_always_likelier() -> None:
    """A negative logarithm in (25) means that no row can be an inlier; a row without a range has no limit."""
    assert bearing_threshold_rad(np.array([1.5]), 0.9, 180.0)[0] == 0.0
    assert range_threshold_m(np.array([100.0]), 0.9, np.array([50.0]))[0] == 0.0
    assert np.isinf(range_threshold_m(np.array([np.nan]), 0.25, np.array([50.0]))[0])
