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

    It says nothing. With ``kill_after_s`` it is killed after so long, if it has not ended before.
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
    chance = random.Random(f"{seed} {job.command}")  # noqa: S311 - drawn to be made again
    line = [*job.line, "--overwrite"]
    _imported(line, job.code)
    seconds = _length_s(line, job.code)
    new = {name: (folder / name).read_bytes() for name in job.outputs}
    old = {name: f"the old {name}".encode() * 1000 for name in job.outputs}
    found: Counter[str] = Counter()
    while found["killed"] < kills:
        for name, content in old.items():
            (folder / name).write_bytes(content)
        status, seconds_now = run_forked(line, chance.uniform(0.0, 1.02 * seconds))
        if status == signal.SIGKILL:
            found["killed"] += 1
        else:
            found["ended before"] += 1
            seconds = 0.5 * (seconds + seconds_now)
        for name in job.outputs:
            content = (folder / name).read_bytes()
            found["old" if content == old[name] else "new" if content == new[name] else "torn"] += 1
        left = [path for path in folder.iterdir() if path.name.endswith(".part")]
        found["temporary files left"] += len(left)
        for path in left:
            assert path.name.startswith("."), f"{path.name} could be taken for an output"
            path.unlink()
    return found


def kill_and_resume(job: WritingJob, kills: int, folder: Path, seed: int) -> Counter[str]:
    """Kill a job of many files ``kills`` times, then resume it; return how often the bytes agree."""
    assert job.folder is not None
    place = folder / job.folder
    chance = random.Random(f"{seed} {job.command}")  # noqa: S311 - drawn to be made again
    _empty(place)
    _imported(job.line, job.code)
    _empty(place)
    seconds = _length_s(job.line, job.code)
    whole = _contents(place)
    found: Counter[str] = Counter()
    while found["killed"] < kills:
        _empty(place)
        times = chance.choice((1, 1, 2))
        for _ in range(times):
            killed, _ = run_forked([*job.line, *job.going_on], chance.uniform(0.0, 1.02 * seconds / times))
            found["killed" if killed == signal.SIGKILL else "ended before"] += 1
        ended, _ = run_forked([*job.line, *job.going_on])
        same = ended >> 8 == job.code and _contents(place) == whole
        found["the same bytes" if same else "torn"] += 1
    return found


def _imported(line: Sequence[str], code: int) -> None:
    """Run the program in this process: what forks of it need is imported then, and not in each of them."""
    from nlosctl.cli.main import run

    with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
        assert run([*line, "-q"]) == code, f"{line} did not end with {code}"


def _length_s(line: Sequence[str], code: int) -> float:
    """Return how long a run takes that nobody kills."""
    status, seconds = run_forked(line)
    assert status >> 8 == code, f"{line} ended with {status}"
    return seconds


def _empty(place: Path) -> None:
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir()


def _contents(place: Path) -> dict[str, bytes]:
    """Return the files of a folder, those that a killed run left unfinished left out."""
    files = [path for path in sorted(place.rglob("*")) if path.is_file() and not path.name.endswith(".part")]
    return {path.relative_to(place).as_posix(): path.read_bytes() for path in files}


def main() -> int:
    """Kill from the command line; exit 1 where an output was torn."""
    parser = argparse.ArgumentParser(description="kill -9 at random moments.")
    parser.add_argument("--kills", type=int, default=200, help="of each command")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--commands", default="", help="only these")
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
            found = kill(job, arguments.kills, Path(name), arguments.seed)
            found["seconds"] = round(time.monotonic() - started)
            torn += found["torn"]
            sys.stdout.write(json.dumps({"line": " ".join(job.line), "seed": arguments.seed, **found}) + "\n")
            sys.stdout.flush()
        os.chdir("/")
    return 1 if torn else 0


if __name__ == "__main__":
    sys.exit(main())
