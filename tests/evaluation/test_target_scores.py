"""Scores of estimated targets: number, exact identification, precision, recall, cases of the paper."""

from __future__ import annotations

import numpy as np
import pytest

from nlosctl.evaluation.targets import EchoRows, TargetScores, case_of

POSITIONS = np.array([[0.0, 0.0], [100.0, 0.0]])


def rows(found: list[int], true: list[int], los: list[int]) -> EchoRows:
    """Return the rows of a snapshot; a row with an estimated target is flagged direct."""
    true_target = np.array(true)
    return EchoRows(
        target=np.array(found),
        true_target=true_target,
        los=np.array(found) >= 0,
        true_los=np.array(los, dtype=bool),
        true_m=np.where((true_target >= 0)[:, None], POSITIONS[true_target], np.nan),
    )


@pytest.mark.parametrize(
    ("true", "los", "case"),
    [
        ([0, 0, 0], [1, 1, 1], "i"),
        ([0, 0, 1], [1, 1, 1], "ii"),
        ([0, 0, 1], [1, 1, 0], "iii"),
        ([0, 1, 2], [1, 1, 1], "iv"),
        ([0, 1, 0], [1, 1, 0], "v"),
        ([0, 0, -1], [0, 0, 0], "vi"),
    ],
)
def test_cases_are_those_of_the_paper(true: list[int], los: list[int], case: str) -> None:
    """Two direct echoes of one target are a TIP; the case depends on whether the others are direct."""
    assert case_of(np.array(true), np.array(los, dtype=bool)) == case


def test_target_numbers_do_not_matter() -> None:
    """Targets with exactly their direct echoes are exact under any numbers."""
    scores = TargetScores()
    scores.add(rows([1, 1, 0, 0, -1], [0, 0, 1, 1, 0], [1, 1, 1, 1, 0]), POSITIONS[::-1])
    summary = scores.overall()
    assert (summary.number_right, summary.exact, summary.los_precision, summary.los_recall) == (1.0, 1.0, 1.0, 1.0)
    assert summary.ospa_m == 0.0
    assert (summary.matched_targets, summary.matched_rmse_m, summary.case_i) == (2, 0.0, 2)


def test_one_echo_wrong_is_not_exact() -> None:
    """A scattered echo taken for a direct one: right number, not exact, one of four flags wrong."""
    scores = TargetScores()
    scores.add(rows([0, 0, 1, -1, 1], [0, 0, 1, 1, 0], [1, 1, 1, 1, 0]), POSITIONS + np.array([3.0, 4.0]))
    summary = scores.overall()
    assert (summary.number_right, summary.exact) == (1.0, 0.0)
    assert (summary.los_precision, summary.los_recall) == (0.75, 0.75)
    assert summary.matched_rmse_m == pytest.approx(5.0)
    assert (summary.case_i, summary.case_v) == (1, 1)


def test_no_target_found_is_counted() -> None:
    """No estimate of two targets: wrong number, GOSPA all missed."""
    scores = TargetScores()
    scores.add(rows([-1, -1], [0, 1], [1, 1]), np.empty((0, 2)))
    summary = scores.overall()
    assert (summary.found_targets, summary.number_right, summary.los_recall) == (0, 0.0, 0.0)
    assert summary.gospa_m == summary.gospa_missed_m == pytest.approx(20.0)


def test_groups_and_overall_target_scores() -> None:
    """Each key has its own summary, and the overall one covers all snapshots."""
    scores = TargetScores()
    scores.add(rows([0, 0], [0, 0], [1, 1]), None, "a")
    scores.add(rows([-1, -1], [0, 0], [1, 1]), None, "b")
    result = scores.result()
    assert (result["a"].exact, result["b"].exact, scores.overall().exact) == (1.0, 0.0, 0.5)
    assert np.isnan(scores.overall().ospa_m)


def test_targets_that_change_their_track_are_counted() -> None:
    """A true target matched by another track than before is a switch; without tracks there is no such figure."""
    scores, plain = TargetScores(), TargetScores()
    snapshot = rows([0, 0, 1, 1], [0, 0, 1, 1], [1, 1, 1, 1])
    for tracks in ([7, 8], [7, 8], [8, 7], [8, np.nan]):
        found = np.column_stack([POSITIONS, np.ones((2, 2)), tracks])
        if np.isnan(tracks[1]):
            found = found[:1]
        scores.add(snapshot, found)
        plain.add(snapshot, found[:, :2])
    assert scores.overall().identity_switches == 2
    assert plain.overall().identity_switches is None
