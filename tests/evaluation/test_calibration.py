"""Calibration of probabilities, compared with counts by hand and with draws of known probability."""

from __future__ import annotations

import numpy as np

from nlosctl.evaluation.calibration import reliability


def test_calibration_by_hand() -> None:
    """Two bins of four rows: means and fractions; NaN is left out, 1 belongs to the last bin."""
    curve = reliability(np.array([0.1, 0.3, 0.9, 1.0, np.nan]), np.array([False, True, True, True, True]), bins=2)
    np.testing.assert_allclose(curve.stated, [0.2, 0.95])
    np.testing.assert_allclose(curve.share, [0.5, 1.0])
    np.testing.assert_allclose(curve.std_error, [np.sqrt(0.125), 0.0])
    assert curve.count.tolist() == [2, 2]


def test_true_probabilities_are_calibrated() -> None:
    """Of rows drawn with their stated probability, the fraction is within four standard errors in every bin."""
    generator = np.random.default_rng(3)
    probability = generator.random(20_000)
    curve = reliability(probability, generator.random(20_000) < probability)
    assert (np.abs(curve.share - curve.stated) < 4.0 * curve.std_error).all()


def test_ten_bins_by_default_and_single_rows_count() -> None:
    """Probabilities on both sides of a tenth are in two bins of one row each; empty bins above are left out."""
    curve = reliability(np.array([0.095, 0.105]), np.array([False, True]))
    np.testing.assert_allclose(curve.stated, [0.095, 0.105])
    assert curve.share.tolist() == [0.0, 1.0]
    assert curve.count.tolist() == [1, 1]


def test_no_rows_give_no_bins() -> None:
    """Without rows there are no bins."""
    assert reliability(np.array([np.nan]), np.array([True])).share.size == 0
