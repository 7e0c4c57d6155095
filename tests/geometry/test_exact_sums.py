"""Exact sums: rational arithmetic is the truth."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from nlosctl.geometry.exact_sums import ExactSums


@pytest.mark.parametrize("spread", [0, 3, 100, 300])
def test_sums_are_those_of_fractions_whatever_the_order_and_the_cut(spread: int) -> None:
    """The sum is rounded once; permutations and parts give the same bits, also where terms cancel."""
    generator = np.random.default_rng(spread)
    values = generator.normal(size=(501, 2)) * 10.0 ** generator.integers(-spread, spread + 1, (501, 2))
    values[250:500] = -values[:250] * (1.0 + 1e-15)
    exact = [float(sum(map(Fraction, column), Fraction(0))) for column in values.T.tolist()]
    whole, parts = ExactSums(), ExactSums()
    whole.add("key", values)
    for part in np.array_split(generator.permutation(values), 7):
        sums = ExactSums()
        sums.add("key", part)
        parts.merge(sums)
    assert whole.sums("key") == exact == parts.sums("key")


def test_groups_have_the_sums_of_their_own_values() -> None:
    """Sums by group are those of fractions; a key without values has zeros, and parts add up."""
    generator = np.random.default_rng(5)
    values = generator.normal(size=(400, 2)) * 10.0 ** generator.integers(-40, 40, (400, 2))
    group = generator.integers(0, 5, 400)
    whole, parts = ExactSums(), ExactSums()
    whole.add_groups("abcdef", group, values)
    for part in np.array_split(generator.permutation(400), 9):
        parts.add_groups("abcdef", group[part], values[part])
    for number, key in enumerate("abcdef"):
        own = values[group == number].T.tolist()
        exact = [float(sum(map(Fraction, column), Fraction(0))) for column in own]
        assert whole.sums(key) == exact == parts.sums(key)


def test_extreme_numbers_and_keys() -> None:
    """The smallest and the largest numbers add exactly; keys are apart; an unknown key has no sums."""
    sums = ExactSums()
    sums.add("a", np.array([[5e-324], [5e-324], [1.7e308], [-1.7e308]]))
    sums.add("one", np.array([[1.7e308]]))
    sums.add("large", np.full((3, 1), 1.7e308))
    assert sums.totals["large"] == [3 * sums.totals["one"][0]]
    sums.add(3, np.array([[0.1, 0.2]]))
    sums.add("empty", np.empty((0, 2)))
    assert (sums.sums("a"), sums.sums(3), sums.sums("empty"), sums.sums("b")) == ([1e-323], [0.1, 0.2], [0.0, 0.0], [])
