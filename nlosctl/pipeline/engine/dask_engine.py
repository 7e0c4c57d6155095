"""Tasks of a run on the workers of a Dask cluster, which receive names and ranges and read the input themselves."""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from nlosctl.errors import MethodError, MissingExtraError, UsageError
from nlosctl.pipeline.engine.slices import Engine, Work
from nlosctl.version import __version__

__all__ = ["dask_engine"]

_SECONDS_TO_ANSWER = 20.0
_SECONDS_BETWEEN_LOOKS = 1.0
_SECONDS_TO_IMPORT = 15.0
"""Scheduler and workers may be silent for so long before the first result, because they import libraries."""

_SECONDS_TO_LEAVE = 2.0
_TASKS_PER_THREAD = 4
"""Limits the number of results that wait for an earlier one."""

_SILENT = logging.CRITICAL + 1


def dask_engine(scheduler: str | None, jobs: int, timeout_s: float) -> Engine:
    """Return the engine of the cluster of ``scheduler`` (tcp://host:port), else of ``jobs`` threads of this process.

    If a worker is lost, another worker repeats its tasks. Raises MissingExtraError without Dask; the engine raises
    UsageError if no scheduler or worker answers, or a worker has another version, and MethodError if the scheduler or
    all workers have been silent for ``timeout_s``.
    """
    try:
        distributed: Any = import_module("distributed")
    except ImportError:
        raise MissingExtraError("`engine` dask", "distributed", "dask") from None

    def make(work: Work, numbers: Sequence[int]) -> Generator[Any, None, None]:
        with _client(distributed, scheduler, jobs, timeout_s) as client:
            watched = _Watched(distributed, client, scheduler, max(timeout_s, _SECONDS_TO_IMPORT))
            most = _TASKS_PER_THREAD * max(1, watched.threads())
            shared = client.submit(_unchanged, work.with_absolute_paths(), pure=False)
            pending: deque[Any] = deque()
            for number in numbers:
                pending.append(client.submit(_make, shared, number, __version__, pure=False))
                if len(pending) >= most:
                    yield watched.result(pending.popleft())
                    watched.timeout_s = timeout_s
            while pending:
                yield watched.result(pending.popleft())
                watched.timeout_s = timeout_s

    return make


@dataclass
class _Watched:
    """Results of a cluster that may be lost while they are awaited; its longest silence is ``timeout_s``."""

    distributed: Any
    client: Any
    scheduler: str | None
    timeout_s: float

    def threads(self) -> int:
        """Return the number of threads of all workers."""
        try:
            workers = self._workers(self.timeout_s)
        except (TimeoutError, OSError) as error:
            raise self._lost("the Dask scheduler does not answer") from error
        return sum(worker["nthreads"] for worker in workers.values())

    def result(self, future: Any) -> Any:
        """Return the result of a task; raise its error, or MethodError if the cluster is silent for too long."""
        while True:
            self._await(future)
            try:
                return future.result(timeout=self.timeout_s)
            except TimeoutError as error:
                if future.status == "error":
                    raise  # the task's own
                if future.status != "pending":  # else its worker was lost with the result, and it is repeated
                    raise self._silent(self._unanswering()) from error
            except (CancelledError, self.distributed.comm.CommClosedError) as error:
                raise self._lost("the connection to the Dask scheduler was lost") from error
            except self.distributed.scheduler.KilledWorker as error:
                raise MethodError(
                    "a task was given up after several Dask workers had ended in it, perhaps for lack of memory"
                ) from error

    def _await(self, future: Any) -> None:
        """Wait until a task has ended; raise MethodError when scheduler or workers are silent for too long."""
        alive = answered = time.monotonic()
        signs = None
        ended = threading.Event()
        future.add_done_callback(lambda _: ended.set())
        while not ended.wait(min(_SECONDS_BETWEEN_LOOKS, self.timeout_s / 4.0)):
            try:
                workers = self._workers(max(0.1, answered + self.timeout_s - time.monotonic()))
            except (TimeoutError, OSError, AttributeError) as error:  # without a connection the client has no scheduler
                if time.monotonic() > answered + self.timeout_s:
                    raise self._silent("the Dask scheduler does not answer") from error
                continue
            answered = time.monotonic()
            now = {address: worker["last_seen"] for address, worker in workers.items()}
            if workers and now != signs:
                alive, signs = answered, now
            if answered > alive + self.timeout_s:
                raise self._silent("no Dask worker answers" if workers else "no Dask worker is left")

    def _unanswering(self) -> str:
        """Return who does not send a result that is there."""
        try:
            self._workers(min(self.timeout_s, _SECONDS_TO_ANSWER))
        except (TimeoutError, OSError, AttributeError):
            return "the Dask scheduler does not answer"
        return "no Dask worker answers"

    def _workers(self, timeout_s: float) -> dict[str, dict[str, Any]]:
        workers: dict[str, dict[str, Any]] = self.client.sync(
            self.client.scheduler.identity, callback_timeout=timeout_s
        )["workers"]
        return workers

    def _silent(self, what: str) -> MethodError:
        return self._lost(f"{what} for {self.timeout_s:g} s (`worker_timeout`)")

    def _lost(self, what: str) -> MethodError:
        name = "`engine` dask" if self.scheduler is None else f"`scheduler` {self.scheduler}"
        return MethodError(f"{name}: {what}; a run into a folder continues with `resume`")


