"""Threads and processes on a stream: order, errors, bounded memory, and complete clean-up."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nlosctl.errors import DataError, MethodError
from nlosctl.pipeline.engine import workers
from nlosctl.pipeline.engine.workers import map_in_order, map_in_processes, usable_jobs

pytestmark = pytest.mark.process


@settings(deadline=None, max_examples=40)
@given(st.lists(st.integers(0, 3), max_size=20), st.integers(1, 5))
def test_results_come_in_the_order_of_the_items(pauses: list[int], jobs: int) -> None:
    """Results are in the order of the stream, for any durations."""

    def work(item: tuple[int, int]) -> int:
        time.sleep(0.0003 * item[1])
        return item[0]

    assert list(map_in_order(work, enumerate(pauses), jobs)) == list(range(len(pauses)))


def drain(stream: Iterator[int], seen: list[int]) -> None:
    """Take results one by one, so that those before an error are kept."""
    for result in stream:
        seen.append(result)


@pytest.mark.parametrize("jobs", [1, 2, 4])
def test_the_first_error_is_raised_in_order(jobs: int) -> None:
    """Results before the first error are returned, then that error, not a later one; no further item is started."""
    started = []

    def work(item: int) -> int:
        started.append(item)
        if item == 6:
            time.sleep(0.05)
            raise ValueError("the first")
        if item > 6:
            raise ValueError("a later one")
        return item

    seen: list[int] = []
    with pytest.raises(ValueError, match="the first"):
        drain(map_in_order(work, range(1000), jobs), seen)
    assert seen == list(range(6))
    assert max(started) <= 6 + jobs


@pytest.mark.parametrize("jobs", [1, 2, 4])
def test_an_error_of_the_stream_is_raised_in_order_too(jobs: int) -> None:
    """If reading fails, earlier results are returned first, for any number of workers."""

    def items() -> Iterator[int]:
        yield from range(5)
        raise OSError("the file ends here")

    seen: list[int] = []
    with pytest.raises(OSError, match="the file ends here"):
        drain(map_in_order(lambda item: item, items(), jobs), seen)
    assert seen == list(range(5))


@pytest.mark.parametrize("jobs", [1, 2, 5])
def test_few_items_are_held(jobs: int) -> None:
    """At most jobs + 1 items are read ahead of the results."""
    taken = 0

    def items() -> Iterator[int]:
        nonlocal taken
        for item in range(100):
            taken += 1
            yield item

    given_back = 0
    for _ in map_in_order(lambda item: item, items(), jobs):
        assert taken - given_back <= jobs + 1
        given_back += 1
    assert given_back == 100


def test_the_workers_work_at_the_same_time() -> None:
    """Two jobs that wait for each other finish only if they run concurrently."""
    barrier = threading.Barrier(2, timeout=10)
    assert list(map_in_order(lambda item: barrier.wait() >= 0, range(2), 2)) == [True, True]


def test_one_job_makes_no_thread() -> None:
    """With one job all work is done in the caller's thread, one item at a time."""
    mine = threading.get_ident()
    assert set(map_in_order(lambda item: threading.get_ident(), range(5), 1)) == {mine}


def test_stopping_early_stops_the_work() -> None:
    """After an abandoned iteration no thread runs and no item is started."""
    started = []
    before = threading.active_count()
    stream = map_in_order(lambda item: started.append(item), range(1000), 3)
    next(stream)
    stream.close()  # type: ignore[attr-defined]
    assert len(started) <= 4
    assert threading.active_count() == before


def test_no_jobs_means_as_many_as_there_are() -> None:
    """0 is the number of processors that this process may use; other numbers are unchanged."""
    assert 1 <= usable_jobs(0) <= len(os.sched_getaffinity(0))
    assert [usable_jobs(jobs) for jobs in (1, 7)] == [1, 7]


def test_control_groups_limit_the_jobs(tmp_path: Path) -> None:
    """The processor limit of a container, rounded up, limits the jobs; an invalid or missing one does not."""
    limit, available = tmp_path / "cpu.max", usable_jobs(0, tmp_path / "absent")
    expected = {"150000 100000": min(2, available), "20000 100000": 1, "max 100000": available, "": available}
    for text, jobs in expected.items():
        limit.write_text(text)
        assert usable_jobs(0, limit) == jobs


def own_process(item: int) -> tuple[int, int]:
    """Return the item and its process."""
    time.sleep(0.05)
    return item, os.getpid()


def test_processes_keep_the_order() -> None:
    """Several child processes do the work; results are in the order of the stream."""
    done = list(map_in_processes(own_process, range(8), 2))
    assert [item for item, _ in done] == list(range(8))
    assert len({process for _, process in done}) == 2
    assert os.getpid() not in {process for _, process in done}


