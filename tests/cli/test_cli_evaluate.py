"""``evaluate``: metrics compared with values computed by hand."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet
import pytest
from cli_support import FIXTURES, GOOD, Outcome, table_csv
from scipy import stats

from nlosctl.contract.tables import SCORES
from nlosctl.evaluation.summaries import DetectionSummary, EstimateSummary, FlagSummary, TargetSummary

Cli = Callable[..., Outcome]

STATUS = ["ok", "ok", "ambiguous", "infeasible", "boundary", "too_few", "ok", "degenerate"]
X = [1.0, 2.5, -3.0, 4.0, 0.5, None, 7.0, None]
Y = [0.0, 1.0, 2.0, -1.5, 0.25, None, 8.0, None]
XX = [1.0, 2.0, 4.0, 0.5, None, None, 9.0, None]
XY = [0.0, 0.5, -1.0, 0.1, None, None, 3.0, None]
YY = [1.0, 3.0, 2.0, 0.25, None, None, 4.0, None]
TRUTH_X = [0.0, 2.0, -1.0, 4.5, 0.0, 1.0, 1.0, 0.0]
TRUTH_Y = [0.0, 0.0, 0.0, -1.0, 0.0, 1.0, 1.0, 0.0]


def estimates(**columns: Any) -> dict[str, list[Any]]:
    """Return the columns of a small table of estimates; columns can be replaced, or removed by None."""
    count = len(STATUS)
    standard: dict[str, list[Any]] = {
        "snapshot": list(range(count)),
        "method": ["ml"] * count,
        "target": [0] * count,
        "alternative": [0] * count,
        "x_m": X,
        "y_m": Y,
        "cov_xx_m2": XX,
        "cov_xy_m2": XY,
        "cov_yy_m2": YY,
        "n_measurements": [3] * count,
        "n_used": [3] * count,
        "cost": [None] * count,
        "status": STATUS,
        "truth_x_m": TRUTH_X,
        "truth_y_m": TRUTH_Y,
    }
    return {name: values for name, values in {**standard, **columns}.items() if values is not None}


def write(folder: Path, name: str = "e.csv", **columns: Any) -> None:
    """Write the table."""
    (folder / name).write_text(table_csv(estimates(**columns)))


def by_hand(rows: list[int]) -> dict[str, float | None]:
    """Return the metrics of some rows, computed row by row."""
    errors = [np.hypot(X[k] - TRUTH_X[k], Y[k] - TRUTH_Y[k]) if X[k] is not None else np.inf for k in rows]
    fixed = [k for k in rows if X[k] is not None]
    offset = np.array([[X[k] - TRUTH_X[k], Y[k] - TRUTH_Y[k]] for k in fixed])
    squared = []
    for k in fixed:
        if XX[k] is not None:
            e = np.array([X[k] - TRUTH_X[k], Y[k] - TRUTH_Y[k]])
            squared.append(e @ np.linalg.inv(np.array([[XX[k], XY[k]], [XY[k], YY[k]]])) @ e)
    count = len(squared)
    low, high = stats.chi2.ppf([0.025, 0.975], 2 * count) / count
    figures = {
        "rows": len(rows),
        "answered": len(fixed),
        "fix_rate": len(fixed) / len(rows),
        "rmse_m": np.sqrt(np.mean(np.sum(offset**2, axis=1))),
        "bias_x_m": offset[:, 0].mean(),
        "bias_y_m": offset[:, 1].mean(),
        "nees": np.mean(squared),
        "nees_rows": count,
        "nees_low": low,
        "nees_high": high,
        **{f"coverage_{p}": np.mean(np.array(squared) <= stats.chi2.ppf(p / 100, 2)) for p in (50, 90, 95, 99)},
    }
    for name, percent in (("median_m", 50), ("p90_m", 90), ("p95_m", 95), ("p99_m", 99)):
        position = percent / 100 * (len(errors) - 1)
        low_error, high_error = np.sort(errors)[[int(np.floor(position)), int(np.ceil(position))]]
        fraction = position - np.floor(position)
        reached = high_error if fraction else low_error
        figures[name] = float(low_error + fraction * (high_error - low_error)) if np.isfinite(reached) else None
    return figures


def assert_metrics_agree(metrics: dict[str, Any], expected: dict[str, float | None]) -> None:
    """Compare metrics."""
    assert {name: metrics[name] for name in expected} == {
        name: None if value is None else pytest.approx(value, rel=1e-12) for name, value in expected.items()
    }


def test_metrics_agree_with_values_by_hand(cli: Cli, tmp_path: Path) -> None:
    """RMSE, bias, percentiles, fix rate, NEES with its interval and coverage of eight mixed rows."""
    write(tmp_path)
    output = cli("evaluate", "e.csv", "--json").json
    assert output["of"] == "estimates"
    assert_metrics_agree(output["overall"], by_hand(list(range(8))))
    assert output["overall"]["statuses"] == {
        "ok": 3, "ambiguous": 1, "infeasible": 1, "boundary": 1, "too_few": 1, "degenerate": 1
    }  # fmt: skip


def test_rows_without_a_fix_are_infinite_in_the_percentiles_alone(cli: Cli, tmp_path: Path) -> None:
    """Two of eight rows have no fix: the median is finite, the 90 % error is not; RMSE excludes them."""
    write(tmp_path)
    output = cli("evaluate", "e.csv", "--json").json["overall"]
    expected = by_hand(list(range(8)))
    assert output["median_m"] == pytest.approx(expected["median_m"])
    assert [output[name] for name in ("p90_m", "p95_m", "p99_m")] == [None] * 3
    assert output["rmse_m"] == pytest.approx(by_hand([0, 1, 2, 3, 4, 6])["rmse_m"])
    assert output["fix_rate"] == 0.75


def test_an_infinite_percentile_is_shown_as_infinite(cli: Cli, tmp_path: Path) -> None:
    """In the table an infinite percentile is ``inf``, a missing metric ``-``."""
    write(tmp_path)
    shown = dict(
        line.split()[:2]
        for line in cli("evaluate", "e.csv", "--format", "text").text.splitlines()
        if "status" not in line
    )
    assert shown["p95_m"] == "inf"


def test_metrics_per_method(cli: Cli, tmp_path: Path) -> None:
    """Each method has its metrics, in order of appearance; those of several methods together are left out."""
    write(tmp_path, method=["ml", "ls"] * 4)
    output = cli("evaluate", "e.csv", "--json").json
    assert [group["method"] for group in output["groups"]] == ["ml", "ls"]
    assert_metrics_agree(output["groups"][0], by_hand([0, 2, 4, 6]))
    assert_metrics_agree(output["groups"][1], by_hand([1, 3, 5, 7]))
    assert "overall" not in output
    shown = cli("evaluate", "e.csv", "--format", "text").text.splitlines()[0].split()
    assert shown == ["figure", "ml", "ls"]


def test_metrics_per_swept_value(cli: Cli, tmp_path: Path) -> None:
    """Columns ``sweep_*`` form groups like methods."""
    write(tmp_path, sweep_sigma_deg=[1.0, 2.0] * 4)
    output = cli("evaluate", "e.csv", "--json").json
    assert [group["sweep_sigma_deg"] for group in output["groups"]] == [1.0, 2.0]
    assert_metrics_agree(output["groups"][1], by_hand([1, 3, 5, 7]))
    assert_metrics_agree(output["overall"], by_hand(list(range(8))))
    shown = cli("evaluate", "e.csv", "--format", "text").text.splitlines()[0].split()
    assert shown == ["figure", "ml", "sigma_deg=1.0", "ml", "sigma_deg=2.0", "overall"]


def test_metrics_per_file(cli: Cli, tmp_path: Path) -> None:
    """Several inputs have their own metrics under the file's name."""
    write(tmp_path)
    write(tmp_path, "g.csv", x_m=[value and value + 100 for value in X])
    output = cli("evaluate", "e.csv", "g.csv", "--json").json
    assert [group["file"] for group in output["groups"]] == ["e.csv", "g.csv"]
    assert_metrics_agree(output["groups"][0], by_hand(list(range(8))))
    assert output["groups"][1]["rmse_m"] > 100 > output["groups"][0]["rmse_m"]


