"""Scores of estimates, compared with plain loops and values by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import chi2

from nlosctl.contract.statuses import Status
from nlosctl.evaluation.estimates import EstimateRows, EstimateScores, nearest_alternatives


def some_rows(count, seed=0):
    """Return rows of every status, with and without truth, with calibrated covariances."""
    generator = np.random.default_rng(seed)
    status = generator.choice(len(Status), count, p=[0.6] + [0.4 / (len(Status) - 1)] * (len(Status) - 1)).astype(
        np.uint8
    )
    root = generator.normal(size=(count, 2, 2)) * 3.0
    truth = generator.normal(size=(count, 2)) * 100.0
    position = truth + (root @ generator.normal(size=(count, 2, 1)))[..., 0]
    covariance = root @ root.transpose(0, 2, 1)
    packed = np.stack([covariance[:, 0, 0], covariance[:, 0, 1], covariance[:, 1, 1]], axis=1)
    position[[not Status(code).has_position for code in status]] = np.nan
    packed[[not Status(code).has_covariance for code in status]] = np.nan
    truth[generator.random(count) < 0.05] = np.nan
    return EstimateRows(position_m=position, covariance_m2=packed, status=status, truth_m=truth)


def scored(rows, cuts=(), group=None, keys=("",)):
    """Return the scores of rows added in chunks."""
    scores = EstimateScores()
    for part in np.split(np.arange(rows.status.size), cuts):
        scores.add(rows.take(part), None if group is None else group[part], keys)
    return scores


def rows_of(positions, statuses, truth=(0.0, 0.0), covariance=(1.0, 0.0, 1.0)):
    """Return rows given by hand, one truth and one covariance for all."""
    count = len(positions)
    return EstimateRows(
        position_m=np.array(positions, dtype=float).reshape(count, 2),
        covariance_m2=np.tile(np.array(covariance, dtype=float), (count, 1)),
        status=np.array(statuses, dtype=np.uint8),
        truth_m=np.tile(np.array(truth, dtype=float), (count, 1)),
    )


def test_summaries_agree_with_plain_loops():
    """Every metric, one row at a time in Python, percentiles by numpy, chi-square by scipy."""
    rows = some_rows(3000)
    offsets, squares, errors, statuses = [], [], [], []
    for position, (xx, xy, yy), status, truth in zip(
        rows.position_m, rows.covariance_m2, rows.status, rows.truth_m, strict=True
    ):
        if np.isnan(truth[0]):
            continue
        statuses.append(Status(status).word)
        if not Status(status).has_position or Status(status).word in ("no_consensus", "outside_field"):
            errors.append(math.inf)
            continue
        offset = position - truth
        offsets.append(offset)
        errors.append(math.hypot(*offset))
        if Status(status).has_covariance:
            squares.append(offset @ np.linalg.inv([[xx, xy], [xy, yy]]) @ offset)
    found = scored(rows).overall()
    assert (found.rows, found.answered, found.nees_rows) == (len(errors), len(offsets), len(squares))
    assert found.without_truth == 3000 - len(errors)
    assert found.statuses == {word: statuses.count(word) for word in dict.fromkeys(s.word for s in Status)}
    assert found.fix_rate == len(offsets) / len(errors)
    assert found.rmse_m == pytest.approx(math.sqrt(np.mean(np.sum(np.square(offsets), axis=1))), rel=1e-12)
    assert (found.bias_x_m, found.bias_y_m) == pytest.approx(tuple(np.mean(offsets, axis=0)), rel=1e-10)
    assert found.mean_m == pytest.approx(np.mean([e for e in errors if e < math.inf]), rel=1e-12)
    assert found.median_m == pytest.approx(np.sort(errors)[[len(errors) // 2, (len(errors) - 1) // 2]].mean())
    assert found.p90_m == math.inf
    assert found.nees == pytest.approx(np.mean(squares), rel=1e-9)
    for percent in (50, 90, 95, 99):
        inside = int(np.sum(np.array(squares) <= chi2.ppf(percent / 100, 2)))
        assert getattr(found, f"inside_{percent}") == inside
        assert getattr(found, f"coverage_{percent}") == inside / len(squares)


def test_calibrated_covariances_have_nominal_scores():
    """With Gaussian errors of the stated covariance NEES is 2 and the coverage of ellipses nominal."""
    found = scored(some_rows(40_000, seed=3)).overall()
    assert found.nees == pytest.approx(2.0, abs=0.06)
    for percent in (50, 90, 95, 99):
        assert getattr(found, f"coverage_{percent}") == pytest.approx(percent / 100, abs=0.011)


@pytest.mark.parametrize("cuts", [(1,), (7, 500, 501, 999), tuple(range(0, 2000, 3))])
def test_scores_do_not_depend_on_the_chunks(cuts):
    """Every metric of every group and overall has the same bits for any division into chunks."""
    rows = some_rows(2000, seed=1)
    group = np.random.default_rng(2).integers(0, 3, 2000)
    keys = ("ls", ("ml", 2.0), "never-mind")
    whole, cut = scored(rows, (), group, keys), scored(rows, cuts, group, keys)
    assert list(whole.result()) == list(cut.result()), "groups come in order of first appearance"
    assert repr(whole.result()) == repr(cut.result())
    assert repr(whole.overall()) == repr(cut.overall())


def test_groups_and_overall_scores():
    """The summary of a group is that of its rows; the overall one is that of all rows."""
    rows = some_rows(900, seed=4)
    group = np.arange(900) % 2
    scores = scored(rows, (), group, ("odd", "even"))
    for number, key in enumerate(("odd", "even")):
        alone = scored(rows.take(np.flatnonzero(group == number))).overall()
        assert repr(scores.result()[key]) == repr(alone)
    together = scored(rows).overall()
    assert scores.overall().rmse_m == pytest.approx(together.rmse_m, rel=1e-12)
    assert scores.overall().p99_m == together.p99_m
    assert scores.overall().statuses == together.statuses


def test_missing_fixes_count_in_percentiles_and_fix_rate_alone():
    """Errors 3, 4, 5 and one degenerate row: RMSE over three, median 4.5 over four, 90 % infinite."""
    found = scored(rows_of([(3, 0), (0, 4), (0, -5), (math.nan, math.nan)], [0, 0, 0, Status.DEGENERATE])).overall()
    assert found.fix_rate == 0.75
    assert found.rmse_m == pytest.approx(math.sqrt(50 / 3))
    assert (found.bias_x_m, found.bias_y_m, found.mean_m) == pytest.approx((1.0, -1 / 3, 4.0))
    assert (found.median_m, found.p90_m) == (4.5, math.inf)
    assert found.nees == pytest.approx(50 / 3)
    assert found.statuses == {"ok": 3, "degenerate": 1}


def test_boundary_rows_have_an_error_and_no_nees():
    """A constrained fix counts in the RMSE; its covariance is not used."""
    found = scored(rows_of([(1, 0), (2, 0)], [Status.INFEASIBLE, Status.BOUNDARY])).overall()
    assert (found.answered, found.nees_rows, found.nees, found.bad_covariances) == (2, 1, 1.0, 0)


@pytest.mark.parametrize("status", [Status.NO_CONSENSUS, Status.OUTSIDE_FIELD])
def test_a_position_that_is_no_fix_is_counted_only_by_its_status(status):
    """RMSE, coverage and fix rate ignore its position; the percentiles treat it as missing."""
    found = scored(rows_of([(1, 0), (900, 0)], [Status.OK, status])).overall()
    assert (found.rows, found.answered, found.fix_rate, found.nees_rows) == (2, 1, 0.5, 1)
    assert (found.rmse_m, found.nees, found.p99_m) == (1.0, 1.0, math.inf)
    assert found.statuses == {"ok": 1, status.word: 1}


def test_the_best_set_of_a_stopped_search_counts_as_a_fix():
    """not_proven has an error and a covariance like any fix."""
    found = scored(rows_of([(1, 0), (0, 1)], [Status.OK, Status.NOT_PROVEN])).overall()
    assert (found.answered, found.fix_rate, found.nees_rows, found.rmse_m) == (2, 1.0, 2, 1.0)


def test_invalid_covariances_are_counted():
    """A covariance that is not positive definite, although the status promises one, is counted and not used."""
    found = scored(rows_of([(1, 0)], [Status.OK], covariance=(1.0, 1.0, 1.0))).overall()
    assert (found.bad_covariances, found.nees_rows) == (1, 0)
    assert math.isnan(found.nees)


def test_a_row_without_a_fix_is_infinite_in_percentiles_alone():
    """The percentiles are infinite, the mean square is undefined, the fix rate is a number."""
    found = scored(rows_of([(math.nan, math.nan)], [Status.TOO_FEW])).overall()
    assert math.isinf(found.median_m)
    assert math.isnan(found.rmse_m)
    assert found.fix_rate == 0.0
    assert found.statuses == {"too_few": 1}


def test_scores_without_rows():
    """Without rows counts are zero and every metric is undefined."""
    found = EstimateScores().overall()
    assert found.rows == 0
    assert all(
        math.isnan(value) for value in (found.fix_rate, found.rmse_m, found.median_m, found.nees, found.nees_low)
    )


def test_nearest_alternative_is_picked_in_any_order():
    """Of each snapshot and method the row nearest to the truth; of equal ones the first; without a fix: 0."""
    generator = np.random.default_rng(5)
    snapshot = np.repeat(np.arange(50), 6)
    method = np.tile(np.repeat(np.array(["ml", "ls"], dtype=object), 3), 50)
    alternative = np.tile(np.arange(3), 100)
    error = generator.integers(0, 3, 300).astype(float)
    error[generator.random(300) < 0.5] = np.inf
    shuffle = generator.permutation(300)
    chosen = nearest_alternatives(error[shuffle], alternative[shuffle], snapshot[shuffle], method[shuffle].astype(str))
    assert (np.diff(chosen) > 0).all()
    found = {(snapshot[row], method[row]): alternative[row] for row in shuffle[chosen]}
    assert len(found) == len(chosen) == 100
    for (number, name), best in found.items():
        mine = np.flatnonzero((snapshot == number) & (method == name))
        assert best == min(range(3), key=lambda rank, mine=mine: (error[mine[rank]], rank))


def test_nearest_alternative_without_rows():
    """An empty table gives an empty table."""
    empty = np.zeros(0)
    assert nearest_alternatives(empty, empty.astype(int), empty).size == 0
