"""The check that the solution of a method keeps the contract."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import BoolArray, StatusArray
from nlosctl.contract.results import (
    FORM,
    MISFIT_FORM,
    Estimates,
    Flags,
    Solution,
    Trace,
    estimate_tail,
    has_covariance,
    has_position,
)
from nlosctl.contract.statuses import Status
from nlosctl.geometry.symmetric import SymmetricMatrix

__all__ = ["contract_violation", "form_faults", "null_faults"]

_ROUNDING = 1e-9
"""A correlation may exceed 1, and a determinant of correlations be below 0, by this much."""


def contract_violation(solution: Any, shape: tuple[int, int], dimension: int = 2) -> str:
    """Return how the solution of a batch of ``shape`` (B, K) in D = ``dimension`` breaks the contract, empty if not.

    Plugins may be wrong: this runs before a row of the solution is written.
    """
    if not isinstance(solution, Solution):
        return f"returned a {type(solution).__name__}, not a Solution"
    faults = [*form_faults(solution.estimates, dimension)] or [*_value_faults(solution.estimates, shape[0])]
    if solution.flags is not None:
        faults += _flag_faults(solution.flags, shape)
    if solution.trace is not None:
        faults += _trace_faults(solution.trace, shape, dimension)
    return f"broke its contract: {faults[0]}" if faults else ""


def form_faults(estimates: Estimates, dimension: int = 2, *, exact_types: bool = False) -> Iterator[str]:
    """Yield a complaint for each value that is not an array of the right shape and type in D = ``dimension``.

    Without ``exact_types`` any integers and any floats are right.
    """
    rows = np.shape(estimates.row)
    count = rows[0] if rows else 0
    for name, dtype in {**FORM, **MISFIT_FORM}.items():
        array, shape = getattr(estimates, name), (count, *estimate_tail(name, dimension))
        if array is None and name in MISFIT_FORM:
            continue
        if not isinstance(array, np.ndarray) or array.shape != shape:
            yield f"{name} has shape {np.shape(array)}, expected {shape}"
        elif exact_types and array.dtype != dtype:
            yield f"{name} is {array.dtype}, expected {dtype}"
        elif array.dtype.kind not in ("f" if dtype == "float64" else "iu"):
            yield f"{name} is {array.dtype}, expected {'floats' if dtype == 'float64' else 'integers'}"


def _value_faults(estimates: Estimates, size: int) -> Iterator[str]:
    """Yield snapshots without estimate, unknown snapshots and statuses, wrong nulls and improper covariances."""
    row, status = estimates.row, estimates.status
    for name, column in estimates.columns.items():
        if np.shape(column) != row.shape:
            yield f"the column {name!r} has shape {np.shape(column)}, expected {row.shape}"
    if row.size and (row.min() < 0 or row.max() >= size):
        yield f"row {row.max()} is not one of its {size} snapshots"
    elif np.bincount(row, minlength=size).min(initial=1) == 0:
        yield "a snapshot got no estimate, expected at least one, if only for its status"
    if (status > max(Status)).any():
        yield f"unknown status {int(status.max())}"
        return
    yield from null_faults("position", estimates.position_m, has_position(status), status)
    yield from null_faults("covariance", estimates.covariance_m2, has_covariance(status), status)
    covariance = estimates.covariance_m2[has_covariance(status)]
    covariance = covariance[np.isfinite(covariance).all(axis=1)]
    if not _are_semidefinite(SymmetricMatrix(*covariance.T)):
        yield "a covariance is not positive semidefinite"


def _are_semidefinite(covariance: SymmetricMatrix) -> bool:
    """Return whether all variances, and the principal minors of 2 and 3 correlations, are at least 0 up to rounding."""
    diagonal = covariance.diagonal
    if not all((variance >= 0.0).all() for variance in diagonal):
        return False
    correlations = []
    for i, j in combinations(range(covariance.dimension), 2):
        largest, entry = np.sqrt(diagonal[i]) * np.sqrt(diagonal[j]), covariance.entry(i, j)
        if not (np.abs(entry) <= largest * (1.0 + _ROUNDING)).all():
            return False
        correlations.append(entry / np.where(largest > 0.0, largest, 1.0))
    if len(correlations) != 3:
        return True
    xy, xz, yz = correlations
    return bool((1.0 + 2.0 * xy * xz * yz - xy * xy - xz * xz - yz * yz >= -_ROUNDING).all())


def null_faults(what: str, values: npt.NDArray[Any], wanted: BoolArray, status: StatusArray) -> Iterator[str]:
    """Yield the first value (E, ...) that is not finite where ``wanted`` (E,), or not NaN elsewhere."""
    values, rows = values.reshape(status.shape[0], -1), values
    wrong = np.where(wanted[:, None], ~np.isfinite(values), ~np.isnan(values)).any(axis=1)
    if wrong.any():
        first = int(np.argmax(wrong))
        yield f"the {what} is {rows[first].tolist()} where the status is {Status(int(status[first])).word}"


def _flag_faults(flags: Flags, shape: tuple[int, int]) -> Iterator[str]:
    for name, column in {"used": flags.used, **flags.columns}.items():
        if np.shape(column) != shape:
            yield f"the flag {name!r} has shape {np.shape(column)}, expected {shape}"
    if np.shape(flags.used) == shape and flags.used.dtype != np.bool_:
        yield f"the flag 'used' is {flags.used.dtype}, expected booleans"


def _trace_faults(trace: Trace, shape: tuple[int, int], dimension: int) -> Iterator[str]:
    count = np.shape(trace.row)
    for name in ("step", "measurement", "position_m", "covariance_m2"):
        tail = estimate_tail(name, dimension)
        if np.shape(getattr(trace, name)) != (*count, *tail):
            yield f"the trace's {name} has shape {np.shape(getattr(trace, name))}, expected {(*count, *tail)}"
    if np.size(trace.row) and (np.min(trace.row) < 0 or np.max(trace.row) >= shape[0]):
        yield f"the trace names snapshot {int(np.max(trace.row))} of {shape[0]}"
