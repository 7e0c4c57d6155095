"""Faults around a run: disks, folders, pipes, signals, clocks. One clear line and no partial output."""

from __future__ import annotations

import fcntl
import itertools
import os
import pty
import resource
import shutil
import signal
import subprocess
import sys
import termios
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from guarded_run import Ending, complaints, message_complaints, run_guarded
from kill_runs import kill_and_resume, kill_at_random
from plugins import ActInCall
from writing_jobs import FIXTURES, WritingJob, resumed_jobs, writing_jobs

pytestmark = pytest.mark.process

PROGRAM = Path(sys.executable).with_name("nlosctl")
GOOD = FIXTURES / "good_bearings.parquet"
JOBS = [pytest.param(job, id=job.command) for job in writing_jobs()]
NOBODY = 65534


def names(folder: Path) -> list[str]:
    """Return the names in a folder, hidden ones too."""
    return [path.name for path in folder.iterdir()]


def assert_failed_cleanly(ending: Ending, folder: Path, before: list[str], message: str) -> None:
    """Check that a run exits 1 with one line that contains ``message``, and leaves no new file."""
    assert list(complaints(ending, folder, [], before)) == []
    assert ending.code == 1
    assert message in ending.err


def shell(script: str, folder: Path, **settings: Any) -> tuple[int, bytes, str]:
    """Run a script of bash where ``nlosctl`` is this program."""
    done = subprocess.run(
        ["bash", "-c", script],
        capture_output=True,
        cwd=folder,
        env={**os.environ, "PATH": f"{PROGRAM.parent}:{os.environ['PATH']}"},
        check=False,
        timeout=120,
        **settings,
    )
    return done.returncode, done.stdout, done.stderr.decode()


def unread(pipe: Any) -> int:
    """Return the number of unread bytes in a pipe."""
    return int.from_bytes(fcntl.ioctl(pipe, termios.FIONREAD, bytes(4)), sys.byteorder)


@pytest.fixture
def small_disk() -> Any:
    """Limit the files of this process to 1000 bytes, as on a full disk."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.parametrize("job", JOBS)
def test_file_size_limits(job: WritingJob, job_folder: Path, small_disk: None) -> None:
    """On a full disk every command names the file that can't be written, and leaves nothing."""
    before = names(job_folder)
    assert_failed_cleanly(
        run_guarded([*job.line, "-q"], seconds=60), job_folder, before, "can't be written: File too large"
    )


@pytest.mark.parametrize("extension", ["parquet", "arrow", "arrows", "csv", "csv.gz", "jsonl", "jsonl.gz"])
def test_every_format_meets_a_full_disk(extension: str, folder: Path, small_disk: None) -> None:
    """A full disk is one line for every format, and leaves neither estimates nor flags."""
    words = ["localize", GOOD, "-o", f"e.{extension}", "--flags-out", f"f.{extension}", "-q"]
    assert_failed_cleanly(run_guarded(words), folder, [], "can't be written: File too large")


@pytest.mark.parametrize("job", JOBS)
def test_full_disks(job: WritingJob, job_folder: Path) -> None:
    """On a full disk of 64 KiB: one line, no new file, the old file intact."""
    disk = job_folder / "disk"
    disk.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", disk], check=False).returncode:
        pytest.skip("a disk of one's own takes root")
    try:
        words = [f"disk/{word}" if word in job.outputs else word for word in job.line]
        (disk / job.outputs[0]).write_bytes(b"x" * 30_000)
        ending = run_guarded([*words, "-q", "--overwrite"], seconds=60)
        assert_failed_cleanly(ending, disk, [job.outputs[0]], "can't be written: No space left on device")
        assert (disk / job.outputs[0]).read_bytes() == b"x" * 30_000
    finally:
        subprocess.run(["umount", disk], check=True)


@pytest.mark.usefixtures("small_chunks")
@pytest.mark.parametrize("jobs", [1, 2])
def test_output_folders_removed_during_a_run(jobs: int, folder: Path, acting_method: ActInCall) -> None:
    """If the folder of an output is removed during the run, exit 1 names the file."""
    (folder / "out").mkdir()
    acting_method(2, lambda: shutil.rmtree(folder / "out"))
    ending = run_guarded(["localize", GOOD, "-m", "acting", "-o", "out/e.csv", "-q", "--jobs", jobs])
    assert_failed_cleanly(ending, folder, [], "out/e.csv: can't be written: No such file or directory")


