"""Fits of single paths as estimates: is a fit an answer, what does it cost, what is left over?"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import BoolArray, FloatArray, StatusArray, ignoring_invalid, ignoring_overflow
from nlosctl.contract.results import Estimates
from nlosctl.contract.statuses import Status
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.triplets import PathRows
from nlosctl.solvers.triplets.likelihood import TripletProblem
from nlosctl.solvers.triplets.target_fits import TargetFits

__all__ = ["judge_targets", "mark_ambiguous", "path_estimates"]


_RELATIVE_MINIMUM_RANGE = 1e-6


def judge_targets(
    problem: TripletProblem, x: FloatArray, y: FloatArray, covariance: SymmetricMatrix, converged: BoolArray
) -> StatusArray:
    """Return the status (B,) of targets at x, y (B,) about the local origin.

    not_converged; degenerate: on a transmitter or receiver (closer than a millionth of the distance of the farthest),
    or a standard deviation beyond that distance, as on a baseline.
    """
    nearest, farthest = np.full(x.shape, np.inf), np.zeros(x.shape)
    with ignoring_overflow():
        for k in range(problem.tx_x.shape[1]):
            for node_x, node_y in ((problem.tx_x, problem.tx_y), (problem.rx_x, problem.rx_y)):
                squared = (x - node_x[:, k]) ** 2 + (y - node_y[:, k]) ** 2
                nearest, farthest = np.minimum(nearest, squared), np.maximum(farthest, squared)
        uncertain = ~(covariance.trace <= farthest) | ~(covariance.determinant > 0.0)
        on_node = nearest < _RELATIVE_MINIMUM_RANGE**2 * farthest
    status = np.full(x.shape, Status.OK, dtype=np.uint8)
    status[~converged] = Status.NOT_CONVERGED
    status[uncertain | on_node] = Status.DEGENERATE
    return status


def mark_ambiguous(fits: TargetFits, status: StatusArray, ambiguous_within: float) -> StatusArray:
    """Return the statuses with ``ambiguous`` where another minimum costs hardly more (nats)."""
    with ignoring_invalid():
        close = (fits.runner_up - fits.cost < ambiguous_within) & (status == Status.OK)
    return np.where(close, np.uint8(Status.AMBIGUOUS), status)


def path_estimates(rows: PathRows, fits: TargetFits, ambiguous_within: float) -> Estimates:
    """Return an estimate for every path, each of a target of its own; covariance: the inverse Fisher information."""
    problem = TripletProblem.of_paths(rows)
    covariance = problem.information(fits.x, fits.y).inverse()
    judged = judge_targets(problem, fits.x, fits.y, covariance, fits.converged)
    status = mark_ambiguous(fits, judged, ambiguous_within)
    x, y = rows.frame.to_global(fits.x, fits.y)
    turned = rows.frame.matrix_to_global(covariance)
    answered = status <= Status.BOUNDARY
    certain = status <= Status.INFEASIBLE

    def by_snapshot(flat: npt.NDArray[np.generic]) -> npt.NDArray[np.generic]:
        return np.ascontiguousarray(rows.dense(flat)).reshape(-1)

    size, count = rows.shape
    position = np.stack([by_snapshot(np.where(answered, value, np.nan)) for value in (x, y)], axis=1)
    matrix = np.stack(
        [by_snapshot(np.where(certain, value, np.nan)) for value in (turned.xx, turned.xy, turned.yy)], axis=1
    )
    places = np.tile(np.arange(count), size)
    return Estimates(
        row=np.repeat(np.arange(size), count),
        target=places,
        alternative=np.zeros_like(places),
        position_m=np.asarray(position, dtype=np.float64),
        covariance_m2=np.asarray(matrix, dtype=np.float64),
        cost=np.asarray(by_snapshot(np.where(answered, fits.cost, np.nan)), dtype=np.float64),
        n_used=np.asarray(by_snapshot(answered.astype(np.int64)), dtype=np.int64),
        status=np.asarray(by_snapshot(status), dtype=np.uint8),
        measurement=places,
    )
