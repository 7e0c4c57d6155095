"""Song, Willett, Zhou 2013, circular surface (Section 5.2, Fig. 9): figures and claims of numerics/song.md.

RMSE in km from 1000 runs are good to 2-3 %; comparisons between methods are on the same noise.
"""

from __future__ import annotations

import numpy as np
import pytest
from circle_solving import TARGET_M, circle_draw, errors, nees, rms, scipy_ml, solve

from nlosctl.evaluation.bounds import bounds_of
from nlosctl.models.bearings import sight_lines
from nlosctl.models.information import INFORMATION
from nlosctl.solvers.bearings.circle_likelihood import bearing_problem
from nlosctl.solvers.bearings.grid_search import search_grid
from nlosctl.solvers.bearings.line_fits import fit_focused, fit_least_squares
from nlosctl.solvers.optimization.levenberg_marquardt import minimize

pytestmark = pytest.mark.extensive

RUNS = 1000
TABLE = {  # set, sigma in degrees: LS, Stansfield, focused, ML without constraint, CRLB, in km
    ("a", 0.1): (3.61, 3.72, 3.61, 3.61, 3.62),
    ("a", 1.0): (36.4, 36.8, 36.2, 36.2, 36.2),
    ("a", 2.0): (74.2, 74.9, 73.6, 73.4, 72.5),
    ("a", 5.0): (192.0, 188.4, 179.4, 179.5, 181.2),
    ("b", 0.1): (5.45, 5.63, 5.45, 5.45, 5.44),
    ("b", 1.0): (51.4, 53.6, 51.3, 51.3, 54.4),
    ("b", 2.0): (106.0, 108.5, 105.8, 105.6, 108.9),
    ("b", 5.0): (287.5, 281.5, 275.6, 274.9, 272.2),
}
NAMES = ("ls", "stansfield", "stansfield-focused", "ml")


def bound_km(parameter_set, sigma_deg):
    """Return the Cramer-Rao bound of the RMSE in km."""
    batch = circle_draw(parameter_set, sigma_deg, 1)
    information = INFORMATION["bearings"].at(batch, TARGET_M[:1], TARGET_M[1:])
    return bounds_of(information.matrix).rms_m[0] / 1e3


@pytest.mark.parametrize("case", TABLE, ids=str)
def test_bound_agrees_with_the_table(case):
    """The Cramer-Rao bound, absent from the paper, to the table's three digits."""
    assert bound_km(*case) == pytest.approx(TABLE[case][4], rel=2e-3)


def test_bound_per_axis():
    """One degree: 10.3 and 34.8 km along x and y in set A, 12.3 and 53.1 km in set B."""
    for parameter_set, expected in (("a", (10.3, 34.8)), ("b", (12.3, 53.1))):
        batch = circle_draw(parameter_set, 1.0, 1)
        bounds = bounds_of(INFORMATION["bearings"].at(batch, TARGET_M[:1], TARGET_M[1:]).matrix)
        found = np.sqrt([bounds.bound_xx_m2[0], bounds.bound_yy_m2[0]]) / 1e3
        np.testing.assert_allclose(found, expected, atol=0.06)


@pytest.mark.parametrize("case", TABLE, ids=str)
def test_errors_agree_with_the_table(case):
    """RMSE of 1000 runs within Monte Carlo error of the table (both have a standard error of 2-3 %)."""
    batch = circle_draw(*case, RUNS)
    for name, expected in zip(NAMES, TABLE[case], strict=False):
        assert rms(errors(solve(name, batch))) / 1e3 == pytest.approx(expected, rel=0.085), name
    ratio = rms(errors(solve("ml", batch))) / 1e3 / bound_km(*case)
    assert 0.93 < ratio < 1.07


@pytest.mark.parametrize("case", TABLE, ids=str)
def test_covariances_are_calibrated(case):
    """NEES 1.75 to 2.25 and 95 % coverage 0.93 to 0.975 for closed forms and ml: weights by spread, not distance."""
    batch = circle_draw(*case, RUNS)
    for name in NAMES:
        squared = nees(solve(name, batch))
        assert 1.75 < squared.mean() < 2.25, name
        assert 0.93 < (squared < 5.991).mean() < 0.975, name


