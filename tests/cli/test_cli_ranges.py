"""Ranges on the command line: localize, identify-los, simulate, evaluate, bound."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.csv
import pytest
from cli_support import FIXTURES, Outcome, table_csv

import nlosctl

pytestmark = pytest.mark.extensive

Cli = Callable[..., Outcome]
ANCHORS, ECHOES = FIXTURES / "good_ranges.csv", FIXTURES / "good_echoes.csv"
FIELD = "--field=-200,200,-200,200"


def read(path: Path) -> Any:
    """Return a CSV file as a table."""
    return pyarrow.csv.read_csv(path)


def errors(table: Any) -> np.ndarray:
    """Return the distances of estimates from their truth."""
    x, y, true_x, true_y = (np.array(table.column(name)) for name in ("x_m", "y_m", "truth_x_m", "truth_y_m"))
    return np.hypot(x - true_x, y - true_y)


def ranges_file(folder: Path, **columns: Any) -> Path:
    """Write four ranges of one source at (3, 4), with columns changed."""
    sensors = [(0.0, 0.0), (10.0, 0.0), (10.0, 8.0), (0.0, 8.0)]
    content = {
        "snapshot": [1] * 4,
        "sensor": ["a", "b", "c", "d"],
        "sensor_x_m": [x for x, _ in sensors],
        "sensor_y_m": [y for _, y in sensors],
        "range_m": [float(np.hypot(3.0 - x, 4.0 - y)) for x, y in sensors],
        "range_std_m": [0.1] * 4,
    }
    path = folder / "m.csv"
    path.write_text(table_csv({**content, **columns}))
    return path


def test_ranges_are_detected(cli: Cli, tmp_path: Path) -> None:
    """A file of ranges is detected by its columns, and ``ml`` is range least squares."""
    ml, r_ls = (cli("localize", ranges_file(tmp_path), *words).table for words in ([], ["-m", "r-ls"]))
    assert (ml["x_m"][0].as_py(), ml["y_m"][0].as_py()) == pytest.approx((3.0, 4.0))
    assert ml["status"].to_pylist() == ["ok"]
    assert ml.drop(["method"]).equals(r_ls.drop(["method"]))


def test_heights_reduce_slant_ranges(cli: Cli) -> None:
    """With ``--target-z-m`` ranges are slant ranges: the error is smaller, and the summary states it."""
    plane = cli("localize", ANCHORS, "-m", "mixture-ml")
    slant = cli("localize", ANCHORS, "-m", "mixture-ml", "--target-z-m", 1.2)
    assert "'sensor_z_m' is not used without --target-z-m" in plane.err
    assert "sensor_z_m" not in slant.err
    assert np.median(errors(slant.table)) < 0.15
    assert np.median(errors(slant.table)) < np.median(errors(plane.table))


def test_a_target_height_needs_sensor_heights(cli: Cli, tmp_path: Path) -> None:
    """``--target-z-m`` without ``sensor_z_m`` is a usage error."""
    outcome = cli("localize", ranges_file(tmp_path), "--target-z-m", 0)
    assert outcome.code == 2
    assert "sensor_z_m" in outcome.err


def test_outliers_are_flagged(cli: Cli, tmp_path: Path) -> None:
    """``mixture-ml`` rejects the one range that is too short; three that agree are no consensus unless all is kept."""
    lengths = [5.0, 8.06, 8.06, 1.0]
    path = ranges_file(tmp_path, range_m=lengths)
    assert cli("localize", path, "-m", "mixture-ml").table["status"].to_pylist() == ["no_consensus"]
    words = ("-p", "least_evidence=-1000", "-o", "e.csv", "--flags-out", "f.csv")
    assert cli("localize", path, "-m", "mixture-ml", *words).code == 0
    assert read(tmp_path / "f.csv")["los"].to_pylist() == [True, True, True, False]
    assert read(tmp_path / "e.csv")["x_m"][0].as_py() == pytest.approx(3.0, abs=0.1)


def test_a_mirror_image_is_an_alternative(cli: Cli, tmp_path: Path) -> None:
    """Collinear sensors are ambiguous, with both positions under ``--alternatives``."""
    path = ranges_file(tmp_path, sensor_y_m=[0.0] * 4, range_m=[5.0, 8.0623, 8.0623, 5.0])
    one, two = (cli("localize", path, "--alternatives", number).table for number in (1, 2))
    assert one["status"].to_pylist() == ["ambiguous"]
    assert two["status"].to_pylist() == ["ambiguous"] * 2
    assert sorted(round(y) for y in two["y_m"].to_pylist()) == [-4, 4]


@pytest.mark.parametrize("value", [0.0, -2.0])
@pytest.mark.parametrize("command", ["localize", "identify-los"])
def test_a_range_that_is_not_positive_is_bad(cli: Cli, tmp_path: Path, command: str, value: float) -> None:
    """Zero and negative ranges are bad rows."""
    path = ranges_file(tmp_path, range_m=[5.0, value, 8.0623, 5.0])
    outcome = cli(command, path)
    assert outcome.code == 1
    assert [word for word in ("row 2", "'range_m'", "larger than 0") if word not in outcome.err] == []
    assert cli(command, path, "--bad-rows", "b.csv", "-o", "o.csv").code == 0


def test_echoes_are_identified_and_scored(cli: Cli, tmp_path: Path) -> None:
    """``identify-los | evaluate``: all targets and sets; flags keep the input's rows and columns."""
    outcome = cli("identify-los", ECHOES, FIELD, "-o", "f.csv", "--estimates-out", "e.csv")
    assert outcome.code == 0, outcome.err
    before, flags, estimates = read(ECHOES), read(tmp_path / "f.csv"), read(tmp_path / "e.csv")
    assert flags.select(before.column_names).to_pylist() == before.to_pylist()
    assert flags.column_names[len(before.column_names) :] == ["used", "los", "target", "residual_m"]
    assert flags["los"].to_pylist() == before["truth_los"].to_pylist()
    assert "truth_x_m" not in estimates.column_names
    scores = cli("evaluate", "f.csv", "--estimates", "e.csv", "--json").json["overall"]
    assert (scores["number_right"], scores["exact"], scores["los_recall"]) == (1.0, 1.0, 1.0)
    assert scores["case_i"] == scores["true_targets"] == estimates.num_rows
    assert 0.0 < scores["matched_rmse_m"] < 1.0
    assert scores["gospa_m"] < 1.0


