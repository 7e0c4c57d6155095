"""What an experiment is: the declaration of one figure or table of a paper. It runs nothing by itself."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from nlosctl.arrays import IntArray, SeedArray
from nlosctl.contract.random_streams import snapshot_seeds
from nlosctl.plotting.panels import Panel
from nlosctl.reproduce.samples import Condition, Drawn, Samples, Statistic
from nlosctl.reproduce.verdicts import Expected

__all__ = ["Beside", "Chunk", "Claim", "Erratum", "Experiment", "Paper"]


@dataclass(frozen=True, kw_only=True)
class Erratum:
    """A slip in a paper's text: where it stands, what is printed, what is right and how we know."""

    where: str
    printed: str
    right: str


@dataclass(frozen=True, kw_only=True)
class Paper:
    """A paper: its short name on the command line, its reference, and where its text is in error."""

    name: str
    reference: str
    errata: tuple[Erratum, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Chunk:
    """Trials ``first`` to ``first + size`` of the ``total`` of a condition; chunk ``number`` of the run of ``seed``.

    The random numbers depend on the seed and the chunk alone: all conditions of an experiment share them, so that
    worlds which differ in one parameter are compared on the same draws.
    """

    seed: int
    number: int
    first: int
    size: int
    total: int

    def generator(self) -> np.random.Generator:
        """Return the chunk's own generator."""
        sequence = np.random.SeedSequence(entropy=self.seed, spawn_key=(self.number,))
        return np.random.Generator(np.random.Philox(sequence))

    @property
    def trials(self) -> IntArray:
        """The numbers (size,) of its trials."""
        return np.arange(self.first, self.first + self.size, dtype=np.int64)

    @property
    def trial_seeds(self) -> SeedArray:
        """A seed (size,) for each trial, for what draws trial by trial."""
        return snapshot_seeds(self.seed, self.trials)


@dataclass(frozen=True, kw_only=True)
class Claim:
    """A statement of the paper, and how our samples are held against it.

    ``ours`` is a number from the samples; ``expected`` is the range in which it must lie for the paper to be
    right, or None where the text has neither a number nor a statement that could be wrong (then ours is told alone).
    ``note`` says where the text is in error, or why the claim does not reproduce.

    ``per_trial``, of a number that is so many times a share of the trials: where none or all of n trials count,
    its standard error is taken to be ``per_trial`` / n in place of the 0 that samples without a difference give.
    """

    says: str
    where: str
    ours: Callable[[Drawn], float]
    expected: Expected | None = None
    unit: str = ""
    note: str = ""
    per_trial: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Beside:
    """What the method that we recommend in place of the paper's reaches on the same trials."""

    says: str
    ours: Callable[[Drawn], float]
    unit: str = ""


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """A figure or table, frozen.

    ``sample(condition, chunk)`` returns arrays (chunk.size,) by name, one value for each trial. ``quantities`` are the
    numbers that the figure shows: a statistic of one condition's samples by name, unit in the name. ``panels`` draws
    them. ``trials`` and ``quick_trials`` are numbers of trials for each condition, ``chunk_trials`` how many are drawn
    at a time (part of what a seed means). ``random`` is false where nothing is drawn (the trials are the points of a
    lattice): then no number has a Monte-Carlo error.
    """

    name: str
    paper: Paper
    title: str
    conditions: Sequence[Condition]
    sample: Callable[[Condition, Chunk], Samples]
    quantities: Mapping[str, Statistic]
    claims: tuple[Claim, ...]
    panels: Callable[[Drawn], Sequence[Panel]]
    trials: int
    quick_trials: int
    beside: tuple[Beside, ...] = ()
    chunk_trials: int = 500
    random: bool = True

    def chunks(self, seed: int, trials: int) -> list[Chunk]:
        """Return the chunks of each condition."""
        count = math.ceil(trials / self.chunk_trials)
        firsts = [number * self.chunk_trials for number in range(count)]
        return [
            Chunk(seed=seed, number=number, first=first, size=min(self.chunk_trials, trials - first), total=trials)
            for number, first in enumerate(firsts)
        ]

    def fingerprint(self, seed: int, trials: int, version: str) -> str:
        """Return what the samples depend on, as JSON: results with another one are never mixed in."""
        content: dict[str, Any] = {
            "experiment": self.name,
            "version": version,
            "seed": seed,
            "trials": trials,
            "chunk_trials": self.chunk_trials,
            "conditions": [dict(condition) for condition in self.conditions],
        }
        return json.dumps(content, sort_keys=True)
