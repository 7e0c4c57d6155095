"""Optima with ambiguous paths, compared with the enumeration of all combinations on a dense grid."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from batches import bearing_batch
from scipy.optimize import minimize as scipy_minimize

from nlosctl.contract.scene import CircleReflector, Scene
from nlosctl.geometry.circular_reflection import all_reflections
from nlosctl.models.bearings import sight_lines
from nlosctl.solvers.bearings.line_fits import fit_focused, fit_least_squares
from nlosctl.solvers.bearings.multistart import find_optima, pairwise_crossings

RADIUS = 1000.0
SCENE = Scene(reflectors=(CircleReflector(name="ring", center=(0.0, 0.0), radius=RADIUS),))


def draw_ambiguous(snapshots, measurements, std_deg, seed):
    """Return bearings of sources in an open circle, each by one of its paths chosen at random."""
    generator = np.random.default_rng(seed)
    shape = (snapshots, measurements)

    def disc(size):
        return 0.9 * RADIUS * np.sqrt(generator.random(size)) * np.exp(2j * np.pi * generator.random(size))

    sensor, source = disc(shape), np.broadcast_to(disc((snapshots, 1)), shape)
    parts = (part.ravel().copy() for part in (sensor.real, sensor.imag, source.real, source.imag))
    paths = all_reflections(*parts, np.full(sensor.size, RADIUS)).bearing_rad
    choice = np.argmax(np.where(np.isnan(paths), -1.0, generator.random(paths.shape)), axis=0)
    bearing = paths[choice, np.arange(sensor.size)].reshape(shape)
    std = np.radians(std_deg)
    sensor_xy = np.stack([sensor.real, sensor.imag], axis=-1)
    noisy = bearing + std * generator.normal(size=shape)
    return bearing_batch(sensor_xy, noisy, std, 0, SCENE, want_flags=False)


def residuals_by_path(batch, row, x, y):
    """Return the scaled residual (4, P, K) of each path of each sensor at points (P,); NaN without a path."""
    columns = []
    for k in range(batch.measurements):
        sensor = [np.full(x.shape, part) for part in batch.sensor_xy_m[row, k]]
        paths = all_reflections(*sensor, x, y, np.full(x.shape, RADIUS))
        off = np.angle(np.exp(1j * (batch.bearing_rad[row, k] - paths.bearing_rad)))
        columns.append(off / batch.bearing_std_rad[row, k])
    return np.stack(columns, axis=-1)


def least_over_combinations(residual):
    """Return the least half chi-square (P,) over all 4^K combinations of paths, by enumeration."""
    sensors = residual.shape[-1]
    best = np.full(residual.shape[1], np.inf)
    for combination in itertools.product(range(4), repeat=sensors):
        cost = 0.5 * sum(residual[path, :, k] ** 2 for k, path in enumerate(combination))
        best = np.fmin(best, cost)
    return best


def enumerated_optima(batch, row):
    """Return (cost, x, y) of the local optima found from the dense grid, best first, and the grid's minimum."""
    steps = np.linspace(-0.999 * RADIUS, 0.999 * RADIUS, 60)
    x, y = (part.ravel() for part in np.meshgrid(steps, steps, indexing="ij"))
    inside = np.hypot(x, y) < 0.999 * RADIUS
    cost = np.full(x.shape, np.inf)
    cost[inside] = least_over_combinations(residuals_by_path(batch, row, x[inside], y[inside]))

    def objective(point):
        if np.hypot(*point) >= RADIUS:
            return np.inf
        return least_over_combinations(residuals_by_path(batch, row, point[:1], point[1:]))[0]

    field = np.pad(cost.reshape(60, 60), 1, constant_values=np.inf)
    shifts = [(a, b) for a in (0, 1, 2) for b in (0, 1, 2) if (a, b) != (1, 1)]
    lowest = np.all([field[1:-1, 1:-1] <= field[a : a + 60, b : b + 60] for a, b in shifts], axis=0).ravel()
    starts = np.flatnonzero(lowest & np.isfinite(cost))
    starts = starts[np.argsort(cost[starts])][:2]
    found = [
        scipy_minimize(objective, (x[i], y[i]), method="Nelder-Mead", options={"xatol": 1e-5, "fatol": 1e-10})
        for i in starts
    ]
    return sorted((result.fun, *result.x) for result in found)


def ends_of(batch):
    """Return the optima reached from all starts."""
    lines = sight_lines(batch)
    first = fit_least_squares(lines)
    start = fit_focused(lines, first)
    return find_optima(lines, (start.point,), 60)


@pytest.mark.extensive
@pytest.mark.parametrize(("measurements", "std_deg", "snapshots"), [(2, 0.5, 6), (3, 1.0, 4), (4, 0.3, 2)])
def test_no_combination_of_paths_is_better(measurements, std_deg, snapshots):
    """No combination of paths has a lower cost than our best, unless the likelihood ends at a caustic."""
    batch = draw_ambiguous(snapshots, measurements, std_deg, seed=measurements)
    ends = ends_of(batch)
    compared = 0
    for row in range(snapshots):
        expected = enumerated_optima(batch, row)[0]
        mine = np.flatnonzero(ends.snapshot == row)
        cost = 0.5 * ends.lines.ray_residuals(ends.x, ends.y).chi_square[mine[0]]
        if ends.converged[mine[0]] and cost <= expected[0] + 1e-6:
            compared += 1
        else:
            assert ends.rival_cost[mine[0]] <= expected[0] + 2.0
    assert compared >= 0.7 * snapshots


def test_optima_are_distinct_and_ranked():
    """The optima of a snapshot have increasing cost, and no two coincide."""
    ends = ends_of(draw_ambiguous(60, 4, 2.0, seed=9))
    cost = 0.5 * ends.lines.ray_residuals(ends.x, ends.y).chi_square
    several = 0
    for row in range(60):
        mine = np.flatnonzero(ends.snapshot == row)
        assert mine.size >= 1
        assert (np.diff(cost[mine]) >= -1e-9).all()
        several += mine.size > 1
        for i, j in itertools.combinations(mine, 2):
            assert np.hypot(ends.x[i] - ends.x[j], ends.y[i] - ends.y[j]) > 1e-3
    assert several > 0


def test_crossings_are_on_both_rays():
    """Each crossing is on the lines of its pair; more than six rows give fifteen pairs."""
    lines = sight_lines(draw_ambiguous(20, 8, 1.0, seed=3))
    x, y = pairwise_crossings(lines)
    assert x.shape == (15, 20)
    across = lines.sine * (x[0][:, None] - lines.origin_x) - lines.cosine * (y[0][:, None] - lines.origin_y)
    assert np.abs(across[:, :2]).max() < 1e-6
