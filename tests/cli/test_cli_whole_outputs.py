"""Convention 4: outputs are complete or absent, and nothing is overwritten by default."""

from __future__ import annotations

import errno
import gc
import os
import stat
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from cli_support import GOOD, PROGRAM, SCENE, Outcome, crossing_rows, listing, plain_csv, plain_environment
from plugins import ActInCall

from nlosctl.errors import MethodError

pytestmark = pytest.mark.extensive

Cli = Callable[..., Outcome]
OUTPUTS = ["-o", "e.parquet", "--flags-out", "f.csv", "--bad-rows", "b.csv"]


def raising(error: BaseException) -> Callable[[], None]:
    """Return a function that raises a copy of an error: its traceback and the objects it refers to are not kept."""

    def fail() -> None:
        raise type(error)(*error.args)

    return fail


@pytest.mark.process
@pytest.mark.usefixtures("small_chunks")
@pytest.mark.parametrize("jobs", [1, 3])
@pytest.mark.parametrize(
    ("error", "code"),
    [
        (KeyboardInterrupt(), 130),
        (RuntimeError("out of luck"), 1),
        (MethodError("method 'ml' failed"), 1),
        (OSError(errno.ENOSPC, "No space left on device"), 1),
        (MemoryError(), 1),
    ],
    ids=lambda value: type(value).__name__,
)
def test_a_failure_in_a_run_leaves_nothing(
    cli: Cli, tmp_path: Path, acting_method: ActInCall, error: BaseException, code: int, jobs: int
) -> None:
    """After an exception between two chunks there is neither an output nor a temporary file."""
    acting_method(3, raising(error))
    outcome = cli("localize", GOOD, "-m", "acting", *OUTPUTS, "--jobs", jobs)
    assert outcome.code == code
    assert outcome.out == b""
    assert listing(tmp_path) == []


def test_an_interrupted_run_prints_one_line(cli: Cli, acting_method: ActInCall) -> None:
    """Exit 130 prints one line."""
    acting_method(0, raising(KeyboardInterrupt()))
    outcome = cli("localize", GOOD, "-m", "acting", "-o", "e.csv")
    assert outcome.code == 130
    assert outcome.err.strip() == "nlosctl: interrupted; no partial output remains"


@pytest.mark.usefixtures("small_chunks")
@pytest.mark.parametrize("extension", ["parquet", "arrow", "csv.gz", "jsonl.gz"])
def test_a_failure_after_rows_are_written_is_quiet(
    cli: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, acting_method: ActInCall, extension: str
) -> None:
    """An abandoned partial output prints no ``Exception ignored in ...`` on stderr."""
    noise: list[Any] = []
    monkeypatch.setattr(sys, "unraisablehook", noise.append)
    gc.collect()
    noise.clear()  # what other tests have left behind
    monkeypatch.setenv("NLOSCTL_GROUP_ROWS", "5")
    acting_method(4, raising(KeyboardInterrupt()))
    outputs = ["-o", f"e.{extension}", "--flags-out", f"f.{extension}"]
    assert cli("localize", GOOD, "-m", "acting", *outputs, "--jobs", 1).code == 130
    gc.collect()
    assert [str(item.exc_value) for item in noise] == []
    assert listing(tmp_path) == []


@pytest.mark.process
@pytest.mark.usefixtures("small_chunks")
def test_a_failure_keeps_existing_outputs(cli: Cli, tmp_path: Path, acting_method: ActInCall) -> None:
    """With ``--overwrite`` the old file stays until the new one is complete."""
    (tmp_path / "e.parquet").write_text("old")
    (tmp_path / "f.csv").write_text("old")
    acting_method(2, raising(RuntimeError("out of luck")))
    assert cli("localize", GOOD, "-m", "acting", *OUTPUTS, "--overwrite").code == 1
    assert listing(tmp_path) == ["e.parquet", "f.csv"]
    assert (tmp_path / "e.parquet").read_text() == (tmp_path / "f.csv").read_text() == "old"


@pytest.mark.process
@pytest.mark.usefixtures("small_chunks")
def test_a_bad_row_near_the_end_leaves_nothing(cli: Cli, tmp_path: Path) -> None:
    """A bad row of the last chunk stops the whole output."""
    rows = [row for index in range(100) for row in crossing_rows(index)]
    (tmp_path / "m.csv").write_text(plain_csv([*rows, (100, "s0", 0, 0, 1.0, -1.0)]))
    outcome = cli("localize", "m.csv", "-o", "e.csv", "--flags-out", "f.csv")
    assert outcome.code == 1
    assert "row 301" in outcome.err
    assert listing(tmp_path) == ["m.csv"]


