"""The heaviest choice of candidates that share no echo."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from nlosctl.solvers.echoes.assignment import choose_disjoint


def heaviest(echo: np.ndarray, weight: np.ndarray) -> float:
    """Return the largest total weight of disjoint candidates, by trying every choice."""
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
    """The choice is disjoint and as heavy as the best of all choices, missed echoes and negative weights included."""
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


def test_nothing_worth_choosing_is_no_choice() -> None:
    """Candidates of negative weight, and no candidates at all, give an empty choice."""
    assert choose_disjoint(np.zeros((2, 3), dtype=np.int64), np.array([-1.0, -2.0]), 10) is not None
    chosen = choose_disjoint(np.zeros((0, 3), dtype=np.int64), np.zeros(0), 10)
    assert chosen is not None
    assert chosen.size == 0


def test_a_search_cut_short_says_so() -> None:
    """A search that looks at more choices than allowed has no answer."""
    generator = np.random.default_rng(1)
    echo, weight = generator.integers(0, 6, (60, 5)), generator.uniform(1.0, 2.0, 60)
    assert choose_disjoint(echo, weight, 5) is None
    assert choose_disjoint(echo, weight, 1_000_000) is not None


def test_candidates_far_apart_cost_no_search() -> None:
    """Two hundred candidates in clusters of their own are chosen within a few hundred looks."""
    echo = np.repeat(np.arange(200)[:, None], 4, axis=1)
    chosen = choose_disjoint(echo, np.ones(200), 1000)
    assert chosen is not None
    assert chosen.size == 200