CHANGES: dict[str, Callable[[Path], Any]] = {
    "appended to": lambda path: path.write_bytes(path.read_bytes() + b"\n"),
    "cut": lambda path: os.truncate(path, path.stat().st_size // 2),
    "replaced": lambda path: path.with_name("other").replace(path),
    "written again": lambda path: (time.sleep(0.02), path.write_bytes(path.read_bytes())),
    "taken away": lambda path: path.unlink(),
}


@pytest.mark.usefixtures("small_chunks")
@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES.keys())
@pytest.mark.parametrize("extension", ["parquet", "arrow", "arrows", "csv", "csv.gz", "jsonl"])
def test_inputs_changed_during_a_run(
    extension: str, change: Callable[[Path], Any], folder: Path, acting_method: ActInCall
) -> None:
    """An input that changes during the run gives no result and no crash."""
    source = folder / f"m.{extension}"
    shutil.copy(FIXTURES / f"good_bearings.{extension}", source)
    shutil.copy(FIXTURES / f"good_bearings.{extension}", folder / "other")
    acting_method(1, lambda: change(source))
    scene = FIXTURES / "good_bearings.scene.toml"
    ending = run_guarded(["localize", source.name, "-m", "acting", "--scene", scene, "-o", "e.csv", "-q", "--jobs", 1])
    assert_failed_cleanly(ending, folder, names(folder), f"m.{extension}: was changed while it was read")
    assert "e.csv" not in names(folder)


@pytest.mark.parametrize("job", JOBS)
def test_outputs_are_whole_after_a_kill(job: WritingJob, job_folder: Path) -> None:
    """After kill -9 each output is the old one or the new one, complete."""
    assert kill_at_random(job, 1, job_folder, seed=9)["torn"] == 0


@pytest.mark.parametrize("job", [pytest.param(job, id=job.command) for job in resumed_jobs()])
def test_resuming_after_a_kill(job: WritingJob, folder: Path, job_folder: Path) -> None:
    """A run resumed after kill -9 gives the bytes of an uninterrupted run."""
    assert kill_and_resume(job, 1, job_folder, seed=9)["torn"] == 0


@pytest.mark.parametrize(
    ("number", "code"),
    [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)],
    ids=lambda value: str(value),
)
@pytest.mark.parametrize("command", ["localize", "simulate"])
def test_signals_end_in_one_line(command: str, number: int, code: int, folder: Path) -> None:
    """SIGINT, SIGTERM and SIGHUP give one line each and leave nothing."""
    words = {
        "localize": ["localize", "-", "-o", "e.csv", "--input-format", "csv"],
        "simulate": ["simulate", "ring", "-n", "100000000", "-o", "m.csv"],
    }[command]
    running = subprocess.Popen([PROGRAM, *words], stdin=subprocess.PIPE, stderr=subprocess.PIPE, cwd=folder)
    assert running.stdin is not None
    deadline = time.monotonic() + 60
    try:
        while command == "simulate" and not names(folder) and time.monotonic() < deadline:
            time.sleep(0.05)
        if command == "localize":
            running.stdin.write(b"snapshot,sensor,sensor_x_m,sensor_y_m,bearing_rad,bearing_std_rad\n")
            running.stdin.flush()
            while unread(running.stdin) and time.monotonic() < deadline:
                time.sleep(0.02)
        running.send_signal(number)
        _, err = running.communicate(timeout=60)
    finally:
        running.kill()
    assert running.returncode == code
    assert [line for line in err.decode().splitlines() if line] == [err.decode().strip()], (
        "more than one line was printed"
    )
    assert b"interrupted" in err
    assert names(folder) == []


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_hang_up_under_nohup_is_ignored(jobs: int, folder: Path) -> None:
    """Under `nohup` a run continues after SIGHUP, with its worker processes, to the same bytes."""
    shell("nlosctl simulate ring -n 40000 -o m.parquet -q", folder)
    words = ["nohup", str(PROGRAM), "localize", "-m", "mixture-ml", "m.parquet", "--jobs", str(jobs), "-q", "-o"]
    running = subprocess.Popen([*words, "a.parquet"], cwd=folder, start_new_session=True, stderr=subprocess.DEVNULL)
    try:
        while running.poll() is None:
            if len(names(folder)) > 1:
                os.killpg(running.pid, signal.SIGHUP)
            time.sleep(0.02)
    finally:
        running.kill()
    assert running.returncode == 0
    assert shell(f"nlosctl localize -m mixture-ml m.parquet --jobs {jobs} -q -o b.parquet", folder)[0] == 0
    assert (folder / "a.parquet").read_bytes() == (folder / "b.parquet").read_bytes()


BIG = "nlosctl simulate ring -n 20000 -q"


