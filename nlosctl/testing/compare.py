"""Comparing two solutions: to the bit, or to rounding. Each function yields what differs."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from nlosctl.arrays import FloatArray, IntArray
from nlosctl.contract.results import FORM, MISFIT_FORM, Estimates, Flags, Solution, has_position
from nlosctl.geometry.symmetric import SymmetricMatrix

__all__ = ["close_solutions", "estimates_of", "same_bits"]

_DISCRETE_FIELDS = ("row", "target", "alternative", "status", "n_used")
_RELATIVE = 1e-9
_OF_STD = 1e-7
"""How far rounding and the end of an iteration may move a fix: as a share of the scene's size, and of its std."""

_ROUNDED = 1e-12
"""Largest rounding error of a number that is zero, such as a residual where two rays cross; of a length per metre."""


def estimates_of(solution: Solution, snapshots: IntArray) -> dict[str, Any]:
    """Return the arrays of some snapshots, flags included, with rows numbered by their index in ``snapshots``."""
    estimates = solution.estimates
    indices = [np.flatnonzero(estimates.row == snapshot) for snapshot in snapshots]
    chosen = np.concatenate([np.empty(0, dtype=np.int64), *indices])
    arrays = {name: getattr(estimates, name)[chosen] for name in FORM}
    if estimates.chi_square is not None:
        arrays |= {name: getattr(estimates, name)[chosen] for name in MISFIT_FORM}
    arrays["row"] = np.repeat(np.arange(len(indices)), [len(part) for part in indices])
    if solution.flags is not None:
        arrays["flags.used"] = solution.flags.used[snapshots]
        arrays |= {f"flags.{name}": column[snapshots] for name, column in solution.flags.columns.items()}
    return arrays


def same_bits(one: dict[str, Any], other: dict[str, Any]) -> Iterator[str]:
    """Yield what differs in any bit (NaN equals NaN) between the arrays of two sets of estimates."""
    for name in sorted(one.keys() | other.keys()):
        if name not in one or name not in other:
            yield f"{name} is there only once"
        elif one[name].shape != other[name].shape:
            yield f"{name} has shape {one[name].shape} and {other[name].shape}"
        elif not np.array_equal(one[name], other[name], equal_nan=one[name].dtype.kind == "f"):
            yield f"{name} differs: {_first_difference(one[name], other[name])}"


def close_solutions(expected: Solution, got: Solution, size_m: float) -> Iterator[str]:
    """Yield where ``got`` is not ``expected`` to rounding in a scene (or at an offset) of this size in metres."""
    one, other = expected.estimates, got.estimates
    for name in _DISCRETE_FIELDS:
        if not np.array_equal(getattr(one, name), getattr(other, name)):
            yield f"{name} differs: {_first_difference(getattr(one, name), getattr(other, name))}"
            return
    yield from _close_estimates(one, other, size_m)
    if expected.flags is not None and got.flags is not None:
        yield from _close_flags(expected.flags, got.flags, size_m)


def _close_estimates(one: Estimates, other: Estimates, size_m: float) -> Iterator[str]:
    trace = np.sum([np.abs(part) for part in SymmetricMatrix(*one.covariance_m2.T).diagonal], axis=0)
    std_m = np.sqrt(np.nan_to_num(trace))
    allowed = _RELATIVE * size_m + _OF_STD * std_m
    answered = has_position(one.status)  # another law checks the rest
    off = np.where(answered, np.linalg.norm(one.position_m - other.position_m, axis=1), np.nan)
    worst = _worst(off / allowed)
    if worst is not None:
        yield f"the fix of estimate {worst} is off by {off[worst]:.3g} m, more than {allowed[worst]:.3g} m"
    change = np.abs(one.covariance_m2 - other.covariance_m2).max(axis=1, initial=0.0) / (1e-5 * trace)
    worst = _worst(change)
    if worst is not None:
        yield f"the covariance of estimate {worst} is off: {other.covariance_m2[worst]}, not {one.covariance_m2[worst]}"
    worst = _worst(np.abs(one.cost - other.cost) / (1e-5 * (1.0 + np.abs(one.cost))))
    if worst is not None:
        yield f"the cost of estimate {worst} is {other.cost[worst]}, not {one.cost[worst]}"
    if one.chi_square is None or other.chi_square is None:
        return
    worst = _worst(np.abs(one.chi_square - other.chi_square) / (1e-5 * (1.0 + np.abs(one.chi_square))))
    if worst is not None:
        yield f"the chi-square of estimate {worst} is {other.chi_square[worst]}, not {one.chi_square[worst]}"


def _close_flags(one: Flags, other: Flags, size_m: float) -> Iterator[str]:
    if not np.array_equal(one.used, other.used):
        yield f"flags.used differs: {_first_difference(one.used, other.used)}"
    for name in sorted(one.columns.keys() & other.columns.keys()):
        left, right = np.asarray(one.columns[name]), np.asarray(other.columns[name])
        if left.dtype.kind != "f":
            differs = not np.array_equal(left, right)
        else:
            rounded = _ROUNDED * (max(1.0, size_m) if name.endswith("_m") else 1.0)
            allowed = rounded + 1e-5 * np.nan_to_num(np.abs(left)).max(initial=0.0)
            differs = not np.allclose(left, right, rtol=1e-5, atol=allowed, equal_nan=True)
        if differs:
            yield f"flags.{name} differs: {_first_difference(left, right)}"


def _worst(excess: FloatArray) -> int | None:
    """Return where ``excess`` is largest, if it is over 1 anywhere; NaN (both have no answer) never is."""
    if not (excess > 1.0).any():
        return None
    return int(np.nanargmax(excess))


def _first_difference(one: Any, other: Any) -> str:
    if one.shape != other.shape:
        return f"shape {one.shape}, then {other.shape}"
    differs = (one != other) & ~((one != one) & (other != other))
    first = tuple(int(index) for index in np.argwhere(differs)[0])
    return f"at {first} {one[first]!r}, then {other[first]!r}"
