"""What a method returns, and the check that it keeps the contract."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import BoolArray, FloatArray, IntArray, StatusArray
from nlosctl.contract.statuses import Status
from nlosctl.contract.text_columns import Words
from nlosctl.geometry.symmetric import SymmetricMatrix

__all__ = [
    "FORM",
    "MISFIT_FORM",
    "Estimates",
    "Flags",
    "Solution",
    "Trace",
    "Words",
    "contract_violation",
    "form_faults",
    "has_covariance",
    "has_position",
    "is_fix",
    "no_estimates",
    "null_faults",
    "single_estimates",
]

FORM: dict[str, tuple[str, tuple[int, ...]]] = {
    "row": ("int64", ()),
    "target": ("int64", ()),
    "alternative": ("int64", ()),
    "position_m": ("float64", (2,)),
    "covariance_m2": ("float64", (3,)),
    "cost": ("float64", ()),
    "n_used": ("int64", ()),
    "status": ("uint8", ()),
}
"""The arrays of `Estimates`: type, and shape after the first axis (E,)."""

MISFIT_FORM: dict[str, tuple[str, tuple[int, ...]]] = {
    "chi_square": ("float64", ()),
    "degrees_of_freedom": ("int64", ()),
}
"""Those that a method may leave out."""


def _by_number(of: Callable[[Status], bool]) -> BoolArray:
    """Return a property of each status, false for the numbers (256,) that are not a status."""
    return np.isin(np.arange(256), [int(status) for status in Status if of(status)])


_POSITION = _by_number(lambda status: status.has_position)
_COVARIANCE = _by_number(lambda status: status.has_covariance)
_FIX = _by_number(lambda status: status.is_fix)


def has_position(status: StatusArray) -> BoolArray:
    """Return which estimates have a position."""
    return _POSITION[status]


def has_covariance(status: StatusArray) -> BoolArray:
    """Return which estimates have a covariance."""
    return _COVARIANCE[status]


def is_fix(status: StatusArray) -> BoolArray:
    """Return which estimates count as a fix: their position is supported by the measurements."""
    return _FIX[status]


@dataclass(frozen=True, kw_only=True)
class Estimates:
    """E estimates, ordered by snapshot, then target, then alternative (best first).

    ``row`` (E,) is the snapshot's index in the batch; every snapshot has at least one estimate, if only to carry
    its status. ``position_m`` (E, 2) in metres; ``covariance_m2`` (E, 3) holds xx, xy, yy in square metres; both
    are NaN exactly where the status requires it. ``cost`` (E,) is NaN where there is no position. ``covariance_kind``
    states what the covariance accounts for, if the method has more than one kind. ``measurement`` (E,) is set if
    every measurement is solved by itself, for a target of its own: its index in the snapshot. ``chi_square`` (E,) is
    that of the residuals of the rows that the estimate uses, NaN if unknown, with ``degrees_of_freedom`` (E,): the
    scalars among those rows (a bearing with a range has two) minus the unknowns. None: the method has no chi-square.
    ``search_failure`` (E,) is the probability that a random search had no right initial estimate, NaN where it is as
    small as asked for.
    ``columns`` are further columns (E,) by name, NaN where there is no value.
    """

    row: IntArray
    target: IntArray
    alternative: IntArray
    position_m: FloatArray
    covariance_m2: FloatArray
    cost: FloatArray
    n_used: IntArray
    status: StatusArray
    covariance_kind: str | None = None
    measurement: IntArray | None = None
    chi_square: FloatArray | None = None
    degrees_of_freedom: IntArray | None = None
    search_failure: FloatArray | None = None
    columns: Mapping[str, FloatArray] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        status: StatusArray,
        position: tuple[FloatArray, ...],
        covariance: SymmetricMatrix,
        cost: FloatArray,
        n_used: IntArray | int,
        *,
        row: IntArray | None = None,
        target: IntArray | None = None,
        alternative: IntArray | None = None,
        chi_square: FloatArray | float = np.nan,
        degrees_of_freedom: IntArray | int = 0,
        **kinds: Any,
    ) -> Estimates:
        """Return estimates (E,) without the numbers that their status denies: those become NaN, ``n_used`` 0.

        Positions are given as one array (E,) per coordinate. ``row`` counts the snapshots by default, ``target`` and
        ``alternative`` are 0; ``kinds`` are `covariance_kind`,
        `measurement` and `columns`.
        """
        positioned, certain = has_position(status), has_covariance(status)
        zero = np.zeros(status.shape, dtype=np.int64)
        return cls(
            row=np.arange(status.shape[0], dtype=np.int64) if row is None else row,
            target=zero if target is None else target,
            alternative=zero if alternative is None else alternative,
            position_m=np.where(positioned[:, None], np.stack(position, axis=1), np.nan),
            covariance_m2=np.where(certain[:, None], covariance.stack(), np.nan),
            cost=np.where(positioned, cost, np.nan),
            n_used=np.where(positioned, n_used, 0),
            status=status,
            chi_square=np.where(certain, chi_square, np.nan),
            degrees_of_freedom=np.where(certain, degrees_of_freedom, 0),
            **kinds,
        )


@dataclass(frozen=True, kw_only=True)
class Flags:
    """The flags of each measurement: ``used`` (B, K), and further columns (B, K) by name.

    Floating-point columns are NaN where there is no value.
    """

    used: BoolArray
    columns: Mapping[str, npt.NDArray[np.generic] | Words] = field(default_factory=dict)

    @classmethod
    def of_fixes(cls, status: StatusArray, columns: Mapping[str, FloatArray]) -> Flags:
        """Return the flags of fixes (B,) that use every row; columns (B, K) are NaN where there is no position."""
        answered = has_position(status)[:, None]
        columns = {name: np.where(answered, values, np.nan) for name, values in columns.items()}
        shape = next(iter(columns.values())).shape
        return cls(used=np.broadcast_to(answered, shape).copy(), columns=columns)


@dataclass(frozen=True, kw_only=True)
class Trace:
    """The T states that a sequential method passed through, ordered by snapshot, then step.

    ``row`` (T,) is the snapshot's index in the batch, ``measurement`` (T,) the index of the row just used (-1: none
    yet), ``step`` (T,) the number of rows used so far. ``position_m`` (T, 2) and ``covariance_m2`` (T, 3) are as in
    `Estimates`.
    """

    row: IntArray
    step: IntArray
    measurement: IntArray
    position_m: FloatArray
    covariance_m2: FloatArray


@dataclass(frozen=True, kw_only=True)
class Solution:
    """The result of one batch. ``flags`` may be None if the batch did not want them.

    ``trace`` is None unless the method has one and the batch wanted it.
    """

    estimates: Estimates
    flags: Flags | None = None
    trace: Trace | None = None


def no_estimates(size: int) -> Estimates:
    """Return the placeholder estimates of B snapshots for a detector that makes none: rows without a position."""
    zeros = np.zeros(size, dtype=np.int64)
    nothing = np.broadcast_to(np.nan, (size, 3))
    return Estimates(
        row=np.arange(size, dtype=np.int64),
        target=zeros,
        alternative=zeros,
        position_m=nothing[:, :2],
        covariance_m2=nothing,
        cost=nothing[:, 0],
        n_used=zeros,
        status=np.broadcast_to(np.uint8(Status.NO_TARGET), size),
    )


def single_estimates(*, position_m: FloatArray, covariance_m2: FloatArray, **columns: Any) -> Estimates:
    """Return estimates with one row per snapshot, without the numbers that their status denies.

    Shapes: position (B, 2), covariance (B, 3); the columns (B,) cost, n_used and status, and chi_square and
    degrees_of_freedom if the method has them. A snapshot without a position gets ``n_used`` 0.
    """
    return Estimates.of(position=tuple(position_m.T), covariance=SymmetricMatrix(*covariance_m2.T), **columns)


def contract_violation(solution: Any, shape: tuple[int, int]) -> str:
    """Return how the solution of a batch of ``shape`` (B, K) breaks the contract, empty if it doesn't.

    Plugins may be wrong: this runs before a row of the solution is written.
    """
    if not isinstance(solution, Solution):
        return f"returned a {type(solution).__name__}, not a Solution"
    faults = [*form_faults(solution.estimates)] or [*_value_faults(solution.estimates, shape[0])]
    if solution.flags is not None:
        faults += _flag_faults(solution.flags, shape)
    if solution.trace is not None:
        faults += _trace_faults(solution.trace, shape)
    return f"broke its contract: {faults[0]}" if faults else ""


def form_faults(estimates: Estimates, *, exact_types: bool = False) -> Iterator[str]:
    """Yield a complaint for each value that is not an array of the right shape and type.

    Without ``exact_types`` any integers and any floats are right.
    """
    rows = np.shape(estimates.row)
    count = rows[0] if rows else 0
    for name, (dtype, tail) in {**FORM, **MISFIT_FORM}.items():
        array, shape = getattr(estimates, name), (count, *tail)
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
    xx, xy, yy = estimates.covariance_m2[has_covariance(status)].T
    largest = np.sqrt(np.abs(xx)) * np.sqrt(np.abs(yy))
    if not ((xx >= 0.0) & (yy >= 0.0) & (np.abs(xy) <= largest * (1.0 + 1e-9))).all():
        yield "a covariance is not positive semidefinite"


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


def _trace_faults(trace: Trace, shape: tuple[int, int]) -> Iterator[str]:
    count = np.shape(trace.row)
    forms = {"step": (), "measurement": (), "position_m": (2,), "covariance_m2": (3,)}
    for name, tail in forms.items():
        if np.shape(getattr(trace, name)) != (*count, *tail):
            yield f"the trace's {name} has shape {np.shape(getattr(trace, name))}, expected {(*count, *tail)}"
    if np.size(trace.row) and (np.min(trace.row) < 0 or np.max(trace.row) >= shape[0]):
        yield f"the trace names snapshot {int(np.max(trace.row))} of {shape[0]}"