def test_the_truth_can_come_from_a_file(cli: Cli, tmp_path: Path) -> None:
    """``--truth`` joins on the snapshot in any order and overrides truth columns; missing ones are counted."""
    write(tmp_path, truth_x_m=None, truth_y_m=None)
    write(tmp_path, "wrong.csv", truth_x_m=[0.0] * 8, truth_y_m=[0.0] * 8)
    order = [6, 3, 0, 1, 7, 4, 2]
    columns = {"snapshot": order, "truth_x_m": [TRUTH_X[k] for k in order], "truth_y_m": [TRUTH_Y[k] for k in order]}
    (tmp_path / "t.csv").write_text(table_csv(columns))
    for name in ("e.csv", "wrong.csv"):
        output = cli("evaluate", name, "--truth", "t.csv", "--json").json["overall"]
        assert_metrics_agree(output, by_hand([0, 1, 2, 3, 4, 6, 7]))
        assert output["without_truth"] == 1


def truth_file(tmp_path: Path, snapshots: list[int], x: list[float | None]) -> None:
    """Write t.csv with a true x of each row."""
    (tmp_path / "t.csv").write_text(table_csv({"snapshot": snapshots, "truth_x_m": x, "truth_y_m": [0.0] * len(x)}))


def test_contradicting_truths_are_an_error(cli: Cli, tmp_path: Path) -> None:
    """A snapshot with two true positions exits 1 with both rows; equal and empty rows are allowed."""
    write(tmp_path, truth_x_m=None, truth_y_m=None)
    truth_file(tmp_path, [0, 1, 0], [1.0, 2.0, 3.0])
    outcome = cli("evaluate", "e.csv", "--truth", "t.csv")
    assert (outcome.code, outcome.out) == (1, b"")
    assert "t.csv, row 3: got truth_x_m, truth_y_m 3, 0 for snapshot '0', which has 1, 0 in row 1" in outcome.err
    truth_file(tmp_path, [0, 1, 0, 1], [None, 2.0, 1.0, 2.0])
    outcome = cli("evaluate", "e.csv", "--truth", "t.csv", "--json")
    assert outcome.json["overall"]["without_truth"] == 6
    assert outcome.json["overall"]["rows"] == 2