@pytest.mark.parametrize(("items", "jobs"), [(0, 2), (1, 2), (5, 1)])
def test_small_inputs_stay_here(items: int, jobs: int) -> None:
    """A single item, or a single job, starts no process."""
    assert [process for _, process in map_in_processes(own_process, range(items), jobs)] == [os.getpid()] * items


def test_what_processes_do_is_inherited() -> None:
    """The function need not be picklable: only items and results are pickled."""
    shift = 100
    assert list(map_in_processes(lambda item: item + shift, range(5), 2)) == [100, 101, 102, 103, 104]


def test_an_error_comes_back_from_its_process() -> None:
    """An error of nlosctl is raised unchanged, in the position of its result."""

    def work(item: int) -> int:
        if item == 3:
            raise DataError("the third")
        return item

    seen: list[int] = []
    with pytest.raises(DataError, match="the third"):
        drain(map_in_processes(work, range(100), 2), seen)
    assert seen == [0, 1, 2]


def test_a_process_that_dies_is_an_error_of_one_line() -> None:
    """A killed worker, as after a lack of memory, ends the run with a message and a cure."""

    def work(item: int) -> int:
        if item == 2:
            os.kill(os.getpid(), signal.SIGKILL)
        return item

    with pytest.raises(MethodError, match="reduce `jobs`"):
        list(map_in_processes(work, range(10), 2))


def test_stopping_early_stops_the_processes() -> None:
    """After an abandoned iteration the processes are ended without waiting for their results."""
    stream = map_in_processes(lambda item: (time.sleep(30.0 if item else 0.0), os.getpid())[1], range(10), 2)
    started = time.monotonic()
    process = next(stream)
    stream.close()
    assert time.monotonic() - started < 10.0
    with pytest.raises(ProcessLookupError):
        os.kill(process, 0)


def test_no_process_outlives_a_killed_parent(tmp_path: Path) -> None:
    """If the program is killed its workers end too."""
    script = """
import os, sys, time
from nlosctl.pipeline.engine.workers import map_in_processes
def work(item):
    open(os.path.join(sys.argv[1], str(os.getpid())), "w").close()
    time.sleep(60)
list(map_in_processes(work, range(4), 2))
"""
    with subprocess.Popen([sys.executable, "-c", script, str(tmp_path)]) as program:
        deadline = time.monotonic() + 30
        while len(list(tmp_path.iterdir())) < 2 and time.monotonic() < deadline:
            time.sleep(0.02)
        program.kill()
    processes = [int(path.name) for path in tmp_path.iterdir()]
    assert len(processes) == 2
    while any(is_running(process) for process in processes) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not any(is_running(process) for process in processes)


def is_running(process: int) -> bool:
    """Whether a process exists and is not a zombie."""
    try:
        return ") Z" not in Path(f"/proc/{process}/stat").read_text()
    except OSError:
        return False


_INTERRUPTED_WHILE_FORKING = """
import os, signal
from nlosctl.pipeline.engine.workers import map_in_processes

os.register_at_fork(after_in_parent=lambda: os.kill(os.getpid(), signal.SIGINT))
try:
    print(list(map_in_processes(abs, [1, 2, 3], 2)))
except KeyboardInterrupt:
    print("interrupted")
"""


@pytest.mark.skipif(not workers.CAN_FORK, reason="nothing is forked here")
def test_an_interrupt_while_forking_is_not_lost() -> None:
    """Python ignores exceptions of callbacks at a fork, so Ctrl-C is deferred until the processes have started."""
    command = [sys.executable, "-W", "ignore", "-c", _INTERRUPTED_WHILE_FORKING]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    assert (ended.stdout, ended.stderr) == ("interrupted\n", "")


_STOPPED_WHILE_RESULTS_ARE_SENT = """
import time
from nlosctl.pipeline.engine.workers import map_in_processes

for tenths in range(1, 9):
    stream = map_in_processes(bytes, [1] + [100_000_000] * 3, 2)
    next(stream)
    time.sleep(0.02 * tenths)
    try:
        stream.throw(KeyboardInterrupt)
    except KeyboardInterrupt:
        print("interrupted")
"""


@pytest.mark.skipif(not workers.CAN_FORK, reason="nothing is forked here")
def test_a_result_cut_off_by_the_end_is_not_waited_for() -> None:
    """Killing processes while they send long results never causes a hang."""
    command = [sys.executable, "-W", "ignore", "-c", _STOPPED_WHILE_RESULTS_ARE_SENT]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    assert (ended.stdout, ended.stderr) == ("interrupted\n" * 8, "")
