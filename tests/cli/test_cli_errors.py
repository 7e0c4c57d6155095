"""Convention 5: one clear line for each fault; bad rows set aside; a traceback only on request."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow.csv
import pytest
from cli_support import FIXTURES, GOOD, SCENE, Outcome, crossing_rows, listing, plain_csv, process

from nlosctl.errors import DataError

Cli = Callable[..., Outcome]

BAD = {
    "bad_missing_column.csv": ["'bearing_rad'", "bearing_deg", "--column"],
    "bad_misspelt_column.csv": ["'bearing_rad'", "did you mean 'bearings_rad'"],
    "bad_wrong_type.csv": ["row 5", "'bearing_rad'", "'north-east'", "expected a number"],
    "bad_wrong_type.parquet": ["'bearing_rad'", "string", "expected numbers"],
    "bad_null_value.csv": ["row 5", "'bearing_rad'", "empty", "expected"],
    "bad_nan_value.csv": ["row 5", "'bearing_rad'", "NaN", "expected a finite number"],
    "bad_infinite_value.csv": ["row 5", "'sensor_x_m'", "inf", "expected a finite number"],
    "bad_zero_std.csv": ["row 5", "'bearing_std_rad'", "0", "larger than 0"],
    "bad_negative_std.csv": ["row 5", "'bearing_std_rad'", "-0.01", "larger than 0"],
    "bad_degrees_as_radians.csv": ["'bearing_rad'", "degrees", "bearing_deg"],
    "bad_duplicate_bearing.csv": ["row 5", "row 4", "duplicate", "'path'"],
    "bad_unknown_reflector.csv": ["row 5", "'reflector'", "'wal'", "did you mean 'wall'"],
    "bad_unknown_sensor.csv": ["row 5", "'nort'", "did you mean 'north'"],
    "bad_malformed_scene.csv": ["bad_malformed_scene.scene.toml", "direction", "'north'", "two numbers"],
    "bad_empty.csv": ["empty"],
    "bad_header_only.csv": ["no rows"],
    "bad_truncated.parquet": ["Parquet", "cut short"],
    "bad_ragged_line.csv": ["row 5", "12 fields", "expected 11"],
    "bad_encoding.csv": ["row 5", "'sensor'", "UTF-8"],
    "bad_sensor_outside_circle.csv": ["row 5", "'sensor_x_m'", "7070593.979 m from the centre", "6671000 m"],
    "bad_blocker_outside_circle.csv": ["bad_blocker_outside_circle.scene.toml", "blocker_radius", "(0, 6.481e+06)"],
    "bad_snapshot_comes_back.csv": ["row 13", "'snapshot'", "row 1", "sort"],
}
ROW_FAULTS = [name for name, texts in BAD.items() if "row 5" in texts]


def test_every_bad_fixture_is_tested() -> None:
    """Every bad fixture is in the table above."""
    there = {path.name for path in FIXTURES.glob("bad_*") if not path.name.endswith(".scene.toml")}
    there -= {path.name for path in FIXTURES.glob("bad_triplets_*")}  # in test_detect_ip.py
    assert there == set(BAD)


@pytest.mark.parametrize("command", ["localize", "validate"])
@pytest.mark.parametrize("name", BAD)
def test_a_bad_file_is_one_line_and_nothing_is_written(cli: Cli, tmp_path: Path, name: str, command: str) -> None:
    """Exit 1, one line with file, row, column, value and expectation; no output appears."""
    outputs = ["-o", "e.csv", "--flags-out", "f.csv", "--report", "r.json"] if command == "localize" else []
    outcome = cli(command, FIXTURES / name, *outputs)
    assert outcome.code == 1
    assert outcome.err.startswith("nlosctl: ")
    assert len(outcome.err.splitlines()) == 1
    assert str(FIXTURES / name).split(".")[0] in outcome.err
    assert [word for word in BAD[name] if word not in outcome.err] == []
    assert (outcome.out, listing(tmp_path)) == (b"", [])


@pytest.mark.extensive
@pytest.mark.parametrize("name", ROW_FAULTS)
def test_bad_rows_are_set_aside(cli: Cli, tmp_path: Path, name: str) -> None:
    """``--bad-rows`` receives the bad row with its fault; the results are those without that row."""
    words = ["--flags-out", "f.csv", "--bad-rows", "b.csv"]
    outcome = cli("localize", FIXTURES / name, *words)
    assert outcome.code == 0, outcome.err
    assert "1 bad row" in outcome.err
    aside = pyarrow.csv.read_csv(tmp_path / "b.csv").to_pylist()
    assert [row["row"] for row in aside] == [5]
    assert name in aside[0]["problem"]
    lines = (FIXTURES / name).read_bytes().splitlines(keepends=True)
    (tmp_path / "rest.csv").write_bytes(b"".join([*lines[:5], *lines[6:]]))
    scene = (FIXTURES / name).with_suffix("").with_suffix(".scene.toml")
    rest = cli("localize", "rest.csv", *(["--scene", scene] if scene.exists() else []), "--flags-out", "g.csv")
    assert outcome.out == rest.out
    assert (tmp_path / "f.csv").read_bytes() == (tmp_path / "g.csv").read_bytes()


@pytest.mark.parametrize("name", sorted(set(BAD) - set(ROW_FAULTS)))
def test_faults_of_a_file_stop_the_run(cli: Cli, tmp_path: Path, name: str) -> None:
    """A fault of the file exits 1 with ``--bad-rows`` too, and leaves no file of bad rows."""
    outcome = cli("localize", FIXTURES / name, "-o", "e.csv", "--bad-rows", "b.csv")
    assert outcome.code == 1
    assert listing(tmp_path) == []


def test_the_problems_of_a_file_are_gathered(cli: Cli, tmp_path: Path) -> None:
    """20 problems are printed, one line each with file and row, then the total."""
    rows = [(*row[:5], 0 if index < 30 else 1) for index, row in enumerate(crossing_rows(1, 50))]
    (tmp_path / "m.csv").write_text(plain_csv(rows))
    outcome = cli("localize", "m.csv", "-o", "e.csv")
    lines = outcome.err.splitlines()
    assert outcome.code == 1
    assert len(lines) == 21
    assert all(f"m.csv, row {index + 1} " in line for index, line in enumerate(lines[:20]))
    assert "30" in lines[20]
    assert "--bad-rows" in lines[20]
    assert listing(tmp_path) == ["m.csv"]


def test_problems_name_their_file(cli: Cli, tmp_path: Path) -> None:
    """With several inputs each problem names its file and the row in it."""
    (tmp_path / "a.csv").write_text(plain_csv([*crossing_rows(1), (2, "s", 0, 0, 1, 0)]))
    (tmp_path / "b.csv").write_text(plain_csv([(1, "s", 0, 0, 1, 0), *crossing_rows(2)]))
    outcome = cli("localize", "a.csv", "b.csv")
    assert outcome.code == 1
    assert "a.csv, row 4 " in outcome.err
    assert "b.csv, row 1 " in outcome.err


def test_bad_rows_of_standard_input_name_it(cli: Cli) -> None:
    """A fault of a pipe is reported as standard input's."""
    outcome = cli("localize", "-", stdin=(FIXTURES / "bad_zero_std.csv").read_bytes())
    assert outcome.code == 1
    assert outcome.err.startswith("nlosctl: stdin, row 5 (line 6), column 'bearing_std_rad': got 0")


