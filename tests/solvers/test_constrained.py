"""Constrained maximum likelihood, compared with a zooming grid search in the allowed part of the annulus."""

from __future__ import annotations

import numpy as np
import pytest
from batches import bearing_batch

from nlosctl.contract.scene import CircleReflector, LineReflector, Scene
from nlosctl.models.bearing_predictions import predict_bearings
from nlosctl.models.bearings import sight_lines
from nlosctl.solvers.bearings.circle_likelihood import bearing_problem
from nlosctl.solvers.bearings.constrained import minimize_within_scene
from nlosctl.solvers.bearings.line_fits import fit_focused, fit_least_squares
from nlosctl.solvers.optimization.levenberg_marquardt import minimize

EARTH_M, IONOSPHERE_M = 6371e3, 6671e3
IONOSPHERE = Scene(
    reflectors=(CircleReflector(name="i", center=(0.0, 0.0), radius=IONOSPHERE_M, blocker_radius=EARTH_M),)
)


def over_the_horizon(snapshots, reflector, seed):
    """Return sight lines of the paper's set B at 5 degrees, all by the layer or the last two direct as well."""
    generator = np.random.default_rng(seed)
    angle = np.pi * np.array([0.11, -0.07, -0.12] if (reflector == 0).all() else [0.11, -0.07, 0.02, -0.015])
    shape = (snapshots, angle.size)
    sensor_xy = np.broadcast_to(EARTH_M * np.stack([np.cos(angle), np.sin(angle)], axis=1), (*shape, 2))
    source = np.broadcast_to([6421e3, 0.0], (*shape, 2))
    placed = np.broadcast_to(reflector, shape)
    bearing = predict_bearings(sensor_xy, placed, IONOSPHERE, source)
    bearing = bearing + np.radians(5.0) * generator.normal(size=shape)
    return sight_lines(bearing_batch(sensor_xy, bearing, np.radians(5.0), placed, IONOSPHERE))


def infeasible_free_estimates(lines):
    """Return the rays of snapshots whose free estimate violates the scene, these estimates and their cost."""
    first = fit_least_squares(lines)
    start = fit_focused(lines, first)
    free = minimize(bearing_problem(lines), *lines.inside_circles(start.x, start.y))
    rows = np.flatnonzero(lines.outside_scene(free.x, free.y) & free.converged)
    chosen = lines.take(rows)
    scale = np.sqrt(chosen.information(free.x[rows], free.y[rows]).inverse().trace)
    return chosen, free.x[rows], free.y[rows], scale


def zoomed_cost(lines, row):
    """Return the least cost among allowed points of zooming grids in height and angle."""
    low, high = np.array([EARTH_M, -0.35]), np.array([0.9999 * IONOSPHERE_M, 0.35])
    best, best_at = np.inf, (low + high) / 2.0
    for _ in range(8):
        radius, angle = (part.ravel() for part in np.meshgrid(*np.linspace(low, high, 41).T, indexing="ij"))
        x, y = radius * np.cos(angle) - lines.center_x[row], radius * np.sin(angle) - lines.center_y[row]
        repeated = lines.take(np.full(x.shape, row))
        cost = np.where(repeated.outside_scene(x, y), np.inf, bearing_problem(repeated).evaluate(x, y).cost)
        cost = np.where(np.isnan(cost), np.inf, cost)
        least = np.argmin(cost)
        if cost[least] < best:
            best, best_at = cost[least], np.array([radius[least], angle[least]])
        width = 0.12 * (high - low)
        low, high = (
            np.maximum(best_at - width, [EARTH_M, -0.35]),
            np.minimum(best_at + width, [0.9999 * IONOSPHERE_M, 0.35]),
        )
    return best


@pytest.mark.parametrize("reflector", [np.zeros(3, dtype=int), np.array([0, 0, -1, -1])], ids=["layer", "and direct"])
def test_no_allowed_point_is_better(reflector):
    """The constrained estimate is allowed, on an edge, and within 1e-3 nats of the zooming search."""
    lines, x, y, scale = infeasible_free_estimates(over_the_horizon(60, reflector, seed=11))
    fix = minimize_within_scene(lines, (x, y), scale, 30)
    assert x.size >= 4
    assert fix.reached.all()
    assert not lines.outside_scene(*fix.point)[fix.reached].any()
    assert fix.at_boundary[fix.reached].all()
    cost = bearing_problem(lines).evaluate(*fix.point).cost
    for row in np.flatnonzero(fix.reached)[:8]:
        assert cost[row] <= zoomed_cost(lines, row) + 1e-3


def test_the_constrained_estimate_is_on_the_mirror():
    """With a flat mirror the constrained estimate is on it, and its cost is the minimum along it."""
    mirror = Scene(reflectors=(LineReflector(name="m", point=(0.0, 100.0), direction=(1.0, 0.0)),))
    sensor_xy = np.array([[[-50.0, 0.0], [50.0, 0.0], [0.0, 10.0]]])
    reflector = np.array([[0, -1, -1]])
    bearing = predict_bearings(sensor_xy, reflector * 0 - 1, mirror, np.broadcast_to([5.0, 130.0], (1, 3, 2)))
    lines = sight_lines(bearing_batch(sensor_xy, bearing, 0.05, reflector, mirror))
    free = minimize(bearing_problem(lines), np.zeros(1) - lines.center_x, np.full(1, 120.0) - lines.center_y)
    scale = np.sqrt(lines.information(free.x, free.y).inverse().trace)
    start_y = np.maximum(free.y, 101.0 - lines.center_y)
    fix = minimize_within_scene(lines, (free.x, start_y), scale, 30)
    assert fix.reached[0]
    along = np.linspace(-60.0, 60.0, 4001)
    for height in (99.9999, 95.0, 90.0):
        x, y = along - lines.center_x[0], np.full(along.shape, height) - lines.center_y[0]
        cost = bearing_problem(lines.take(np.zeros(along.size, dtype=np.int64))).evaluate(x, y).cost
        assert bearing_problem(lines).evaluate(*fix.point).cost[0] <= cost.min() + 1e-4
