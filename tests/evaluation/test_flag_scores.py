"""Scores of line-of-sight flags."""

from __future__ import annotations

import math

import numpy as np
import pytest

from nlosctl.evaluation.flags import UNKNOWN, FlagScores


def flags(*values):
    """Return flags in the form that the scores take."""
    return np.array(values, dtype=np.int8)


def test_confusion_by_hand():
    """Rows with flag and truth form the table; flags without truth and truth without flags are counted apart."""
    scores = FlagScores()
    los = flags(1, 1, 1, 0, 0, 1, UNKNOWN, 1, UNKNOWN)
    truth = flags(1, 1, 0, 1, 0, 1, 1, UNKNOWN, UNKNOWN)
    scores.add(los, truth)
    found = scores.overall()
    assert (found.los_called_los, found.nlos_called_los, found.los_called_nlos, found.nlos_called_nlos) == (3, 1, 1, 1)
    assert (found.rows, found.without_flag, found.without_truth) == (6, 1, 2)
    assert (found.precision, found.recall, found.false_alarm) == (0.75, 0.75, 0.5)
    assert found.accuracy == pytest.approx(4 / 6)


def test_groups_and_chunks_add_up():
    """Random flags in chunks and groups have the counts of a plain loop."""
    generator = np.random.default_rng(1)
    los, truth = generator.integers(-1, 2, (2, 1000)).astype(np.int8)
    group = generator.integers(0, 3, 1000)
    scores = FlagScores()
    for part in np.array_split(np.arange(1000), 7):
        scores.add(los[part], truth[part], group[part], ("a", "b", "c"))
    for number, key in enumerate("abc"):
        pairs = list(zip(truth[group == number], los[group == number], strict=True))
        found = scores.result()[key]
        assert found.los_called_nlos == pairs.count((1, 0))
        assert found.nlos_called_los == pairs.count((0, 1))
        assert found.without_truth == sum(truth == UNKNOWN for truth, _ in pairs)
    assert scores.overall().rows == sum(one.rows for one in scores.result().values())
    assert list(scores.result()) == ["abc"[number] for number in dict.fromkeys(group)]


def test_rates_without_rows():
    """Without rows the rates are undefined."""
    found = FlagScores().overall()
    assert math.isnan(found.precision)
    assert math.isnan(found.recall)
