"""Work on a stream of chunks with several threads, results in the order of the stream."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

__all__ = ["map_in_order", "usable_jobs"]

ItemT = TypeVar("ItemT")
ResultT = TypeVar("ResultT")


def map_in_order(function: Callable[[ItemT], ResultT], items: Iterable[ItemT], jobs: int) -> Iterator[ResultT]:
    """Yield ``function(item)`` for each item in order, with up to ``jobs`` threads.

    At most ``jobs`` + 1 items are held at a time. With one job no thread is made. The first error, of the function or
    of the stream, is raised where its result would have stood, and nothing more is begun.
    """
    if jobs == 1:
        for item in items:
            yield function(item)
        return
    pending: deque[Future[ResultT]] = deque()
    failures: list[Exception] = []
    with ThreadPoolExecutor(max_workers=jobs) as pool:
        try:
            for item in _until_failure(items, failures):
                pending.append(pool.submit(function, item))
                if len(pending) > jobs:
                    yield pending.popleft().result()
            while pending:
                yield pending.popleft().result()
        finally:
            for future in pending:
                future.cancel()
    if failures:
        raise failures[0]


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


def usable_jobs(jobs: int) -> int:
    """Return ``jobs``, or for 0 as many as the processors that this process may use."""
    return (
        jobs if jobs > 0 else len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    )
