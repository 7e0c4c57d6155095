"""Compare the results of two checkouts of the package: tables, exit codes, standard output, and messages.

    python tests/reliability/compare_checkouts.py OTHER_CHECKOUT [REGEX]

Every fixture, method, format and command runs in both checkouts with this interpreter. A table is compared by its
columns, types and values (Arrow IPC without metadata), any other file by its bytes. Differing messages are listed
separately: a rewording may keep file, row, column, value, expectation and cure. ``REGEX`` selects runs by name. The
exit code is 1 if any result differs. Fixed digests would change with the versions of the libraries, so this
is a program for checking changes that must not alter results, not a test.
"""

from __future__ import annotations

import gzip
import hashlib
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import pyarrow as pa
import pyarrow.ipc
import pyarrow.parquet

ROOT = Path(__file__).parents[2]
ESTIMATES_AND_FLAGS = ["-o", "e.parquet", "--flags-out", "f.parquet"]
BEARINGS = ["ls", "stansfield", "ml", "mixture-ml", "suppress", "sequential", "stansfield-focused", "ml-grid"]
CIRCLES = ["ls", "stansfield", "ml", "stansfield-focused", "mixture-ml", "suppress", "sequential"]
RANGES = ["sr-ls", "r-ls", "ml", "mixture-ml"]
WORLDS = {
    "ring": (100, BEARINGS),
    "random": (60, BEARINGS),
    "song-flat": (100, BEARINGS),
    "song-circle": (60, CIRCLES),
    "mixed": (60, CIRCLES),
    "over-the-horizon": (40, CIRCLES[:4]),
    "madhow-ring": (60, ["ml", "mixture-ml", "suppress", "sequential"]),
    "madhow-walls": (40, ["ml", "mixture-ml", "suppress"]),
    "shen": (200, ["tdaj", "chi2", "joint"]),
    "room": (40, ["tdaj", "chi2", "joint"]),
    "echo-field": (10, ["assignment"]),
    "liang": (10, ["assignment"]),
}
IMPORTS = {
    "kraken-csv": "kraken_app.csv",
    "kraken-xml": "df_aggregator.xml",
    "uudf": "u_connect_locate.log",
    "anchor-azimuths": "anchor_azimuths.csv",
    "wildlife": "bear_bearings.csv",
    "uwb": "uwb_ranges.csv",
    "sionna": "sionna_paths.npz",
}
EXPORTS = {"geojson": "geojson", "kml": "kml", "czml": "czml", "geoparquet": "parquet"}


@dataclass(frozen=True)
class Run:
    """A command to run, and commands that read its outputs afterwards in the same folder."""

    name: str
    words: list[str]
    then: list[list[str]] = field(default_factory=list)


def solving_runs() -> Iterator[Run]:
    """Yield the runs of all methods on fixtures and on simulated worlds."""
    good, precision = "../in/good_", ["--ellipse", "0.9", "--add", "cep50,gdop"]
    maps = [["convert", "e.parquet", "--to", to, "--origin", "52,4", "-o", f"m.{end}"] for to, end in EXPORTS.items()]
    scores = [
        ["evaluate", "e.parquet", "-o", "v.parquet"],
        ["evaluate", "e.parquet", "--json"],
        ["evaluate", "f.parquet"],
    ]
    for method in BEARINGS:
        words = ["localize", "-m", method, f"{good}bearings.parquet", *ESTIMATES_AND_FLAGS, *precision]
        yield Run(
            f"bearings-{method}", [*words, "--alternatives", "3", "--block-size", "7", "--seed", "5"], maps + scores
        )
    for method in RANGES:
        yield Run(f"ranges-{method}", ["localize", "-m", method, f"{good}ranges.csv", *ESTIMATES_AND_FLAGS, *precision])
    for method in CIRCLES:
        yield Run(f"circles-{method}", ["localize", "-m", method, f"{good}over_the_horizon.csv", *ESTIMATES_AND_FLAGS])
    for method in ("tdaj", "chi2", "joint"):
        words = ["detect-ip", "-m", method, f"{good}triplets.parquet", "--details", "-o", "f.parquet"]
        yield Run(f"triplets-{method}", words, [["evaluate", "f.parquet"], ["localize", "f.parquet", "-o", "e.csv"]])
    for method, extra in (("assignment", []), ("extended-tca", []), ("tca", ["-p", "targets=3"])):
        words = ["identify-los", "-m", method, f"{good}echoes.csv", "-o", "f.parquet", "--estimates-out", "e.parquet"]
        yield Run(f"echoes-{method}", [*words, *extra], [["evaluate", "f.parquet", "--estimates", "e.parquet"]])
    for world, (_, methods) in WORLDS.items():
        jobs = {"assignment": "identify-los", "tdaj": "detect-ip", "chi2": "detect-ip", "joint": "detect-ip"}
        for method in methods:
            words = [jobs.get(method, "localize"), "-m", method, f"../in/{world}.parquet", "-o", "r.parquet"]
            yield Run(f"world-{world}-{method}", words)


