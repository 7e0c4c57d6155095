"""The two best optima, against descents from the same points that are followed to their ends, one point at a time."""

from __future__ import annotations

import numpy as np
import pytest
from arrival_batches import arrival_batch

from nlosctl.models.arrivals import arrival_rows
from nlosctl.solvers.arrivals.closed_forms import initial_estimates
from nlosctl.solvers.arrivals.likelihood import ArrivalProblem
from nlosctl.solvers.optimization.levenberg_marquardt import minimize
from nlosctl.solvers.optimization.two_optima import find_best_two


@pytest.mark.parametrize(("dimension", "sensors"), [(2, 4), (3, 5)])
def test_no_descent_that_is_cut_short_hides_an_optimum(dimension: int, sensors: int) -> None:
    """Few sensors anywhere: both optima are those of whole descents, also where they are near each other."""
    draw = np.random.default_rng(7)
    side_m = np.array([1000.0, 1000.0, 300.0])[:dimension]
    sensor = draw.random((400, sensors, dimension)) * side_m
    source = draw.random((400, 1, dimension)) * side_m
    arrival = np.linalg.norm(source - sensor, axis=2) + 3.0 * draw.normal(size=(400, sensors))
    rows = arrival_rows(arrival_batch(sensor, arrival, 3.0))
    problem, points = ArrivalProblem.of_rows(rows), initial_estimates(rows)
    best, other = find_best_two(problem, rows, points, 100)
    ends = [minimize(problem, *point, max_iterations=100, patience=20) for point in points]
    cost = np.array([np.where(end.converged, end.cost, np.inf) for end in ends])
    place = np.array([end.point for end in ends])
    settled = np.flatnonzero(best.converged)
    assert settled.size > 380
    np.testing.assert_allclose(best.cost[settled], cost.min(axis=0)[settled], rtol=1e-6, atol=1e-9)
    away = np.linalg.norm(place - np.array(best.point), axis=1)
    rival = np.where(away > 1.0, cost, np.inf).min(axis=0)
    seen = settled[np.isfinite(rival[settled])]
    assert seen.size > 40
    np.testing.assert_allclose(other.cost[seen], rival[seen], rtol=1e-6, atol=1e-9)
