"""What a method gave back, held to the contract before a row of it is written: a plugin may be wrong."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import BoolArray
from nlosctl.contract.results import Estimates, Flags, Solution, Trace
from nlosctl.contract.statuses import Status

__all__ = ["fault_of"]

_SHAPES: dict[str, tuple[int, ...]] = {
    "row": (),
    "target": (),
    "alternative": (),
    "position_m": (2,),
    "covariance_m2": (3,),
    "cost": (),
    "n_used": (),
    "status": (),
}
_WHOLE = ("row", "target", "alternative", "n_used", "status")


def fault_of(solution: Any, shape: tuple[int, int]) -> str:
    """Return what is wrong with the solution of a batch of ``shape`` (B, K), empty where it keeps the contract."""
    if not isinstance(solution, Solution):
        return f"returned a {type(solution).__name__}, not a Solution"
    faults = [*_in_form(solution.estimates, shape[0])] or [*_in_truth(solution.estimates, shape[0])]
    if solution.flags is not None:
        faults += _of_flags(solution.flags, shape)
    if solution.trace is not None:
        faults += _of_trace(solution.trace, shape)
    return f"broke its contract: {faults[0]}" if faults else ""


def _in_form(estimates: Estimates, size: int) -> Iterator[str]:
    """Yield arrays that are none, or not as long and wide as they must be."""
    rows = np.shape(estimates.row)
    count = rows[0] if rows else 0
    for name, tail in _SHAPES.items():
        array = getattr(estimates, name)
        if not isinstance(array, np.ndarray) or array.shape != (count, *tail):
            yield f"{name} has shape {np.shape(array)}, expected {(count, *tail)}"
        elif array.dtype.kind not in ("iu" if name in _WHOLE else "f"):
            yield f"{name} holds {array.dtype}, expected {'integers' if name in _WHOLE else 'floats'}"


def _in_truth(estimates: Estimates, size: int) -> Iterator[str]:
    """Yield answers that are missing, of no snapshot, of no status, or not numbers just where the status says so."""
    row, status = estimates.row, estimates.status
    if row.size and (row.min() < 0 or row.max() >= size):
        yield f"row {row.max()} is none of its {size} snapshots"
    elif np.bincount(row, minlength=size).min(initial=1) == 0:
        yield "a snapshot got no estimate, expected one at least, if only for its status"
    if (status > max(Status)).any():
        yield f"{int(status.max())} is no status"
        return
    with_position, with_covariance = status <= Status.BOUNDARY, status <= Status.INFEASIBLE
    yield from _nulls("position", estimates.position_m, with_position, status)
    yield from _nulls("covariance", estimates.covariance_m2, with_covariance, status)
    xx, xy, yy = estimates.covariance_m2[with_covariance].T
    largest = np.sqrt(np.abs(xx)) * np.sqrt(np.abs(yy))
    if not ((xx >= 0.0) & (yy >= 0.0) & (np.abs(xy) <= largest * (1.0 + 1e-9))).all():
        yield "a covariance is that of no ellipse"


def _nulls(what: str, values: npt.NDArray[Any], wanted: BoolArray, status: npt.NDArray[Any]) -> list[str]:
    wrong = np.where(wanted[:, None], ~np.isfinite(values), ~np.isnan(values)).any(axis=1)
    if not wrong.any():
        return []
    place = int(np.argmax(wrong))
    return [f"the {what} is {values[place].tolist()} where the status is {Status(int(status[place])).word}"]


def _of_flags(flags: Flags, shape: tuple[int, int]) -> Iterator[str]:
    for name, column in {"used": flags.used, **flags.columns}.items():
        if np.shape(column) != shape:
            yield f"the flag {name!r} has shape {np.shape(column)}, expected {shape}"
    if np.shape(flags.used) == shape and flags.used.dtype != np.bool_:
        yield f"the flag 'used' holds {flags.used.dtype}, expected booleans"


def _of_trace(trace: Trace, shape: tuple[int, int]) -> Iterator[str]:
    count = np.shape(trace.row)
    forms = {"step": (), "measurement": (), "position_m": (2,), "covariance_m2": (3,)}
    for name, tail in forms.items():
        if np.shape(getattr(trace, name)) != (*count, *tail):
            yield f"the trace's {name} has shape {np.shape(getattr(trace, name))}, expected {(*count, *tail)}"
    if np.size(trace.row) and (np.min(trace.row) < 0 or np.max(trace.row) >= shape[0]):
        yield f"the trace tells of snapshot {int(np.max(trace.row))}, of {shape[0]}"
