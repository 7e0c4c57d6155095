"""Work on a stream of chunks with several processes or threads, results in the order of the stream.

Processes where they can be forked: the many short NumPy calls of a method hold the interpreter's lock for so long that
threads lose more by waiting for it than they win (see docs/performance.md). Threads elsewhere.
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

from nlosctl.errors import MethodError

__all__ = ["CAN_FORK", "map_in_order", "map_in_processes", "usable_jobs"]

ItemT = TypeVar("ItemT")
ResultT = TypeVar("ResultT")

CAN_FORK = sys.platform == "linux"
"""Whether processes can share what is in memory: elsewhere the system's libraries don't bear being forked."""

_inherited: Callable[[Any], Any]


def map_in_order(function: Callable[[ItemT], ResultT], items: Iterable[ItemT], jobs: int) -> Iterator[ResultT]:
    """Yield ``function(item)`` for each item in order, with up to ``jobs`` threads.

    At most ``jobs`` + 1 items are held at a time. With one job no thread is made. The first error, of the function or
    of the stream, is raised where its result would have stood, and nothing more is begun.
    """
    if jobs == 1:
        yield from map(function, items)
        return
    with ThreadPoolExecutor(max_workers=jobs) as pool:
        yield from _in_order(pool, function, items, jobs)


def map_in_processes(
    function: Callable[[ItemT], ResultT], items: Iterable[ItemT], jobs: int
) -> Generator[ResultT, None, None]:
    """As `map_in_order`, with processes that inherit ``function``; items and results are sent to and fro.

    A single item is done here. Where processes can't be forked there are threads. Raises MethodError where a process
    dies; none outlives this one, or the end of the iteration.
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
        raise MethodError("a worker process was killed, perhaps for want of memory; try fewer `jobs`") from error
    finally:
        for future in pending:
            future.cancel()
    if failures:
        raise failures[0]


@contextmanager
def _forked_pool(function: Callable[[Any], Any], jobs: int) -> Iterator[Executor]:
    """Give a pool whose processes are stopped at once where the block does not end well, or not all can be made."""
    context = multiprocessing.get_context("fork")
    pool = ProcessPoolExecutor(jobs, mp_context=context, initializer=_begin_work, initargs=(function,))
    try:
        _start(pool)
        # With our end for writing closed, a result that a kill cuts off ends; else the rest of it would be waited for.
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
        with warnings.catch_warnings(), _signals_put_off():
            warnings.simplefilter("ignore", DeprecationWarning)  # forking beside threads, from Python 3.12 on
            pool.submit(os.getpid).result()
    except OSError as error:
        raise MethodError(f"no processes can be made: {error.strerror or error}; try fewer `jobs`") from error


@contextmanager
def _signals_put_off() -> Iterator[None]:
    """Let Ctrl-C and its like take effect at the end of the block: an exception raised while forking would be lost."""
    if threading.current_thread() is not threading.main_thread():
        yield  # no handler runs in this thread
        return
    came: list[int] = []
    interrupts = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGXCPU, signal.SIGALRM)
    handlers = {number: signal.getsignal(number) for number in interrupts}
    handlers = {number: handler for number, handler in handlers.items() if callable(handler)}
    for number in handlers:
        signal.signal(number, lambda number, frame: came.append(number))
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
        for caught in came:
            signal.raise_signal(caught)


def _begin_work(function: Callable[[Any], Any]) -> None:
    """Keep what is to be done, leave Ctrl-C to the parent, and end when it is gone."""
    global _inherited
    _inherited = function
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
    """Yield the items until the stream fails; then put its error into ``failures`` and end."""
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