def test_validate_counts_bad_rows(cli: Cli, tmp_path: Path) -> None:
    """``validate --bad-rows`` writes and counts them, and exits 1."""
    outcome = cli("validate", FIXTURES / "bad_zero_std.csv", "--bad-rows", "b.csv", "--json")
    assert outcome.code == 1
    assert outcome.json["bad_rows"] == 1
    assert listing(tmp_path) == ["b.csv"]


FAULTS: list[tuple[list[Any], int, list[str]]] = [
    (["localize", "good_bearing.csv"], 1, ["good_bearing.csv", "no such file", "did you mean 'good_bearings.csv'"]),
    (["localize", "x*.csv"], 1, ["x*.csv", "no file matches"]),
    (["localize", "empty_folder"], 1, ["empty_folder", "no table file"]),
    (["localize", "-"], 1, ["stdin", "empty"]),
    (["localize", GOOD, GOOD], 2, ["twice"]),
    (["localize", "good_bearings.txt"], 2, ["good_bearings.txt", ".parquet", "--input-format"]),
    (["localize", "good_bearings.csv", "-o", "absent/e.csv"], 1, ["absent/e.csv", "no folder"]),
    (["localize", "good_bearings.csv", "-o", "good_bearings.csv/e.csv"], 1, ["good_bearings.csv/e.csv"]),
    (["localize", "good_bearings.csv", "-o", "folder.csv"], 1, ["folder.csv", "folder"]),
    (["localize", "good_bearings.csv", "-o", "e.cvs"], 2, ["e.cvs", ".csv", "--format"]),
    (["localize", "good_bearings.csv", "--flags-out", "e.cvs"], 2, ["e.cvs", ".csv"]),
    (["localize", "good_bearings.csv", "--bad-rows", "e.cvs"], 2, ["e.cvs", ".csv"]),
    (["localize", "good_bearings.csv", "--report", "absent/r.json"], 1, ["absent/r.json"]),
    (["localize", "good_bearings.csv", "--format", "parket"], 2, ["'parket'", "did you mean 'parquet'"]),
    (["localize", "good_bearings.csv", "--input-format", "parket"], 2, ["'parket'", "did you mean 'parquet'"]),
    (["localize", "good_bearings.csv", "--input-format", "parquet"], 1, ["good_bearings.csv", "Parquet"]),
    (["localize", "good_bearings.csv", "--method", "stansfeld"], 2, ["bearings", "did you mean 'stansfield'", "ml"]),
    (["localize", "good_bearings.csv", "--method", "ml", "--method", "ml"], 2, ["'ml'", "twice"]),
    (["localize", "good_bearings.csv", "--method", "ranges.ml"], 2, ["ranges.ml", "bearings"]),
    (["localize", "good_bearings.csv", "-p", "max_iteration=3"], 2, ["did you mean 'max_iterations'", "min_range_m"]),
    (["localize", "good_bearings.csv", "-p", "max_iterations=two"], 2, ["'max_iterations'", "an int", "'two'"]),
    (["localize", "good_bearings.csv", "-p", "max_iterations=1.5"], 2, ["an int in the range [1, inf)", "'1.5'"]),
    (["localize", "good_bearings.csv", "-p", "max_iterations=0"], 2, ["an int in the range [1, inf)", "'0'"]),
    (["localize", "good_bearings.csv", "-p", "min_range_m=nan"], 2, ["a float in the range [0, inf)", "'nan'"]),
    (["localize", "good_bearings.csv", "-p", "min_range_m=inf"], 2, ["a float in the range [0, inf)", "'inf'"]),
    (["localize", "good_bearings.csv", "-p", "min_range_m"], 2, ["KEY=VALUE", "'min_range_m'"]),
    (["localize", "good_bearings.csv", "-p", "min_range_m=1", "-p", "min_range_m=2"], 2, ["min_range_m", "twice"]),
    (["localize", "good_bearings.csv", "-p", "sl:min_range_m=1"], 2, ["'sl'"]),
    (["localize", "good_bearings.csv", "--kind", "bearing"], 2, ["'bearing'", "did you mean 'bearings'"]),
    (["localize", "good_bearings.csv", "--column", "AZ"], 2, ["--column", "AZ"]),
    (["localize", "good_bearings.csv", "--column", "sensor=station"], 1, ["--column", "'station'"]),
    (["localize", "good_bearings.csv", "--carry", "truth_x"], 1, ["truth_x", "did you mean 'truth_x_m'"]),
    (["localize", "good_bearings.csv", "--scene", "absent.toml"], 1, ["absent.toml"]),
    (["localize", "good_bearings.csv", "--jobs", "-1"], 2, ["--jobs", "0"]),
    (["localize", "good_bearings.csv", "--block-size", "0"], 2, ["--block-size", "1"]),
    (["localize", "good_bearings.csv", "--alternatives", "0"], 2, ["--alternatives", "1"]),
    (["localize", "good_bearings.csv", "--seed", "x"], 2, ["--seed", "integer"]),
    (["localize", "good_bearings.csv", "--max-snapshot-rows", "2"], 1, ["good_bearings.csv", "--max-snapshot-rows"]),
    (["localize", "no_std.csv", "--bearing-std-deg", "0"], 2, ["bearing-std-deg", "0"]),
    (["localize", "no_std.csv", "--bearing-std-deg", "-2"], 2, ["bearing-std-deg", "-2"]),
    (["localize", "no_std.csv", "--bearing-std-deg", "nan"], 2, ["bearing-std-deg", "nan"]),
    (["localize", "no_std.csv"], 1, ["no_std.csv", "'bearing_std_rad'", "--bearing-std-deg"]),
    (["simulate", "rign"], 2, ["'rign'", "did you mean 'ring'"]),
    (["simulate", "ring", "-p", "sensor=3"], 2, ["'sensor'", "did you mean 'sensors'"]),
    (["simulate", "ring", "-n", "0"], 2, ["--trials", "1"]),
    (["simulate", "ring", "--scene-out", "absent/s.toml"], 1, ["absent/s.toml"]),
    (["evaluate", "good_bearings.csv"], 1, ["good_bearings.csv", "estimates", "flags"]),
    (["evaluate", "absent.csv"], 1, ["absent.csv", "no such file"]),
    (["evaluate", FIXTURES / "bad_truncated.parquet"], 1, ["bad_truncated.parquet", "Parquet"]),
    (["evaluate", FIXTURES / "bad_empty.csv"], 1, ["bad_empty.csv", "empty"]),
    (["evaluate", GOOD, "good_bearings.csv", "--estimates", "e.csv"], 2, ["--estimates", "one file of flags"]),
    (["evaluate", GOOD, "--estimates", GOOD, "--ospa-cutoff-m", "0"], 2, ["--ospa-cutoff-m", "larger than 0"]),
    (["evaluate", GOOD, "--estimates", GOOD, "--ospa-cutoff-m", "inf"], 2, ["--ospa-cutoff-m", "up to 1e+15"]),
    (["evaluate", GOOD, "--estimates", GOOD, "--ospa-order", "inf"], 2, ["--ospa-order", "finite"]),
    (["evaluate", GOOD, "--estimates", GOOD, "--ospa-order", "400"], 2, ["20^400", "too large"]),
    (["convert", "good_bearings.csv", "good_bearings.txt", "-o", "a.csv"], 2, ["one input"]),
    (["convert", "--show"], 2, ["--from or --to"]),
    (["convert", "empty_folder", "--from", "uwb", "-o", "a.csv"], 1, ["empty_folder", "is a folder"]),
    (["convert", "good_bearing.csv", "--from", "uwb", "-o", "a.csv"], 1, ["no such file", "did you mean"]),
    (["convert", "good_bearings.csv", "--from", "sionna", "-o", "a.csv"], 1, ["good_bearings.csv"]),
    (["reproduce", "song-fig5", "--page", "p.md"], 2, ["--page needs -o FOLDER"]),
    (["reproduce", "song-fig5", "--quick", "-o", "good_bearings.csv"], 1, ["good_bearings.csv", "folder"]),
    (["simulate", "ring", "--sweep", "sensors=[3]"], 2, ["'sensors'", "an int"]),
    (["localize", "good_bearings.csv", "--add", "gdop,speed"], 2, ["--add", "speed"]),
    (["localize", "good_bearings.csv", "--carry", "status"], 2, ["'status'", "of their own"]),
    (["schema", "estimate"], 2, ["'estimate'", "did you mean 'estimates'"]),
    (["schema", "--write", "good_bearings.csv"], 1, ["good_bearings.csv"]),
    (["methods", "show", "mll"], 2, ["'mll'", "did you mean 'ml'"]),
    (["localise", "good_bearings.csv"], 2, ["localise", "ocalize"]),
    (["localize", "good_bearings.csv", "--overwite"], 2, ["--overwite", "--overwrite"]),
]


