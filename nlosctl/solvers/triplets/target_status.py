"""Fits of single paths as estimates: status, cost and covariance."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import BoolArray, FloatArray, ScalarT, StatusArray, ignoring_invalid, ignoring_overflow
from nlosctl.contract.results import Estimates
from nlosctl.contract.statuses import Status
from nlosctl.geometry.symmetric import SymmetricMatrix, dot
from nlosctl.models.triplets import PathRows
from nlosctl.solvers.triplets.elliptic_coordinates import path_covariance
from nlosctl.solvers.triplets.likelihood import TripletProblem
from nlosctl.solvers.triplets.target_fits import TargetFits

__all__ = ["curved_covariance", "judge_targets", "mark_ambiguous", "path_estimates"]


_RELATIVE_MINIMUM_RANGE = 1e-6


def judge_targets(
    problem: TripletProblem, point: tuple[FloatArray, ...], covariance: SymmetricMatrix, converged: BoolArray
) -> StatusArray:
    """Return the status (B,) of targets (D arrays (B,)) about the local origin.

    not_converged; degenerate: on a transmitter or receiver (closer than a millionth of the distance of the farthest),
    or a standard deviation beyond that distance, as on a baseline.
    """
    shape = point[0].shape
    nearest, farthest = np.full(shape, np.inf), np.zeros(shape)
    with ignoring_overflow():
        for k in range(problem.paths):
            for node in (problem.tx, problem.rx):
                apart = [part - own[:, k] for part, own in zip(point, node.position, strict=True)]
                squared = dot(apart, apart)
                nearest, farthest = np.minimum(nearest, squared), np.maximum(farthest, squared)
        uncertain = ~(covariance.trace <= farthest) | ~(covariance.determinant > 0.0)
        on_node = nearest < _RELATIVE_MINIMUM_RANGE**2 * farthest
    status = np.full(shape, Status.OK, dtype=np.uint8)
    status[~converged] = Status.NOT_CONVERGED
    status[uncertain | on_node] = Status.DEGENERATE
    return status


def mark_ambiguous(fits: TargetFits, status: StatusArray, ambiguous_within: float) -> StatusArray:
    """Return the statuses with ``ambiguous`` where another minimum costs hardly more (nats)."""
    with ignoring_invalid():
        close = (fits.runner_up - fits.cost < ambiguous_within) & (status == Status.OK)
    return np.where(close, np.uint8(Status.AMBIGUOUS), status)


def curved_covariance(rows: PathRows, fits: TargetFits) -> SymmetricMatrix:
    """Return the posterior's second moments (N,) about the targets of single paths, in the axes of the file."""
    problem = TripletProblem.of_paths(rows)
    information = problem.information(*fits.point)
    covariance = path_covariance(problem, rows.rays.baseline_m, information, fits.point, fits.cost)
    return rows.frame.matrix_to_global(covariance)


def path_estimates(rows: PathRows, fits: TargetFits, ambiguous_within: float) -> Estimates:
    """Return an estimate for every path, each of a separate target; covariance: the posterior's second moments."""
    problem = TripletProblem.of_paths(rows)
    judged = judge_targets(problem, fits.point, problem.information(*fits.point).inverse(), fits.converged)
    status = mark_ambiguous(fits, judged, ambiguous_within)
    position = rows.frame.to_global(*fits.point)
    covariance = curved_covariance(rows, fits)

    def by_snapshot(flat: npt.NDArray[ScalarT]) -> npt.NDArray[ScalarT]:
        return np.ascontiguousarray(rows.dense(flat)).reshape(-1)

    size, count = rows.shape
    measurement = np.tile(np.arange(count), size)
    return Estimates.of(
        by_snapshot(status),
        tuple(map(by_snapshot, position)),
        covariance.map(by_snapshot),
        by_snapshot(fits.cost),
        1,
        row=np.repeat(np.arange(size), count),
        target=measurement,
        measurement=measurement,
        chi_square=2.0 * by_snapshot(fits.cost),
        degrees_of_freedom=by_snapshot(problem.scalars()[:, 0]) - len(position),
    )
