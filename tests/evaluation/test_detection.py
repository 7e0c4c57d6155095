"""Scores of indirect-path flags."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from nlosctl.evaluation.detection import DetectionScores, kolmogorov_smirnov, roc_curve


def test_area_is_the_mann_whitney_statistic():
    """The area under the curve is the fraction of pairs in the right order, ties counted half."""
    generator = np.random.default_rng(1)
    p_value = generator.integers(0, 20, 200) / 20.0
    indirect = generator.random(200) < 0.4
    pairs = p_value[indirect][:, None], p_value[~indirect][None]
    expected = np.mean((pairs[0] < pairs[1]) + 0.5 * (pairs[0] == pairs[1]))
    assert roc_curve(p_value, indirect).area == pytest.approx(expected, rel=1e-12)


def test_curve_by_hand():
    """The corner points of a small curve; a path without a p-value is flagged last."""
    curve = roc_curve(np.array([0.01, 0.2, 0.3, np.nan]), np.array([True, False, True, False]))
    assert curve.p_fa.tolist() == [0.0, 0.0, 0.5, 0.5, 1.0]
    assert curve.p_d.tolist() == [0.0, 0.5, 0.5, 1.0, 1.0]
    assert roc_curve(np.array([0.1]), np.array([True])).p_fa.size == 0


def test_kolmogorov_smirnov_agrees_with_scipy():
    """The distance is scipy's; the corrected asymptotic probability is close to the exact one."""
    values = np.random.default_rng(2).random(300) ** 1.1
    distance, p_value = kolmogorov_smirnov(values)
    exact = stats.kstest(values, "uniform")
    assert distance == pytest.approx(exact.statistic, rel=1e-12)
    assert p_value == pytest.approx(exact.pvalue, abs=0.01)
    assert math.isnan(kolmogorov_smirnov(np.array([np.nan]))[0])


def test_confusion_by_hand_in_chunks():
    """Counts and rates of a small table; unknown flags and unknown truths are counted apart; chunks add up."""
    ip = np.array([1, 0, 1, 0, -1, 1], dtype=np.int8)
    truth = np.array([1, 1, 0, 0, 1, -1], dtype=np.int8)
    p_value = np.array([0.01, 0.5, 0.02, 0.8, np.nan, 0.1])
    scores = DetectionScores()
    for part in (slice(0, 2), slice(2, 6)):
        size = ip[part].shape[0]
        scores.add(ip[part], truth[part], p_value[part], np.zeros(size, dtype=np.int64), ["chi2"])
    found = scores.result()["chi2"]
    assert (found.rows, found.without_flag, found.without_truth) == (4, 1, 1)
    assert (found.p_fa, found.p_d, found.accuracy) == (0.5, 0.5, 0.5)
    assert found.auc == 0.75
    assert scores.overall() == found


def test_the_roc_covers_all_false_alarm_rates() -> None:
    """``roc`` rises from 0 to 1, agrees with the named points, and its area with the AUC."""
    generator = np.random.default_rng(4)
    truth = (generator.random(2000) < 0.4).astype(np.int8)
    p_value = np.where(truth == 1, generator.beta(0.3, 2.0, 2000), generator.random(2000))
    scores = DetectionScores()
    scores.add((p_value < 0.05).astype(np.int8), truth, p_value, np.zeros(2000, dtype=np.int64), [()])
    found = scores.overall()
    p_fa, p_d = np.array(found.roc["p_fa"]), np.array(found.roc["p_d"])
    assert (p_fa[0], p_fa[-1], p_d[-1]) == (0.0, 1.0, 1.0)
    assert (np.diff(p_d) >= 0.0).all()
    assert np.interp(0.01, p_fa, p_d) == pytest.approx(found.p_d_at_1, abs=1e-12)
    assert np.sum(np.diff(p_fa) * 0.5 * (p_d[1:] + p_d[:-1])) == pytest.approx(found.auc, abs=5e-3)