@pytest.mark.extensive
@pytest.mark.parametrize(("words", "code", "message"), FAULTS, ids=lambda value: str(value)[:70])
def test_usage_errors_are_one_line(cli: Cli, tmp_path: Path, words: list[Any], code: int, message: list[str]) -> None:
    """The exit code, one line, fault and cure; nothing is written, nor printed on stdout."""
    for name in ("good_bearings.csv", "good_bearings.scene.toml"):
        (tmp_path / name).write_bytes((FIXTURES / name).read_bytes())
    (tmp_path / "good_bearings.txt").write_text("snapshot")
    header = "snapshot,sensor,sensor_x_m,sensor_y_m,bearing_rad"
    (tmp_path / "no_std.csv").write_text(plain_csv([row[:5] for row in crossing_rows(1)], header))
    (tmp_path / "empty_folder").mkdir()
    (tmp_path / "folder.csv").mkdir()
    before = listing(tmp_path)
    outcome = cli(*words)
    assert outcome.code == code, outcome.err
    assert outcome.err.startswith("nlosctl: ")
    assert len(outcome.err.splitlines()) == 1
    assert "internal error" not in outcome.err
    assert [word for word in message if word not in outcome.err] == []
    assert (outcome.out, listing(tmp_path)) == (b"", before)


