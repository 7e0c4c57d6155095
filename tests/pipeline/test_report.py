"""The counts and the summary of a run."""

from __future__ import annotations

import json
from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nlosctl.contract.statuses import Status
from nlosctl.pipeline.solve.method_runs import MethodTally
from nlosctl.pipeline.solve.report import RunReport

ANSWERED = {"ok", "ambiguous", "infeasible", "boundary", "not_proven", "std_not_estimable"}
POSITION_ONLY = {"no_consensus", "outside_field"}


@given(st.lists(st.lists(st.sampled_from(list(Status)), max_size=12), max_size=5))
def test_statuses_are_counted_over_chunks(chunks: list[list[Status]]) -> None:
    """Statuses are counted by word over all chunks; estimates with a position are answered."""
    tally = MethodTally()
    for chunk in chunks:
        tally.add(np.array(chunk, dtype=np.uint8), np.full(len(chunk), np.nan))
    words = Counter(status.word for chunk in chunks for status in chunk)
    assert dict(tally.statuses) == dict(words)
    assert tally.answered == sum(count for word, count in words.items() if word in ANSWERED)
    assert (tally.tested, tally.badly_fitted, tally.fits_badly) == (0, 0, False)


@given(st.lists(st.floats(0, 1) | st.floats(0, 2e-3) | st.just(np.nan), max_size=40))
def test_bad_fits_are_those_that_chance_does_not_explain(p_values: list[float]) -> None:
    """A p-value below 0.001 is a bad fit, one that is unknown is not tested; over 5 % of those tested fit badly."""
    tally = MethodTally()
    tally.add(np.zeros(len(p_values), dtype=np.uint8), np.array(p_values, dtype=float))
    tested = [p_value for p_value in p_values if not np.isnan(p_value)]
    bad = sum(p_value < 1e-3 for p_value in tested)
    assert (tally.tested, tally.badly_fitted) == (len(tested), bad)
    assert tally.fits_badly == (bad > 0.05 * len(tested))


def report() -> RunReport:
    """Return a report of two methods."""
    tallies = {"ml": MethodTally(Counter(ok=3, too_few=1)), "ls": MethodTally(Counter(behind=2, boundary=2))}
    inputs = [{"name": name, "rows": 3} for name in ("a.csv", "b.csv", "c.csv", "d.csv")]
    return RunReport(
        kind="bearings",
        inputs=inputs,
        rows=12,
        rows_left_out=2,
        bad_rows=1,
        snapshots=4,
        methods=tallies,
        notes=["mind the gap"],
    )


def test_the_summary_tells_every_count() -> None:
    """The summary has inputs, snapshots, rows, rows left out, bad rows, a line for each method, and the notes."""
    lines = report().lines()
    assert lines[0].startswith("a.csv, b.csv, c.csv and 1 more: 4 snapshots of bearings, 12 rows")
    assert "2 left out" in lines[0]
    assert "1 bad row" in lines[0]
    assert lines[1:] == ["ml: 3 ok, 1 too_few", "ls: 2 boundary, 2 behind", "note: mind the gap"]


def test_unanswered_are_counted_over_the_methods() -> None:
    """Estimates of any method that are no fix are unanswered."""
    assert report().unanswered == 3
    tally = MethodTally(Counter(ok=3, no_consensus=2, outside_field=4, not_proven=5))
    assert RunReport(kind="bearings", inputs=[], methods={"mixture-ml": tally}).unanswered == 6
    assert (tally.answered, tally.total) == (8, 14)
    assert RunReport(kind="bearings", inputs=[]).unanswered == 0


def test_the_report_is_plain_json() -> None:
    """The dictionary has every count and can be written as JSON."""
    loaded = json.loads(json.dumps(report().as_dict(), allow_nan=False))
    assert (loaded["rows"], loaded["rows_left_out"], loaded["bad_rows"], loaded["snapshots"]) == (12, 2, 1, 4)
    assert loaded["methods"]["ml"] == {
        "statuses": {"ok": 3, "too_few": 1},
        "answered": 3,
        "fits_badly": False,
        "tested": 0,
        "badly_fitted": 0,
        "used_share": None,
        "verdicts": {},
    }
    assert loaded["notes"] == ["mind the gap"]


@pytest.mark.parametrize("status", Status)
def test_every_status_says_what_it_has(status: Status) -> None:
    """Fixes have a position, and a covariance unless on a boundary; two statuses have a position without being one."""
    assert status.is_fix == (status.word in ANSWERED)
    assert status.has_position == (status.word in ANSWERED | POSITION_ONLY)
    assert status.has_covariance == (status.word in ANSWERED - {"boundary", "std_not_estimable"})
