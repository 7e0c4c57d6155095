"""Parts of a run made by the workers of a Dask cluster: they are sent names and ranges, and write part files."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from typing import Any

from nlosctl.errors import MissingExtraError, UsageError
from nlosctl.pipeline.engine.folder_run import Engine, Records
from nlosctl.pipeline.engine.parts import PartWork
from nlosctl.version import __version__

__all__ = ["dask_engine"]

_SECONDS_TO_ANSWER = 20
_SECONDS_FOR_A_WORKER = 60
_SILENT = logging.CRITICAL + 1


def dask_engine(scheduler: str | None, jobs: int) -> Engine:
    """Return the engine of a cluster: that of ``scheduler`` (tcp://host:port), else a local one of ``jobs`` workers.

    A part whose worker is lost is made by another. Raises MissingExtraError without Dask; the engine raises
    UsageError where no scheduler or no worker answers, or a worker has another version.
    """
    try:
        distributed: Any = import_module("distributed")
    except ImportError:
        raise MissingExtraError("--engine dask", "distributed", "dask") from None

    def make(work: PartWork, numbers: Sequence[int]) -> Records:
        with _client(distributed, scheduler, jobs) as client:
            shared = client.submit(_itself, work.with_absolute_paths(), pure=False)
            futures = {
                client.submit(_make, shared, number, __version__, key=f"nlosctl-part-{os.getpid()}-{number}"): number
                for number in numbers
            }
            for future in distributed.as_completed(list(futures)):
                yield futures[future], future.result()
                future.release()

    return make


def _itself(work: PartWork) -> PartWork:
    return work


def _make(work: PartWork, number: int, version: str) -> dict[str, Any]:
    if version != __version__:
        raise UsageError(f"--engine dask: a worker has nlosctl {__version__}, expected {version}; give all one version")
    return work.make(number)


@contextmanager
def _client(distributed: Any, scheduler: str | None, jobs: int) -> Iterator[Any]:
    for name in ("distributed", "distributed.client", "distributed.comm", "distributed.nanny", "distributed.core"):
        logging.getLogger(name).setLevel(_SILENT)  # what goes wrong is told by us, once
    cluster = None
    if scheduler is None:
        cluster = distributed.LocalCluster(
            n_workers=jobs,
            threads_per_worker=1,
            dashboard_address=":0",
            host="127.0.0.1",
            silence_logs=_SILENT,
        )
    try:
        try:
            client = distributed.Client(cluster or scheduler, timeout=_SECONDS_TO_ANSWER)
        except (OSError, ValueError, TimeoutError) as error:
            raise UsageError(
                f"--scheduler {scheduler}: no Dask scheduler answers there: {_first_line(error)}"
            ) from error
        try:
            client.wait_for_workers(1, timeout=_SECONDS_FOR_A_WORKER)
            yield client
        except TimeoutError as error:
            raise UsageError(f"--scheduler {scheduler}: no worker has joined in {_SECONDS_FOR_A_WORKER} s") from error
        finally:
            client.close()
    finally:
        if cluster is not None:
            cluster.close()


def _first_line(error: BaseException) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0]
