"""suppress on directions in space, compared with mixture-ml, ml and the thresholds of (25)."""

from __future__ import annotations

import numpy as np
import pytest
from space_worlds import ring_world, with_height
from test_mixture_in_space import CHI_SQUARE_95, best_of, model_of, squared_errors, with_outliers, with_ranges

from nlosctl.contract.statuses import Status
from nlosctl.methods import bearings_mixture_ml, bearings_ml, bearings_suppress
from nlosctl.methods.bearings_mixture_ml import MixtureOptions
from nlosctl.methods.bearings_suppress import SuppressOptions
from nlosctl.solvers.sequential.hypotheses import bearing_threshold_rad
from nlosctl.solvers.sequential.space_sets import SpaceSets


@pytest.mark.parametrize("acceptance", ["threshold", "likelihood"])
@pytest.mark.parametrize("kind", ["angles", "some azimuths", "ranges", "height"])
def test_fixes_are_those_of_the_mixture(kind: str, acceptance: str) -> None:
    """A quarter of outliers: half the fixes within .1 std of the mixture's optimum, as many ok, a true covariance."""
    generator = np.random.default_rng(3)
    batch, source = ring_world(generator, 400, 0.5, without_elevation=kind == "some azimuths")
    if kind == "ranges":
        batch = with_ranges(generator, batch, source)
    batch = with_outliers(generator, batch, 0.25)
    if kind == "height":
        batch = with_height(batch, source[:, 2] + 2.0 * generator.standard_normal(400), 2.0)
    solution = bearings_suppress.solve(batch, SuppressOptions(acceptance=acceptance))  # type: ignore[arg-type]
    status, position, _ = best_of(solution)
    theirs, expected, covariance = best_of(bearings_mixture_ml.solve(batch, MixtureOptions()))
    both = (status == Status.OK) & (theirs == Status.OK)
    assert both.mean() > 0.95
    apart = np.linalg.norm(position - expected, axis=1)[both] / np.sqrt(covariance[both][:, [0, 2, 5]].sum(axis=1))
    assert np.median(apart) < 0.1
    assert np.mean(apart < 0.35) > 0.9  # rows count as linear where their set began
    assert 0.925 <= np.mean(squared_errors(solution, source) < CHI_SQUARE_95) <= 0.98


def test_fine_rows_have_the_fix_of_all_rows() -> None:
    """Clean rows of .02 degrees all join, and the fix is that of ml to a twentieth of a standard deviation."""
    batch, _ = ring_world(np.random.default_rng(4), 60, 0.02)
    solution = bearings_suppress.solve(batch, SuppressOptions())
    _, position, covariance = best_of(solution)
    _, expected, _ = best_of(bearings_ml.solve(batch, bearings_ml.METHOD.options()))
    whole = solution.estimates.n_used[solution.estimates.alternative == 0] == 8
    assert whole.mean() > 0.9
    apart = np.linalg.norm(position - expected, axis=1) / np.sqrt(covariance[:, [0, 2, 5]].sum(axis=1))
    assert np.max(apart[whole]) < 0.05


def test_the_limit_of_an_azimuth_is_that_of_the_plane() -> None:
    """A row of azimuth alone is below its limit up to the angle of (25)."""
    batch, _ = ring_world(np.random.default_rng(5), 4, 2.0, without_elevation=True)
    model = model_of(batch)
    pairs = np.zeros((4, 1), dtype=np.int64), np.full((4, 1), 2)
    sets = SpaceSets.start(model, *pairs)
    limit = bearing_threshold_rad(batch.bearing_std_rad, 0.25, 180.0) / batch.bearing_std_rad
    alone = np.isnan(np.asarray(batch.elevation_rad))
    for scale, expected in ((0.999, True), (1.001, False)):
        assert (sets.below_limits(0.5 * (scale * limit) ** 2)[alone] == expected).all()
