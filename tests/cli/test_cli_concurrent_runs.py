"""Several processes and one output name: one writes, and what appears during a run is not replaced."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from cli_support import GOOD, PROGRAM, SCENE, Outcome, listing, plain_environment, process
from plugins import ActInCall

from nlosctl.errors import DataError
from nlosctl.io.parts.run_folder import RunFolder
from nlosctl.io.writers import byte_output
from nlosctl.io.writers.locks import WriterLock
from nlosctl.io.writers.output_set import OutputSet

Cli = Callable[..., Outcome]
INPUTS = tuple(f"in/{number}.parquet" for number in range(4))
RESULTS = [*(f"{number}.parquet" for number in range(4)), "_manifest.json"]
OTHER = "from another program\n"


@contextmanager
def started(*words: Any, folder: Path) -> Iterator[subprocess.Popen[bytes]]:
    """Start the program; it is killed at the end."""
    command = [str(PROGRAM), *map(str, words)]
    with subprocess.Popen(command, cwd=folder, env=plain_environment(), stderr=subprocess.PIPE) as running:
        try:
            yield running
        finally:
            running.kill()


def stopped_when(running: subprocess.Popen[bytes], there: Callable[[], bool]) -> None:
    """Stop a process as soon as it has made a file."""
    deadline = time.monotonic() + 60
    while not there() and running.poll() is None and time.monotonic() < deadline:
        time.sleep(0.002)
    running.send_signal(signal.SIGSTOP)
    assert there()
    assert running.poll() is None


@pytest.fixture
def parts(tmp_path: Path) -> Path:
    """The current folder with some parts of measurements."""
    assert process("simulate", "ring", "-n", 8_000, "-q", "-o", "m.parquet", cwd=tmp_path).code == 0
    (tmp_path / "in").mkdir()
    for number in range(4):
        os.link(tmp_path / "m.parquet", tmp_path / "in" / f"{number}.parquet")
    return tmp_path


@pytest.mark.process
def test_a_second_run_into_a_folder_is_refused(parts: Path) -> None:
    """While a run writes into a folder, others end with one line that names it, and the first completes."""
    words = ("localize", *INPUTS, "-q", "-o", "out/")
    with started(*words, "--flags-out", "flags/", folder=parts) as first:
        stopped_when(first, lambda: bool([*parts.glob("out/.*.part"), *parts.glob("out/*.parquet")]))
        others = [process(*words, option, cwd=parts) for option in ("--resume", "--overwrite", "-q")]
        elsewhere = process("localize", "in/0.parquet", "-q", "-o", "new/", "--flags-out", "flags/", cwd=parts)
        first.send_signal(signal.SIGCONT)
        assert first.wait(60) == 0, first.stderr
    by = f"another run writes here (process {first.pid} on {socket.gethostname()})"
    for other in others:
        assert (other.code, other.err.count("\n")) == (1, 1)
        assert other.err.startswith(f"nlosctl: out: {by}"), other.err
    assert (elsewhere.code, elsewhere.err.startswith(f"nlosctl: flags: {by}")) == (1, True), elsewhere.err
    assert not (parts / "new").exists()
    assert listing(parts / "out") == RESULTS


@pytest.mark.process
def test_a_killed_run_releases_its_folder(parts: Path) -> None:
    """After kill -9 the same command with ``--resume`` completes the run at once."""
    words = ("localize", *INPUTS, "-q", "-o", "out/", "--jobs", "2")
    with started(*words, folder=parts) as first:
        stopped_when(first, lambda: bool([*parts.glob("out/.*.part"), *parts.glob("out/*.parquet")]))
        first.kill()
        first.wait()
    assert (parts / "out" / "_lock").exists()
    again = process(*words, "--resume", cwd=parts)
    assert again.code == 0, again.err
    assert listing(parts / "out") == RESULTS


@pytest.mark.process
def test_temporary_files_of_running_processes_stay(parts: Path) -> None:
    """A run into a folder removes the temporary file of an ended process, but not that of a running one."""
    (parts / "out").mkdir()
    with started("simulate", "ring", "-n", 3_000_000, "-q", "-o", "out/0.parquet", folder=parts) as other:
        stopped_when(other, lambda: bool([*parts.glob("out/.0.parquet.*.part")]))
        (foreign,) = parts.glob("out/.0.parquet.*.part")
        left = parts / "out" / ".0.parquet.00000000.part"
        left.touch()
        RunFolder({"estimates": str(parts / "out")}).remove_temporary_files(["0.parquet"])
        assert foreign.exists()
        assert not left.exists()


@pytest.mark.process
def test_of_two_runs_to_one_name_one_fails(tmp_path: Path) -> None:
    """Without ``--overwrite`` the file that was complete first stays, and the later run exits 1."""
    with started("simulate", "ring", "-n", 100_000, "-q", "-o", "m.parquet", folder=tmp_path) as first:
        stopped_when(first, lambda: bool([*tmp_path.glob(".m.parquet.*.part")]))
        second = process("simulate", "ring", "-n", 10, "-q", "-o", "m.parquet", cwd=tmp_path)
        assert second.code == 0, second.err
        before = (tmp_path / "m.parquet").read_bytes()
        first.send_signal(signal.SIGCONT)
        _, message = first.communicate(timeout=60)
    assert first.returncode == 1
    assert message.decode() == (
        "nlosctl: m.parquet: can't be written: a file of this name was made during the run; --overwrite replaces it\n"
    )
    assert (tmp_path / "m.parquet").read_bytes() == before
    assert listing(tmp_path) == ["m.parquet"]


@pytest.mark.parametrize("name", ["e.parquet", "f.csv", "b.csv", "r.json"])
def test_no_output_is_replaced(cli: Cli, tmp_path: Path, acting_method: ActInCall, name: str) -> None:
    """A file made during a run under the name of any output stays, and no other output appears."""
    words = ("localize", GOOD, "-m", "acting", "-q", "-o", "e.parquet", "--flags-out", "f.csv", "--bad-rows", "b.csv")
    words = (*words, "--report", "r.json", "--scene", SCENE)
    acting_method(0, lambda: (tmp_path / name).write_text(OTHER))
    outcome = cli(*words)
    assert (outcome.code, outcome.err.count("\n")) == (1, 1), outcome.err
    assert outcome.err.startswith(f"nlosctl: {name}: can't be written: a file of this name was made during the run")
    assert listing(tmp_path) == [name]
    assert (tmp_path / name).read_text() == OTHER
    (tmp_path / name).unlink()
    acting_method(0, lambda: (tmp_path / name).write_text(OTHER))
    assert cli(*words, "--overwrite").code == 0
    assert (tmp_path / name).read_bytes()[:9] != OTHER.encode()[:9]


def test_no_part_is_replaced(cli: Cli, tmp_path: Path, acting_method: ActInCall) -> None:
    """A file made during a run under the name of a part, or of the manifest, stays."""
    for name in ("good_bearings.parquet", "_manifest.json"):
        acting_method(0, lambda name=name: (tmp_path / "out" / name).write_text(OTHER))
        outcome = cli("localize", GOOD, "--scene", SCENE, "-m", "acting", "-q", "-o", "out/")
        assert outcome.code == 1
        assert "made during the run" in outcome.err
        assert (tmp_path / "out" / name).read_text() == OTHER
        for path in [path for path in (tmp_path / "out").rglob("*") if path.is_file()]:
            path.unlink()
        (tmp_path / "out" / "_unfinished").rmdir()


def test_without_hard_links(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where a file system has no hard links, a new file gets its name and an existing one is kept."""

    def refuse(path: Path, other: Path) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(Path, "hardlink_to", refuse)
    with OutputSet() as outputs:
        outputs.write_text(str(tmp_path / "a.txt"), "a", overwrite=False)
    outputs = OutputSet().__enter__()
    outputs.write_text(str(tmp_path / "b.txt"), "b", overwrite=False)
    (tmp_path / "b.txt").write_text(OTHER)
    with pytest.raises(DataError, match="made during the run"):
        outputs.__exit__(None, None, None)
    assert (tmp_path / "a.txt").read_text() == "a"
    assert (tmp_path / "b.txt").read_text() == OTHER
    assert listing(tmp_path) == ["a.txt", "b.txt"]


def test_without_file_locks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where files cannot be locked, the lock of a running process or of another host holds, an ended one's does not."""
    monkeypatch.setattr(byte_output, "flock", None)
    path = tmp_path / "_lock"
    with (
        WriterLock(path, "out"),
        pytest.raises(DataError, match=f"out: another run writes here .process {os.getpid()} on "),
    ):
        WriterLock(path, "out").__enter__()
    ended = subprocess.Popen(["true"])
    ended.wait()
    path.write_text(json.dumps({"pid": ended.pid, "host": socket.gethostname()}))
    with WriterLock(path, "out"):
        assert json.loads(path.read_text())["pid"] == os.getpid()
    path.write_text(json.dumps({"pid": ended.pid, "host": "elsewhere.example"}))
    with pytest.raises(DataError, match=r"on elsewhere\.example.*remove .*_lock"):
        WriterLock(path, "out").__enter__()
