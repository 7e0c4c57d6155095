"""Parallel maps over a stream of items by processes or threads, with results in the order of the stream.

Processes are used if they can be forked: a method makes many short NumPy calls, so that
threads would mostly wait for the interpreter's lock (see docs/performance.md). Otherwise threads are used.
"""

from __future__ import annotations

import math
import multiprocessing
import os
import signal
import sys
import threading
import warnings
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from itertools import chain, islice
from pathlib import Path
from typing import Any, TypeVar, cast

from nlosctl.contract.step_progress import ignore_steps
from nlosctl.errors import MethodError

__all__ = ["CAN_FORK", "map_in_order", "map_in_processes", "usable_jobs"]

ItemT = TypeVar("ItemT")
ResultT = TypeVar("ResultT")

CAN_FORK = sys.platform == "linux"
"""Whether processes can be forked; the libraries of other systems do not support it."""

_inherited: Callable[[Any], Any]


def map_in_order(function: Callable[[ItemT], ResultT], items: Iterable[ItemT], jobs: int) -> Iterator[ResultT]:
    """Yield ``function(item)`` for each item in order, with up to ``jobs`` threads.

    At most ``jobs`` + 1 items are in memory at a time. With one job no thread is started. The first error of the
    function or the stream is raised in place of its result, and no further item is started.
    """
    if jobs == 1:
        yield from map(function, items)
        return
    with ThreadPoolExecutor(max_workers=jobs) as pool:
        yield from _in_order(pool, function, items, jobs)


def map_in_processes(
    function: Callable[[ItemT], ResultT], items: Iterable[ItemT], jobs: int
) -> Generator[ResultT, None, None]:
    """Yield the results of `map_in_order`, by processes that inherit ``function``; items and results are pickled.

    This process handles a single item itself, and uses threads if it cannot fork. Raises MethodError if a process dies.
    All processes end with the iteration, or with this process.
    """
    iterator = iter(items)
    first = list(islice(iterator, 1 if jobs == 1 or not CAN_FORK else 2))
    if len(first) < 2:
        yield from map_in_order(function, chain(first, iterator), jobs)
        return
    with _forked_pool(function, jobs) as pool:
        yield from _in_order(pool, _call_inherited, chain(first, iterator), jobs)


def _in_order(
    pool: Executor, function: Callable[[ItemT], ResultT], items: Iterable[ItemT], jobs: int
) -> Iterator[ResultT]:
    pending: deque[Future[ResultT]] = deque()
    failures: list[Exception] = []
    try:
        for item in _until_failure(items, failures):
            pending.append(pool.submit(function, item))
            if len(pending) > jobs:
                yield pending.popleft().result()
        while pending:
            yield pending.popleft().result()
    except BrokenProcessPool as error:
        raise MethodError("a worker process was killed, perhaps for lack of memory; reduce `jobs`") from error
    finally:
        for future in pending:
            future.cancel()
    if failures:
        raise failures[0]


@contextmanager
def _forked_pool(function: Callable[[Any], Any], jobs: int) -> Iterator[Executor]:
    """Provide a pool whose processes are killed if the block raises an exception or not all can be started."""
    context = multiprocessing.get_context("fork")
    pool = ProcessPoolExecutor(jobs, mp_context=context, initializer=_begin_work, initargs=(function,))
    try:
        _start(pool)
        # Close the write end here: a read of a result truncated by a kill then fails instead of waiting for the rest.
        cast(Any, pool._result_queue)._writer.close()
        yield pool
    except BaseException:
        for process in list((pool._processes or {}).values()):
            process.kill()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _start(pool: ProcessPoolExecutor) -> None:
    try:
        with warnings.catch_warnings(), _deferred_signals():
            warnings.simplefilter("ignore", DeprecationWarning)  # about forking with threads, since Python 3.12
            pool.submit(os.getpid).result()
    except OSError as error:
        raise MethodError(f"no process can be started: {error.strerror or error}; reduce `jobs`") from error


@contextmanager
def _deferred_signals() -> Iterator[None]:
    """Defer Ctrl-C and similar signals to the end of the block: an exception raised during the fork would be lost."""
    if threading.current_thread() is not threading.main_thread():
        yield  # no handler runs in this thread
        return
    received: list[int] = []
    interrupts = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGXCPU, signal.SIGALRM)
    handlers = {number: signal.getsignal(number) for number in interrupts}
    handlers = {number: handler for number, handler in handlers.items() if callable(handler)}
    for number in handlers:
        signal.signal(number, lambda number, frame: received.append(number))
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
        for signal_number in received:
            signal.raise_signal(signal_number)


def _begin_work(function: Callable[[Any], Any]) -> None:
    """Store the function, leave Ctrl-C to the parent process, and exit when the parent does."""
    global _inherited
    _inherited = function
    ignore_steps()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGXCPU):
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, signal.SIG_DFL)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _call_inherited(item: Any) -> Any:
    return _inherited(item)


def _until_failure(items: Iterable[ItemT], failures: list[Exception]) -> Iterator[ItemT]:
    """Yield the items until the stream fails; then append its error to ``failures`` and end."""
    iterator = iter(items)
    while True:
        try:
            item = next(iterator)
        except StopIteration:
            return
        except Exception as error:
            failures.append(error)
            return
        yield item


_CPU_LIMIT = Path("/sys/fs/cgroup/cpu.max")


def usable_jobs(jobs: int, cpu_limit: Path = _CPU_LIMIT) -> int:
    """Return ``jobs``, or for 0 the processors that this process may use.

    These are limited by its affinity and by its control group, whose file is ``cpu_limit``.
    """
    if jobs > 0:
        return jobs
    processors = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, min(processors, _container_processors(cpu_limit)))


def _container_processors(limit: Path) -> int:
    """Return the processors that this control group may use, rounded up; ``sys.maxsize`` without a limit."""
    try:
        quota, period = limit.read_text().split()
        return math.ceil(int(quota) / int(period))
    except (OSError, ValueError):
        return sys.maxsize