def test_snapshots_without_truth_are_reported(cli: Cli, tmp_path: Path) -> None:
    """The summary and the JSON state how many snapshots the truth has; none at all is an error."""
    write(tmp_path, truth_x_m=None, truth_y_m=None)
    truth_file(tmp_path, [3, 900], [1.0, 2.0])
    outcome = cli("evaluate", "e.csv", "--truth", "t.csv", "--json")
    note = "t.csv has the truth of 1 of 8 snapshots; the others are not scored"
    assert outcome.json["notes"] == [note]
    assert f"note: {note}" in outcome.err
    truth_file(tmp_path, list(range(8)), [1.0] * 8)
    assert "notes" not in cli("evaluate", "e.csv", "--truth", "t.csv", "--json").json
    truth_file(tmp_path, [100, 101], [1.0, 2.0])
    outcome = cli("evaluate", "e.csv", "--truth", "t.csv")
    assert (outcome.code, outcome.out) == (1, b"")
    assert "t.csv: none of its snapshots (the first is '100') is one of the 8 snapshots" in outcome.err


def test_the_truth_is_for_estimates(cli: Cli, tmp_path: Path) -> None:
    """Flags, with or without their estimates, with ``--truth`` are a usage error."""
    drawn = cli("simulate", "echo-field", "-n", 2, "-q")
    cli("identify-los", "-", "-o", "f.csv", "--estimates-out", "e.csv", stdin=drawn.out)
    truth_file(tmp_path, [0], [1.0])
    for words in ((), ("--estimates", "e.csv")):
        outcome = cli("evaluate", "f.csv", "--truth", "t.csv", *words)
        assert outcome.code == 2
        assert "--truth is for estimates" in outcome.err


