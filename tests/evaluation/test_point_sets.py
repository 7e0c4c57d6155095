"""OSPA and GOSPA, compared with brute force over all assignments and closed forms."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest

from nlosctl.evaluation.point_sets import set_distance


def brute(found: np.ndarray, true: np.ndarray, order: float, cutoff: float) -> tuple[float, float]:
    """Return OSPA and GOSPA by enumeration of all assignments of the smaller set to the larger."""
    small, large = sorted((found, true), key=len)
    if not len(large):
        return 0.0, 0.0
    ospa, gospa = np.inf, np.inf
    for chosen in permutations(range(len(large)), len(small)):
        distance = np.linalg.norm(small - large[list(chosen)], axis=1)
        powers = np.minimum(distance, cutoff) ** order
        surplus = cutoff**order * (len(large) - len(small))
        ospa = min(ospa, ((powers.sum() + surplus) / len(large)) ** (1.0 / order))
        gospa = min(gospa, (powers.sum() + 0.5 * surplus) ** (1.0 / order))
    return ospa, gospa


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("order", [1.0, 2.0])
def test_distances_agree_with_brute_force(order: float, dimension: int) -> None:
    """Both distances equal the minimum over all assignments, in space too; their parts add up in the p-th power."""
    generator = np.random.default_rng(1)
    for found_count in range(5):
        for true_count in range(5):
            found, true = (generator.uniform(0.0, 50.0, (n, dimension)) for n in (found_count, true_count))
            distance = set_distance(found, true, order=order, cutoff_m=20.0)
            ospa, gospa = brute(found, true, order, 20.0)
            assert distance.ospa_m == pytest.approx(ospa)
            assert distance.gospa_m == pytest.approx(gospa)
            assert distance.ospa_location_m**order + distance.ospa_number_m**order == pytest.approx(ospa**order)
            parts = (distance.gospa_location_m, distance.gospa_missed_m, distance.gospa_false_m)
            assert sum(part**order for part in parts) == pytest.approx(gospa**order)


def test_one_missed_target() -> None:
    """One exact and one missed target: OSPA is c / sqrt 2, all cardinality; GOSPA is c / sqrt 2, all missed."""
    true = np.array([[0.0, 0.0], [100.0, 0.0]])
    distance = set_distance(true[:1], true, order=2.0, cutoff_m=20.0)
    assert distance.ospa_m == distance.ospa_number_m == pytest.approx(20.0 / np.sqrt(2.0))
    assert distance.gospa_m == distance.gospa_missed_m == pytest.approx(20.0 / np.sqrt(2.0))
    assert distance.pairs.tolist() == [[0, 0]]


def test_a_target_without_a_position_is_false() -> None:
    """An estimated target without a position matches nothing."""
    distance = set_distance(np.array([[np.nan, np.nan]]), np.array([[0.0, 0.0]]), order=2.0, cutoff_m=20.0)
    assert distance.pairs.size == 0
    assert distance.ospa_m == pytest.approx(20.0)
    assert distance.gospa_m == pytest.approx(20.0)
