"""Sweeps: several values of a parameter in one run, recorded in columns ``sweep_KEY`` of the results."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from itertools import product
from typing import Any, TypeVar

from nlosctl.contract.tables import SWEEP_PREFIX
from nlosctl.errors import UsageError

__all__ = ["SweepWords", "refuse_both", "refuse_swept_columns", "sweep_points", "swept_options"]

SweepWords = Mapping[str, str | Sequence[Any]]
"""The values of each swept parameter: text separated by commas, or a sequence of Python values."""

OptionsT = TypeVar("OptionsT")

_MOST_POINTS = 10_000
_PLAIN = (bool, int, float, str)


def sweep_points(sweep: SweepWords) -> list[dict[str, Any]]:
    """Return every point of the grid of all values, the last parameter changing fastest; one empty point for no sweep.

    Raises UsageError for a parameter without values or with an empty one, and for a grid that is too large.
    """
    values = {key: _values(key, listed) for key, listed in sweep.items()}
    return [dict(zip(values, point, strict=True)) for point in _product(values)]


def swept_options(
    sweep: SweepWords, parameters: Mapping[str, Any], parse: Callable[[Mapping[str, Any]], OptionsT]
) -> Iterator[tuple[dict[str, Any], OptionsT]]:
    """Yield the parsed swept values and the options of each point of the grid.

    ``parse`` makes options from parameters. Raises UsageError for an invalid or duplicate value, or a parameter that is
    also set without a sweep.
    """
    refuse_both(parameters, sweep)
    seen: list[dict[str, Any]] = []
    for point in sweep_points(sweep):
        options = parse({**parameters, **point})
        values = {key: getattr(options, key) for key in point}
        for key, value in values.items():
            if not isinstance(value, _PLAIN):
                raise UsageError(f"`sweep` {key}={point[key]}: only numbers, words, true and false can be swept")
        if values in seen:
            shown = ", ".join(f"{key}={value}" for key, value in values.items())
            raise UsageError(f"`sweep`: {shown} occurs twice")
        seen.append(values)
        yield values, options


def refuse_both(parameters: Container[str], sweep: SweepWords) -> None:
    """Raise UsageError for a swept parameter that is also set without a sweep."""
    for key in sweep:
        if key in parameters:
            raise UsageError(f"{key!r} is given by `parameters` and by `sweep`; leave out one")


def refuse_swept_columns(points: Sequence[Mapping[str, Any]], columns: Sequence[str]) -> None:
    """Raise UsageError if an input with ``columns`` already has the column of a swept parameter."""
    for key in dict.fromkeys(key for point in points for key in point):
        name = f"{SWEEP_PREFIX}{key}"
        if name in columns:
            raise UsageError(f"`sweep` {key}: the input has a column {name!r} of an earlier sweep; rename that one")


def _values(key: str, listed: str | Sequence[Any]) -> list[Any]:
    values = [item.strip() for item in listed.split(",")] if isinstance(listed, str) else list(listed)
    if not values or "" in values:
        raise UsageError(f"`sweep` takes KEY=VALUE,VALUE,.... Got '{key}={listed}' instead.")
    return values


def _product(values: Mapping[str, list[Any]]) -> Iterator[tuple[Any, ...]]:
    size = 1
    for some in values.values():
        size *= len(some)
    if size > _MOST_POINTS:
        raise UsageError(f"`sweep`: a grid of {size} points, expected at most {_MOST_POINTS}")
    return product(*values.values())
