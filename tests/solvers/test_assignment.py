"""Maximum-weight choice of candidates that share no echo."""

from __future__ import annotations

import tracemalloc
from itertools import combinations

import numpy as np
import pytest

from nlosctl.solvers.echoes import assignment
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


def assert_disjoint(echo: np.ndarray, chosen: np.ndarray) -> None:
    """No two of the chosen candidates share an echo."""
    for taken in echo[chosen].T:
        assert np.unique(taken[taken >= 0]).size == (taken >= 0).sum()


@pytest.mark.parametrize("most", [2, 3, 6])
def test_no_other_choice_is_heavier(most: int) -> None:
    """The choice is disjoint and has the maximum weight, with missed echoes and negative weights."""
    generator = np.random.default_rng(most)
    for _ in range(60):
        echo = generator.integers(-1, most, (9, 4))
        weight = generator.uniform(-2.0, 5.0, 9)
        chosen, proven = choose_disjoint(echo, weight, 100_000)
        assert proven
        assert_disjoint(echo, chosen)
        assert weight[chosen].sum() == pytest.approx(heaviest(echo, weight))
        assert (np.diff(weight[chosen]) <= 0.0).all()


def test_the_integer_programme_agrees_with_branch_and_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    """Both searches give the same total weight for components of 60 candidates, with and without missed echoes."""
    generator = np.random.default_rng(8)
    for least in (-1, 0, 0, -1):
        echo, weight = generator.integers(least, 7, (60, 4)), generator.uniform(0.5, 4.0, 60)
        totals = []
        for size in (1000, 0):
            monkeypatch.setattr(assignment, "_MOST_SEARCHED", size)
            chosen, proven = choose_disjoint(echo, weight, 1_000_000)
            assert proven
            assert_disjoint(echo, chosen)
            totals.append(weight[chosen].sum())
        assert totals[0] == pytest.approx(totals[1], abs=1e-9)


def test_memory_grows_with_the_candidates_not_with_their_square() -> None:
    """Twenty thousand candidates of eight sensors in one component take less than 100 MB."""
    generator = np.random.default_rng(2)
    echo, weight = generator.integers(0, 30, (20_000, 8)), generator.uniform(0.0, 1.0, 20_000)
    tracemalloc.start()
    components = assignment._components(echo)
    assert [members.shape[0] for members in components] == [20_000]
    assert_disjoint(echo[np.argsort(-weight)], assignment._greedy(echo[np.argsort(-weight)]))
    assert tracemalloc.get_traced_memory()[1] < 100e6
    tracemalloc.stop()


def test_negative_weights_give_an_empty_choice() -> None:
    """Candidates of negative weight, and no candidates at all, give an empty choice, which is proven."""
    for echo, weight in ((np.zeros((2, 3)), [-1.0, -2.0]), (np.zeros((0, 3)), [])):
        chosen, proven = choose_disjoint(echo.astype(np.int64), np.array(weight), 10)
        assert chosen.size == 0
        assert proven


@pytest.mark.parametrize("searched", [1000, 0])
def test_a_truncated_search_has_the_best_choice_so_far(monkeypatch: pytest.MonkeyPatch, searched: int) -> None:
    """A search that exceeds the node limit returns a choice no lighter than the greedy one, not proven."""
    monkeypatch.setattr(assignment, "_MOST_SEARCHED", searched)
    generator = np.random.default_rng(1)
    echo, weight = generator.integers(0, 6, (60, 5)), generator.uniform(1.0, 2.0, 60)
    order = np.argsort(-weight)
    greedy = weight[order][assignment._greedy(echo[order])].sum()
    chosen, proven = choose_disjoint(echo, weight, 5)
    assert_disjoint(echo, chosen)
    assert weight[chosen].sum() >= greedy
    best, complete = choose_disjoint(echo, weight, 1_000_000)
    assert complete
    assert weight[best].sum() >= weight[chosen].sum()
    assert not proven or weight[best].sum() == pytest.approx(weight[chosen].sum())
    if searched:
        assert not proven


def test_separate_clusters_are_solved_separately() -> None:
    """Two hundred candidates in separate clusters are solved within a few nodes each."""
    echo = np.repeat(np.arange(200)[:, None], 4, axis=1)
    chosen, proven = choose_disjoint(echo, np.ones(200), 2)
    assert proven
    assert chosen.size == 200
