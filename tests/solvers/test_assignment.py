"""Maximum-weight choice of candidates that share no echo."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from nlosctl.solvers.echoes.assignment import choose_disjoint


def heaviest(echo: np.ndarray, weight: np.ndarray) -> float:
    """Return the maximum total weight of disjoint candidates by exhaustive enumeration."""
    count = weight.shape[0]
    clash = [[bool(((echo[i] == echo[j]) & (echo[i] >= 0)).any()) for j in range(count)] for i in range(count)]
    best = 0.0
    for size in range(1, count + 1):
        for chosen in combinations(range(count), size):
            if not any(clash[i][j] for i, j in combinations(chosen, 2)):
                best = max(best, float(weight[list(chosen)].sum()))
    return best


@pytest.mark.parametrize("most", [2, 3, 6])
def test_no_other_choice_is_heavier(most: int) -> None:
    """The choice is disjoint and has the maximum weight, with missed echoes and negative weights."""
    generator = np.random.default_rng(most)
    for _ in range(60):
        echo = generator.integers(-1, most, (9, 4))
        weight = generator.uniform(-2.0, 5.0, 9)
        chosen = choose_disjoint(echo, weight, 100_000)
        assert chosen is not None
        for i, j in combinations(chosen, 2):
            assert not ((echo[i] == echo[j]) & (echo[i] >= 0)).any()
        assert weight[chosen].sum() == pytest.approx(heaviest(echo, weight))
        assert (np.diff(weight[chosen]) <= 0.0).all()


def test_negative_weights_give_an_empty_choice() -> None:
    """Candidates of negative weight, and no candidates at all, give an empty choice."""
    assert choose_disjoint(np.zeros((2, 3), dtype=np.int64), np.array([-1.0, -2.0]), 10) is not None
    chosen = choose_disjoint(np.zeros((0, 3), dtype=np.int64), np.zeros(0), 10)
    assert chosen is not None
    assert chosen.size == 0


def test_a_truncated_search_has_no_result() -> None:
    """A search that exceeds the node limit has no result."""
    generator = np.random.default_rng(1)
    echo, weight = generator.integers(0, 6, (60, 5)), generator.uniform(1.0, 2.0, 60)
    assert choose_disjoint(echo, weight, 5) is None
    assert choose_disjoint(echo, weight, 1_000_000) is not None


def test_separate_clusters_are_solved_separately() -> None:
    """Two hundred candidates in separate clusters are solved within a few hundred nodes."""
    echo = np.repeat(np.arange(200)[:, None], 4, axis=1)
    chosen = choose_disjoint(echo, np.ones(200), 1000)
    assert chosen is not None
    assert chosen.size == 200
