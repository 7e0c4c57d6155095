"""Calibration of probabilities, compared with counts by hand and with draws of known probability."""

from __future__ import annotations

import numpy as np

from nlosctl.evaluation.calibration import reliability


def test_calibration_by_hand() -> None:
    """Two bins of four rows: means and fractions; NaN is left out, 1 belongs to the last bin."""
    told = reliability(np.array([0.1, 0.3, 0.9, 1.0, np.nan]), np.array([False, True, True, True, True]), bins=2)
    np.testing.assert_allclose(told.stated, [0.2, 0.95])
    np.testing.assert_allclose(told.share, [0.5, 1.0])
    np.testing.assert_allclose(told.std_error, [np.sqrt(0.125), 0.0])
    assert told.count.tolist() == [2, 2]


def test_true_probabilities_are_calibrated() -> None:
    """Of rows drawn with their stated probability, the fraction is within four standard errors in every bin."""
    generator = np.random.default_rng(3)
    probability = generator.random(20_000)
    told = reliability(probability, generator.random(20_000) < probability)
    assert (np.abs(told.share - told.stated) < 4.0 * told.std_error).all()


def test_no_rows_give_no_bins() -> None:
    """Without rows there are no bins."""
    assert reliability(np.array([np.nan]), np.array([True])).share.size == 0