def _unchanged(work: Work) -> Work:
    return work


def _make(work: Work, number: int, version: str) -> Any:
    if version != __version__:
        found = f"a worker has nlosctl {__version__}, expected {version}"
        raise UsageError(f"`engine` dask: {found}; install the same version everywhere")
    return work.make(number)


@contextmanager
def _client(distributed: Any, scheduler: str | None, jobs: int, timeout_s: float) -> Iterator[Any]:
    quiet = (
        "distributed",
        "distributed.client",
        "distributed.comm",
        "distributed.nanny",
        "distributed.core",
        "asyncio",
    )
    for name in quiet:
        logging.getLogger(name).setLevel(_SILENT)  # each error is reported once, by the run
    cluster = None if scheduler is not None else _local_cluster(distributed, jobs)
    try:
        try:
            client = distributed.Client(cluster or scheduler, timeout=min(_SECONDS_TO_ANSWER, timeout_s))
        except (OSError, ValueError, TimeoutError) as error:
            raise UsageError(
                f"`scheduler` {scheduler}: no Dask scheduler answers there: {_first_line(error)}"
            ) from error
        try:
            _await_worker(client, scheduler, timeout_s)
            yield client
        finally:
            with suppress(TimeoutError, OSError):  # a scheduler that was stopped does not answer
                client.close(timeout=_SECONDS_TO_LEAVE)
    finally:
        if cluster is not None:
            cluster.close()


def _local_cluster(distributed: Any, jobs: int) -> Any:
    """Return a cluster of threads: its messages stay in this process, so that no other user can send it any.

    Dask starts web servers in any case; they are on loopback and have no pages.
    """
    address = "127.0.0.1:0"
    routes: dict[str, list[str]] = {f"distributed.{part}.http.routes": [] for part in ("scheduler", "worker")}
    with import_module("dask").config.set(routes):
        return distributed.LocalCluster(
            n_workers=jobs,
            threads_per_worker=1,
            processes=False,
            dashboard_address=address,
            worker_dashboard_address=address,
            silence_logs=_SILENT,
        )


def _await_worker(client: Any, scheduler: str | None, timeout_s: float) -> None:
    try:
        client.wait_for_workers(1, timeout=timeout_s)
    except TimeoutError as error:
        raise UsageError(
            f"`scheduler` {scheduler}: no worker has joined in {timeout_s:g} s (`worker_timeout`)"
        ) from error


def _first_line(error: BaseException) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0]
