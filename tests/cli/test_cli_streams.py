"""Convention 2: data on stdout, everything else on stderr or in a report."""

from __future__ import annotations

import json
import os
import pty
import re
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
from cli_support import GOOD, PROGRAM, Outcome, crossing_rows, plain_csv, plain_environment

pytestmark = pytest.mark.extensive

Cli = Callable[..., Outcome]


def test_stdout_carries_the_table_alone(cli: Cli) -> None:
    """Every line of stdout is a row; the summary on stderr counts the statuses."""
    outcome = cli("localize", GOOD)
    assert outcome.table.num_rows == len(outcome.text.splitlines()) - 1 == 40
    assert "40 snapshots of bearings, 240 rows" in outcome.err
    assert "ml: 40 ok" in outcome.err


@pytest.mark.parametrize(
    "words", [["localize", GOOD], ["simulate", "ring", "-n", "5"], ["validate", GOOD]], ids=lambda words: words[0]
)
def test_quiet_prints_nothing_on_stderr(cli: Cli, words: list[str]) -> None:
    """``-q`` leaves stderr empty and stdout unchanged."""
    quiet, loud = cli(*words, "-q"), cli(*words)
    assert quiet.err == ""
    assert quiet.out == loud.out != b""


def test_with_an_output_file_stdout_is_empty(cli: Cli) -> None:
    """With ``-o FILE`` stdout is empty."""
    for words in (["localize", GOOD, "-o", "e.csv"], ["simulate", "ring", "-n", 2, "-o", "m.csv"]):
        outcome = cli(*words)
        assert (outcome.code, outcome.out) == (0, b"")
        assert outcome.err != ""


def test_verbose_prints_more(cli: Cli) -> None:
    """``-v`` prints more than the summary on stderr, and nothing more on stdout."""
    plain, verbose = cli("localize", GOOD), cli("localize", GOOD, "-v")
    assert verbose.out == plain.out
    assert len(verbose.err.splitlines()) > len(plain.err.splitlines())


def test_the_report_is_json_with_the_counts(cli: Cli, tmp_path: Path) -> None:
    """``--report`` writes rows, excluded, bad, snapshots and statuses as JSON, with ``-q`` too."""
    rows = [*crossing_rows(1), *crossing_rows(2, 1), *crossing_rows(3)]
    rows = [(*row, "false" if index == 6 else "true") for index, row in enumerate(rows)]
    rows[5] = (*rows[5][:5], "-1", "true")
    header = "snapshot,sensor,sensor_x_m,sensor_y_m,bearing_rad,bearing_std_rad,los"
    (tmp_path / "m.csv").write_text(plain_csv(rows, header))
    words = ["localize", "m.csv", "-q", "-o", "e.csv", "--bad-rows", "bad.csv", "--report", "r.json"]
    outcome = cli(*words, "--method", "ml", "--method", "ls")
    assert (outcome.code, outcome.err) == (0, "")
    report = json.loads((tmp_path / "r.json").read_text())
    assert (report["rows"], report["rows_left_out"], report["bad_rows"], report["snapshots"]) == (6, 1, 1, 3)
    assert {name: output["statuses"] for name, output in report["methods"].items()} == {
        "ml": {"ok": 1, "too_few": 2},
        "ls": {"ok": 1, "too_few": 2},
    }
    assert [given["name"] for given in report["inputs"]] == ["m.csv"]


def test_the_report_can_go_to_stderr(cli: Cli) -> None:
    """``--report -`` writes the JSON to stderr."""
    outcome = cli("localize", GOOD, "-q", "--report", "-")
    assert json.loads(outcome.err)["snapshots"] == 40
    assert outcome.table.num_rows == 40


def test_the_report_of_an_evaluation(cli: Cli, tmp_path: Path) -> None:
    """``evaluate --report`` writes the content of ``--json``."""
    cli("localize", GOOD, "-o", "e.csv")
    outcome = cli("evaluate", "e.csv", "--json", "--report", "r.json")
    assert json.loads((tmp_path / "r.json").read_text()) == outcome.json


def test_a_file_without_ids_is_one_snapshot(cli: Cli, tmp_path: Path) -> None:
    """Without a ``snapshot`` column a file is one snapshot; the summary states it."""
    rows = [row[1:] for row in crossing_rows(1)]
    header = "sensor,sensor_x_m,sensor_y_m,bearing_rad,bearing_std_rad"
    (tmp_path / "m.csv").write_text(plain_csv(rows, header))
    outcome = cli("localize", "m.csv")
    assert outcome.table.num_rows == 1
    assert "without a 'snapshot' column" in outcome.err


@pytest.mark.parametrize(("share", "expected"), [(0.0, False), (0.3, True)])
def test_bad_fits_are_reported(cli: Cli, share: float, expected: bool) -> None:
    """The summary states when residuals are too large for their standard deviations, and only then."""
    drawn = cli("simulate", "ring", "-n", 60, "-q", "-p", f"outlier_fraction={share}")
    assert ("ml fits badly" in cli("localize", "-", stdin=drawn.out).err) is expected


def on_a_terminal(*words: str, cwd: Path, **environment: str) -> tuple[int, str, str]:
    """Return exit code, stdout and stderr with a terminal as stdout."""
    terminal, slave = pty.openpty()
    running = subprocess.Popen(
        [str(PROGRAM), *words],
        stdin=subprocess.DEVNULL,
        stdout=slave,
        stderr=subprocess.PIPE,
        cwd=cwd,
        env=plain_environment(TERM="xterm-256color", COLUMNS="250", **environment),
    )
    os.close(slave)
    seen = b""
    while True:
        try:
            piece = os.read(terminal, 65536)
        except OSError:
            break
        if not piece:
            break
        seen += piece
    os.close(terminal)
    assert running.stderr is not None
    err = running.stderr.read().decode()
    running.stderr.close()
    return running.wait(timeout=30), seen.decode(), err


def test_a_terminal_gets_a_preview(tmp_path: Path) -> None:
    """Without ``-o`` a terminal gets the first rows as a table, and the number of rows."""
    code, seen, err = on_a_terminal("localize", str(GOOD), cwd=tmp_path)
    assert code == 0
    assert "snapshot" in seen
    assert "snapshot," not in seen
    assert "20 of 40 rows" in err
    assert "ml: 40 ok" in err


def test_no_color_is_obeyed(tmp_path: Path) -> None:
    """With ``NO_COLOR`` there are no colour codes."""
    code, seen, _ = on_a_terminal("--help", cwd=tmp_path, NO_COLOR="1")
    assert code == 0
    assert "localize" in seen
    assert re.findall(r"\x1b\[[0-9;]*?(?:3[0-8]|9[0-7])[0-9;]*m", seen) == []