def test_distance_weights_are_worse_than_none():
    """Up to 3 degrees Stansfield's distances are worse than least squares; weights by spread are as good as ml."""
    for case in (("a", 1.0), ("b", 2.0)):
        batch = circle_draw(*case, RUNS)
        ls, stansfield, focused, ml = (rms(errors(solve(name, batch))) for name in NAMES)
        assert stansfield > 1.002 * ls
        assert focused == pytest.approx(ml, rel=7e-3)
        assert focused < 0.99 * stansfield


def test_methods_agree_at_small_errors():
    """At 0.1 degrees best and worst are within 6 %, as the paper states."""
    batch = circle_draw("a", 0.1, RUNS)
    found = [rms(errors(solve(name, batch))) for name in NAMES]
    assert max(found) < 1.06 * min(found)


@pytest.mark.parametrize("parameter_set", ["a", "b"])
def test_noise_free_closed_forms_are_exact(parameter_set):
    """The tangent at the hit is the ray itself: closed forms are exact within 1 mm."""
    batch = circle_draw(parameter_set, 1e-13, 3)
    for name in NAMES[:3]:
        assert np.abs(errors(solve(name, batch))).max() < 1e-3


@pytest.mark.parametrize("case", [("a", 1.0), ("b", 5.0)], ids=str)
def test_ml_agrees_with_scipy(case):
    """Position and cost agree with scipy from the same start at tight tolerances: 1 m, 1e-6 nats."""
    batch = circle_draw(*case, 40)
    estimates = solve("ml", batch)
    starts = solve("stansfield-focused", batch)
    for row in np.flatnonzero(estimates.status <= 2)[:25]:
        position, cost = scipy_ml(batch, row, starts.position_m[row])
        assert estimates.cost[row] <= cost + 1e-6
        position, cost = scipy_ml(batch, row, estimates.position_m[row])
        assert np.hypot(*(estimates.position_m[row] - position)) < 1.0
        assert estimates.cost[row] == pytest.approx(cost, abs=1e-6)


@pytest.mark.parametrize("case", [("a", 1.0), ("b", 2.0)], ids=str)
def test_grid_search_is_never_below_ml_and_needs_500_times_the_work(case):
    """Where ml is feasible no vertex is better, the best is near; the evaluations are counted."""
    batch = circle_draw(*case, 8)
    grid, ml = solve("ml-grid", batch), solve("ml", batch)
    feasible = (ml.status == 0) & (grid.status == 0)
    assert feasible.sum() >= 7
    assert (ml.cost <= grid.cost + 1e-12)[feasible].all()
    assert np.hypot(*(ml.position_m - grid.position_m)[feasible].T).max() < 1.6e3
    lines = sight_lines(batch)
    first = fit_least_squares(lines)
    start = fit_focused(lines, first)
    steps = minimize(bearing_problem(lines), start.x, start.y).evaluations
    vertices = search_grid(lines, first.x, first.y, width_m=160e3, height_m=200e3, step_m=1e3).evaluations
    assert vertices.max() <= 161 * 201
    assert (vertices >= 500 * steps).all()


def test_feasible_ml_stays_in_the_annulus():
    """At 5 degrees at least 12 % of free estimates are infeasible; with ``feasible`` none is."""
    batch = circle_draw("b", 5.0, 300)
    free, held = solve("ml", batch), solve("ml", batch, feasible=True)
    assert 0.15 < (free.status == 2).mean() < 0.45
    assert set(np.unique(held.status)) <= {0, 3, 7, 8}
    inside = free.status == 0
    assert (held.position_m[inside] == free.position_m[inside]).all()
    edge = held.status == 3
    radius = np.hypot(*held.position_m[edge].T)
    assert edge.sum() > 40
    assert radius.min() > 6371e3 - 1.0
    assert (held.cost >= free.cost)[edge].all()
    assert np.isnan(held.covariance_m2[edge]).all()


@pytest.mark.slow
@pytest.mark.parametrize("sigma_deg", [0.1, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0])
@pytest.mark.parametrize("parameter_set", ["a", "b"])
def test_twenty_thousand_runs_reach_the_bound(parameter_set, sigma_deg):
    """With 20,000 runs ml's RMSE is within 5 % of the bound at every sigma, and its NEES within 10 % of 2."""
    found = [solve("ml", circle_draw(parameter_set, sigma_deg, 1000, seed)) for seed in range(20)]
    error = np.concatenate([errors(estimates) for estimates in found])
    assert rms(error) / 1e3 == pytest.approx(bound_km(parameter_set, sigma_deg), rel=0.05)
    assert np.concatenate([nees(estimates) for estimates in found]).mean() == pytest.approx(2.0, rel=0.1)
