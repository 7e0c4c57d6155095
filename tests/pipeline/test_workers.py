"""Threads on a stream: order, errors, and how much is held at a time."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nlosctl.pipeline.workers import map_in_order, usable_jobs


@settings(deadline=None, max_examples=40)
@given(st.lists(st.integers(0, 3), max_size=20), st.integers(1, 5))
def test_results_come_in_the_order_of_the_items(pauses: list[int], jobs: int) -> None:
    """However long each takes, results leave in the order of the stream."""

    def work(item: tuple[int, int]) -> int:
        time.sleep(0.0003 * item[1])
        return item[0]

    assert list(map_in_order(work, enumerate(pauses), jobs)) == list(range(len(pauses)))


def drain(stream: Iterator[int], seen: list[int]) -> None:
    """Take results one by one, so that those before an error are kept."""
    for result in stream:
        seen.append(result)


@pytest.mark.parametrize("jobs", [1, 2, 4])
def test_the_first_error_stands_in_its_place(jobs: int) -> None:
    """Results before the first error come out, then that error: not a later one that was quicker; no more is begun."""
    begun = []

    def work(item: int) -> int:
        begun.append(item)
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
    assert max(begun) <= 6 + jobs


@pytest.mark.parametrize("jobs", [1, 2, 4])
def test_an_error_of_the_stream_stands_in_its_place_too(jobs: int) -> None:
    """When reading fails, what was read before comes out first: the same for any number of workers."""

    def items() -> Iterator[int]:
        yield from range(5)
        raise OSError("the file ends here")

    seen: list[int] = []
    with pytest.raises(OSError, match="the file ends here"):
        drain(map_in_order(lambda item: item, items(), jobs), seen)
    assert seen == list(range(5))


@pytest.mark.parametrize("jobs", [1, 2, 5])
def test_few_items_are_held(jobs: int) -> None:
    """Never more than jobs + 1 items are taken from the stream that have not come out."""
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
    """Two jobs wait for each other: they meet only if both run at once."""
    barrier = threading.Barrier(2, timeout=10)
    assert list(map_in_order(lambda item: barrier.wait() >= 0, range(2), 2)) == [True, True]


def test_one_job_makes_no_thread() -> None:
    """With one job everything happens in the caller's thread, an item at a time."""
    mine = threading.get_ident()
    assert set(map_in_order(lambda item: threading.get_ident(), range(5), 1)) == {mine}


def test_stopping_early_stops_the_work() -> None:
    """Who takes no more results leaves no thread and no item behind."""
    begun = []
    before = threading.active_count()
    stream = map_in_order(lambda item: begun.append(item), range(1000), 3)
    next(stream)
    stream.close()  # type: ignore[attr-defined]
    assert len(begun) <= 4
    assert threading.active_count() == before


def test_no_jobs_means_as_many_as_there_are() -> None:
    """0 is the number of processors that this process may use; any other number is itself."""
    assert usable_jobs(0) == len(os.sched_getaffinity(0))
    assert [usable_jobs(jobs) for jobs in (1, 7)] == [1, 7]
