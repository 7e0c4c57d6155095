"""Random numbers depend only on the seed and the snapshot's number."""

from __future__ import annotations

import numpy as np
import pytest

from nlosctl.scenarios.catalogue import scenarios
from nlosctl.scenarios.spec import SNAPSHOTS_PER_BLOCK, draw_block, draw_snapshots

NAMES = list(scenarios())


def draw_table(name, seed, trials, **options):
    """Return one table of a whole draw."""
    spec = scenarios()[name]
    chunks = list(draw_snapshots(spec, spec.options(**options), seed, trials))
    return {column: np.concatenate([chunk[column] for chunk in chunks]) for column in chunks[0]}


def assert_equal(one, other):
    """Compare two tables bit by bit."""
    assert list(one) == list(other)
    for name in one:
        np.testing.assert_array_equal(one[name], other[name])


@pytest.mark.parametrize("name", NAMES)
def test_longer_draws_begin_with_shorter_ones(name):
    """More trials with the same seed leave the first snapshots unchanged, across a block boundary."""
    long, short = draw_table(name, 3, SNAPSHOTS_PER_BLOCK + 7), draw_table(name, 3, SNAPSHOTS_PER_BLOCK - 5)
    head = long["snapshot"] < SNAPSHOTS_PER_BLOCK - 5
    assert_equal({column: values[head] for column, values in long.items()}, short)


@pytest.mark.parametrize("name", NAMES)
def test_blocks_may_be_drawn_in_any_order(name):
    """A block drawn alone equals its part of the whole draw."""
    trials = 2 * SNAPSHOTS_PER_BLOCK + 3
    whole = draw_table(name, 5, trials)
    spec = scenarios()[name]
    for block in (2, 0, 1):
        part = whole["snapshot"] // SNAPSHOTS_PER_BLOCK == block
        assert_equal(
            draw_block(spec, spec.options(), 5, block, trials),
            {column: values[part] for column, values in whole.items()},
        )


@pytest.mark.parametrize("trials", [0, 1, SNAPSHOTS_PER_BLOCK, SNAPSHOTS_PER_BLOCK + 1])
def test_snapshots_are_numbered_consecutively(trials):
    """Snapshots count from 0 to trials - 1 through all blocks."""
    spec = scenarios()["song-flat"]
    chunks = [chunk["snapshot"] for chunk in draw_snapshots(spec, spec.options(), 1, trials)]
    numbers = np.concatenate([np.zeros(0, dtype=int), *chunks])
    np.testing.assert_array_equal(numbers, np.repeat(np.arange(trials), 3))


def test_seeds_and_blocks_are_independent():
    """Different seeds, large ones too, and different blocks share no bearing."""
    seeds = (0, 1, 2**32, 2**32 + 1, 2**64)
    bearings = np.concatenate([draw_table("song-flat", seed, SNAPSHOTS_PER_BLOCK + 9)["bearing_rad"] for seed in seeds])
    assert np.unique(bearings).size == bearings.size


def test_sigma_scales_the_same_noise():
    """Draws that differ only in sigma share their noise, so that sweeps compare like with like."""
    quiet, loud = (draw_table("song-flat", 2, 50, bearing_std_deg=sigma)["bearing_rad"] for sigma in (0.01, 0.02))
    silent = draw_table("song-flat", 2, 50, bearing_std_deg=1e-12)["bearing_rad"]
    np.testing.assert_allclose(loud - silent, 2.0 * (quiet - silent), atol=1e-12)
