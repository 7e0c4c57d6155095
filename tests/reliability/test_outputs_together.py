"""All-or-nothing outputs: if the disk can't store one of them, none is written."""

from __future__ import annotations

import errno
import os
import resource
import subprocess
import sys
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest
from guarded_run import complaints, run_guarded

pytestmark = pytest.mark.process

PROGRAM = Path(sys.executable).with_name("nlosctl")
SCENARIOS = {"localize": "ring", "detect-ip": "room", "identify-los": "echo-field", "bound": "ring", "convert": "ring"}
REST = ["--bad-rows", "b.csv", "--report", "r.json"]
RUNS = {
    "localize": ["m.csv", "-o", "e.csv", "--flags-out", "f.parquet", *REST],
    "detect-ip": ["m.csv", "-m", "joint", "-o", "f.csv", "--estimates-out", "e.arrow", *REST],
    "identify-los": ["m.csv", "-o", "f.jsonl", "--estimates-out", "e.csv.gz", *REST],
    "bound": ["m.csv", "-o", "x.csv", *REST],
    "convert": ["m.csv", "-o", "c.parquet", "--scene-out", "s.toml", "--bad-rows", "b.csv"],
    "simulate": ["ring", "-n", "3", "-o", "x.csv", "--scene-out", "s.toml"],
    "evaluate": ["estimates.csv", "-o", "x.csv", "--report", "r.json"],
}
MAP = ["localize", "m.csv", "-o", "e.geojson", "--flags-out", "f.csv", "--bad-rows", "b.csv", "--origin", "60,25"]
LINES = [*([command, *words] for command, words in RUNS.items()), MAP]


def names(folder: Path) -> list[str]:
    """Return the names in a folder, hidden ones too."""
    return sorted(path.name for path in folder.iterdir())


def outputs(line: list[str]) -> list[str]:
    """Return the files that a command line writes."""
    return [word for option, word in pairwise(line) if option.startswith("-") and "." in word]


def prepare(line: list[str], good_lines: int = 40) -> list[str]:
    """Write the inputs of a run, bad rows from ``good_lines`` on, and return the names of the files."""
    if line[0] in SCENARIOS:
        scenario = SCENARIOS[line[0]]
        assert run_guarded(["simulate", scenario, "-n", 30, "-o", "m.csv", "--scene-out", "m.scene.toml"]).code == 0
        lines = Path("m.csv").read_text(encoding="utf-8").splitlines()
        lines[good_lines:] = [",".join("?" * (line.count(",") + 1)) for line in lines[good_lines:]]
        Path("m.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    if line[0] == "evaluate":
        assert run_guarded(["simulate", "ring", "-n", 3, "-o", "t.csv"]).code == 0
        assert run_guarded(["localize", "t.csv", "-o", "estimates.csv"]).code == 0
    return names(Path())


@pytest.mark.parametrize("line", LINES, ids=lambda line: f"{line[0]}-{outputs(line)[0]}")
def test_a_disk_without_room_for_one_output(line: list[str], folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """If one output has no room, one line names it, and there is no output at all."""
    before, sync, full = prepare(line), os.fsync, ""

    def sync_others(number: int) -> None:
        if Path(f"/proc/self/fd/{number}").readlink().name.startswith(f".{full}."):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        sync(number)

    assert list(complaints(run_guarded([*line, "-q"]), folder, outputs(line), before)) == []
    for name in outputs(line):
        (folder / name).unlink()
    monkeypatch.setattr(os, "fsync", sync_others)
    for full in outputs(line):
        ending = run_guarded([*line, "-q"])
        assert list(complaints(ending, folder, [], before)) == []
        assert (ending.code, ending.err) == (1, f"nlosctl: {full}: can't be written: No space left on device\n")


@pytest.fixture
def small_files() -> Iterator[None]:
    """Limit the files of this process to 20,000 bytes."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.usefixtures("small_files")
@pytest.mark.parametrize("command", list(SCENARIOS))
def test_no_room_for_bad_rows(command: str, folder: Path) -> None:
    """If there is no room for bad rows, estimates and flags are not written either."""
    line = [command, *RUNS[command]]
    before = prepare(line)
    with Path("m.csv").open("a", encoding="utf-8") as file:
        file.write("?\n" * 2000)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, resource.getrlimit(resource.RLIMIT_FSIZE)[1]))
    ending = run_guarded([*line, "-q"])
    assert list(complaints(ending, folder, [], before)) == []
    assert (ending.code, ending.err) == (1, "nlosctl: b.csv: can't be written: File too large\n")


@pytest.mark.parametrize("kind", ["csv", "parquet", "arrow"])
@pytest.mark.parametrize("way", ["> /dev/full", "-o /dev/full"])
def test_full_streams_leave_no_other_output(kind: str, way: str, folder: Path) -> None:
    """A full standard output or device leaves no other output either."""
    before = prepare(["localize"])
    script = f"{PROGRAM} localize m.csv --flags-out f.csv --bad-rows b.csv -q --format {kind} {way}"
    done = subprocess.run(["bash", "-c", script], capture_output=True, cwd=folder, check=False, timeout=60)
    assert done.returncode == 1
    assert done.stderr.endswith(b": can't be written: No space left on device\n")
    assert names(folder) == before
