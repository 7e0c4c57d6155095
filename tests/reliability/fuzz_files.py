"""Fuzz the command line with corrupted files: `python fuzz_files.py --help`.

Each input is generated from its number and the seed alone, so that a failure can be repeated. Inputs run in forked
workers; a crash or hang of a worker counts as a failure of its input.
"""

from __future__ import annotations

import argparse
import json
import mmap
import os
import random
import re
import resource
import shutil
import signal
import struct
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import nullcontext
from functools import cache
from pathlib import Path
from typing import Any

from corrupt import corrupt
from fuzz_results import Case, result_complaints
from fuzz_words import words_of
from guarded_run import Ending, complaints, run_guarded
from other_seeds import other_seeds, without_figures
from seed_files import SeedFile, table_seeds

__all__ = ["TARGETS", "case_of", "check_case", "seed_files"]

TARGETS = (
    "parquet", "arrow", "csv", "jsonl", "scene", "config", "import", "estimates", "polygon", "manifest", "cache",
)  # fmt: skip
_SHARES = {"config": 0.5, "polygon": 0.25, "manifest": 0.3, "cache": 0.03}
"""Relative frequency of a target; 1 for the others."""

_MEMORY_BYTES = 2 << 30
_WORKER_INPUTS = 2000
_HANG_S = 60.0
_COUNTS = ("done", "exit 0", "exit 1", "exit 2", "broken")


@cache
def seed_files() -> tuple[SeedFile, ...]:
    """Return the valid files of all targets."""
    return (*table_seeds(), *other_seeds())


def case_of(seed: int, number: int, targets: Sequence[str] = ()) -> Case:
    """Return input ``number``."""
    chance = random.Random(f"{seed} {number}")  # noqa: S311 - repeatable
    files = [file for file in seed_files() if not targets or file.target in targets]
    drawn = sorted({file.target for file in files})
    target = chance.choices(drawn, [_SHARES.get(name, 1.0) for name in drawn])[0]
    file = chance.choice([file for file in files if file.target == target])
    suffix = Path(file.name).suffix
    others = [other.content for other in files if other.target == target and Path(other.name).suffix == suffix]
    text, zipped = suffix not in (".parquet", ".arrow", ".arrows", ".npz"), suffix == ".gz"
    content = corrupt(file.content, others, text=text, zipped=zipped, chance=chance)
    words, outputs = words_of(file, chance)
    return Case(number=number, seed_file=file, content=content, words=words, outputs=outputs)


def check_case(case: Case, folder: Path) -> tuple[Ending, list[str]]:
    """Run a case in an empty ``folder`` (the current one); return its ending and the complaints."""
    for name, content in ((case.seed_file.name, case.content), *case.seed_file.beside):
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
        if case.seed_file.target == "manifest":  # changed inputs are detected by their time
            os.utime(path, ns=(10**18, 10**18))
    before = [path.name for path in folder.iterdir()]
    with without_figures() if case.seed_file.target == "cache" else nullcontext():
        ending = run_guarded(case.words)
    wrong = list(complaints(ending, folder, case.outputs, before))
    if re.search(r"(importer|exporter|method|view) '[^']*' failed", ending.err):
        wrong.append(f"an internal fault: {ending.err[:300]!r}")
    return ending, wrong or list(result_complaints(case, ending, folder))


def _work(seed: int, numbers: range, targets: Sequence[str], counts: mmap.mmap, failures: Path) -> None:
    """Check inputs one after the other; record counts and failures as they occur."""
    resource.setrlimit(resource.RLIMIT_AS, (_address_space() + _MEMORY_BYTES,) * 2)
    for number in numbers:
        counts[:8] = struct.pack("q", number)
        case = case_of(seed, number, targets)
        with tempfile.TemporaryDirectory() as name:
            os.chdir(name)
            ending, wrong = check_case(case, Path(name))
            os.chdir("/")
        _add(counts, "done")
        _add(counts, "broken" if wrong else f"exit {ending.code}")
        if wrong:
            _record_failure(failures, case, wrong, ending.err)