def test_missed_targets_in_ospa(cli: Cli, tmp_path: Path) -> None:
    """``tca`` for one target finds one; cutoff and order of OSPA are parameters."""
    outcome = cli(
        "identify-los", ECHOES, FIELD, "-m", "tca", "-p", "targets=1", "-o", "f.csv", "--estimates-out", "e.csv"
    )
    assert outcome.code == 0, outcome.err
    scores = [
        cli("evaluate", "f.csv", "--estimates", "e.csv", "--json", "--ospa-cutoff-m", cutoff).json["overall"]
        for cutoff in (20, 40)
    ]
    assert scores[0]["found_targets"] == 8
    assert scores[0]["gospa_false_m"] == 0.0
    assert scores[1]["gospa_missed_m"] == pytest.approx(2.0 * scores[0]["gospa_missed_m"])


def test_flags_of_identify_los_are_measurements_again(cli: Cli, tmp_path: Path) -> None:
    """``identify-los | localize`` uses only the direct rows."""
    assert cli("identify-los", ECHOES, FIELD, "-o", "f.csv").code == 0
    rows = read(tmp_path / "f.csv")
    outcome = cli("localize", "f.csv", "-m", "r-ls")
    assert outcome.code == 0, outcome.err
    assert f"{rows.num_rows - sum(rows['los'].to_pylist())} left out" in outcome.err


def test_several_methods_follow_each_other(cli: Cli, tmp_path: Path) -> None:
    """Flags are repeated under ``method``; each method has its scores and takes its own parameters."""
    words = ["-m", "assignment", "-m", "extended-tca", "-p", "eta=15", "-p", "extended-tca:unique=circles"]
    assert cli("identify-los", ECHOES, FIELD, *words, "-o", "f.csv", "--estimates-out", "e.csv").code == 0
    groups = cli("evaluate", "f.csv", "--estimates", "e.csv", "--json").json["groups"]
    assert [group["method"] for group in groups] == ["assignment", "extended-tca"]
    assert [group["snapshots"] for group in groups] == [8, 8]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["-m", "extended-tca"], "needs the parameter 'eta'"),
        (["-m", "extended-tca", "-p", "eta=0"], "(0, inf)"),
        (["-m", "extended-tca", "-p", "eta=-3"], "(0, inf)"),
        (["-m", "tca"], "needs the parameter 'targets'"),
        (["-m", "tca", "-p", "targets=0"], "[1, inf)"),
        (["-p", "min_sensors=2"], "[3, inf)"),
        (["--field", "1,2,3"], "4 finite numbers"),
    ],
)
def test_invalid_parameters_are_usage_errors(cli: Cli, words: list[str], message: str) -> None:
    """A missing or invalid parameter exits 2 with the expectation."""
    outcome = cli("identify-los", ECHOES, *words)
    assert outcome.code == 2
    assert message in outcome.err


def test_the_limit_on_echoes(cli: Cli) -> None:
    """The limit on echoes at a sensor is reported with its parameter."""
    outcome = cli("identify-los", ECHOES, "-p", "max_echoes=5")
    assert outcome.code == 1
    assert "max_echoes=5" in outcome.err