def test_a_source_of_whole_numbers_is_a_label(cli: Cli, tmp_path: Path) -> None:
    """A column ``source`` of integers groups like text, in a table of scores too."""
    write(tmp_path, source=[5, 7] * 4)
    outcome = cli("evaluate", "e.csv", "-o", "scores.csv")
    assert outcome.code == 0
    assert [row.split(",")[1] for row in (tmp_path / "scores.csv").read_text().splitlines()[1:]] == ["5", "7"]


def test_missing_truth_is_an_error(cli: Cli, tmp_path: Path) -> None:
    """Estimates without truth exit 1 with the cure."""
    write(tmp_path, truth_x_m=None, truth_y_m=None)
    outcome = cli("evaluate", "e.csv")
    assert outcome.code == 1
    assert "truth_x_m" in outcome.err
    assert "--truth" in outcome.err


def test_alternatives_in_metrics(cli: Cli, tmp_path: Path) -> None:
    """Alternative 0 counts; with ``--alternatives best`` the one nearest to the truth of each target."""
    columns = {
        "snapshot": ["a", "a", "a", "a", "b", "b"],
        "method": ["ml"] * 6,
        "target": [0, 0, 1, 1, 0, 0],
        "alternative": [0, 1, 0, 1, 0, 1],
        "x_m": [3.0, 1.0, 2.0, 5.0, 4.0, 6.0],
        "y_m": [0.0] * 6,
        **{name: [1.0] * 6 for name in ("cov_xx_m2", "cov_yy_m2")},
        "cov_xy_m2": [0.0] * 6,
        **{name: [3] * 6 for name in ("n_measurements", "n_used", "cost")},
        "status": ["ok"] * 6,
        "truth_x_m": [0.0] * 6,
        "truth_y_m": [0.0] * 6,
    }
    (tmp_path / "e.csv").write_text(table_csv(columns))
    first = cli("evaluate", "e.csv", "--json").json["overall"]
    best = cli("evaluate", "e.csv", "--alternatives", "best", "--json").json["overall"]
    assert (first["rows"], best["rows"]) == (3, 3)
    assert first["rmse_m"] == pytest.approx(np.sqrt((9 + 4 + 16) / 3))
    assert best["rmse_m"] == pytest.approx(np.sqrt((1 + 4 + 16) / 3))


@pytest.mark.extensive
@pytest.mark.parametrize(
    ("conditions", "code"),
    [
        (["rmse_m>5"], 0),
        (["rmse_m>3"], 4),
        (["fix_rate<0.75"], 0),
        (["fix_rate<=0.75"], 4),
        (["rows>=8"], 4),
        (["rows > 8"], 0),
        (["rmse_m>5", "fix_rate<1"], 4),
        (["p95_m>1e9"], 4),
        (["coverage_95<0.95"], 4),
        (["status_degenerate>=1"], 4),
        (["status_behind>0"], 0),
        (["status_odd>0"], 2),
        (["ml:rmse_m>3"], 4),
        ([" ml : rmse_m > 5 "], 0),
        (["rows==8"], 4),
        (["rows!=8"], 0),
        (["rows!=8", "ml:rows==8"], 4),
        (["rmse>5"], 2),
        (["ls:rmse_m>5"], 2),
        (["rmse_m>nan"], 2),
        (["rmse_m>5", "method>1"], 2),
        (["rmse_m=5"], 2),
        (["rmse_m>five"], 2),
        (["statuses>5"], 2),
    ],
)
def test_fail_if_conditions(cli: Cli, tmp_path: Path, conditions: list[str], code: int) -> None:
    """``--fail-if`` exits 4 if a condition is met (by infinity too), 2 if it is invalid."""
    write(tmp_path)
    assert by_hand(list(range(8)))["rmse_m"] == pytest.approx(4.0, abs=1.0)
    outcome = cli("evaluate", "e.csv", *(word for condition in conditions for word in ("--fail-if", condition)))
    assert outcome.code == code, outcome.err
    assert len(outcome.err.splitlines()) == (code > 0)


