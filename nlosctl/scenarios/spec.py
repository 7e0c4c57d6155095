"""The specification of a scenario, and its snapshots drawn block by block."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.contract.scene import Scene

__all__ = ["SNAPSHOTS_PER_BLOCK", "Columns", "ScenarioSpec", "draw_block", "draw_snapshots"]

Columns = Mapping[str, npt.NDArray[Any]]
"""Flat columns (N,) of a measurement file by name; ``snapshot`` counts from 0 within the call."""

SNAPSHOTS_PER_BLOCK = 1024
"""Part of the meaning of a seed: another block size gives other random numbers."""


@dataclass(frozen=True, kw_only=True)
class ScenarioSpec:
    """A scenario: a simulated world that generates measurements with their truth.

    ``options`` is a frozen dataclass whose fields are its parameters, ``scene(options)`` returns its sensors and
    reflectors, and ``generate(options, generator, snapshots)`` samples that many snapshots, using only ``generator``.
    ``further`` are the columns that it generates beside those of the contract. ``of_scene(scene)`` returns the same
    scenario in a scene of the user's own; None: it has a scene of its own. ``one_by_one`` is whether fewer snapshots of
    a block are the beginning of more, so that no more are drawn.
    """

    name: str
    kind: str
    summary: str
    reference: str
    options: type[Any]
    scene: Callable[[Any], Scene]
    generate: Callable[[Any, np.random.Generator, int], Columns]
    further: tuple[str, ...] = ()
    of_scene: Callable[[Scene], ScenarioSpec] | None = None
    one_by_one: bool = False


def draw_snapshots(spec: ScenarioSpec, options: Any, seed: int, trials: int) -> Iterator[Columns]:
    """Yield the columns of ``trials`` snapshots, numbered from 0, block by block.

    A shorter draw with the same seed is the beginning of a longer one.
    """
    for block in range(-(-trials // SNAPSHOTS_PER_BLOCK)):
        yield draw_block(spec, options, seed, block, trials)


def draw_block(spec: ScenarioSpec, options: Any, seed: int, block: int, trials: int) -> Columns:
    """Return the columns of block ``block`` of a draw of ``trials`` snapshots; blocks may be drawn in any order.

    The random numbers depend only on the seed and the block's number. A block is drawn whole, unless ``one_by_one``;
    the last one is cut after ``trials`` snapshots. ``snapshot`` is numbered over the whole draw.
    """
    sequence = np.random.SeedSequence(entropy=seed, spawn_key=(block,))
    generator = np.random.Generator(np.random.Philox(sequence))
    first = block * SNAPSHOTS_PER_BLOCK
    count = min(SNAPSHOTS_PER_BLOCK, trials - first) if spec.one_by_one else SNAPSHOTS_PER_BLOCK
    columns = spec.generate(options, generator, count)
    snapshot = columns["snapshot"] + first
    if trials >= first + SNAPSHOTS_PER_BLOCK:
        return {**columns, "snapshot": snapshot}
    wanted = snapshot < trials
    return {name: column[wanted] for name, column in {**columns, "snapshot": snapshot}.items()}
