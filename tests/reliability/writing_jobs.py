"""Commands that write files: the arguments of a run that takes a moment, and its outputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet
import typer.main

from nlosctl.cli.main import app
from nlosctl.cli.main import run as run_program

__all__ = ["FIXTURES", "WritingJob", "make_inputs", "resumed_jobs", "writing_jobs"]

FIXTURES = Path(__file__).parents[2] / "fixtures"


@dataclass(frozen=True, kw_only=True)
class WritingJob:
    """A run of the program in a folder made by `make_inputs`; ``outputs`` are the files that it writes.

    ``code`` is its exit code. With a ``folder`` its outputs are all files in it, and a stopped run is resumed with
    ``resume_arguments`` instead of ``--overwrite``.
    """

    command: str
    words: Sequence[str]
    outputs: Sequence[str] = ()
    code: int = 0
    folder: str | None = None
    resume_arguments: Sequence[str] = ()

    @property
    def line(self) -> list[str]:
        """The arguments of the command line."""
        return [self.command, *self.words]


_JOBS = [
    WritingJob(
        command="localize",
        words=["bearings.parquet", "-m", "mixture-ml", "-o", "e.parquet", "--flags-out", "f.csv.gz", "--jobs", "1"],
        outputs=["e.parquet", "f.csv.gz"],
    ),
    WritingJob(
        command="detect-ip",
        words=["triplets.parquet", "-m", "joint", "-o", "f.arrow", "--estimates-out", "e.jsonl", "--jobs", "2"],
        outputs=["f.arrow", "e.jsonl"],
    ),
    WritingJob(
        command="identify-los",
        words=["echoes.parquet", "-o", "f.csv", "--estimates-out", "e.parquet"],
        outputs=["f.csv", "e.parquet"],
    ),
    WritingJob(
        command="simulate",
        words=["ring", "-n", "40000", "-o", "m.csv", "--scene-out", "m.scene.toml"],
        outputs=["m.csv", "m.scene.toml"],
    ),
    WritingJob(command="bound", words=["bearings.parquet", "-o", "b.parquet"], outputs=["b.parquet"]),
    WritingJob(command="posterior", words=["bearings.parquet", "--all", "-o", "p.parquet"], outputs=["p.parquet"]),
    WritingJob(command="report", words=["bearings.parquet", "triplets.parquet", "-o", "r.html"], outputs=["r.html"]),
    WritingJob(command="validate", words=["corrupted.csv", "--bad-rows", "bad.csv"], outputs=["bad.csv"], code=1),
    WritingJob(command="convert", words=["bearings.parquet", "-o", "c.jsonl.gz"], outputs=["c.jsonl.gz"]),
]


_RESUMED = [
    WritingJob(
        command="localize",
        words=["bearing_parts", "-o", "out/e/", "--flags-out", "out/f/", "--format", "csv", "--jobs", "2"],
        folder="out",
        resume_arguments=["--resume"],
    ),
    WritingJob(
        command="detect-ip",
        words=["triplet_parts", "-o", "out/f/", "--estimates-out", "out/e/", "--jobs", "1"],
        folder="out",
        resume_arguments=["--resume"],
    ),
    WritingJob(
        command="identify-los",
        words=["echo_parts", "-o", "out/f/", "--estimates-out", "out/e/", "--jobs", "1"],
        folder="out",
        resume_arguments=["--resume"],
    ),
    WritingJob(command="reproduce", words=["song-fig8", "--trials", "20", "-o", "out"], folder="out"),
]
_PARTS = {
    "bearing_parts": ("bearings.parquet", 500),
    "triplet_parts": ("triplets.parquet", 50),
    "echo_parts": ("echoes.parquet", 12),
}
"""Folders of parts, the file that each is cut from, and the snapshots in a part."""


def writing_jobs() -> list[WritingJob]:
    """Return the jobs of all commands."""
    return [job for job in _JOBS if job.command in _commands()]


def resumed_jobs() -> list[WritingJob]:
    """Return the jobs that can be resumed."""
    return [job for job in _RESUMED if job.command in _commands()]


def _commands() -> Sequence[str]:
    return list(typer.main.get_command(app).commands)  # type: ignore[attr-defined]


@cache
def _inputs() -> tuple[tuple[str, ...], ...]:
    return (
        ("simulate", "ring", "-n", "3000", "-o", "bearings.parquet"),
        ("simulate", "room", "-n", "300", "-o", "triplets.parquet"),
        ("simulate", "echo-field", "-n", "60", "-o", "echoes.parquet"),
        ("simulate", "ring", "-n", "2000", "-o", "corrupted.csv"),
    )


def make_inputs(folder: Path) -> None:
    """Write the inputs of all jobs into ``folder``, the current one."""
    for words in _inputs():
        assert run_program([*words, "-q"]) == 0
    for name, (source, snapshots) in _PARTS.items():
        _cut_up(folder / source, folder / name, snapshots)
    corrupted = folder / "corrupted.csv"
    lines = corrupted.read_text(encoding="utf-8").splitlines()
    lines[20:] = [line.replace(",", ";") for line in lines[20:]]
    corrupted.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _cut_up(source: Path, parts: Path, snapshots: int) -> None:
    table = pa.parquet.read_table(source)
    numbers = table.column("snapshot").to_numpy() // snapshots
    parts.mkdir()
    for number in range(int(numbers.max()) + 1):
        pa.parquet.write_table(table.filter(pa.array(numbers == number)), parts / f"{number}.parquet")
