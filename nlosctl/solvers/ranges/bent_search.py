"""The two best optima of snapshots with a range by a circle, whose points of one length are no circle."""

from __future__ import annotations

import numpy as np

from nlosctl.arrays import FloatArray, ignoring_invalid
from nlosctl.geometry.blocks import rows_of, sum_measurements
from nlosctl.models.ranges.circles import RangeCircles
from nlosctl.solvers.optimization.levenberg_marquardt import minimize
from nlosctl.solvers.optimization.two_optima import End
from nlosctl.solvers.ranges.circle_crossings import MOST_CROSSINGS, cross_by_circle, pairs_by_circle
from nlosctl.solvers.ranges.likelihood import RangeProblem
from nlosctl.solvers.ranges.search import cross_pairs

__all__ = ["find_bent_optima"]

_EVERY_PAIR = 5
"""Up to this many rows all pairs are crossed; of more rows those with the surest range."""

_DESCENTS = 8
"""Descents of each snapshot, from its likeliest crossings."""

_DISTINCT_STANDARD_DEVIATIONS = 1e-3
"""Optima nearer to each other than this are the same."""


def find_bent_optima(circles: RangeCircles, max_iterations: int, infeasible_nats: float) -> tuple[End, End]:
    """Return the best optima of a block of snapshots that all have a row by a circle; the same where there is only one.

    Descents start from the likeliest crossings of pairs of rows. A point that the scene hides from a row is taken only
    if it is likelier than the others by ``infeasible_nats``.
    """
    x, y = _likeliest(circles, *_crossings(circles))
    starts, snapshots = x.shape[1], x.shape[0]
    rows = np.repeat(np.arange(snapshots), starts)
    many = circles.take(rows)
    end = minimize(RangeProblem.of_rows(many), x.ravel(), y.ravel(), max_iterations=max_iterations)
    cost = np.where(end.converged, end.cost, np.inf) + infeasible_nats * many.unseen(end.x, end.y).any(axis=1)
    with ignoring_invalid():
        std = np.sqrt(many.information(end.x, end.y).inverse().trace)
    cost, std = cost.reshape(x.shape), std.reshape(x.shape)
    first = np.arange(snapshots) * starts
    index = np.argmin(cost, axis=1)
    best = first + index
    with ignoring_invalid():
        away = np.hypot(end.x - np.repeat(end.x[best], starts), end.y - np.repeat(end.y[best], starts))
        apart = away.reshape(x.shape) > _DISTINCT_STANDARD_DEVIATIONS * std[np.arange(snapshots), index][:, None]
    others = np.where(apart, cost, np.inf)
    following = first + np.where(np.isfinite(others).any(axis=1), np.argmin(others, axis=1), index)
    one, other = (End(rows_of(end.point, at), end.cost[at], end.converged[at]) for at in (best, following))
    return one, other


def _crossings(circles: RangeCircles) -> tuple[FloatArray, FloatArray]:
    """Return x, y (b, C) of the crossings of pairs of rows; NaN where there are fewer."""
    snapshots, count = circles.range_m.shape
    if count <= _EVERY_PAIR:
        first, second = (np.broadcast_to(index, (snapshots, index.size)) for index in np.triu_indices(count, 1))
    else:
        first = np.broadcast_to(np.argmin(circles.std_m, axis=1)[:, None], (snapshots, count))
        second = np.broadcast_to(np.arange(count), (snapshots, count))
    points = np.full((*first.shape, MOST_CROSSINGS, 2), np.nan)
    straight = np.stack(cross_pairs(circles, first, second), axis=-1)
    points[:, :, :2] = straight.reshape(2, first.shape[1], snapshots, 2).transpose(2, 1, 0, 3)
    bent = pairs_by_circle(circles, first, second)
    bent = tuple(part[first[bent] != second[bent]] for part in bent)
    points[bent] = np.stack(cross_by_circle(circles, bent[0], first[bent], second[bent]), axis=-1)
    return points[..., 0].reshape(snapshots, -1), points[..., 1].reshape(snapshots, -1)


def _likeliest(circles: RangeCircles, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the likeliest (b, S) of points (b, C)."""
    costs = []
    for candidate_x, candidate_y in zip(x.T, y.T, strict=True):
        scaled = circles.residual_m(candidate_x, candidate_y) / circles.std_m
        costs.append(sum_measurements(scaled * scaled))
    cost = np.where(np.isnan(costs), np.inf, costs)
    order = np.argsort(cost, axis=0, kind="stable")[:_DESCENTS].T
    return np.take_along_axis(x, order, axis=1), np.take_along_axis(y, order, axis=1)