def file_runs() -> Iterator[Run]:
    """Yield the runs of formats, faults, simulation, bounds and conversion."""
    for ending in ("arrow", "arrows", "csv", "csv.gz", "jsonl", "parquet"):
        words = ["localize", "-m", "stansfield", "-m", "mixture-ml", f"../in/good_bearings.{ending}"]
        yield Run(f"format-{ending}", [*words, "-o", f"e.{ending}", "--flags-out", f"f.{ending}", "--report", "r.json"])
    yield Run(
        "trace", ["localize", "-m", "sequential", "../in/good_bearings.csv", "-o", "e.csv", "--trace-out", "t.csv"]
    )
    both = ["../in/good_bearings.parquet", "../in/good_bearings.csv"]
    yield Run("folder", ["localize", "-m", "ml", *both, "-o", "e/", "--flags-out", "f/"])
    yield Run("two-jobs", ["localize", "-m", "ml", *both, "--jobs", "2", "-o", "e.parquet"])
    for world, (trials, _) in WORLDS.items():
        yield Run(
            f"simulate-{world}", ["simulate", world, "-n", str(min(trials, 20)), "--seed", "3", "-o", "s.parquet"]
        )
    yield Run("bound", ["bound", "../in/good_bearings.parquet", "-o", "b.parquet"])
    yield Run("bound-map", ["bound", "../in/good_ranges.csv", "--map=-500,500,-500,500,100", "-o", "b.csv"])
    for name, file in IMPORTS.items():
        yield Run(f"convert-{name}", ["convert", "--from", name, f"../in/formats/{file}", "-o", "c.csv"])
    for path in sorted((ROOT / "fixtures").glob("bad_*")):
        if not path.name.endswith(".scene.toml"):
            words = ["localize", f"../in/{path.name}", "-o", "e.csv", "--flags-out", "f.csv"]
            yield Run(f"bad-{path.name}", words, [["validate", words[1]], [*words, "--bad-rows", "b.csv"]])


def digest(path: Path) -> str:
    """Return a digest of a table's columns, types and values, or of another file's bytes."""
    if path.name.startswith("_"):
        return "manifest"
    if path.suffix not in (".parquet", ".arrow", ".arrows"):
        content = path.read_bytes()
        return hashlib.sha256(gzip.decompress(content) if path.suffix == ".gz" else content).hexdigest()
    if path.suffix == ".parquet":
        table = pa.parquet.read_table(path)
    else:
        with pa.memory_map(str(path)) as source:
            table = (pa.ipc.open_file if path.suffix == ".arrow" else pa.ipc.open_stream)(source).read_all()
    schema = pa.schema([column.remove_metadata() for column in table.schema])
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, schema) as writer:
        writer.write_table(pa.table([column.combine_chunks() for column in table.columns], schema=schema))
    return hashlib.sha256(sink.getvalue()).hexdigest()


def call(checkout: Path, words: list[str], folder: Path) -> tuple[int, bytes, str]:
    """Return exit code, standard output and standard error of a command of a checkout."""
    environment = {**os.environ, "PYTHONPATH": str(checkout), "NO_COLOR": "1"}
    command = [sys.executable, "-m", "nlosctl.cli.__main__", *words]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, check=False)
    return done.returncode, done.stdout, done.stderr.decode("utf-8", "replace")


def results(checkout: Path, run: Run, scratch: Path) -> tuple[dict[str, object], list[str]]:
    """Return the outputs of a run and its followers, by name, and their messages."""
    folder = scratch / run.name
    folder.mkdir()
    produced: dict[str, object] = {}
    messages = []
    for number, words in enumerate([run.words, *run.then]):
        code, output, message = call(checkout, words, folder)
        produced[f"command {number}"] = (code, hashlib.sha256(output).hexdigest())
        messages.append(message)
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            produced[str(path.relative_to(folder))] = digest(path)
    return produced, messages


def _print(text: str) -> None:
    sys.stdout.write(text + "\n")


def main(other: Path, selected: re.Pattern[str]) -> int:
    """Run everything in both checkouts, print the differences, and return the exit code."""
    runs = [run for run in (*solving_runs(), *file_runs()) if selected.search(run.name)]
    with tempfile.TemporaryDirectory() as scratch:
        for checkout, name in ((other, "before"), (ROOT, "after")):
            shutil.copytree(ROOT / "fixtures", Path(scratch, name, "in"))
            for world, (trials, _) in WORLDS.items():
                words = ["simulate", world, "-n", str(trials), "--seed", "11", "-o", f"{world}.parquet"]
                call(checkout, words, Path(scratch, name, "in"))
        differing, reworded = 0, 0
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            before = pool.map(lambda run: results(other, run, Path(scratch, "before")), runs)
            after = pool.map(lambda run: results(ROOT, run, Path(scratch, "after")), runs)
            for run, (old, old_messages), (new, new_messages) in zip(runs, before, after, strict=True):
                names = [name for name in old.keys() | new.keys() if old.get(name) != new.get(name)]
                if names:
                    differing += 1
                    _print(f"{run.name}: different results: {', '.join(sorted(names))}")
                for a, b in zip(old_messages, new_messages, strict=True):
                    if a != b:
                        reworded += 1
                        _print(f"{run.name}: different message\n  before: {a.strip()}\n  after:  {b.strip()}")
    _print(f"{len(runs)} runs: {differing} with different results, {reworded} different messages")
    return 1 if differing else 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]).resolve(), re.compile(sys.argv[2] if len(sys.argv) > 2 else "")))
