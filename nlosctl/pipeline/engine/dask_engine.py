"""Tasks of a run on the workers of a Dask cluster, which receive names and ranges and read the input themselves."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from typing import Any

from nlosctl.errors import MissingExtraError, UsageError
from nlosctl.pipeline.engine.slices import Engine, Work
from nlosctl.version import __version__

__all__ = ["dask_engine"]

_SECONDS_TO_ANSWER = 20
_SECONDS_FOR_A_WORKER = 60
_TASKS_PER_THREAD = 4
"""Limits the number of results that wait for an earlier one."""

_SILENT = logging.CRITICAL + 1


def dask_engine(scheduler: str | None, jobs: int) -> Engine:
    """Return the engine of the cluster of ``scheduler`` (tcp://host:port), else of a local one of ``jobs`` workers.

    If a worker is lost, another worker repeats its tasks. Raises MissingExtraError without Dask; the engine raises
    UsageError if no scheduler or worker answers, or a worker has another version.
    """
    try:
        distributed: Any = import_module("distributed")
    except ImportError:
        raise MissingExtraError("`engine` dask", "distributed", "dask") from None

    def make(work: Work, numbers: Sequence[int]) -> Generator[Any, None, None]:
        with _client(distributed, scheduler, jobs) as client:
            shared = client.submit(_unchanged, work.with_absolute_paths(), pure=False)
            most = _TASKS_PER_THREAD * max(1, sum(client.nthreads().values()))
            pending: deque[Any] = deque()
            for number in numbers:
                pending.append(client.submit(_make, shared, number, __version__, pure=False))
                if len(pending) >= most:
                    yield pending.popleft().result()
            while pending:
                yield pending.popleft().result()

    return make


def _unchanged(work: Work) -> Work:
    return work


def _make(work: Work, number: int, version: str) -> Any:
    if version != __version__:
        found = f"a worker has nlosctl {__version__}, expected {version}"
        raise UsageError(f"`engine` dask: {found}; install the same version everywhere")
    return work.make(number)


@contextmanager
def _client(distributed: Any, scheduler: str | None, jobs: int) -> Iterator[Any]:
    for name in ("distributed", "distributed.client", "distributed.comm", "distributed.nanny", "distributed.core"):
        logging.getLogger(name).setLevel(_SILENT)  # each error is reported once, by the run
    cluster = None
    if scheduler is None:
        cluster = distributed.LocalCluster(
            n_workers=jobs, threads_per_worker=1, dashboard_address=":0", host="127.0.0.1", silence_logs=_SILENT
        )
    try:
        try:
            client = distributed.Client(cluster or scheduler, timeout=_SECONDS_TO_ANSWER)
        except (OSError, ValueError, TimeoutError) as error:
            raise UsageError(
                f"`scheduler` {scheduler}: no Dask scheduler answers there: {_first_line(error)}"
            ) from error
        try:
            client.wait_for_workers(1, timeout=_SECONDS_FOR_A_WORKER)
            yield client
        except TimeoutError as error:
            raise UsageError(f"`scheduler` {scheduler}: no worker has joined in {_SECONDS_FOR_A_WORKER} s") from error
        finally:
            client.close()
    finally:
        if cluster is not None:
            cluster.close()


def _first_line(error: BaseException) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0]
