"""Sweeps: a parameter goes through several values, and the results tell theirs in a column ``sweep_KEY``."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import product
from typing import Any, TypeVar

from nlosctl.contract.tables import SWEEP_PREFIX
from nlosctl.errors import UsageError

__all__ = ["SweepWords", "refuse_swept_columns", "sweep_points", "swept_options"]

SweepWords = Mapping[str, str | Sequence[Any]]
"""The values of each swept parameter: in words with commas between them, or a sequence of Python values."""

OptionsT = TypeVar("OptionsT")

_MOST_POINTS = 10_000
_PLAIN = (bool, int, float, str)


def sweep_points(sweep: SweepWords) -> list[dict[str, Any]]:
    """Return every point of the grid of all values, the last parameter changing fastest; one point without any.

    Raises UsageError where a parameter has no value or an empty one, or the grid is larger than any sweep.
    """
    values = {key: _values(key, given) for key, given in sweep.items()}
    return [dict(zip(values, point, strict=True)) for point in _product(values)]


def swept_options(
    sweep: SweepWords, parameters: Mapping[str, Any], parse: Callable[[Mapping[str, Any]], OptionsT]
) -> Iterator[tuple[dict[str, Any], OptionsT]]:
    """Yield the swept values, as their options hold them, and the options of each point of the grid.

    ``parse`` makes options from parameters. Raises UsageError for a value that does not fit, one that is there twice,
    or a parameter that is swept and given.
    """
    for key in sweep:
        if key in parameters:
            raise UsageError(f"{key!r} is given by `parameters` and by `sweep`; leave out one")
    seen: list[dict[str, Any]] = []
    for point in sweep_points(sweep):
        options = parse({**parameters, **point})
        held = {key: getattr(options, key) for key in point}
        for key, value in held.items():
            if not isinstance(value, _PLAIN):
                raise UsageError(f"`sweep` {key}={point[key]}: only numbers, words, true and false can be swept")
        if held in seen:
            told = ", ".join(f"{key}={value}" for key, value in held.items())
            raise UsageError(f"`sweep`: {told} is there twice")
        seen.append(held)
        yield held, options


def refuse_swept_columns(points: Sequence[Mapping[str, Any]], columns: Sequence[str]) -> None:
    """Raise UsageError where an input with ``columns`` has the column of a swept parameter already."""
    for key in dict.fromkeys(key for point in points for key in point):
        name = f"{SWEEP_PREFIX}{key}"
        if name in columns:
            raise UsageError(f"`sweep` {key}: the input has a column {name!r} of an earlier sweep; rename that one")


def _values(key: str, given: str | Sequence[Any]) -> list[Any]:
    values = [word.strip() for word in given.split(",")] if isinstance(given, str) else list(given)
    if not values or "" in values:
        raise UsageError(f"`sweep` takes KEY=VALUE,VALUE,.... Got '{key}={given}' instead.")
    return values


def _product(values: Mapping[str, list[Any]]) -> Iterator[tuple[Any, ...]]:
    size = 1
    for some in values.values():
        size *= len(some)
    if size > _MOST_POINTS:
        raise UsageError(f"`sweep`: a grid of {size} points, expected at most {_MOST_POINTS}")
    return product(*values.values())
