"""The samples of an experiment by condition, what is computed of them, and its Monte-Carlo standard error."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray
from nlosctl.reproduce.jackknife import GROUPS, jackknife_error

__all__ = [
    "Condition",
    "Drawn",
    "Measured",
    "Samples",
    "Statistic",
    "conditions",
    "measure",
    "median",
    "median_of",
    "rms",
    "rms_of",
    "share",
    "share_of",
]

Condition = Mapping[str, float | int | str]
Samples = Mapping[str, FloatArray]
"""Arrays (trials,) by name; NaN where a trial has no value, as where a method gave no fix."""
Statistic = Callable[[Samples], float]


def conditions(**values: Sequence[float | int | str]) -> list[Condition]:
    """Return every combination of the values, the last name running fastest."""
    found: list[dict[str, float | int | str]] = [{}]
    for name, options in values.items():
        found = [{**condition, name: option} for condition in found for option in options]
    return list(found)


@dataclass(frozen=True, kw_only=True)
class Drawn:
    """The samples of all conditions."""

    conditions: Sequence[Condition]
    samples: Sequence[Samples]
    random: bool = True

    def of(self, **keys: float | int | str) -> Samples:
        """Return the samples of the one condition with these values; raises KeyError where there is not one."""
        found = [samples for _, samples in self.where(**keys)]
        if len(found) != 1:
            raise KeyError(f"{len(found)} conditions with {keys}")
        return found[0]

    def where(self, **keys: float | int | str) -> Iterator[tuple[Condition, Samples]]:
        """Yield the conditions with these values, and their samples, in order."""
        for condition, samples in zip(self.conditions, self.samples, strict=True):
            if all(condition[name] == value for name, value in keys.items()):
                yield condition, samples

    def without(self, group: int) -> Drawn:
        """Return the samples without every trial whose number is ``group`` modulo the number of jackknife groups."""
        return Drawn(
            conditions=self.conditions, samples=[_Without(part, group) for part in self.samples], random=self.random
        )


class _Without(Mapping[str, FloatArray]):
    """Samples without a group of trials, cut when they are read."""

    def __init__(self, samples: Samples, group: int) -> None:
        self._samples, self._group = samples, group

    def __getitem__(self, name: str) -> FloatArray:
        values = self._samples[name]
        left: FloatArray = values[_kept(values.shape[0], self._group)]
        return left

    def __iter__(self) -> Iterator[str]:
        return iter(self._samples)

    def __len__(self) -> int:
        return len(self._samples)


@lru_cache(maxsize=2 * GROUPS)
def _kept(trials: int, group: int) -> BoolArray:
    return np.asarray(np.arange(trials) % GROUPS != group)


@dataclass(frozen=True)
class Measured:
    """A number from samples and its Monte-Carlo standard error; NaN where there is none."""

    value: float
    standard_error: float


def measure(statistic: Callable[[Drawn], float], drawn: Drawn) -> Measured:
    """Return a statistic of the samples with its standard error, by the jackknife over groups of trials.

    Trials of different conditions with the same number share their random numbers, and leave together.
    """
    value = float(statistic(drawn))
    if not drawn.random or not np.isfinite(value):
        return Measured(value, 0.0 if np.isfinite(value) else np.nan)
    return Measured(value, jackknife_error([float(statistic(drawn.without(group))) for group in range(GROUPS)]))


def rms(values: FloatArray) -> float:
    """Return the root mean square of the values that there are; NaN where there is none."""
    there = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(there * there))) if there.size else np.nan


def median(values: FloatArray) -> float:
    """Return the median, a missing value counted as infinite; NaN where half are missing."""
    middle = float(np.median(np.where(np.isnan(values), np.inf, values))) if values.size else np.nan
    return middle if np.isfinite(middle) else np.nan


def share(values: BoolArray | FloatArray) -> float:
    """Return the share of trials that are true (or 1); a missing value counts as false. NaN without trials."""
    return float(np.mean(np.nan_to_num(np.asarray(values, dtype=float)))) if values.size else np.nan


def rms_of(name: str) -> Statistic:
    """Return the statistic `rms` of the samples called ``name``."""
    return lambda samples: rms(samples[name])


def median_of(name: str) -> Statistic:
    """Return the statistic `median` of the samples called ``name``."""
    return lambda samples: median(samples[name])


def share_of(name: str) -> Statistic:
    """Return the statistic `share` of the samples called ``name``."""
    return lambda samples: share(samples[name])
