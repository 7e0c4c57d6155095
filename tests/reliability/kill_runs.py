"""kill -9 at random moments: an output stays whole until the new one is complete. `python kill_runs.py --help`."""

from __future__ import annotations

import argparse
import io
import json
import os
import random
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

from writing_jobs import WritingJob, make_inputs, resumed_jobs, writing_jobs

__all__ = ["kill_and_resume", "kill_at_random", "run_forked"]


def run_forked(line: Sequence[str], kill_after_s: float | None = None) -> tuple[int, float]:
    """Run the program in a fork of this process, so that nothing is imported again; return wait status and seconds.

    It prints nothing. If it runs longer than ``kill_after_s`` it is killed.
    """
    from nlosctl.cli.main import run

    started = time.monotonic()
    child = os.fork()
    if child == 0:
        nowhere = os.open(os.devnull, os.O_RDWR)
        for stream in range(3):
            os.dup2(nowhere, stream)
        os._exit(run([*line, "-q"]))
    if kill_after_s is not None:
        deadline = started + kill_after_s
        while time.monotonic() < deadline:
            ended, status = os.waitpid(child, os.WNOHANG)
            if ended:
                return status, time.monotonic() - started
            time.sleep(min(0.002, max(deadline - time.monotonic(), 0.0)))
        os.kill(child, signal.SIGKILL)
    _, status = os.waitpid(child, 0)
    return status, time.monotonic() - started


def kill_at_random(job: WritingJob, kills: int, folder: Path, seed: int) -> Counter[str]:
    """Kill a job ``kills`` times in ``folder``, the current one; return how often each output was old, new or torn."""
    chance = random.Random(f"{seed} {job.command}")  # noqa: S311 - repeatable
    line = [*job.line, "--overwrite"]
    _import_modules(line, job.code)
    seconds = _length_s(line, job.code)
    new = {name: (folder / name).read_bytes() for name in job.outputs}
    old = {name: f"the old {name}".encode() * 1000 for name in job.outputs}
    counts: Counter[str] = Counter()
    while counts["killed"] < kills:
        for name, content in old.items():
            (folder / name).write_bytes(content)
        status, seconds_now = run_forked(line, chance.uniform(0.0, 1.02 * seconds))
        if status == signal.SIGKILL:
            counts["killed"] += 1
        else:
            counts["ended before"] += 1
            seconds = 0.5 * (seconds + seconds_now)
        for name in job.outputs:
            content = (folder / name).read_bytes()
            counts["old" if content == old[name] else "new" if content == new[name] else "torn"] += 1
        left = [path for path in folder.iterdir() if path.name.endswith(".part")]
        counts["temporary files left"] += len(left)
        for path in left:
            assert path.name.startswith("."), f"{path.name} could be mistaken for an output"
            path.unlink()
    return counts


def kill_and_resume(job: WritingJob, kills: int, folder: Path, seed: int) -> Counter[str]:
    """Kill a job of many files ``kills`` times, then resume it; return how often the bytes agree."""
    assert job.folder is not None
    target = folder / job.folder
    chance = random.Random(f"{seed} {job.command}")  # noqa: S311 - repeatable
    _empty(target)
    _import_modules(job.line, job.code)
    _empty(target)
    seconds = _length_s(job.line, job.code)
    whole = _contents(target)
    counts: Counter[str] = Counter()
    while counts["killed"] < kills:
        _empty(target)
        times = chance.choice((1, 1, 2))
        for _ in range(times):
            killed, _ = run_forked([*job.line, *job.resume_arguments], chance.uniform(0.0, 1.02 * seconds / times))
            counts["killed" if killed == signal.SIGKILL else "ended before"] += 1
        ended, _ = run_forked([*job.line, *job.resume_arguments])
        same = ended >> 8 == job.code and _contents(target) == whole
        counts["the same bytes" if same else "torn"] += 1
    return counts


def _import_modules(line: Sequence[str], code: int) -> None:
    """Run the program in this process, so that the modules are imported once and not in each fork."""
    from nlosctl.cli.main import run

    with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
        assert run([*line, "-q"]) == code, f"{line} did not end with {code}"


def _length_s(line: Sequence[str], code: int) -> float:
    """Return the duration of an uninterrupted run."""
    status, seconds = run_forked(line)
    assert status >> 8 == code, f"{line} ended with {status}"
    return seconds


def _empty(target: Path) -> None:
    shutil.rmtree(target, ignore_errors=True)
    target.mkdir()


def _contents(target: Path) -> dict[str, bytes]:
    """Return the files of a folder, without unfinished files of a killed run."""
    files = [path for path in sorted(target.rglob("*")) if path.is_file() and not path.name.endswith(".part")]
    return {path.relative_to(target).as_posix(): path.read_bytes() for path in files}


def main() -> int:
    """Run from the command line; exit 1 if an output was torn."""
    parser = argparse.ArgumentParser(description="kill -9 at random moments.")
    parser.add_argument("--kills", type=int, default=200, help="kills of each command")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--commands", default="", help="commands to run (default: all)")
    arguments = parser.parse_args()
    wanted = [word for word in arguments.commands.split(",") if word]
    torn = 0
    with tempfile.TemporaryDirectory() as name:
        os.chdir(name)
        make_inputs(Path(name))
        for job in [*writing_jobs(), *resumed_jobs()]:
            if wanted and job.command not in wanted:
                continue
            kill = kill_at_random if job.folder is None else kill_and_resume
            started = time.monotonic()
            counts = kill(job, arguments.kills, Path(name), arguments.seed)
            counts["seconds"] = round(time.monotonic() - started)
            torn += counts["torn"]
            sys.stdout.write(json.dumps({"line": " ".join(job.line), "seed": arguments.seed, **counts}) + "\n")
            sys.stdout.flush()
        os.chdir("/")
    return 1 if torn else 0


if __name__ == "__main__":
    sys.exit(main())
