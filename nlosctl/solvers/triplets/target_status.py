"""Fits of single paths as estimates: status, cost and covariance."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.special import chdtrc, erfc

from nlosctl.arrays import BoolArray, FloatArray, ScalarT, StatusArray, ignoring_invalid, ignoring_overflow
from nlosctl.contract.results import Estimates
from nlosctl.contract.statuses import Status
from nlosctl.geometry.symmetric import SymmetricMatrix, dot
from nlosctl.models.triplets import PathRows, SpaceFrame, SpacePaths
from nlosctl.solvers.triplets.elliptic_coordinates import path_covariance
from nlosctl.solvers.triplets.legs import Node
from nlosctl.solvers.triplets.likelihood import TripletProblem, level_part
from nlosctl.solvers.triplets.spheroidal_coordinates import space_path_covariance
from nlosctl.solvers.triplets.target_fits import TargetFits

__all__ = ["curved_covariance", "judge_targets", "mark_ambiguous", "p_values", "path_estimates"]


_RELATIVE_MINIMUM_RANGE = 1e-6
_VERTICAL_WITHIN = 3.0
_NEAR_STDS = 3.0
"""A target of a single path in space is on a node if it is nearer than so many standard deviations of its length."""


def judge_targets(
    problem: TripletProblem, point: tuple[FloatArray, ...], covariance: SymmetricMatrix, converged: BoolArray
) -> StatusArray:
    """Return the status (B,) of targets (D arrays (B,)) about the local origin.

    not_converged; degenerate: on a transmitter or receiver (closer than a millionth of the distance of the farthest),
    or a standard deviation beyond that distance, as on a baseline. In space also straight above or below one, within
    three standard deviations, where its azimuth and elevation are no Gaussian pair.
    """
    shape = point[0].shape
    vertical = np.zeros(shape, dtype=bool)
    nearest, farthest = np.full(shape, np.inf), np.zeros(shape)
    with ignoring_overflow():
        for k in range(problem.paths):
            for node in (problem.tx, problem.rx):
                apart = [part - own[:, k] for part, own in zip(point, node.position, strict=True)]
                squared = dot(apart, apart)
                nearest, farthest = np.minimum(nearest, squared), np.maximum(farthest, squared)
                if len(point) == 3:
                    vertical |= _is_vertical(node, k, apart, covariance)
        leading = covariance if problem.held is None else level_part(covariance)
        uncertain = ~(covariance.trace <= farthest) | ~(leading.determinant > 0.0) | vertical
        on_node = nearest < _RELATIVE_MINIMUM_RANGE**2 * farthest
    status = np.full(shape, Status.OK, dtype=np.uint8)
    status[~converged] = Status.NOT_CONVERGED
    status[uncertain | on_node] = Status.DEGENERATE
    return status


def _is_vertical(node: Node, k: int, apart: list[FloatArray], covariance: SymmetricMatrix) -> BoolArray:
    """Return where targets (three arrays (B,) from a node), or what it measures, are within three std of the vertical.

    The standard deviation is that of the measured elevation, or that of the elevation of the estimate if it is larger.
    """
    inverse_std = np.asarray(node.inverse_elevation_std)[:, k]
    std_rad = np.where(inverse_std > 0.0, 1.0 / np.where(inverse_std > 0.0, inverse_std, 1.0), 0.0)
    level = np.hypot(apart[0], apart[1])
    distance = np.hypot(level, apart[2])
    h, rise = (apart[0] / level, apart[1] / level), apart[2] / distance
    tangent = (-rise * h[0], -rise * h[1], level / distance)
    spread = np.sqrt(covariance.quadratic_form(*tangent)) / distance
    steep: BoolArray = ~(np.arctan2(level, np.abs(apart[2])) >= _VERTICAL_WITHIN * np.fmax(std_rad, spread))
    steep |= 0.5 * np.pi - np.abs(np.asarray(node.elevation_rad)[:, k]) < _VERTICAL_WITHIN * std_rad
    return steep


def p_values(rows: PathRows | SpacePaths, fits: TargetFits) -> FloatArray:
    """Return the probabilities (N,) of as large a chi-square for direct paths; NaN without a spare scalar."""
    if isinstance(rows, PathRows):
        return np.asarray(erfc(np.sqrt(fits.cost)))
    spare = TripletProblem.of_paths(rows).degrees_of_freedom(np.ones((fits.cost.shape[0], 1), dtype=bool))
    return np.where(spare > 0, chdtrc(np.maximum(spare, 1), 2.0 * fits.cost), np.nan)


def mark_ambiguous(fits: TargetFits, status: StatusArray, ambiguous_within: float) -> StatusArray:
    """Return the statuses with ``ambiguous`` where another minimum costs hardly more (nats)."""
    with ignoring_invalid():
        close = (fits.runner_up - fits.cost < ambiguous_within) & (status == Status.OK)
    return np.where(close, np.uint8(Status.AMBIGUOUS), status)


def _is_near_node(problem: TripletProblem, point: tuple[FloatArray, ...]) -> BoolArray:
    """Return which targets (N,) of single paths are so near to a node that the path length cannot separate them.

    The angle measured at that node is then worth little, and the linearized covariance as much as it is near.
    """
    near = np.zeros(point[0].shape, dtype=bool)
    for node in (problem.tx, problem.rx):
        apart = [part - own[:, 0] for part, own in zip(point, node.position, strict=True)]
        near |= dot(apart, apart) * problem.inverse_length_std[:, 0] ** 2 < _NEAR_STDS**2
    return near


def curved_covariance(rows: PathRows | SpacePaths, fits: TargetFits) -> SymmetricMatrix:
    """Return the posterior's second moments (N,) about the targets of single paths, in the axes of the file."""
    problem, frame = TripletProblem.of_paths(rows), rows.frame
    if problem.held is not None:
        return problem.covariance(*fits.point)
    if isinstance(frame, SpaceFrame):
        return space_path_covariance(problem, frame.length_m, frame.axes, fits.point, fits.cost)
    information = problem.information(*fits.point)
    return frame.matrix_to_global(path_covariance(problem, frame.length_m, information, fits.point, fits.cost))


def path_estimates(rows: PathRows | SpacePaths, fits: TargetFits, ambiguous_within: float) -> Estimates:
    """Return an estimate for every path, each of a separate target; covariance: the posterior's second moments."""
    problem = TripletProblem.of_paths(rows)
    judged = judge_targets(problem, fits.point, problem.covariance(*fits.point), fits.converged)
    if isinstance(rows, SpacePaths):
        judged[_is_near_node(problem, fits.point)] = Status.DEGENERATE
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
        degrees_of_freedom=by_snapshot(problem.degrees_of_freedom(np.ones((size * count, 1), dtype=bool))),
    )
