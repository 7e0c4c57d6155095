"""Ranked alternatives of each snapshot as a solution: statuses, estimates, flags."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import BoolArray, FloatArray, IntArray, Point, StatusArray, ignoring_invalid, ignoring_overflow
from nlosctl.contract.results import Estimates, Flags, has_covariance, has_position
from nlosctl.contract.statuses import Status
from nlosctl.geometry.blocks import RowBlock
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.solvers.mixture.likelihood import Mixture
from nlosctl.solvers.mixture.modes import Modes
from nlosctl.solvers.mixture.path_groups import PathGroups, restore_rows
from nlosctl.solvers.optimization.problem import RowDerivatives, least_chi_square

__all__ = ["Misfit", "RankedFixes", "direct_at", "rank_modes", "ranked_estimates", "ranked_flags", "ranked_status"]


_CHANCE = 2
"""This many rows always agree on some point."""

_ROUNDING = 1e-10
"""Determinants of covariances below this share of the diagonal's product are rounding: the information was singular."""


@dataclass(frozen=True)
class RankedFixes(RowBlock):
    """Up to T fixes (B, T) of each snapshot, the most likely first; ``cost`` is infinite for missing ones."""

    point: Point
    cost: FloatArray
    covariance: SymmetricMatrix
    n_used: IntArray
    misfit: Misfit

    @property
    def best_point(self) -> Point:
        """The point (B,) of the best fix of each snapshot."""
        return tuple(part[:, 0] for part in self.point)


@dataclass(frozen=True)
class Misfit(RowBlock):
    """The chi-square (B, T) of the rows that each fix uses, and its degrees of freedom."""

    chi_square: FloatArray
    degrees_of_freedom: IntArray

    @classmethod
    def unknown(cls, shape: tuple[int, int]) -> Misfit:
        """Return as many that are not yet known."""
        return cls(np.full(shape, np.nan), np.zeros(shape, dtype=np.int64))

    def put(
        self,
        index: Any,
        mixture: Mixture,
        point: Point,
        used: BoolArray,
        derivatives: Sequence[RowDerivatives] | None = None,
    ) -> None:
        """Fill in the fixes at points (N,) with an ``index``, which use the rows marked by ``used`` (N, K).

        ``derivatives`` are those of the mixture's rows at the points, if already computed.
        """
        height = None if mixture.height is None else mixture.height_terms(*point)
        chi_square, scalars = least_chi_square(mixture.rows, point, used, height, derivatives)
        if mixture.height is not None:
            scalars = scalars + mixture.height.known
        self.chi_square[index], self.degrees_of_freedom[index] = chi_square, scalars - len(point)


def direct_at(mixture: Mixture, center: Point, position_m: FloatArray) -> FloatArray:
    """Return each row's probability (B, K) to be direct at known positions (B, D); ``center`` are the local origins."""
    unknown = position_m.T[: mixture.dimension]  # without a height that is exactly known
    point = (part - middle for part, middle in zip(unknown, center, strict=False))
    return mixture.responsibilities(*point)[0]


def rank_modes(mixture: Mixture, modes: Modes) -> tuple[RankedFixes, FloatArray]:
    """Return the modes with the information of their direct rows, and each row's probability (B, K) at the best."""
    snapshot, index = np.nonzero(np.isfinite(modes.cost))
    taken, point = mixture.take(snapshot), tuple(part[snapshot, index] for part in modes.point)
    rows = taken.derivatives(*point)
    probability, information = taken.responsibilities(*point, rows=rows)
    misfit = Misfit.unknown(modes.cost.shape)
    misfit.put((snapshot, index), taken, point, probability > 0.5, rows)
    covariance = SymmetricMatrix.full(modes.cost.shape, np.nan, mixture.dimension)
    covariance.put((snapshot, index), information.inverse())
    n_used = np.zeros(modes.cost.shape, dtype=np.int64)
    n_used[snapshot, index] = np.count_nonzero(probability > 0.5, axis=1)
    best = np.full((modes.cost.shape[0], mixture.count), np.nan, order="F")
    best[snapshot[index == 0]] = probability[index == 0]
    return RankedFixes(modes.point, modes.cost, covariance, n_used, misfit), best


