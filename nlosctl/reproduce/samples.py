"""Samples of an experiment by condition, statistics of them, and their Monte-Carlo standard errors."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray

__all__ = [
    "GROUPS",
    "Condition",
    "Measured",
    "Results",
    "Samples",
    "Statistic",
    "at",
    "conditions",
    "jackknife_error",
    "largest",
    "measure",
    "measure_all",
    "median",
    "median_of",
    "ratio_of",
    "rms",
    "rms_of",
    "share",
    "share_of",
    "smallest",
]

Value = float | int | str
Condition = Mapping[str, Value]
Samples = Mapping[str, FloatArray]
"""Arrays (trials,) by name; NaN for trials without a value, such as those without a fix."""
Statistic = Callable[[Samples], float]

GROUPS = 40
"""Number of jackknife groups of trials; the relative error of a standard error is then about one ninth."""


def conditions(**values: Sequence[Value]) -> list[Condition]:
    """Return all combinations of the values, the last name varying fastest."""
    combinations: list[dict[str, Value]] = [{}]
    for name, options in values.items():
        combinations = [{**condition, name: option} for condition in combinations for option in options]
    return list(combinations)


@dataclass(frozen=True, kw_only=True)
class Results:
    """The samples of all conditions of an experiment."""

    conditions: Sequence[Condition]
    samples: Sequence[Samples]
    random: bool = True

    def of(self, **keys: Value) -> Samples:
        """Return the samples of the only condition with these values; raise KeyError unless there is exactly one."""
        matches = [samples for _, samples in self.where(**keys)]
        if len(matches) != 1:
            raise KeyError(f"{len(matches)} conditions with {keys}")
        return matches[0]

    def where(self, **keys: Value) -> Iterator[tuple[Condition, Samples]]:
        """Yield the conditions with these values, and their samples, in order."""
        for condition, samples in zip(self.conditions, self.samples, strict=True):
            if all(condition[name] == value for name, value in keys.items()):
                yield condition, samples

    def separately(self, **keys: Value) -> Iterator[tuple[Condition, Results]]:
        """Yield the conditions with these values, and the results of each condition alone."""
        for condition, samples in self.where(**keys):
            yield condition, Results(conditions=[condition], samples=[samples], random=self.random)

    def without(self, group: int) -> Results:
        """Return the results without the trials whose number is ``group`` modulo `GROUPS`."""
        return Results(
            conditions=self.conditions, samples=[_Without(part, group) for part in self.samples], random=self.random
        )


class _Without(Mapping[str, FloatArray]):
    """Samples without a group of trials, cut when read."""

    def __init__(self, samples: Samples, group: int) -> None:
        self._samples, self._group = samples, group

    def __getitem__(self, name: str) -> FloatArray:
        values = self._samples[name]
        remaining: FloatArray = values[_outside(values.shape[0], self._group)]
        return remaining

    def __iter__(self) -> Iterator[str]:
        return iter(self._samples)

    def __len__(self) -> int:
        return len(self._samples)


@lru_cache(maxsize=2 * GROUPS)
def _outside(trials: int, group: int) -> BoolArray:
    return np.asarray(np.arange(trials) % GROUPS != group)


@dataclass(frozen=True)
class Measured:
    """A statistic of samples and its Monte-Carlo standard error; NaN: undefined."""

    value: float
    standard_error: float


def measure(statistic: Callable[[Results], float], results: Results) -> Measured:
    """Return a statistic with its standard error, by the jackknife over groups of trials.

    Trials of different conditions with the same number share their random numbers, so they are left out together.
    """
    value = float(statistic(results))
    if not results.random or not np.isfinite(value):
        return Measured(value, 0.0 if np.isfinite(value) else np.nan)
    return Measured(value, jackknife_error([float(statistic(results.without(group))) for group in range(GROUPS)]))


def measure_all(statistics: Sequence[Callable[[Results], float]], results: Results) -> tuple[FloatArray, FloatArray]:
    """Return the values (N,) of N statistics and their standard errors (N,)."""
    measured = [measure(statistic, results) for statistic in statistics]
    return np.array([item.value for item in measured]), np.array([item.standard_error for item in measured])


def jackknife_error(without: Sequence[float]) -> float:
    """Return the delete-a-group jackknife standard error from the statistic without each group in turn.

    Efron 1982, The Jackknife, the Bootstrap and Other Resampling Plans, equation (3.1), with groups instead of single
    observations. NaN if the statistic is undefined without one of the groups.
    """
    values = np.asarray(without, dtype=np.float64)
    offsets = values - values[0]  # exactly 0 for what no group changes
    return float(np.sqrt((values.size - 1) * np.mean((offsets - offsets.mean()) ** 2)))


def at(statistic: Statistic, **keys: Value) -> Callable[[Results], float]:
    """Return ``statistic`` of the only condition with these values."""
    return lambda results: statistic(results.of(**keys))


def largest(statistic: Statistic, **keys: Value) -> Callable[[Results], float]:
    """Return the largest ``statistic`` of the conditions with these values."""
    return lambda results: max(float(statistic(samples)) for _, samples in results.where(**keys))


def smallest(statistic: Statistic, **keys: Value) -> Callable[[Results], float]:
    """Return the smallest ``statistic`` of the conditions with these values."""
    return lambda results: min(float(statistic(samples)) for _, samples in results.where(**keys))


def rms(values: FloatArray) -> float:
    """Return the root mean square of the finite values; NaN without any."""
    finite = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(finite * finite))) if finite.size else np.nan


def median(values: FloatArray) -> float:
    """Return the median, a missing value counted as infinite; NaN if half are missing."""
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


def ratio_of(name: str, other: str, of: Callable[[str], Statistic] = rms_of) -> Statistic:
    """Return the statistic ``of`` (default: rms) of ``name`` divided by that of ``other``."""
    upper, lower = of(name), of(other)
    return lambda samples: upper(samples) / lower(samples)
