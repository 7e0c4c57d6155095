"""Signals at the worst moment: none is lost, none leaves a file or an extra line."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from nlosctl.io.parts.run_folder import RunFolder

pytestmark = pytest.mark.process

PROGRAM = Path(sys.executable).with_name("nlosctl")
CODES = [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129), (signal.SIGXCPU, 152)]


def names(folder: Path) -> list[str]:
    """Return all names in a folder, hidden and nested ones too."""
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*"))


def run_script(folder: Path, script: str, *words: str) -> subprocess.CompletedProcess[str]:
    """Run Python that prepares something, then the program with ``words``."""
    start = "\nimport sys\nfrom nlosctl.cli.__main__ import main\nsys.exit(main())\n"
    line = [sys.executable, "-c", script + start, *words]
    return subprocess.run(line, capture_output=True, text=True, cwd=folder, check=False, timeout=60)


DROPS = """
import signal
from nlosctl.pipeline.simulate import simulation
class Gone:
    def __del__(self):
        signal.raise_signal({number})
        for _ in range(100):
            pass
table = simulation.measurement_table
def once(*words):
    simulation.measurement_table = table
    Gone()
    return table(*words)
simulation.measurement_table = once
"""


@pytest.mark.parametrize(("number", "code"), CODES, ids=lambda value: str(value))
def test_interrupts_in_callbacks_end_the_run(number: int, code: int, folder: Path) -> None:
    """An interrupt in a ``__del__`` or callback, where Python drops exceptions, ends the run too."""
    done = run_script(folder, DROPS.format(number=int(number)), "simulate", "ring", "-n", "100000000", "-o", "m.csv")
    assert (done.returncode, done.stderr) == (code, "nlosctl: interrupted; no partial output remains\n")
    assert names(folder) == []


def test_other_dropped_exceptions_are_reported(folder: Path) -> None:
    """Other exceptions that Python drops are reported as usual."""
    script = (
        "class Gone:\n    def __del__(self):\n        raise ValueError('lost')\nimport atexit\natexit.register(Gone)\n"
    )
    done = run_script(folder, script, "simulate", "ring", "-n", "2", "-o", "m.csv", "-q")
    assert done.returncode == 0
    assert "ValueError: lost" in done.stderr


def test_the_entry_imports_next_to_nothing(folder: Path) -> None:
    """Only a few small modules are imported before interrupts are handled: milliseconds."""
    script = "import sys; before = {*sys.modules}; import nlosctl.cli.__main__; print(*sorted({*sys.modules} - before))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, cwd=folder)
    assert set(done.stdout.split()) <= {
        "__future__",
        "nlosctl",
        "nlosctl.version",
        "nlosctl.cli",
        "nlosctl.cli.__main__",
    }


def test_interrupts_while_processes_start(folder: Path) -> None:
    """Ctrl-C reaches the starting processes of ``reproduce`` too: they print nothing."""
    script = """
import os, signal, threading
from concurrent.futures import process
spawn = process.ProcessPoolExecutor._spawn_process
def spawn_then_interrupt(pool):
    spawn(pool)
    threading.Timer(0.2, os.killpg, (0, signal.SIGINT)).start()
    process.ProcessPoolExecutor._spawn_process = spawn
process.ProcessPoolExecutor._spawn_process = spawn_then_interrupt
"""
    start = "\nimport sys\nfrom nlosctl.cli.__main__ import main\nif __name__ == '__main__': sys.exit(main())\n"
    (folder / "program.py").write_text(script + start)
    done = subprocess.run(
        [sys.executable, "program.py", "reproduce", "song-fig8", "--trials", "2000", "-o", "out", "--jobs", "2"],
        capture_output=True,
        text=True,
        cwd=folder,
        check=False,
        timeout=60,
        start_new_session=True,
    )
    assert done.returncode == 130
    assert [line for line in done.stderr.splitlines() if "finished chunks are kept" not in line] == [
        "nlosctl: interrupted; no partial output remains"
    ]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_interrupted_workers_leave_no_partial_parts(number: int, job_folder: Path) -> None:
    """After an interrupted run into a folder no partial file is left, and --resume completes it."""
    script = """
import time
from nlosctl.io.writers.byte_output import AtomicFile
keep = AtomicFile.keep
def keep_late(file):
    if ".parquet." in file._temporary.name:
        time.sleep(60)
    keep(file)
AtomicFile.keep = keep_late
"""
    start = "\nimport sys\nfrom nlosctl.cli.__main__ import main\nsys.exit(main())\n"
    words = ["localize", "bearing_parts", "-o", "e/", "--flags-out", "f/", "--jobs", "2", "-q"]
    running = subprocess.Popen([sys.executable, "-c", script + start, *words], cwd=job_folder, stderr=subprocess.PIPE)
    try:
        deadline = time.monotonic() + 60
        while sum(name.endswith(".part") for name in names(job_folder)) < 4 and time.monotonic() < deadline:
            time.sleep(0.02)
        running.send_signal(number)
        _, err = running.communicate(timeout=60)
    finally:
        running.kill()
    assert running.returncode == 128 + number
    assert err == b"nlosctl: interrupted; no partial output remains\n"
    assert [name for name in names(job_folder) if name.endswith(".part")] == []
    done = subprocess.run([PROGRAM, *words, "--resume"], cwd=job_folder, check=False)
    assert done.returncode == 0


def test_only_own_temporary_files_are_removed(folder: Path) -> None:
    """Files of other programs beside the parts are kept; one that was killed before it locked its file has left it."""
    (folder / "out").mkdir()
    ours = (".0.parquet.1a2b3c4d.part", ".0123456789abcdef.part")
    for name in (*ours, ".1.parquet.1a2b3c4d.part", "0.parquet", ".other.part", "x.part"):
        (folder / "out" / name).touch()
    RunFolder({"estimates": "out"}).remove_temporary_files(["0.parquet"])
    assert names(folder / "out") == [".1.parquet.1a2b3c4d.part", ".other.part", "0.parquet", "x.part"]


def test_cpu_time_limits(folder: Path) -> None:
    """A limit on processor time ends a run like SIGTERM: one line, and nothing left."""
    script = f"ulimit -St 2; exec {PROGRAM} simulate ring -n 100000000 -o m.csv"
    done = subprocess.run(["bash", "-c", script], capture_output=True, cwd=folder, check=False, timeout=120)
    assert (done.returncode, done.stderr) == (152, b"nlosctl: interrupted; no partial output remains\n")
    assert names(folder) == []


@pytest.mark.parametrize("made", [0, 1, 2])
def test_process_limits(made: int, job_folder: Path) -> None:
    """If the system refuses further processes there is one line, and those already started end."""
    script = f"""
import errno, os
fork, made = os.fork, []
def fork_some():
    if len(made) == {made}:
        raise BlockingIOError(errno.EAGAIN, os.strerror(errno.EAGAIN))
    made.append(0)
    return fork()
os.fork = fork_some
"""
    before = names(job_folder)
    done = run_script(job_folder, script, "localize", "bearing_parts", "-o", "e/", "--jobs", "3", "-q")
    assert done.returncode == 1
    assert done.stderr == "nlosctl: no process can be started: Resource temporarily unavailable; reduce --jobs\n"
    assert [name for name in names(job_folder) if name.split("/")[0] not in {*before, "e"}] == []