def ranked_status(
    fixes: RankedFixes,
    candidates: BoolArray,
    degenerate: BoolArray,
    ambiguous_within: float,
    at_boundary: BoolArray | None = None,
    *,
    unordered: BoolArray | None = None,
    ambiguous_rows: int = 0,
    further: Mapping[Status, BoolArray] | None = None,
) -> StatusArray:
    """Return the status (B,).

    ambiguous: another fix is within ``ambiguous_within`` nats; or, in ``unordered`` (B,) snapshots, where sensors have
    several paths in unknown order, at most ``ambiguous_rows`` fewer rows agree on it. There the number of rows does
    not distinguish the source from its mirror image.

    ``candidates`` (B,) marks snapshots with any candidate in the search region; a fix without a direct row (all are
    outliers) does not count either. ``degenerate`` (B,) marks snapshots that can't determine a position for any values
    of their rows, ``at_boundary`` (B,) fixes constrained to the edge of the search region. ``further`` marks the
    snapshots (B,) of other statuses; of several the first in the order of docs/conventions.md holds.
    """
    further = further or {}
    status = np.full(candidates.shape, Status.OK, dtype=np.uint8)
    covariance = fixes.covariance
    with ignoring_invalid():
        if fixes.cost.shape[1] > 1:
            status[fixes.cost[:, 1] - fixes.cost[:, 0] <= ambiguous_within] = Status.AMBIGUOUS
            if unordered is not None:
                others = np.where(np.isfinite(fixes.cost), fixes.n_used, 0)[:, 1:].max(axis=1)
                rivalled = (others > _CHANCE) & (others >= fixes.n_used[:, 0] - ambiguous_rows)
                status[unordered & rivalled] = Status.AMBIGUOUS
    status[further.get(Status.AMBIGUOUS, [])] = Status.AMBIGUOUS
    if at_boundary is not None:
        status[at_boundary] = Status.BOUNDARY
    for word in (Status.INFEASIBLE, Status.DEGENERATE):
        status[further.get(word, [])] = word
    status[~_sound(covariance)[:, 0]] = Status.DEGENERATE
    status[further.get(Status.NO_CONSENSUS, [])] = Status.NO_CONSENSUS
    missing = ~np.isfinite(fixes.cost[:, 0])
    status[missing] = Status.NOT_CONVERGED
    status[~missing & (fixes.n_used[:, 0] == 0)] = Status.NO_CANDIDATE
    status[~candidates] = Status.NO_CANDIDATE
    for word in (Status.OUTSIDE_FIELD, Status.BEHIND):
        status[further.get(word, [])] = word
    status[degenerate] = Status.DEGENERATE
    return status


def ranked_estimates(
    fixes: RankedFixes,
    status: StatusArray,
    rows: Any,
    covariance_kind: str,
    columns: Mapping[str, FloatArray] | None = None,
) -> Estimates:
    """Return the estimates: every fix of a snapshot that has an answer, the most likely first; else its status.

    The fixes are about the local origins of the measured ``rows`` (B, K), which have the frame as well, and a height
    that is exactly known. ``columns`` (B, T) are further ones of fixes with a covariance. A position without one is
    alone.
    """
    written = np.isfinite(fixes.cost) & has_position(status)[:, None] & _sound(fixes.covariance)
    written &= has_covariance(status)[:, None]
    written[:, 0] = True
    row, alternative = np.nonzero(written)
    at = row, alternative
    before = np.cumsum(written, axis=1) - 1
    mine, point = rows.take(row), tuple(part[at] for part in fixes.point)
    return Estimates.of(
        status[row],
        mine.absolute(*point),
        mine.whole_covariance(fixes.covariance.at(*at), *point),
        fixes.cost[at],
        fixes.n_used[at],
        row=row.astype(np.int64),
        alternative=before[at].astype(np.int64),
        covariance_kind=covariance_kind,
        chi_square=fixes.misfit.chi_square[at],
        degrees_of_freedom=fixes.misfit.degrees_of_freedom[at],
        columns={
            name: np.where(has_covariance(status[row]), values[at], np.nan) for name, values in (columns or {}).items()
        },
    )


def _sound(covariance: SymmetricMatrix) -> BoolArray:
    """Return which covariances are positive definite beyond rounding."""
    with ignoring_overflow():
        diagonal = covariance.diagonal
        sound: BoolArray = np.isfinite(covariance.trace) & np.logical_and.reduce([part > 0.0 for part in diagonal])
        sound &= covariance.determinant > reduce(np.multiply, diagonal[1:], _ROUNDING * diagonal[0])
    return sound


def ranked_flags(
    status: StatusArray,
    groups: PathGroups | None,
    used: BoolArray,
    probability: FloatArray,
    numbers: Mapping[str, FloatArray],
) -> Flags:
    """Return the flags of the best fix, which uses the rows ``used`` (B, K), with columns of numbers (B, K).

    ``los`` is whether a row's probability (B, K) to be direct exceeds a half. The input is in the order of the groups
    (None: of the file), the result in that of the file. A snapshot without a position uses no row and has no values;
    without a consensus there is no source that a row may be direct from.
    """
    answered = has_position(status)[:, None]
    judged = answered & (status != Status.NO_CONSENSUS)[:, None]
    probability = np.where(judged, restore_rows(probability, groups), np.nan)
    los = np.full(probability.shape, None, dtype=object)
    np.copyto(los, probability > 0.5, where=np.broadcast_to(judged, los.shape))
    columns: dict[str, npt.NDArray[np.generic]] = {"los": los, "los_probability": probability}
    columns.update({name: np.where(answered, restore_rows(values, groups), np.nan) for name, values in numbers.items()})
    return Flags(used=restore_rows(used, groups) & answered, columns=columns)
