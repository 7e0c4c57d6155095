"""Several sources by bearings on the command line: identify-los, its options, and what it refuses."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.csv
import pytest
from cli_support import Outcome

import nlosctl

pytestmark = pytest.mark.extensive

Cli = Callable[..., Outcome]


@pytest.fixture(name="heard")
def heard_file(cli: Cli, tmp_path: Path) -> Path:
    """Write 12 snapshots of up to three sources."""
    words = ["-n", 12, "-p", "least_targets=0", "-p", "false_bearings=0.5", "-p", "detection_probability=0.95"]
    assert cli("simulate", "bearing-field", *words, "-o", "heard.csv", "-q").code == 0
    return tmp_path / "heard.csv"


def read(path: Path) -> Any:
    """Return a CSV file as a table."""
    return pyarrow.csv.read_csv(path)


def write(table: Any, path: Path) -> Path:
    """Write a table as CSV."""
    pyarrow.csv.write_csv(table, path)
    return path


def test_sources_are_found_and_scored(cli: Cli, tmp_path: Path, heard: Path) -> None:
    """Flags and estimates belong together, and their scores are those of identified targets."""
    outcome = cli("identify-los", heard, "-o", "f.csv", "--estimates-out", "e.csv")
    assert outcome.code == 0
    assert "snapshots of bearings" in outcome.err
    flags, estimates = read(tmp_path / "f.csv"), read(tmp_path / "e.csv")
    assert {"used", "los", "target", "residual_rad"} <= set(flags.column_names)
    assert set(estimates["status"].to_pylist()) <= {"ok", "no_target"}
    pairs = {
        pair
        for pair in zip(*(flags[name].to_pylist() for name in ("snapshot", "target")), strict=True)
        if pair[1] is not None
    }
    found = estimates.filter(pa.compute.equal(estimates["status"], "ok"))
    assert pairs == set(zip(*(found[name].to_pylist() for name in ("snapshot", "target")), strict=True))
    assert flags["los"].to_pylist() == [target is not None for target in flags["target"].to_pylist()]
    scores = cli("evaluate", "f.csv", "--estimates", "e.csv", "--json").json["overall"]
    assert scores["number_right"] > 0.8
    assert scores["los_precision"] > 0.9


def test_the_function_equals_the_command(cli: Cli, tmp_path: Path, heard: Path) -> None:
    """``nlosctl.identify_los`` has the results of the command, whatever the blocks and jobs."""
    result = nlosctl.identify_los(read(heard))
    contents = set()
    for number, (block, jobs) in enumerate([(1, 1), (5, 2), (4096, 1)]):
        names = [f"f{number}.csv", f"e{number}.csv"]
        words = ["--block-size", block, "--jobs", jobs, "-o", names[0], "--estimates-out", names[1]]
        assert cli("identify-los", heard, *words).code == 0
        contents.add(tuple((tmp_path / name).read_bytes() for name in names))
    assert len(contents) == 1
    assert result.estimates.to_pylist() == read(tmp_path / "e0.csv").to_pylist()


def test_a_file_with_ranges_is_one_of_ranges(cli: Cli, tmp_path: Path, heard: Path) -> None:
    """Ranges beside bearings are taken, unless the kind is bearings: then they are not used, and that is stated."""
    table = read(heard)
    ones = pa.array([100.0] * table.num_rows)
    both = write(table.append_column("range_m", ones).append_column("range_std_m", ones), tmp_path / "both.csv")
    assert "snapshots of ranges" in cli("identify-los", both, "-o", "r.csv").err
    outcome = cli("identify-los", both, "--kind", "bearings", "-o", "b.csv")
    assert "snapshots of bearings" in outcome.err
    assert "'range_m' is not used" in outcome.err
    assert cli("identify-los", heard, "-o", "f.csv").code == 0
    assert read(tmp_path / "b.csv")["target"] == read(tmp_path / "f.csv")["target"]


def test_standard_deviations_may_be_an_option(cli: Cli, tmp_path: Path, heard: Path) -> None:
    """Missing standard deviations are an error that names the option, which replaces them."""
    table = read(heard)
    bare = write(table.drop(["bearing_std_rad"]), tmp_path / "bare.csv")
    refused = cli("identify-los", bare)
    assert refused.code == 1
    assert "bearing_std" in refused.err
    assert cli("identify-los", bare, "--bearing-std-deg", 1, "-o", "b.csv").code == 0
    assert cli("identify-los", heard, "-o", "f.csv").code == 0
    assert read(tmp_path / "b.csv")["target"] == read(tmp_path / "f.csv")["target"]


@pytest.mark.parametrize(
    ("words", "code", "text"),
    [
        (["-p", "targets=2"], 2, "targets"),
        (["-p", "eta=15"], 2, "eta"),
        (["-m", "tca"], 2, "tca"),
        (["-p", "min_sensors=2"], 2, "min_sensors"),
        (["-p", "max_echoes=1"], 1, "max_echoes=1"),
    ],
)
def test_what_bearings_do_not_take(cli: Cli, heard: Path, words: list[str], code: int, text: str) -> None:
    """Parameters of other methods, a pair of sensors and too many bearings are refused by one line."""
    outcome = cli("identify-los", heard, *words)
    assert outcome.code == code
    assert text in outcome.err
    assert len(outcome.err.strip().splitlines()) == 1


def test_more_sensors_than_there_are(cli: Cli, tmp_path: Path, heard: Path) -> None:
    """No snapshot has a target if more sensors must see it than there are; the summary states why."""
    outcome = cli("identify-los", heard, "-p", "min_sensors=7", "-o", "f.csv", "--estimates-out", "e.csv")
    assert outcome.code == 0
    assert set(read(tmp_path / "e.csv")["status"].to_pylist()) == {"no_target"}
    assert "min_sensors=7" in outcome.err