def test_a_full_disk_is_one_line_that_names_the_file(cli: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A full disk exits 1 with the name of the file, and leaves nothing."""

    def full(*_: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    outcome = cli("localize", GOOD, "-o", "e.csv")
    assert outcome.code == 1
    assert listing(tmp_path) == []
    assert outcome.err == "nlosctl: e.csv: can't be written: No space left on device\n"


@pytest.mark.process
def test_a_full_stdout(tmp_path: Path) -> None:
    """A full stdout exits 1 with one line."""
    with Path("/dev/full").open("wb") as full:
        done = subprocess.run(
            [str(PROGRAM), "localize", str(GOOD), "-q"],
            stdout=full,
            stderr=subprocess.PIPE,
            cwd=tmp_path,
            env=plain_environment(),
            check=False,
        )
    assert done.returncode == 1
    assert len(done.stderr.decode().strip().splitlines()) == 1
    assert b"No space left" in done.stderr


WRITING: list[tuple[list[Any], str]] = [
    (["localize", GOOD, "-o", "x.csv"], "x.csv"),
    (["localize", GOOD, "-o", "y.csv", "--flags-out", "x.csv"], "x.csv"),
    (["localize", GOOD, "-o", "y.csv", "--bad-rows", "x.csv"], "x.csv"),
    (["localize", GOOD, "-o", "y.csv", "--report", "x.json"], "x.json"),
    (["validate", GOOD, "--bad-rows", "x.csv"], "x.csv"),
    (["simulate", "ring", "-n", "2", "-o", "x.csv"], "x.csv"),
    (["simulate", "ring", "-n", "2", "-o", "y.csv", "--scene-out", "x.toml"], "x.toml"),
    (["simulate", "ring", "-n", "2", "-o", "x.csv", "--scene-out", "y.toml"], "x.csv"),
]


@pytest.mark.parametrize(("words", "name"), WRITING, ids=lambda value: " ".join(map(str, value)).split("bearings")[-1])
def test_an_existing_output_is_kept(cli: Cli, tmp_path: Path, words: list[Any], name: str) -> None:
    """An existing output exits 1, stays unchanged, and no other output of the run appears."""
    (tmp_path / name).write_text("precious")
    outcome = cli(*words)
    assert outcome.code == 1
    assert name in outcome.err
    assert "--overwrite" in outcome.err
    assert (tmp_path / name).read_text() == "precious"
    assert listing(tmp_path) == [name]


@pytest.mark.parametrize(("words", "name"), WRITING, ids=lambda value: " ".join(map(str, value)).split("bearings")[-1])
def test_overwrite_replaces(cli: Cli, tmp_path: Path, words: list[Any], name: str) -> None:
    """``--overwrite`` replaces any output that exists."""
    (tmp_path / name).write_text("precious")
    outcome = cli(*words, "--overwrite")
    assert outcome.code == 0, outcome.err
    assert (tmp_path / name).read_text() != "precious"


@pytest.mark.parametrize("option", ["-o", "--flags-out", "--bad-rows", "--report"])
def test_the_input_is_never_overwritten(cli: Cli, tmp_path: Path, option: str) -> None:
    """No output takes the name of an input, ``--overwrite`` or not."""
    content = plain_csv(crossing_rows(1))
    (tmp_path / "m.csv").write_text(content)
    others = [] if option == "-o" else ["-o", "e.csv"]
    outcome = cli("localize", "m.csv", *others, option, "m.csv", "--overwrite")
    assert (tmp_path / "m.csv").read_text() == content
    assert outcome.code != 0
    assert listing(tmp_path) == ["m.csv"]


@pytest.mark.parametrize(
    "words",
    [
        ["localize", GOOD, "-o", "x.csv", "--flags-out", "x.csv"],
        ["localize", GOOD, "-o", "x.csv", "--flags-out", "./x.csv"],
        ["localize", GOOD, "-o", "x.csv", "--bad-rows", "x.csv"],
        ["localize", GOOD, "-o", "x.csv", "--report", "x.csv"],
        ["simulate", "ring", "-o", "x.csv", "--scene-out", "x.csv"],
    ],
    ids=lambda words: " ".join(map(str, words[2:])),
)
def test_two_outputs_of_one_name_are_refused(cli: Cli, tmp_path: Path, words: list[Any]) -> None:
    """Two outputs with one name are refused, in any spelling of the path."""
    outcome = cli(*words)
    assert outcome.code == 2
    assert listing(tmp_path) == []


def test_devices_are_not_replaced(cli: Cli, tmp_path: Path) -> None:
    """``--overwrite`` replaces files only; a pipe or device (``-o /dev/null``) stays."""
    os.mkfifo(tmp_path / "pipe")
    reader = os.open(tmp_path / "pipe", os.O_RDONLY | os.O_NONBLOCK)
    try:
        cli("localize", GOOD, "-o", "pipe", "--format", "csv", "--overwrite")
        assert stat.S_ISFIFO((tmp_path / "pipe").stat().st_mode)
    finally:
        os.close(reader)


def test_outputs_have_default_permissions(cli: Cli, tmp_path: Path) -> None:
    """The permissions of the temporary file do not remain on the output."""
    (tmp_path / "plain").write_text("")
    assert cli("localize", GOOD, "--scene", SCENE, "-o", "e.csv").code == 0
    assert (tmp_path / "e.csv").stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_overwriting_keeps_the_mode(cli: Cli, tmp_path: Path) -> None:
    """A result that only its owner may read stays so."""
    (tmp_path / "e.csv").write_text("old")
    (tmp_path / "e.csv").chmod(0o600)
    assert cli("localize", GOOD, "-q", "-o", "e.csv", "--overwrite").code == 0
    assert stat.S_IMODE((tmp_path / "e.csv").stat().st_mode) == 0o600