def _record_failure(failures: Path, case: Case, wrong: Sequence[str], err: str) -> None:
    output = {"number": case.number, "file": case.seed_file.name, "kind": case.seed_file.kind, "wrong": wrong}
    with (failures / "failures.jsonl").open("a", encoding="utf-8") as file:
        file.write(json.dumps({**output, "words": case.words, "err": err[:2000]}) + "\n")
    (failures / f"{case.number}-{Path(case.seed_file.name).name}").write_bytes(case.content)


def _add(counts: mmap.mmap, name: str) -> None:
    offset = 8 + 8 * _COUNTS.index(name)
    counts[offset : offset + 8] = struct.pack("q", _count(counts, name) + 1)


def _count(counts: mmap.mmap, name: str) -> int:
    offset = 8 + 8 * _COUNTS.index(name)
    return int(struct.unpack("q", counts[offset : offset + 8])[0])


def _address_space() -> int:
    return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0]) * resource.getpagesize()


def run(seed: int, inputs: int, targets: Sequence[str], failures: Path, minutes: float) -> dict[str, Any]:
    """Check ``inputs`` inputs, or as many as ``minutes`` allow, and return the counts."""
    failures.mkdir(parents=True, exist_ok=True)
    counts = mmap.mmap(-1, 8 + 8 * len(_COUNTS))
    crashes: Counter[str] = Counter()
    deadline, started, next_number = time.monotonic() + 60.0 * minutes, time.monotonic(), 0
    seed_files()
    while next_number < inputs and time.monotonic() < deadline:
        stop = min(next_number + _WORKER_INPUTS, inputs)
        child = os.fork()
        if child == 0:
            _work(seed, range(next_number, stop), targets, counts, failures)
            os._exit(0)
        status = _wait(child, counts)
        if status == 0:
            next_number = stop
            continue
        number = int(struct.unpack("q", counts[:8])[0])
        what = "hang" if status == -1 else f"crash {status}"
        crashes[what] += 1
        _add(counts, "done")
        _add(counts, "broken")
        _record_failure(failures, case_of(seed, number, targets), [what], "")
        next_number = number + 1
    output = {name: _count(counts, name) for name in _COUNTS}
    return {"seed": seed, **output, "crashes": dict(crashes), "seconds": round(time.monotonic() - started)}


def _wait(child: int, counts: mmap.mmap) -> int:
    """Wait for a worker; return its wait status, or -1 if it hung and was killed."""
    seen, since = bytes(counts[:16]), time.monotonic()
    while True:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            return status
        if bytes(counts[:16]) != seen:
            seen, since = bytes(counts[:16]), time.monotonic()
        if time.monotonic() - since > _HANG_S:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            return -1
        time.sleep(0.05)


def main() -> int:
    """Run from the command line; exit 1 if an input failed."""
    parser = argparse.ArgumentParser(description="Fuzz the command line with corrupted files.")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--inputs", type=int, default=100_000)
    parser.add_argument("--targets", default="", help=f"{','.join(TARGETS)} (default: all)")
    parser.add_argument("--minutes", type=float, default=600.0, help="time limit")
    parser.add_argument("--failures", type=Path, default=Path(tempfile.gettempdir()) / "nlosctl-fuzz")
    parser.add_argument("--again", type=int, help="run only this input and print its ending")
    arguments = parser.parse_args()
    targets = [word for word in arguments.targets.split(",") if word]
    if arguments.again is not None:
        return _again(case_of(arguments.seed, arguments.again, targets))
    shutil.rmtree(arguments.failures, ignore_errors=True)
    output = run(arguments.seed, arguments.inputs, targets, arguments.failures.resolve(), arguments.minutes)
    sys.stdout.write(json.dumps({**output, "targets": targets or "all"}) + "\n")
    return 1 if output["broken"] else 0


def _again(case: Case) -> int:
    with tempfile.TemporaryDirectory() as name:
        os.chdir(name)
        ending, wrong = check_case(case, Path(name))
        os.chdir("/")
    sys.stdout.write(f"{' '.join(case.words)}\ncode {ending.code} {ending.raised}\n{ending.err}{wrong}\n")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
