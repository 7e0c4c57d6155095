"""The declaration of an experiment: one figure or table of a paper. It runs nothing by itself."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from nlosctl.arrays import IntArray
from nlosctl.plotting.panels import Panel
from nlosctl.reproduce.samples import Condition, Results, Samples, Statistic
from nlosctl.reproduce.verdicts import Expected

__all__ = ["Chunk", "Claim", "Comparison", "Erratum", "Experiment", "Paper"]


@dataclass(frozen=True)
class Erratum:
    """An error in a paper's text: its location, what is printed, what is right and why."""

    where: str
    printed: str
    right: str


@dataclass(frozen=True, kw_only=True)
class Paper:
    """A paper: its short name on the command line, its reference, and the errors in its text.

    ``ours`` lists what the text does not state or could not be read, and what stands in its place.
    """

    name: str
    reference: str
    ours: tuple[str, ...] = ()
    errata: tuple[Erratum, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Chunk:
    """Trials ``first`` to ``first + size`` of the ``total`` of a condition: chunk ``number`` of a run with ``seed``.

    The random numbers depend only on the seed and the chunk. All conditions of an experiment share them, so that worlds
    that differ in one parameter are compared with common random numbers.
    """

    seed: int
    number: int
    first: int
    size: int
    total: int

    def generator(self) -> np.random.Generator:
        """Return the chunk's random generator."""
        sequence = np.random.SeedSequence(entropy=self.seed, spawn_key=(self.number,))
        return np.random.Generator(np.random.Philox(sequence))

    @property
    def trials(self) -> IntArray:
        """The numbers (size,) of the trials."""
        return np.arange(self.first, self.first + self.size, dtype=np.int64)


@dataclass(frozen=True, kw_only=True)
class Claim:
    """A statement of the paper, in words, and its comparison with our samples.

    ``ours`` is a number from the samples; ``expected`` is the range that confirms the paper, or None if the text has
    neither a number nor a statement that could be wrong. ``note`` explains an error in the text, or why the claim does
    not reproduce.

    ``per_trial`` is for a number that is this multiple of a share of the trials: its standard error is at least
    ``per_trial`` / n, because the jackknife gives 0 if none or all of the n trials count.
    """

    text: str
    where: str
    ours: Callable[[Results], float]
    expected: Expected | None = None
    unit: str = ""
    note: str = ""
    per_trial: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """A number, on the same trials, of a method that we recommend instead of the paper's."""

    text: str
    ours: Callable[[Results], float]
    unit: str = ""


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """A figure or table.

    ``sample(condition, chunk)`` returns arrays (chunk.size,) by name, one value per trial. ``quantities`` are the
    numbers that the figure shows: statistics of one condition's samples by name, with the unit in the name. ``panels``
    draws them. ``trials`` and ``quick_trials`` are numbers of trials per condition, ``chunk_trials`` is the number
    sampled at a time (part of the meaning of a seed). ``random`` is false if the trials are the points of a lattice:
    then no number has a Monte-Carlo error. ``options`` is a class of further parameters (see
    `nlosctl.reproduce.variation`): those that differ from their defaults are in each condition.
    """

    name: str
    paper: Paper
    title: str
    conditions: Sequence[Condition]
    sample: Callable[[Condition, Chunk], Samples]
    quantities: Mapping[str, Statistic]
    claims: tuple[Claim, ...]
    panels: Callable[[Results], Sequence[Panel]]
    trials: int
    quick_trials: int
    comparisons: tuple[Comparison, ...] = ()
    chunk_trials: int = 500
    random: bool = True
    options: type[Any] | None = None

    def chunks(self, seed: int, trials: int) -> list[Chunk]:
        """Return the chunks of each condition."""
        count = math.ceil(trials / self.chunk_trials)
        firsts = [number * self.chunk_trials for number in range(count)]
        return [
            Chunk(seed=seed, number=number, first=first, size=min(self.chunk_trials, trials - first), total=trials)
            for number, first in enumerate(firsts)
        ]

    def fingerprint(self, seed: int, trials: int, version: str) -> str:
        """Return everything that the samples depend on, as JSON; stored samples with another one are not used."""
        content: dict[str, Any] = {
            "experiment": self.name,
            "version": version,
            "seed": seed,
            "trials": trials,
            "chunk_trials": self.chunk_trials,
            "conditions": [dict(condition) for condition in self.conditions],
        }
        return json.dumps(content, sort_keys=True)
