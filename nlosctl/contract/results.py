"""What a method gives back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import BoolArray, FloatArray, IntArray
from nlosctl.contract.statuses import Status

__all__ = ["Estimates", "Flags", "Solution", "Trace", "Words", "no_estimates", "single_estimates"]


@dataclass(frozen=True, kw_only=True)
class Estimates:
    """E estimates, ordered by snapshot, then target, then alternative (best first).

    ``row`` (E,) is the snapshot's place in the batch; every snapshot has at least one estimate, if only to carry
    its status. ``position_m`` (E, 2) in metres; ``covariance_m2`` (E, 3) holds xx, xy, yy in square metres; both
    NaN exactly where the status says so. ``cost`` (E,) is NaN where there is no position. ``covariance_kind``
    says what the covariance accounts for, where the method has more than one kind. ``measurement`` (E,) is given
    where every measurement is solved by itself, for a target of its own: its place in the snapshot.
    """

    row: IntArray
    target: IntArray
    alternative: IntArray
    position_m: FloatArray
    covariance_m2: FloatArray
    cost: FloatArray
    n_used: IntArray
    status: npt.NDArray[np.uint8]
    covariance_kind: str | None = None
    measurement: IntArray | None = None


@dataclass(frozen=True, kw_only=True)
class Words:
    """A text column that has few words: each entry of ``code`` (B, K) is a place in ``words``.

    It reads like an array of text. A word may be None: nothing is said.
    """

    code: npt.NDArray[np.uint8]
    words: tuple[str | None, ...]

    @property
    def shape(self) -> tuple[int, ...]:
        """The shape of the array."""
        return self.code.shape

    def __getitem__(self, key: Any) -> Any:
        """Return the words at places of the array."""
        return np.array(self.words, dtype=object)[self.code[key]]

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> npt.NDArray[np.object_]:
        """Return the words (B, K) as an array of text."""
        return np.array(self.words, dtype=object)[self.code]


@dataclass(frozen=True, kw_only=True)
class Flags:
    """What is said of each measurement: ``used`` (B, K), and further columns (B, K) by their name.

    Floating-point columns hold NaN where there is nothing to say.
    """

    used: BoolArray
    columns: Mapping[str, npt.NDArray[np.generic] | Words] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Trace:
    """The T states that a sequential method went through, ordered by snapshot, then step.

    ``row`` (T,) is the snapshot's place in the batch, ``measurement`` (T,) that of the row just used (-1: none yet),
    ``step`` (T,) the number of rows used so far. ``position_m`` (T, 2) and ``covariance_m2`` (T, 3) as in estimates.
    """

    row: IntArray
    step: IntArray
    measurement: IntArray
    position_m: FloatArray
    covariance_m2: FloatArray


@dataclass(frozen=True, kw_only=True)
class Solution:
    """The result of one batch. ``flags`` may be None when the batch did not want them.

    ``trace`` is left out unless the method has one and the batch wanted it.
    """

    estimates: Estimates
    flags: Flags | None = None
    trace: Trace | None = None


def no_estimates(size: int) -> Estimates:
    """Return the estimates of B snapshots by a detector that makes none: rows without a position, read by nobody."""
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


def single_estimates(
    *,
    position_m: FloatArray,
    covariance_m2: FloatArray,
    cost: FloatArray,
    n_used: IntArray,
    status: npt.NDArray[np.uint8],
) -> Estimates:
    """Return estimates with one row per snapshot; what the status denies is blanked.

    Shapes: position (B, 2), covariance (B, 3), cost, n_used and status (B,). A snapshot without a position gets
    ``n_used`` 0.
    """
    rows = np.arange(status.shape[0], dtype=np.int64)
    has_position = status <= Status.BOUNDARY
    has_covariance = status <= Status.INFEASIBLE
    return Estimates(
        row=rows,
        target=np.zeros_like(rows),
        alternative=np.zeros_like(rows),
        position_m=np.where(has_position[:, None], position_m, np.nan),
        covariance_m2=np.where(has_covariance[:, None], covariance_m2, np.nan),
        cost=np.where(has_position, cost, np.nan),
        n_used=np.where(has_position, n_used, 0),
        status=status,
    )
