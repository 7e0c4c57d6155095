"""Maximum likelihood where several paths are possible: many initial estimates, the distinct optima ranked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ScalarT, ignoring_division, ignoring_invalid
from nlosctl.geometry.blocks import rows_in_order
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.bearings import SightLines
from nlosctl.models.sight import Sight
from nlosctl.solvers.bearings.circle_likelihood import bearing_problem
from nlosctl.solvers.optimization.levenberg_marquardt import minimize
from nlosctl.solvers.optimization.unknown_std import StdFactors

__all__ = ["MAX_ALTERNATIVES", "Optima", "find_optima", "pairwise_crossings"]


MAX_ALTERNATIVES = 10
"""The largest number of optima kept per snapshot."""

_MOST_PAIRS = 15
_SAME_VALLEY = 5.0
"""An initial estimate within this many standard deviations of an optimum leads to it."""

_DISTINCT = 0.1
"""Optima closer than this (standard deviations) are one."""


@dataclass(frozen=True)
class Optima:
    """E optima of the likelihood, by snapshot, best first; each snapshot has at least one.

    ``snapshot`` (E,) is the index in the block; None means one optimum per snapshot, in order. ``lines`` are the rays
    of each point's snapshot (E, K), ``point`` the D coordinates (E,) about its local origin, ``converged`` marks smooth
    optima. ``rival_cost`` (E,) is the lowest cost at which another search of the snapshot stopped at a caustic, where
    the likelihood ends with a jump and has no smooth optimum; infinite if none did. ``evaluations`` counts all model
    evaluations of the snapshot.
    """

    snapshot: IntArray | None
    lines: Sight
    point: tuple[FloatArray, ...]
    converged: BoolArray
    rival_cost: FloatArray
    evaluations: IntArray

    @property
    def x(self) -> FloatArray:
        """The first coordinate."""
        return self.point[0]

    @property
    def y(self) -> FloatArray:
        """The second coordinate."""
        return self.point[1]


def find_optima(
    lines: Sight, starts: Sequence[tuple[FloatArray, ...]], max_iterations: int, *, relative_std: bool = False
) -> Optima:
    """Return the optima reached from initial estimates, each as D arrays (B,), the best one last.

    In the plane only the best is used, and the crossings of all pairs of rows if a row may take several paths. In space
    a ``relative_std`` is scaled by the residuals of that estimate, so that distances in it are those of real errors.
    """
    if not isinstance(lines, SightLines):
        if not relative_std:
            return _optima_in_space(lines, starts, max_iterations)
        start = lines.inside_circles(*starts[-1])
        factors = StdFactors.of(lines.ray_residuals(*start).chi_square, lines.scalars() - len(start))
        optima = _optima_in_space(lines.with_std(factors.scaled(lines.std)), starts, max_iterations)
        rows = np.arange(start[0].size) if optima.snapshot is None else optima.snapshot
        rival_cost = optima.rival_cost * factors.squared[rows]
        return replace(optima, lines=lines if optima.snapshot is None else lines.take(rows), rival_cost=rival_cost)
    start_x, start_y = starts[-1]
    several = np.zeros(start_x.shape, dtype=bool)
    if lines.circles is not None and lines.origin_x.shape[1] > 1:
        several[lines.circles.snapshot[lines.circles.has_choice]] = True
    if not several.any():
        x, y = lines.inside_circles(start_x, start_y)
        minimum = minimize(bearing_problem(lines), x, y, max_iterations=max_iterations)
        no_rival = np.full(x.shape, np.inf)
        return Optima(None, lines, minimum.point, minimum.converged, no_rival, minimum.evaluations)
    more_x, more_y = pairwise_crossings(lines)
    all_x = np.concatenate([start_x[None], np.where(several, more_x, np.nan)])
    all_y = np.concatenate([start_y[None], np.where(several, more_y, np.nan)])
    return _optima_from_many(lines, (all_x, all_y), max_iterations)


def _optima_in_space(lines: Sight, starts: Sequence[tuple[FloatArray, ...]], max_iterations: int) -> Optima:
    """Return the optima reached from the last initial estimate, and from all others that are not near its optimum."""
    minimum = minimize(bearing_problem(lines), *lines.inside_circles(*starts[-1]), max_iterations=max_iterations)
    single = minimum.converged.copy()
    with ignoring_invalid():
        for start in starts[:-1]:
            apart = (part - end for part, end in zip(start, minimum.point, strict=True))
            single &= ~(minimum.hessian.quadratic_form(*apart) > _SAME_VALLEY**2)
    rest = np.flatnonzero(~single)
    no_rival = np.full(single.shape, np.inf)
    if not rest.size:
        return Optima(None, lines, minimum.point, minimum.converged, no_rival, minimum.evaluations)
    every = tuple(np.stack([start[axis][rest] for start in starts]) for axis in range(len(starts[-1])))
    many = _optima_from_many(lines.take(rest), every, max_iterations)
    alone = np.flatnonzero(single)
    snapshot = np.concatenate([alone, rest[many.snapshot]])
    order = np.argsort(snapshot, kind="stable")

    def joined(one: npt.NDArray[ScalarT], other: npt.NDArray[ScalarT]) -> npt.NDArray[ScalarT]:
        return np.concatenate([one[alone], other])[order]

    return Optima(
        snapshot[order],
        rows_in_order(lines, snapshot[order], single.shape[0]),
        tuple(joined(*pair) for pair in zip(minimum.point, many.point, strict=True)),
        joined(minimum.converged, many.converged),
        joined(no_rival, many.rival_cost),
        joined(minimum.evaluations, many.evaluations),
    )


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
        with ignoring_division():
            along = (dx * lines.sine[:, j] - dy * lines.cosine[:, j]) / determinant
            x = lines.origin_x[:, i] + along * lines.cosine[:, i]
            crossings.append((x, lines.origin_y[:, i] + along * lines.sine[:, i]))
    return np.stack([x for x, _ in crossings]), np.stack([y for _, y in crossings])


def _optima_from_many(lines: Sight, start: tuple[FloatArray, ...], max_iterations: int) -> Optima:
    """Return the distinct optima reached from S points per snapshot, D arrays (S, B); points may be non-finite."""
    starts, snapshots = start[0].shape
    many = lines.take(np.tile(np.arange(snapshots), starts))
    point = many.inside_circles(*(part.ravel() for part in start))
    minimum = minimize(bearing_problem(many), *point, max_iterations=max_iterations)
    shape = start[0].shape
    cost = np.where(minimum.converged, minimum.cost, np.inf).reshape(shape)
    stopped = np.where(minimum.converged | np.isnan(minimum.cost), np.inf, minimum.cost).reshape(shape)
    order = np.argsort(cost, axis=0, kind="stable")

    def ranked(values: npt.NDArray[ScalarT]) -> npt.NDArray[ScalarT]:
        return np.take_along_axis(values.reshape(shape), order, axis=0)

    point, cost = tuple(map(ranked, minimum.point)), np.take_along_axis(cost, order, axis=0)
    metric = minimum.hessian.map(ranked)
    kept = np.isfinite(cost) & ~_repeated(point, cost, metric)
    kept &= np.cumsum(kept, axis=0) <= MAX_ALTERNATIVES
    kept[0] = True
    snapshot, rank = np.nonzero(kept.T)
    return Optima(
        snapshot,
        lines.take(snapshot),
        tuple(part[rank, snapshot] for part in point),
        np.isfinite(cost)[rank, snapshot],
        stopped.min(axis=0)[snapshot],
        minimum.evaluations.reshape(shape).sum(axis=0)[snapshot],
    )


def _repeated(point: tuple[FloatArray, ...], cost: FloatArray, metric: SymmetricMatrix) -> BoolArray:
    """Return which points, D arrays (S, B) in order of their cost, are the same optimum as one before them."""
    repeated = np.zeros(cost.shape, dtype=bool)
    for later in range(1, cost.shape[0]):
        for earlier in range(later):
            apart = (part[later] - part[earlier] for part in point)
            near = metric.at(earlier).quadratic_form(*apart) <= _DISTINCT**2
            repeated[later] |= near & np.isfinite(cost[earlier]) & ~repeated[earlier]
    return repeated
