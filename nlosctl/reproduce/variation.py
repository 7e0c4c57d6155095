"""An experiment with other parameters than the paper's: its numbers, without a verdict on the paper."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

from nlosctl.contract.options import parse_options
from nlosctl.errors import UsageError, did_you_mean
from nlosctl.plotting.panels import LinesPanel, Panel, Series
from nlosctl.reproduce.experiment import Experiment
from nlosctl.reproduce.panels import curve
from nlosctl.reproduce.samples import Condition, Results, Statistic, Value

__all__ = ["parameter_names", "varied"]


def parameter_names(experiment: Experiment) -> list[str]:
    """Return the parameters of an experiment: what its conditions differ in, and its own options."""
    axes = dict.fromkeys(name for condition in experiment.conditions for name in condition)
    return [*axes, *(field.name for field in _fields(experiment))]


def varied(experiment: Experiment, parameters: Mapping[str, Any]) -> Experiment:
    """Return the experiment with these parameters, as text or values.

    A parameter in which the conditions differ takes several values (``0.5,1,2``), an option of the experiment one.
    With the paper's own values it is the same experiment; with others it has no claims, and plain panels. Raises
    UsageError for an unknown parameter or an impossible value.
    """
    names = parameter_names(experiment)
    for name in parameters:
        if name not in names:
            near = did_you_mean(name, names)
            raise UsageError(f"{experiment.name} has no parameter {name!r}{near}; it has: {', '.join(names)}")
    own = {name: value for name, value in parameters.items() if name in [field.name for field in _fields(experiment)]}
    conditions: list[dict[str, Value]] = [dict(condition) for condition in experiment.conditions]
    for name, given in parameters.items():
        if name not in own:
            values = _values(experiment, name, given)
            rest = [{key: value for key, value in condition.items() if key != name} for condition in conditions]
            unique = [condition for index, condition in enumerate(rest) if condition not in rest[:index]]
            order = [*conditions[0]]
            conditions = [
                {key: {**condition, name: value}[key] for key in order} for condition in unique for value in values
            ]
    if own and experiment.options is not None:
        options = parse_options(experiment.options, own, experiment.name)
        changed = {
            field.name: getattr(options, field.name)
            for field in _fields(experiment)
            if getattr(options, field.name) != field.default
        }
        conditions = [{**condition, **changed} for condition in conditions]
    if {*map(_items, conditions)} == {*map(_items, experiment.conditions)}:
        return experiment
    return dataclasses.replace(
        experiment, conditions=conditions, claims=(), comparisons=(), panels=partial(_panels, experiment)
    )


def _items(condition: Condition) -> frozenset[tuple[str, Value]]:
    return frozenset(condition.items())


def _fields(experiment: Experiment) -> Sequence[dataclasses.Field[Any]]:
    return () if experiment.options is None else dataclasses.fields(experiment.options)


def _values(experiment: Experiment, name: str, given: Any) -> list[Value]:
    """Return the values of a condition, of the type of the paper's; raise UsageError for any other."""
    papers = list(dict.fromkeys(condition[name] for condition in experiment.conditions))
    items = given.split(",") if isinstance(given, str) else given if isinstance(given, list | tuple) else [given]
    values = [_value(experiment, name, item, papers) for item in items]
    return list(dict.fromkeys(values))


def _value(experiment: Experiment, name: str, item: Any, papers: Sequence[Value]) -> Value:
    expected = f"one of {', '.join(map(str, papers))}"
    if not any(isinstance(value, str) for value in papers):
        whole = all(isinstance(value, int) for value in papers)
        least = 0.0 if min(map(float, papers)) > 0.0 else -math.inf
        expected = f"{'an int' if whole else 'a number'}{' larger than 0' if least == 0.0 else ''}"
        try:
            number = int(item) if whole else float(item)
        except (TypeError, ValueError):
            number = math.nan
        if least < number < math.inf:
            return number
    elif str(item) in map(str, papers):
        return next(value for value in papers if str(value) == str(item))
    raise UsageError(f"The {name!r} parameter of {experiment.name} must be {expected}. Got {str(item)!r} instead.")


def _panels(experiment: Experiment, results: Results) -> Sequence[Panel]:
    """Return a panel for each quantity over the first number in which the conditions differ, a line for each rest."""
    first = results.conditions[0]
    axes = [name for name, value in first.items() if not isinstance(value, str)]
    x = next((name for name in axes if len({condition[name] for condition in results.conditions}) > 1), None)
    if x is None:
        return []
    rests: list[Condition] = []
    for condition in results.conditions:
        rest = {name: value for name, value in condition.items() if name != x}
        if rest not in rests:
            rests.append(rest)
    return [
        LinesPanel(x_label=x, y_label=name, lines=tuple(_line(results, x, name, statistic, rest) for rest in rests))
        for name, statistic in experiment.quantities.items()
    ]


def _line(results: Results, x: str, name: str, statistic: Statistic, rest: Condition) -> Series:
    keys: dict[str, Any] = dict(rest)
    return curve(results, x, ", ".join(f"{key}={value}" for key, value in rest.items()) or name, statistic, **keys)
