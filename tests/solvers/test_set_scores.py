"""Scores of many sets of rows, a point each, computed for all rows at once."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from outlier_worlds import mixture_cost, ring_batch

from nlosctl.methods.bearings_mixture_ml import MixtureOptions
from nlosctl.solvers.mixture.outlier_model import grouped_batch, outlier_model
from nlosctl.solvers.sequential.set_scores import SetScores


@pytest.mark.parametrize("sensors", [2, 7, 8, 9, 31])
@pytest.mark.parametrize("options", [{}, {"range_std_share": 0.05}, {"paths": 2}], ids=["bearings", "ranges", "paths"])
def test_the_scores_of_all_rows_at_once_are_those_of_row_after_row(sensors: int, options: dict[str, Any]) -> None:
    """Both have the same bits, for numbers of rows about the factors multiplied before a logarithm, and (23)."""
    _, batch, _ = ring_batch(5, 30, sensors=sensors, alpha=0.3, sources="disc", **options)
    model = outlier_model(*grouped_batch(batch), MixtureOptions())
    xy = np.random.default_rng(6).uniform(-0.6, 0.6, (30, 2))
    x, y = xy[:, :1] - model.lines.center_x[:, None], xy[:, 1:] - model.lines.center_y[:, None]
    scored = SetScores.of(model.mixture).at(x, y)
    np.testing.assert_array_equal(scored, model.mixture.score(x, y))
    if "range_std_share" not in options:
        np.testing.assert_allclose(scored[:, 0], mixture_cost(batch, xy, 0.25), atol=0.02 * sensors)
