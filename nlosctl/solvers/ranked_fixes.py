"""Ranked alternatives of each snapshot as a solution: statuses, estimates, flags."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nlosctl.contract.results import Estimates, Flags
from nlosctl.contract.statuses import Status
from nlosctl.geometry.symmetric import Symmetric2x2

__all__ = ["RankedFixes", "ranked_estimates", "ranked_flags", "ranked_status"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]
StatusArray = npt.NDArray[np.uint8]


@dataclass(frozen=True)
class RankedFixes:
    """Up to T fixes (B, T) of each snapshot, the most likely first; ``cost`` is infinite where there is none."""

    x: FloatArray
    y: FloatArray
    cost: FloatArray
    covariance: Symmetric2x2
    n_used: IntArray


def ranked_status(
    fixes: RankedFixes,
    candidates: BoolArray,
    degenerate: BoolArray,
    ambiguous_within: float,
    held: BoolArray | None = None,
) -> StatusArray:
    """Return the status (B,).

    ``candidates`` (B,) tells whether there was any point to start from in the search field, ``degenerate`` (B,)
    whether the rows can't say where the source is, whatever they read, ``held`` (B,) whether the fixes were held back
    at the edge of the search field.
    """
    status = np.full(candidates.shape, Status.OK, dtype=np.uint8)
    covariance = fixes.covariance
    with np.errstate(invalid="ignore"):
        if fixes.cost.shape[1] > 1:
            status[fixes.cost[:, 1] - fixes.cost[:, 0] <= ambiguous_within] = Status.AMBIGUOUS
        positive = (covariance.xx[:, 0] > 0.0) & (covariance.determinant[:, 0] > 0.0)
    status[~(positive & np.isfinite(covariance.trace[:, 0]))] = Status.DEGENERATE
    if held is not None:
        status[held] = Status.BOUNDARY
    status[~np.isfinite(fixes.cost[:, 0])] = Status.NOT_CONVERGED
    status[~candidates] = Status.NO_CANDIDATE
    status[degenerate] = Status.DEGENERATE
    return status


def ranked_estimates(
    fixes: RankedFixes, status: StatusArray, center_x: FloatArray, center_y: FloatArray, covariance_kind: str
) -> Estimates:
    """Return the estimates: every fix of a snapshot that has an answer, the most likely first; else its status."""
    answered = status <= Status.BOUNDARY
    covariance = fixes.covariance
    with np.errstate(invalid="ignore"):
        sound = np.isfinite(covariance.trace) & (covariance.xx > 0.0) & (covariance.determinant > 0.0)
    written = np.isfinite(fixes.cost) & answered[:, None] & sound
    written &= (status != Status.BOUNDARY)[:, None]
    written[:, 0] = True
    row, alternative = np.nonzero(written)
    has_position = answered[row]

    def pick(values: FloatArray) -> FloatArray:
        return np.where(has_position, values[row, alternative], np.nan)

    spread = np.stack([pick(covariance.xx), pick(covariance.xy), pick(covariance.yy)], axis=1)
    before = np.cumsum(written, axis=1) - 1
    return Estimates(
        row=row.astype(np.int64),
        target=np.zeros(row.shape, dtype=np.int64),
        alternative=before[row, alternative].astype(np.int64),
        position_m=np.stack([pick(fixes.x) + center_x[row], pick(fixes.y) + center_y[row]], axis=1),
        covariance_m2=np.where((status <= Status.INFEASIBLE)[row][:, None], spread, np.nan),
        cost=pick(fixes.cost),
        n_used=np.where(has_position, fixes.n_used[row, alternative], 0),
        status=status[row],
        covariance_kind=covariance_kind,
    )


def ranked_flags(status: StatusArray, los: BoolArray, numbers: Mapping[str, FloatArray]) -> Flags:
    """Return the flags of the best fix: ``los`` (B, K), which is also ``used``, and columns of numbers (B, K).

    A snapshot without an answer uses no row and says nothing of any.
    """
    answered = (status <= Status.BOUNDARY)[:, None]
    said = np.full(los.shape, None, dtype=object)
    np.copyto(said, los, where=np.broadcast_to(answered, los.shape))
    columns: dict[str, npt.NDArray[np.generic]] = {"los": said}
    columns.update({name: np.where(answered, values, np.nan) for name, values in numbers.items()})
    return Flags(used=los & answered, columns=columns)
