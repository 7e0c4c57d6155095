"""``nlosctl calibrate``: outputs, the same bytes however the input is read, messages."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
import pytest
from calibration_worlds import joined, session
from cli_support import Outcome
from program import run_here

from nlosctl.contract.limits import size_variable

Cli = Callable[..., Outcome]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with two sessions in ``m.parquet``, ``m.csv``, and in ``in/``: parts that cut snapshots."""
    folder = tmp_path_factory.mktemp("calibrate")
    tables = []
    for number, name in enumerate(("a", "b")):
        table, _ = session("ranges", 40, seed=number, first=100 * number, outliers=0.05)
        tables.append({**table, "session": [name] * len(table["snapshot"])})
    table = pa.table(joined(*tables)).drop_columns(["truth_x_m", "truth_y_m"])
    pyarrow.parquet.write_table(table, folder / "m.parquet")
    pyarrow.csv.write_csv(table, folder / "m.csv")
    (folder / "in").mkdir()
    for number, (first, behind) in enumerate(pairwise([0, 131, 250, table.num_rows])):
        pyarrow.parquet.write_table(table.slice(first, behind - first), folder / "in" / f"p{number}.parquet")
    return folder


def calibrated(folder: Path, *words: str, stdin: bytes = b"") -> bytes:
    """Return the calibration of a run as TOML."""
    done = run_here("calibrate", "-m", "mixture-ml", "--by", "session", "-q", *words, folder=folder, stdin=stdin)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_bytes_do_not_depend_on_how_the_input_is_read(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Formats, jobs, block sizes, chunk and slice sizes, parts and standard input give the same bytes."""
    expected = calibrated(folder, "m.parquet")
    assert b"[covariance]" in expected
    assert calibrated(folder, "m.csv") == expected
    assert calibrated(folder, "in/") == expected
    for words in (["--jobs", "1"], ["--jobs", "2"], ["--block-size", "7"]):
        assert calibrated(folder, "m.parquet", *words) == expected
    assert calibrated(folder, "-", stdin=(folder / "m.parquet").read_bytes()) == expected
    for name, size in (("chunk_rows", "50"), ("slice_rows", "40")):
        monkeypatch.setenv(size_variable(name), size)
    assert calibrated(folder, "m.parquet", "--jobs", "2") == expected


def test_many_snapshots_begin_with_a_few(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Passes over a part of the snapshots first end at the same offsets, and at the same bytes for any jobs."""
    import nlosctl.pipeline.calibrate.offset_passes as offset_passes

    whole = tomllib.loads(calibrated(folder, "m.parquet").decode())
    monkeypatch.setattr(offset_passes, "_FEW", 20)
    expected = calibrated(folder, "m.parquet", "--jobs", "1")
    assert calibrated(folder, "m.csv", "--jobs", "2", "--block-size", "5") == expected
    quick = tomllib.loads(expected.decode())
    assert quick["calibration"]["snapshots"] == whole["calibration"]["snapshots"] == 80
    for entry, other in zip(quick["sensor"], whole["sensor"], strict=True):
        assert entry["range_offset_m"] == pytest.approx(other["range_offset_m"], abs=0.05 * other["range_offset_std_m"])


def test_the_file_and_the_table(folder: Path, cli: Cli) -> None:
    """The file has an entry per sensor and session, and the covariance; the table the same numbers, a row each."""
    table = folder / "m.parquet"
    outcome = cli(
        "calibrate", table, "--by", "session", "-o", "c.toml", "--table-out", "c.parquet", "--report", "r.json"
    )
    assert (outcome.code, outcome.out) == (0, b"")
    assert outcome.err.startswith(f"{table}: 80 snapshots of ranges, 320 rows\nml: offsets by 80 snapshots at ")
    tree = tomllib.loads(Path("c.toml").read_text())
    rows = pyarrow.parquet.read_table("c.parquet").to_pylist()
    assert rows == tree["sensor"]
    assert list(rows[0]) == ["name", "session", "range_offset_m", "range_offset_std_m", "std_scale", "std_dof"]
    assert tree["covariance"]["order"] == [[row["name"], row["session"]] for row in rows]
    variances = [row[index] for index, row in enumerate(tree["covariance"]["matrix"])]
    assert variances == pytest.approx([row["range_offset_std_m"] ** 2 for row in rows])
    report = json.loads(Path("r.json").read_text())
    assert report["snapshots_used"] == 80
    assert [entry["offset"] for entry in report["sensors"]] == [row["range_offset_m"] for row in rows]
    assert cli("calibrate", table, "-o", "c.toml").code == 1
    assert cli("calibrate", table, "-o", "c.toml", "--overwrite").code == 0
    assert cli("calibrate", table, "-o", "x.toml", "--table-out", "x.toml").code == 2
    assert not Path("x.toml").exists()


def test_headings_are_in_degrees(cli: Cli) -> None:
    """Offsets of bearings have their own names, in degrees; the covariance too."""
    table, given = session("bearings", 40, seed=3, offsets=[0.05, 0, 0, 0, 0, -0.05])
    pyarrow.csv.write_csv(pa.table(table), "b.csv")
    assert cli("calibrate", "b.csv", "-q", "-o", "c.toml").code == 0
    tree = tomllib.loads(Path("c.toml").read_text())
    assert list(tree["sensor"][0]) == ["name", "heading_offset_deg", "heading_std_deg", "std_scale", "std_dof"]
    for entry, offset in zip(tree["sensor"], given, strict=True):
        assert abs(entry["heading_offset_deg"] - 57.29578 * offset) < 4.0 * entry["heading_std_deg"] < 1.5
    assert tree["covariance"]["matrix"][0][0] == pytest.approx(tree["sensor"][0]["heading_std_deg"] ** 2)


def test_known_positions(folder: Path, cli: Cli) -> None:
    """A table of truth, or the input's own columns; unused truth columns are mentioned, and what is not there."""
    table, _ = session("ranges", 30, seed=5)
    pyarrow.csv.write_csv(pa.table(table), "m.csv")
    assert (
        "truth_x_m and truth_y_m are not used: --truth columns takes them" in cli("calibrate", "m.csv", "-o", "0").err
    )
    by_columns = cli("calibrate", "m.csv", "--truth", "columns", "-q")
    assert by_columns.out == cli("calibrate", "m.csv", "--truth", "m.csv", "-q").out
    assert b'known_positions = "yes"' in by_columns.out
    assert cli("calibrate", folder / "m.parquet", "--truth", "columns").err == (
        "nlosctl: --truth columns: the input has no column 'truth_x_m'; give a table of true positions\n"
    )
    Path("other.csv").write_text("snapshot,truth_x_m,truth_y_m\n7,1,2\n")
    assert (
        "29 of 30 snapshots have no true position: they are left out"
        in cli("calibrate", "m.csv", "--truth", "other.csv", "-o", "1").err
    )


def test_nothing_to_determine_exits_0(cli: Cli) -> None:
    """Two rows a snapshot: all offsets are 0, which standard error states, and the file names the sensors."""
    table, _ = session("ranges", 20, seed=8, sensors=[[0, 0], [30, 0]])
    pyarrow.csv.write_csv(pa.table(table), "two.csv")
    outcome = cli("calibrate", "two.csv")
    assert outcome.code == 0
    assert "note: no snapshot has a position with rows to spare: all offsets are 0" in outcome.err
    tree = tomllib.loads(outcome.text)
    assert tree["calibration"]["not_determined"] == [["s0"], ["s1"]]
    assert [entry["range_offset_m"] for entry in tree["sensor"]] == [0.0, 0.0]
    assert "covariance" not in tree


def test_bad_rows_stop_or_are_set_aside(cli: Cli) -> None:
    """A bad row is an error that names it; with --bad-rows the others calibrate, and the row is in the file."""
    table, _ = session("ranges", 20, seed=8)
    table["range_m"][5] = float("nan")
    pyarrow.csv.write_csv(pa.table(table), "m.csv")
    outcome = cli("calibrate", "m.csv", "-o", "c.toml")
    assert outcome.code == 1
    assert "row 6" in outcome.err
    assert not Path("c.toml").exists()
    outcome = cli("calibrate", "m.csv", "-o", "c.toml", "--bad-rows", "bad.csv")
    assert outcome.code == 0
    assert "79 rows, 1 bad row set aside" in outcome.err
    assert len(Path("bad.csv").read_text().splitlines()) == 2


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["--by", "sesion"], 1, "--by sesion: no column 'sesion' (did you mean 'session'?)"),
        (["--offset-prior-deg", "1"], 2, "--offset-prior-deg is not for ranges; set --offset-prior-m"),
        (["-m", "sr-ls"], 2, "sr-ls can't calibrate ranges; ml and mixture-ml can"),
        (["-m", "ml", "-m", "mixture-ml"], 2, "--method: a calibration is made by one method. Got 2."),
        (["-m", "mixture-ml", "-p", "alpha=estimate"], 2, "alpha=estimate: set a number to calibrate with"),
        (["--engine", "dusk"], 2, "no engine 'dusk'"),
    ],
)
def test_errors_are_one_line(folder: Path, cli: Cli, words: list[str], code: int, message: str) -> None:
    """Each names the setting and the cure; nothing is written."""
    outcome = cli("calibrate", folder / "m.parquet", "-o", "c.toml", *words)
    assert outcome.code == code
    assert message in outcome.err
    assert outcome.err.count("\n") == 1
    assert not Path("c.toml").exists()


def test_each_pass_has_a_line_with_verbose(folder: Path, cli: Cli) -> None:
    """The steps get smaller; the last is below the tolerance."""
    lines = cli("calibrate", folder / "m.parquet", "-v", "-o", "c.toml").err.splitlines()
    steps = [float(line.split("step ")[1].split()[0]) for line in lines if ": pass " in line]
    assert len(steps) > 2
    assert steps[-1] <= 3e-3 < steps[0]
