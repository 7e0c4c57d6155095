"""The seed of a snapshot depends only on the run's seed and the snapshot's id."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nlosctl.contract.random_streams import snapshot_seeds

INTEGERS = st.lists(st.integers(-(2**63), 2**63 - 1), min_size=1, max_size=20, unique=True)
TEXTS = st.lists(st.text(max_size=8), min_size=1, max_size=20, unique=True)
SEEDS = st.integers(-(2**31), 2**31)


def ints(ids: list[int]) -> np.ndarray:
    """Return ids in the type that the pipeline uses."""
    return np.array(ids, dtype=np.int64)


@given(SEEDS, INTEGERS, st.randoms())
def test_integer_ids_in_any_order_and_company(seed: int, ids: list[int], random: object) -> None:
    """A snapshot's seed depends neither on its position nor on the other snapshots."""
    together = dict(zip(ids, snapshot_seeds(seed, ints(ids)).tolist(), strict=True))
    shuffled = ids[:]
    random.shuffle(shuffled)  # type: ignore[attr-defined]
    assert dict(zip(shuffled, snapshot_seeds(seed, ints(shuffled)).tolist(), strict=True)) == together
    assert [snapshot_seeds(seed, ints([one]))[0] for one in ids] == list(together.values())


@given(SEEDS, TEXTS)
def test_text_ids_in_any_order_and_company(seed: int, ids: list[str]) -> None:
    """The same holds for text with any characters."""
    together = snapshot_seeds(seed, ids).tolist()
    assert snapshot_seeds(seed, ids[::-1]).tolist() == together[::-1]
    assert [int(snapshot_seeds(seed, [one])[0]) for one in ids] == together


@given(SEEDS, INTEGERS)
def test_different_ids_have_different_seeds(seed: int, ids: list[int]) -> None:
    """No two snapshots of a run share a seed."""
    assert len(set(snapshot_seeds(seed, ints(ids)).tolist())) == len(ids)
    words = [str(one) for one in ids]
    assert len(set(snapshot_seeds(seed, words).tolist())) == len(ids)


@given(SEEDS, SEEDS, INTEGERS)
def test_different_runs_have_different_seeds(one: int, other: int, ids: list[int]) -> None:
    """Another seed of the run changes the seed of every snapshot; the same seed does not."""
    equal = snapshot_seeds(one, ints(ids)) == snapshot_seeds(other, ints(ids))
    assert equal.all() if one == other else not equal.any()
    equal = snapshot_seeds(one, list(map(str, ids))) == snapshot_seeds(other, list(map(str, ids)))
    assert equal.all() if one == other else not equal.any()


@pytest.mark.parametrize("as_text", [False, True])
def test_neighbouring_seeds_are_unrelated(as_text: bool) -> None:
    """Seeds of consecutive ids, and of runs with consecutive seeds, differ in half their bits."""
    ids = np.arange(4000)
    seeds = snapshot_seeds(0, [str(one) for one in ids] if as_text else ids)
    assert seeds.dtype == np.uint64
    assert seeds.shape == (4000,)
    flipped = np.bitwise_count(seeds[1:] ^ seeds[:-1])
    assert flipped.mean() == pytest.approx(32.0, abs=4 * 4 / np.sqrt(4000))
    runs = np.array([snapshot_seeds(seed, ["a"] if as_text else ints([1]))[0] for seed in range(1000)])
    assert np.bitwise_count(runs[1:] ^ runs[:-1]).mean() == pytest.approx(32.0, abs=4 * 4 / np.sqrt(1000))


def test_no_snapshot_no_seed() -> None:
    """No ids give no seeds."""
    assert snapshot_seeds(3, ints([])).shape == snapshot_seeds(3, []).shape == (0,)
