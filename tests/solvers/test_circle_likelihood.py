"""The likelihood of mixed rows, compared with its definition and finite differences."""

from __future__ import annotations

import numpy as np
import pytest

from nlosctl.models.bearings import sight_lines
from nlosctl.solvers.bearings.circle_likelihood import MixedBearingProblem, bearing_problem
from nlosctl.solvers.bearings.likelihood import BearingProblem
from nlosctl.solvers.bearings.line_fits import fit_focused, fit_least_squares
from nlosctl.solvers.optimization.levenberg_marquardt import minimize
from nlosctl.testing import CIRCLES


def draw_mixed_rows(seed, snapshots=40, measurements=5):
    """Return sight lines of mixed rows and starting points near the sources."""
    batch = CIRCLES.trial(np.random.default_rng(seed), snapshots, measurements, None).batch
    lines = sight_lines(batch)
    first = fit_least_squares(lines)
    start = fit_focused(lines, first)
    return lines, *lines.inside_circles(start.x, start.y)


@pytest.mark.parametrize("seed", range(3))
def test_cost_is_half_the_chi_square(seed):
    """The cost is half the sum of squares of measured minus predicted bearing over its std."""
    lines, x, y = draw_mixed_rows(seed)
    found = bearing_problem(lines).evaluate(x, y)
    expected = 0.5 * ((lines.bearing_residual_rad(x, y) / lines.std_rad) ** 2).sum(axis=1)
    defined = np.isfinite(found.cost)
    assert defined.sum() > 30
    np.testing.assert_allclose(found.cost[defined], expected[defined], rtol=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_gradient_agrees_with_finite_differences(seed):
    """The gradient agrees with finite differences of the cost where no row changes its path."""
    lines, x, y = draw_mixed_rows(seed)
    problem = bearing_problem(lines)
    at = problem.evaluate(x, y)
    size = 1.0 / np.sqrt(at.hessian.trace)
    step = 1e-5 * size
    for dx, dy, slope in ((step, 0.0, at.gradient_x), (0.0, step, at.gradient_y)):
        ahead, behind = problem.evaluate(x + dx, y + dy).cost, problem.evaluate(x - dx, y - dy).cost
        scaled = slope * size
        numeric = (ahead - behind) / (2.0 * step) * size
        usable = np.isfinite(numeric) & (np.abs(numeric) < 1e4)
        close = np.abs(scaled - numeric)[usable] < 1e-3 * (1.0 + np.abs(numeric[usable]))
        assert usable.sum() > 25
        assert close.mean() > 0.95


def test_circle_rows_do_not_affect_other_snapshots():
    """Snapshots of direct and mirror rows have the same values with and without circle rows in the block."""
    batch = CIRCLES.trial(np.random.default_rng(1), 30, 3, None).batch
    batch.reflector[::2] = np.where(batch.reflector[::2] > 0, -1, batch.reflector[::2])
    lines = sight_lines(batch)
    plain = np.arange(0, 30, 2)
    x, y = lines.center_x * 0.0 + 0.1, lines.center_y * 0.0 - 0.2
    mixed = bearing_problem(lines)
    assert isinstance(mixed, MixedBearingProblem)
    alone = BearingProblem.of_lines(lines.take(plain)).evaluate(x[plain], y[plain])
    together = mixed.evaluate(x, y)
    np.testing.assert_array_equal(together.cost[plain], alone.cost)
    np.testing.assert_array_equal(together.hessian.xy[plain], alone.hessian.xy)


def test_without_circles_the_plain_problem_is_used():
    """A block without circle rows uses the plain likelihood."""
    batch = CIRCLES.trial(np.random.default_rng(1), 5, 3, None).batch
    batch.reflector[:] = -1
    assert isinstance(bearing_problem(sight_lines(batch)), BearingProblem)


def test_the_minimum_is_stationary():
    """Where Levenberg-Marquardt converges, the gradient in standard deviations is zero."""
    lines, x, y = draw_mixed_rows(5)
    found = minimize(bearing_problem(lines), x, y)
    at = bearing_problem(lines).evaluate(found.x, found.y)
    size = 1.0 / np.sqrt(at.hessian.trace)
    assert found.converged.mean() > 0.8
    assert (np.hypot(at.gradient_x, at.gradient_y) * size)[found.converged].max() < 1e-5
