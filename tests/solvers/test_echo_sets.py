"""Steps of identification by hand: echoes of a point, roots of a structured set, the elbow of the spreads."""

from __future__ import annotations

import numpy as np
import pytest
from batches import range_batch

from nlosctl.solvers.echoes.candidates import Gates, associate
from nlosctl.solvers.echoes.echoes import read_echoes
from nlosctl.solvers.echoes.structured_sets import StructuredSets, build_sets, cut_at_elbow
from nlosctl.solvers.echoes.type_sets import CrossingTable, Seeds


@pytest.mark.parametrize(
    ("spreads", "chosen"), [([0.0, 4.0, 8.0], [0, 1]), ([0.0, 4.0, 6.9], [0, 1, 2]), ([0.0, 9.0, 9.0], [0])]
)
def test_the_elbow_compares_with_the_mean_of_the_spreads_before(spreads: list[float], chosen: list[int]) -> None:
    """(7): 8 m is 6 m above the mean of 0 and 4 m, though only 4 m above the last; the elbow is 5 m."""
    nothing = np.zeros((3, 1), dtype=np.int64)
    assert cut_at_elbow(StructuredSets(np.array(spreads), nothing, nothing), iter(range(3)), 5.0) == chosen


def test_roots_are_chosen_again_about_the_mean() -> None:
    """The root of one pair that is nearest to the seed is on the other side of the set: the mean corrects it."""
    table = np.full((2, 4, 4, 2), np.inf)
    for one in range(4):
        for other in range(one + 1, 4):
            table[0, one, other] = table[0, other, one] = (0.0, 0.0) if (one, other) == (0, 1) else (2.5, 0.0)
    table[0, 1, 2] = table[0, 2, 1] = (-3.0, 0.0)
    table[1, 1, 2] = table[1, 2, 1] = (3.1, 0.0)
    seed = Seeds(np.zeros(1), np.zeros(1), np.array([0]), np.array([1]))
    sets = build_sets(CrossingTable(4, 1, table[..., 0], table[..., 1]), np.array([[0, 1, 2, 3]]), seed)
    x = np.array([0.0, 2.5, 2.5, 3.1, 2.5, 2.5])
    assert sets.spread_m[0] == pytest.approx(np.sqrt(((x - x.mean()) ** 2).sum()), rel=1e-12)


@pytest.mark.parametrize(("off_m", "kept"), [(3.9, True), (4.1, False), (12.0, False)])
def test_an_echo_beyond_the_gate_is_left_out(off_m: float, kept: bool) -> None:
    """An echo farther from a point than the gate, in standard deviations of 1 m, is not associated with it."""
    sensors = np.array([(0.0, 0.0), (100.0, 0.0), (0.0, 100.0), (100.0, 100.0)])
    ranges = np.hypot(*((30.0, 40.0) - sensors).T)
    ranges[3] += off_m
    echoes = read_echoes(range_batch([sensors], ranges[None], 1.0), 0, 100)
    gates = Gates(min_sensors=3, gate_std=4.0, false_alarm=1e-3, least_evidence=0.0, most=100)
    found = associate(echoes, (np.array([30.0 - echoes.center_x]), np.array([40.0 - echoes.center_y])), gates)
    assert np.count_nonzero(found == -1) == (0 if kept else 1)
