"""What a method returns; `nlosctl.contract.result_checks` checks that it keeps the contract."""

from __future__ import annotations

from collections.abc import Callable, Mapping
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
    "estimate_tail",
    "has_covariance",
    "has_position",
    "is_fix",
    "no_estimates",
    "single_estimates",
]

FORM: dict[str, str] = {
    "row": "int64",
    "target": "int64",
    "alternative": "int64",
    "position_m": "float64",
    "covariance_m2": "float64",
    "cost": "float64",
    "n_used": "int64",
    "status": "uint8",
}
"""The arrays of `Estimates` and their types; `estimate_tail` is their shape after the first axis (E,)."""

MISFIT_FORM: dict[str, str] = {"chi_square": "float64", "degrees_of_freedom": "int64"}
"""Those that a method may leave out."""


def estimate_tail(name: str, dimension: int) -> tuple[int, ...]:
    """Return the shape, after the first axis, of an array of `Estimates` or `Trace` in D = ``dimension``."""
    return {"position_m": (dimension,), "covariance_m2": (dimension * (dimension + 1) // 2,)}.get(name, ())


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
    its status. ``position_m`` (E, D) in metres, D the dimension of the batch; ``covariance_m2`` (E, D (D + 1) / 2)
    holds xx, xy, yy, and in space xz, yz, zz, in square metres; both are NaN exactly where the status requires it. A
    coordinate that is held exactly has the covariances 0. ``cost`` (E,) is NaN where there is no position.
    ``covariance_kind`` states what the covariance accounts for, if the method has more than one kind. ``measurement``
    (E,) is set if every measurement is solved by itself, for a target of its own: its index in the snapshot.
    ``chi_square`` (E,) is that of the residuals of the rows that the estimate uses, NaN if unknown, with
    ``degrees_of_freedom`` (E,): the scalars among those rows (a bearing with a range has two) minus the unknowns.
    None: the method has no chi-square. ``search_failure`` (E,) is the probability that a random search had no right
    initial estimate, NaN where it is as small as asked for.
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
    yet), ``step`` (T,) the number of rows used so far. ``position_m`` (T, D) and ``covariance_m2`` are as in
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


def no_estimates(size: int, dimension: int = 2, status: Status = Status.NO_TARGET) -> Estimates:
    """Return estimates of B snapshots without a position in D = ``dimension``; ``status`` states why."""
    nothing = np.broadcast_to(np.nan, size)
    return Estimates.of(
        np.full(size, status, dtype=np.uint8),
        (nothing,) * dimension,
        SymmetricMatrix.full(size, np.nan, dimension),
        nothing,
        0,
    )


def single_estimates(*, position_m: FloatArray, covariance_m2: FloatArray, **columns: Any) -> Estimates:
    """Return estimates with one row per snapshot, without the numbers that their status denies.

    Shapes: position (B, D), covariance (B, D (D + 1) / 2); the columns (B,) cost, n_used and status, and chi_square and
    degrees_of_freedom if the method has them. A snapshot without a position gets ``n_used`` 0.
    """
    return Estimates.of(position=tuple(position_m.T), covariance=SymmetricMatrix(*covariance_m2.T), **columns)