def test_conditions_apply_to_every_method(cli: Cli, tmp_path: Path) -> None:
    """A condition that one method meets is met, and the message names the method."""
    write(tmp_path, method=["ml"] * 6 + ["ls"] * 2)
    outcome = cli("evaluate", "e.csv", "--fail-if", "rmse_m>6")
    assert outcome.code == 4
    assert "ls" in outcome.err


def test_every_met_condition_is_reported(cli: Cli, tmp_path: Path) -> None:
    """Each group that meets a condition is on standard error, in ``--json`` and in the report."""
    write(tmp_path, method=["ml", "ls"] * 4)
    words = ["--fail-if", "rows>3", "--fail-if", "ls:rows>=4", "--fail-if", "ml:rows>4"]
    outcome = cli("evaluate", "e.csv", "--json", "--report", "r.json", *words)
    lines = [line.removeprefix("nlosctl: ") for line in outcome.err.splitlines()]
    assert [line.split(" is ")[0] for line in lines] == ["rows of ml", "rows of ls", "rows of ls"]
    assert lines[2] == "rows of ls is 4, which meets 'ls:rows>=4'"
    assert outcome.json["failed"] == json.loads((tmp_path / "r.json").read_text())["failed"] == lines


@pytest.mark.parametrize(
    ("condition", "message"),
    [
        ("rmse>5", "no metric 'rmse' (did you mean 'rmse_m'?); there are: rows, "),
        ("mle:rmse_m>5", "no method 'mle' in the input (did you mean 'ml'?); there are: ml"),
    ],
)
def test_unknown_names_in_conditions(cli: Cli, tmp_path: Path, condition: str, message: str) -> None:
    """An unknown metric or method exits 2, with the nearest name and all names."""
    write(tmp_path)
    outcome = cli("evaluate", "e.csv", "--fail-if", condition)
    assert (outcome.code, outcome.out) == (2, b"")
    assert message in outcome.err


def test_conditions_name_swept_values(cli: Cli, tmp_path: Path) -> None:
    """The reason names swept values too, which are not metrics."""
    write(tmp_path, sweep_sigma_deg=[1.0, 2.0] * 4)
    assert "rows of ml sigma_deg=1.0 is 4" in cli("evaluate", "e.csv", "--fail-if", "rows<5").err
    assert cli("evaluate", "e.csv", "--fail-if", "sweep_sigma_deg>0").code == 2


def test_invalid_conditions_print_no_table(cli: Cli, tmp_path: Path) -> None:
    """An invalid condition prints nothing on stdout."""
    write(tmp_path)
    assert cli("evaluate", "e.csv", "--fail-if", "rmse_m=5").out == b""


def test_flags_are_compared_with_the_truth(cli: Cli, tmp_path: Path) -> None:
    """Flags: the confusion table of ``los`` and ``truth_los``, unknown ones apart."""
    los = ["true", "true", "false", "false", "true", "", "true"]
    truth = ["true", "false", "false", "true", "true", "true", ""]
    columns = {"snapshot": [1] * 7, "sensor": list("abcdefg"), "used": ["true"] * 7, "los": los, "truth_los": truth}
    (tmp_path / "f.csv").write_text(table_csv(columns))
    output = cli("evaluate", "f.csv", "--json").json
    figures = output["overall"]
    assert output["of"] == "flags"
    assert (figures["rows"], figures["without_flag"], figures["without_truth"]) == (5, 1, 1)
    assert [figures[name] for name in ("los_called_los", "los_called_nlos", "nlos_called_los", "nlos_called_nlos")] == [
        2, 1, 1, 1
    ]  # fmt: skip
    assert figures["precision"] == pytest.approx(2 / 3)
    assert figures["recall"] == pytest.approx(2 / 3)
    assert figures["false_alarm"] == pytest.approx(1 / 2)