@pytest.mark.parametrize(
    "line",
    [BIG, f"{BIG} --format parquet", f"{BIG} --format arrow", f"nlosctl localize -q {GOOD}", "nlosctl methods"],
    ids=["csv", "parquet", "arrow", "small", "methods"],
)
def test_a_closed_pipe_is_quiet(line: str, folder: Path) -> None:
    """A closed pipe exits 0 without output on stderr."""
    code, _, err = shell(f"set -o pipefail; {line} | head -c 10 > /dev/null", folder)
    assert (code, err) == (0, "")


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("nlosctl localize - -q <&-", "standard input is closed"),
        (f"nlosctl localize {GOOD} -q >&-", "standard output is closed"),
        ("nlosctl methods >&-", "standard output is closed"),
        (f"nlosctl localize {GOOD} -q > /dev/full", "No space left on device"),
        ("nlosctl methods --json > /dev/full", "No space left on device"),
    ],
)
def test_closed_and_full_streams(line: str, message: str, folder: Path) -> None:
    """A closed input, and a closed or full output, exit 1 with a line that names it."""
    code, out, err = shell(line, folder)
    assert (code, out) == (1, b"")
    assert list(message_complaints(err, quiet_end=False)) == []
    assert message in err
    assert len(err.splitlines()) == 1


@pytest.mark.parametrize("way", ["2>&-", "2> /dev/full"])
def test_closed_and_full_stderr(way: str, folder: Path) -> None:
    """A closed or full standard error changes neither results nor exit code."""
    code, out, _ = shell(f"nlosctl localize {GOOD} -o e.csv {way}", folder)
    assert (code, out) == (0, b"")
    assert len((folder / "e.csv").read_text().splitlines()) == 41
    assert shell(f"nlosctl localize absent.csv {way}", folder)[0] == 1
    assert shell(f"nlosctl localize --nonsense {way}", folder)[0] == 2


@pytest.mark.parametrize("job", JOBS)
def test_read_only_folders(job: WritingJob, job_folder: Path) -> None:
    """A read-only folder is reported before any work is done, and stays unchanged."""
    run_guarded([*job.line, "-q", "--overwrite"], seconds=60)  # imports late modules, which are in folders of root
    for name in job.outputs:
        (job_folder / name).unlink()
    before = names(job_folder)
    user = os.geteuid()
    job_folder.chmod(0o555)
    for path in [job_folder, *job_folder.parents]:
        if not os.access(path, os.X_OK) or (path.stat().st_uid == user and path.stat().st_mode & 0o005 != 0o005):
            path.chmod(path.stat().st_mode | 0o055)
    if user == 0:
        os.seteuid(NOBODY)
    try:
        ending = run_guarded([*job.line, "-q"])
    finally:
        os.seteuid(user)
        job_folder.chmod(0o755)
    assert_failed_cleanly(ending, job_folder, before, "can't be written")


@pytest.mark.usefixtures("small_chunks")
def test_clocks_that_run_backwards(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Results do not depend on the clock, and the progress bar tolerates one that runs backwards."""
    assert run_guarded(["localize", GOOD, "-o", "a.parquet", "-q"]).code == 0
    ticks = itertools.count()
    for name in ("time", "monotonic", "perf_counter"):
        monkeypatch.setattr(time, name, lambda: 1e9 - 100.0 * next(ticks))
    ending = run_guarded(["localize", GOOD, "-o", "b.parquet", "--jobs", 1], terminal=True)
    assert (ending.code, ending.raised) == (0, "")
    assert (folder / "a.parquet").read_bytes() == (folder / "b.parquet").read_bytes()


def test_without_any_terminal(folder: Path) -> None:
    """Without terminal, HOME and TERM the output is the same."""
    plain = {"PATH": os.environ["PATH"]}
    words = [PROGRAM, "localize", GOOD, "-q"]
    done = subprocess.run(words, capture_output=True, cwd=folder, env=plain, start_new_session=True, check=False)
    assert (done.returncode, done.stderr) == (0, b"")
    assert done.stdout == run_guarded(words[1:]).out


def test_closing_the_terminal_ends_a_run(folder: Path) -> None:
    """When the terminal closes the run ends and leaves nothing."""
    child, terminal = pty.fork()
    if child == 0:
        os.chdir(folder)
        os.execv(PROGRAM, [str(PROGRAM), "simulate", "ring", "-n", "100000000", "-o", "m.csv"])  # noqa: S606
    deadline = time.monotonic() + 60
    while not names(folder) and time.monotonic() < deadline:
        time.sleep(0.05)
    os.close(terminal)
    _, status = os.waitpid(child, 0)
    assert os.waitstatus_to_exitcode(status) == 129
    assert names(folder) == []