def test_two_sensors_are_too_few(cli: Cli, tmp_path: Path) -> None:
    """A snapshot of two sensors is too_few, and exits 3 under ``--strict``."""
    path = ranges_file(tmp_path, sensor=["a", "a", "b", "b"], sensor_x_m=[0.0, 0.0, 10.0, 10.0], sensor_y_m=[0.0] * 4)
    assert cli("identify-los", path, "-o", "f.csv", "--estimates-out", "e.csv", "--strict").code == 3
    assert read(tmp_path / "e.csv")["status"].to_pylist() == ["too_few"]


@pytest.mark.parametrize("scenario", ["liang", "echo-field"])
def test_simulated_echoes_are_a_file_of_ranges(cli: Cli, tmp_path: Path, scenario: str) -> None:
    """``simulate`` writes a valid file; false echoes have neither target nor truth."""
    words = ["-n", 4, "-p", "false_echoes=2", "-p", "detection_probability=0.9", "-o", "s.csv"]
    assert cli("simulate", scenario, *words).code == 0
    assert cli("validate", "s.csv", "--json").json["kind"] == "ranges"
    table = read(tmp_path / "s.csv")
    nobody = [value is None for value in table["truth_target"].to_pylist()]
    assert 0 < sum(nobody) < table.num_rows
    assert [value is None for value in table["truth_x_m"].to_pylist()] == nobody


def test_results_do_not_depend_on_blocks_or_jobs(cli: Cli, tmp_path: Path) -> None:
    """The same bytes for any block size and number of jobs."""
    contents = set()
    for number, (block, jobs) in enumerate([(1, 1), (3, 2), (4096, 1)]):
        names = [f"f{number}.csv", f"e{number}.csv"]
        words = ["--block-size", block, "--jobs", jobs, "-o", names[0], "--estimates-out", names[1]]
        assert cli("identify-los", ECHOES, FIELD, *words).code == 0
        contents.add(tuple((tmp_path / name).read_bytes() for name in names))
    assert len(contents) == 1


def test_the_bound_of_ranges(cli: Cli, tmp_path: Path) -> None:
    """Four ranges from the corners of a square to its middle: variance std^2 / 2 on each axis."""
    path = ranges_file(tmp_path, sensor_y_m=[0.0, 0.0, 10.0, 10.0], truth_x_m=[5.0] * 4, truth_y_m=[5.0] * 4)
    bound = cli("bound", path).table
    assert bound["bound_xx_m2"][0].as_py() == pytest.approx(0.005)
    assert bound["bound_yy_m2"][0].as_py() == pytest.approx(0.005)
    assert bound["bound_xy_m2"][0].as_py() == pytest.approx(0.0, abs=1e-12)


def test_the_functions_equal_the_commands(cli: Cli, tmp_path: Path) -> None:
    """``nlosctl.identify_los`` and ``evaluate`` give the results of the command line."""
    table = read(ECHOES)
    result = nlosctl.identify_los(table, field="-200,200,-200,200")
    assert cli("identify-los", ECHOES, FIELD, "-o", "f.csv", "--estimates-out", "e.csv").code == 0
    assert result.estimates.to_pylist() == read(tmp_path / "e.csv").to_pylist()
    theirs = cli("evaluate", "f.csv", "--estimates", "e.csv", "--json").json["overall"]
    assert nlosctl.evaluate(result.flags, estimates=result.estimates).overall == theirs


def test_echoes_of_several_targets_have_no_bound(cli: Cli) -> None:
    """``bound`` refuses a file of unlabelled echoes."""
    outcome = cli("bound", ECHOES)
    assert outcome.code == 1
    assert "truth_target" in outcome.err


@pytest.mark.parametrize(("path", "rows", "snapshots"), [(ANCHORS, 48, 12), (ECHOES, 225, 8)])
def test_the_fixtures_are_valid(cli: Cli, path: Path, rows: int, snapshots: int) -> None:
    """The fixtures of ranges are valid, with their rows counted."""
    output = cli("validate", path, "--json").json
    assert (output["kind"], output["rows"], output["snapshots"], output["bad_rows"]) == ("ranges", rows, snapshots, 0)


@pytest.mark.parametrize(
    ("job", "words", "advised"),
    [("identify-los", ["-m", "tca", "-p", "targets=1"], False), ("localize", ["-m", "r-ls"], True)],
)
def test_a_bad_fit_names_only_methods_of_the_same_job(
    cli: Cli, tmp_path: Path, job: str, words: list[str], advised: bool
) -> None:
    """``identify-los`` does not advise mixture-ml, which it refuses; ``localize`` does."""
    path = ranges_file(tmp_path, range_m=[5.5, 8.0, 8.0, 5.0], range_std_m=[1e-3] * 4)
    outcome = cli(job, path, *words, "-o", "f.csv")
    assert outcome.code == 0, outcome.err
    assert "fits badly" in outcome.err
    assert ("mixture-ml" in outcome.err) is advised
