"""Maximum likelihood where several paths are possible: many starts, the distinct optima ranked."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
import numpy.typing as npt

from nlosctl.geometry.symmetric import Symmetric2x2
from nlosctl.models.bearings import SightLines
from nlosctl.solvers.levenberg_marquardt import Minimum, minimize
from nlosctl.solvers.mixed_bearing_problem import bearing_problem

__all__ = ["MAX_ALTERNATIVES", "Optima", "find_optima", "pairwise_crossings"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

MAX_ALTERNATIVES = 10
"""The largest number of optima that are kept of a snapshot."""

_MOST_PAIRS = 15
_DISTINCT = 0.1
"""Optima closer than this (standard deviations) are one."""


@dataclass(frozen=True)
class Optima:
    """Optima of B snapshots, shapes (A, B), best first; ``cost`` is infinite where there are fewer.

    ``rival_cost`` (B,) is the least cost at which another start stopped at a caustic, where the likelihood ends with a
    jump and has no smooth optimum; infinite where none did. ``evaluations`` (B,) counts all model evaluations.
    """

    x: FloatArray
    y: FloatArray
    cost: FloatArray
    rival_cost: FloatArray
    evaluations: IntArray


def pairwise_crossings(lines: SightLines) -> tuple[FloatArray, FloatArray]:
    """Return where the lines of pairs of rows cross, shapes (P, B); not finite where they are parallel.

    All pairs of up to six rows; of more rows the first fifteen in order of their distance in the list.
    """
    measurements = lines.origin_x.shape[1]
    pairs = sorted(combinations(range(measurements), 2), key=lambda pair: (pair[1] - pair[0], pair[0]))[:_MOST_PAIRS]
    crossings = []
    for i, j in pairs:
        determinant = lines.cosine[:, i] * lines.sine[:, j] - lines.sine[:, i] * lines.cosine[:, j]
        dx, dy = lines.origin_x[:, j] - lines.origin_x[:, i], lines.origin_y[:, j] - lines.origin_y[:, i]
        with np.errstate(divide="ignore", invalid="ignore"):
            along = (dx * lines.sine[:, j] - dy * lines.cosine[:, j]) / determinant
            x = lines.origin_x[:, i] + along * lines.cosine[:, i]
            crossings.append((x, lines.origin_y[:, i] + along * lines.sine[:, i]))
    return np.stack([x for x, _ in crossings]), np.stack([y for _, y in crossings])


def find_optima(lines: SightLines, start_x: FloatArray, start_y: FloatArray, max_iterations: int) -> Optima:
    """Return the distinct optima reached from starts (S, B) about the local origins; starts may be not finite."""
    starts, snapshots = start_x.shape
    many = lines.take(np.tile(np.arange(snapshots), starts))
    x, y = many.inside_circles(start_x.ravel(), start_y.ravel())
    minimum = minimize(bearing_problem(many), x, y, max_iterations=max_iterations)
    cost = np.where(minimum.converged, minimum.cost, np.inf).reshape(start_x.shape)
    order = np.argsort(cost, axis=0, kind="stable")

    def ranked(values: FloatArray) -> FloatArray:
        return np.take_along_axis(values.reshape(start_x.shape), order, axis=0)

    x, y, cost = ranked(minimum.x), ranked(minimum.y), ranked(cost.ravel())
    metric = Symmetric2x2(*(ranked(part) for part in vars(minimum.hessian).values()))
    cost = np.where(_repeated(x, y, cost, metric), np.inf, cost)
    order = np.argsort(cost, axis=0, kind="stable")[:MAX_ALTERNATIVES]
    rival = np.where(minimum.converged | np.isnan(minimum.cost), np.inf, minimum.cost).reshape(start_x.shape)
    return Optima(
        *(np.take_along_axis(values, order, axis=0) for values in (x, y, cost)),
        rival_cost=rival.min(axis=0),
        evaluations=minimum.evaluations.reshape(start_x.shape).sum(axis=0),
    )


def _repeated(x: FloatArray, y: FloatArray, cost: FloatArray, metric: Symmetric2x2) -> BoolArray:
    """Return which of the ends (S, B), in order of their cost, are the same optimum as one before them."""
    repeated = np.zeros(cost.shape, dtype=bool)
    for later in range(1, cost.shape[0]):
        for earlier in range(later):
            dx, dy = x[later] - x[earlier], y[later] - y[earlier]
            xx, xy, yy = metric.xx[earlier], metric.xy[earlier], metric.yy[earlier]
            with np.errstate(invalid="ignore", over="ignore"):
                near = xx * dx * dx + 2.0 * xy * dx * dy + yy * dy * dy <= _DISTINCT**2
            repeated[later] |= near & np.isfinite(cost[earlier]) & ~repeated[earlier]
    return repeated
