"""Drawing the snapshots of a scenario, in blocks whose random numbers depend on the seed and their place alone."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from nlosctl.scenarios.spec import Columns, ScenarioSpec

__all__ = ["SNAPSHOTS_PER_BLOCK", "draw_block", "draw_snapshots"]

SNAPSHOTS_PER_BLOCK = 1024
"""Part of what a seed means: another number gives other random numbers."""


def draw_snapshots(spec: ScenarioSpec, options: Any, seed: int, trials: int) -> Iterator[Columns]:
    """Yield the columns of ``trials`` snapshots, numbered from 0, a block at a time.

    The first snapshots of a longer draw are those of a shorter one with the same seed.
    """
    for block in range(-(-trials // SNAPSHOTS_PER_BLOCK)):
        yield draw_block(spec, options, seed, block, trials)


def draw_block(spec: ScenarioSpec, options: Any, seed: int, block: int, trials: int) -> Columns:
    """Return the columns of block ``block`` of a draw of ``trials`` snapshots; blocks may be drawn in any order.

    A block is always drawn whole, from a generator of its own, and the last one is cut after ``trials``
    snapshots. Each row's ``snapshot`` is its number in the whole draw.
    """
    sequence = np.random.SeedSequence(entropy=seed, spawn_key=(block,))
    generator = np.random.Generator(np.random.Philox(sequence))
    columns = spec.generate(options, generator, SNAPSHOTS_PER_BLOCK)
    first = block * SNAPSHOTS_PER_BLOCK
    snapshot = columns["snapshot"] + first
    if trials >= first + SNAPSHOTS_PER_BLOCK:
        return {**columns, "snapshot": snapshot}
    wanted = snapshot < trials
    return {name: column[wanted] for name, column in {**columns, "snapshot": snapshot}.items()}