def test_unexpected_exceptions_are_one_line(cli: Cli, monkeypatch: pytest.MonkeyPatch) -> None:
    """An unexpected exception is one line with its name and ``--debug``."""

    def broken(*_: Any, **__: Any) -> None:
        raise ZeroDivisionError("division by zero")

    monkeypatch.setattr(os, "fsync", broken)
    outcome = cli("localize", GOOD, "-o", "e.csv")
    assert outcome.code == 1
    assert len(outcome.err.splitlines()) == 1
    assert "ZeroDivisionError: division by zero" in outcome.err
    assert "--debug" in outcome.err
    with pytest.raises(ZeroDivisionError):
        cli("localize", GOOD, "-o", "e.csv", "--debug")


def test_debug_raises(cli: Cli) -> None:
    """With ``--debug`` the error itself is raised."""
    with pytest.raises(DataError, match="no such file"):
        cli("localize", "absent.csv", "--debug")


@pytest.mark.process
def test_debug_gives_a_traceback(tmp_path: Path) -> None:
    """``--debug`` ends in a traceback on stderr and exit 1."""
    outcome = process("localize", "absent.csv", "--debug", cwd=tmp_path)
    assert outcome.code == 1
    assert outcome.err.startswith("Traceback (most recent call last):")
    assert "DataError: absent.csv" in outcome.err


def test_malformed_results_are_reported(cli: Cli, tmp_path: Path) -> None:
    """``evaluate`` names file, row and column of an unreadable cell, and an unknown status."""
    cli("localize", GOOD, "--scene", SCENE, "-o", "e.csv", "-q")
    text = (tmp_path / "e.csv").read_text()
    (tmp_path / "a.csv").write_text(text.replace(",ok,", ",okay,"))
    (tmp_path / "b.csv").write_text(text.replace("0,ml,0,0,", "0,ml,0,0,west", 1))
    unknown, unreadable = cli("evaluate", "a.csv"), cli("evaluate", "b.csv")
    assert (unknown.code, unreadable.code) == (1, 1)
    assert "a.csv" in unknown.err
    assert "'okay'" in unknown.err
    assert "b.csv, row 1, column 'x_m'" in unreadable.err
    assert len(unknown.err.splitlines()) == len(unreadable.err.splitlines()) == 1
