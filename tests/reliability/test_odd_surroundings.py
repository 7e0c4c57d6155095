"""Unusual file names and system settings: one clear line, or the correct result."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from guarded_run import complaints, message_complaints, run_guarded
from writing_jobs import FIXTURES

pytestmark = pytest.mark.process

PROGRAM = Path(sys.executable).with_name("nlosctl")
GOOD = FIXTURES / "good_bearings.parquet"


def run_with(folder: Path, words: list[str], **variables: str) -> subprocess.CompletedProcess[bytes]:
    """Run the program in a separate process with changed environment variables."""
    environment = {**os.environ, **variables}
    line = [str(PROGRAM), *words]
    return subprocess.run(line, capture_output=True, cwd=folder, env=environment, check=False, timeout=120)


@pytest.mark.parametrize("option", ["input", "-o", "--flags-out", "--bad-rows", "--report", "--scene", "--config"])
@pytest.mark.parametrize("name", ["", "a\0b.csv"])
def test_invalid_file_names(name: str, option: str, folder: Path) -> None:
    """An empty name, and one with a zero byte from a setting, give one line in any position."""
    words = ["localize", GOOD, "-q", option, name] if option != "input" else ["localize", name, "-q"]
    ending = run_guarded(words)
    assert list(complaints(ending, folder, [], [])) == []
    assert ending.code in (1, 2)


@pytest.mark.parametrize("option", ["input", "-o", "--flags-out", "--bad-rows", "--report"])
def test_symbolic_links_in_a_circle(option: str, folder: Path) -> None:
    """A symbolic link to itself can't be written, or does not exist."""
    (folder / "loop.csv").symlink_to("loop.csv")
    words = ["localize", GOOD, "-q", option, "loop.csv"] if option != "input" else ["localize", "loop.csv", "-q"]
    ending = run_guarded([*words, "--overwrite"])
    assert list(complaints(ending, folder, [], ["loop.csv"])) == []
    assert ending.code == 1


@pytest.mark.parametrize("extension", ["parquet", "csv", "arrow", "jsonl"])
@pytest.mark.parametrize("way", ["file", "folder", "pattern", "importer"])
def test_input_names_that_are_not_utf8(extension: str, way: str, folder: Path) -> None:
    """Results record input names in UTF-8: other names are reported as such, not as damaged files."""
    name = os.fsdecode(b"m\xff.") + extension
    (folder / "in").mkdir()
    shutil.copy(FIXTURES / f"good_bearings.{extension}", folder / "in" / name)
    word = {"file": f"in/{name}", "folder": "in", "pattern": "in/*", "importer": f"in/{name}"}[way]
    words = ["convert", "--from", "uwb", word] if way == "importer" else ["localize", word]
    ending = run_guarded([*words, "-q", "-o", "e.parquet"])
    assert list(complaints(ending, folder, [], ["in"])) == []
    assert ending.code == 1
    assert "the name is not UTF-8" in ending.err


def test_output_names_that_are_not_utf8(folder: Path) -> None:
    """An output may have any name that the system accepts."""
    name = os.fsdecode(b"m\xff.csv")
    assert run_guarded(["simulate", "ring", "-n", 2, "-o", name, "-q"]).code == 0
    assert [path.name for path in folder.iterdir()] == [name]


def test_ascii_terminals(folder: Path) -> None:
    """On a terminal that accepts only ASCII the help is printed."""
    done = run_with(folder, ["localize", "--help"], PYTHONIOENCODING="ascii", LC_ALL="C")
    assert (done.returncode, done.stderr) == (0, b"")
    assert done.stdout.isascii()
    assert b"--flags-out" in done.stdout


@pytest.mark.parametrize(
    ("variable", "value"), [("MPLBACKEND", "nonsense"), ("MATPLOTLIBRC", "corrupted"), ("NLOSCTL_MAX_MEMORY_MB", "1")]
)
def test_invalid_settings_of_libraries(variable: str, value: str, folder: Path) -> None:
    """Settings with which matplotlib can't start, or libraries don't fit in memory, give one line."""
    (folder / "corrupted").write_bytes(b"\xff\xfe backend: \x00")
    done = run_with(folder, ["plot", str(GOOD), "-o", "p.svg", "-q"], **{variable: value})
    err = done.stderr.decode()
    assert done.returncode in (1, 2)
    assert list(message_complaints(err[err.index("nlosctl: ") :], quiet_end=False)) == []
    assert not (folder / "p.svg").exists()


@pytest.mark.parametrize("megabytes", [1, 150, 256, 511])
def test_too_small_memory_limits(megabytes: int, folder: Path) -> None:
    """A memory limit below that of the libraries is refused; OpenBLAS would try to load forever."""
    done = run_with(folder, ["localize", str(GOOD)], NLOSCTL_MAX_MEMORY_MB=str(megabytes))
    assert done.returncode == 2
    assert done.stderr.startswith(b"nlosctl: NLOSCTL_MAX_MEMORY_MB must be 0 (no limit) or at least 512")
    assert done.stderr.count(b"\n") == 1


def test_libraries_that_can_not_be_loaded(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A library that does not fit into memory, or is damaged, gives a line of bounded length."""
    monkeypatch.setitem(sys.modules, "nlosctl.jobs.solve", None)
    ending = run_guarded(["localize", GOOD, "-q", "-o", "e.csv"])
    assert list(complaints(ending, folder, [], [])) == []
    assert (ending.code, ending.err[:44]) == (1, "nlosctl: a library cannot be loaded, perhaps")
