"""Do probabilities come true: against counting by hand, and draws whose probabilities are known."""

from __future__ import annotations

import numpy as np

from nlosctl.evaluation.calibration import reliability


def test_by_hand() -> None:
    """Two bins of four rows: means and shares as counted; NaN is left out, 1 belongs to the last bin."""
    told = reliability(np.array([0.1, 0.3, 0.9, 1.0, np.nan]), np.array([False, True, True, True, True]), bins=2)
    np.testing.assert_allclose(told.stated, [0.2, 0.95])
    np.testing.assert_allclose(told.share, [0.5, 1.0])
    np.testing.assert_allclose(told.std_error, [np.sqrt(0.125), 0.0])
    assert told.count.tolist() == [2, 2]


def test_true_probabilities_come_true() -> None:
    """Of rows drawn with their stated probability, the share is within four standard errors of it in every bin."""
    generator = np.random.default_rng(3)
    probability = generator.random(20_000)
    told = reliability(probability, generator.random(20_000) < probability)
    assert (np.abs(told.share - told.stated) < 4.0 * told.std_error).all()


def test_without_rows() -> None:
    """No row, no bin."""
    assert reliability(np.array([np.nan]), np.array([True])).share.size == 0