def test_metrics_do_not_depend_on_the_format(cli: Cli, tmp_path: Path) -> None:
    """CSV, Parquet and Arrow of the same estimates have the same metrics to the last digit."""
    output = []
    for extension in ("csv", "parquet", "arrow", "jsonl"):
        assert cli("localize", GOOD, "-o", f"e.{extension}", "-m", "ml", "-m", "ls").code == 0
        output.append(cli("evaluate", f"e.{extension}", "--json").json)
    assert output[1:] == output[:1] * 3


def test_parts_of_a_folder_are_one_table_of_estimates(cli: Cli, tmp_path: Path) -> None:
    """A folder of parts is evaluated as one."""
    assert cli("localize", GOOD, "-o", "e.csv").code == 0
    lines = (tmp_path / "e.csv").read_text().splitlines(keepends=True)
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "0.csv").write_text("".join(lines[:14]))
    (tmp_path / "parts" / "1.csv").write_text("".join([lines[0], *lines[14:]]))
    assert cli("evaluate", "parts", "--json").json["overall"] == cli("evaluate", "e.csv", "--json").json["overall"]


def test_files_without_a_fix(cli: Cli, tmp_path: Path) -> None:
    """Without any fix metrics are null, the fix rate is 0, and every condition on an error is met."""
    nothing: list[Any] = [None] * 8
    columns = dict.fromkeys(["x_m", "y_m", "cov_xx_m2", "cov_xy_m2", "cov_yy_m2"], nothing)
    write(tmp_path, **columns, status=["too_few"] * 8)
    outcome = cli("evaluate", "e.csv", "--json", "--fail-if", "rmse_m>1000")
    assert outcome.code == 4
    assert json.loads(outcome.out)["overall"]["rmse_m"] is None
    assert json.loads(outcome.out)["overall"]["fix_rate"] == 0.0


def test_measurements_are_refused(cli: Cli) -> None:
    """A file of measurements is refused with the missing columns."""
    outcome = cli("evaluate", FIXTURES / "good_bearings.csv")
    assert outcome.code == 1
    assert "'method'" in outcome.err


def test_the_table_of_scores(cli: Cli, tmp_path: Path) -> None:
    """``-o`` writes a row per group with the metrics of ``--json``; values that are not finite are empty."""
    write(tmp_path, method=["ml", "ls"] * 4)
    assert cli("evaluate", "e.csv", "-o", "scores.parquet").code == 0
    table = pyarrow.parquet.read_table(tmp_path / "scores.parquet").to_pylist()
    output = cli("evaluate", "e.csv", "--json").json["groups"]
    for row, group in zip(table, output, strict=True):
        assert row.pop("of") == "estimates"
        statuses = group.pop("statuses")
        assert {name: row.pop(name) for name in list(row) if name.startswith("status_") and row[name]} == {
            f"status_{word}": count for word, count in statuses.items()
        }
        assert {name: value for name, value in row.items() if not name.startswith("status_")} == group
    refused = cli("evaluate", "e.csv", "-o", "scores.parquet")
    assert refused.code == 1
    assert "exists already" in refused.err
    assert cli("evaluate", "e.csv", "-o", "text.csv", "--format", "text").code == 2


def test_every_metric_is_a_column_of_the_schema() -> None:
    """The schema of scores has each metric except for the curves."""
    summaries = (EstimateSummary, FlagSummary, DetectionSummary, TargetSummary)
    names = {field.name for summary in summaries for field in dataclasses.fields(summary)}
    assert names - {column.name for column in SCORES.columns} == {"statuses", "roc"}
