"""The one Monte-Carlo loop: conditions times chunks of trials, on one process or several, resumable."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from contextlib import contextmanager
from multiprocessing import get_context, parent_process

import numpy as np

from nlosctl.reproduce.catalogue import find_experiment
from nlosctl.reproduce.experiment import Chunk, Experiment
from nlosctl.reproduce.samples import Drawn, Samples
from nlosctl.reproduce.store import SampleStore

__all__ = ["draw_samples", "worker_pool"]

Task = tuple[int, Chunk]


def draw_samples(
    experiment: Experiment,
    *,
    seed: int,
    trials: int,
    store: SampleStore | None,
    pool: Executor | None,
    progress: Callable[[int, int | None], None],
) -> tuple[Drawn, int]:
    """Return the samples of all conditions, and how many trials of them were in the store already.

    They are the same whatever the pool, and whether they come from the store or not. ``progress`` is told the trials
    done and their total.
    """
    whole = store.load() if store is not None else None
    if whole is not None:
        return whole, trials * len(experiment.conditions)
    chunks = experiment.chunks(seed, trials)
    tasks = [(number, chunk) for number in range(len(experiment.conditions)) for chunk in chunks]
    parts: dict[tuple[int, int], Samples] = {}
    for number, chunk in tasks if store is not None else []:
        known = store.part(number, chunk.number) if store is not None else None
        if known is not None:
            parts[number, chunk.number] = known
    missing = [task for task in tasks if (task[0], task[1].number) not in parts]
    resumed = sum(chunk.size for number, chunk in tasks if (number, chunk.number) in parts)
    done, total = resumed, trials * len(experiment.conditions)
    progress(done, total)
    for (number, chunk), samples in _sampled(experiment, missing, pool):
        if store is not None:
            store.keep(number, chunk.number, samples)
        parts[number, chunk.number] = samples
        done += chunk.size
        progress(done, total)
    drawn = _gathered(experiment, parts, len(chunks))
    if store is not None:
        store.finish(drawn)
    return drawn, resumed


def _sampled(experiment: Experiment, tasks: list[Task], pool: Executor | None) -> Iterator[tuple[Task, Samples]]:
    """Yield each task with its samples, in the order in which they are ready."""
    if pool is None:
        for number, chunk in tasks:
            yield (number, chunk), _checked(experiment, chunk, experiment.sample(experiment.conditions[number], chunk))
        return
    with _interrupts_held():  # processes begin here, and take over what is held until they ignore it
        pending: dict[Future[Samples], Task] = {
            pool.submit(_work, experiment.name, number, chunk): (number, chunk) for number, chunk in tasks
        }
    try:
        while pending:
            ready, _ = wait(pending, return_when=FIRST_COMPLETED)
            for future in ready:
                yield pending.pop(future), future.result()
    finally:
        for future in pending:
            future.cancel()


def _work(name: str, condition: int, chunk: Chunk) -> Samples:
    experiment = find_experiment(name)
    return _checked(experiment, chunk, experiment.sample(experiment.conditions[condition], chunk))


def _checked(experiment: Experiment, chunk: Chunk, samples: Samples) -> Samples:
    for name, values in samples.items():
        if values.shape != (chunk.size,):
            raise ValueError(f"{experiment.name}: {name} has shape {values.shape}, expected {(chunk.size,)}")
    return {name: np.asarray(values, dtype=np.float64) for name, values in samples.items()}


def _gathered(experiment: Experiment, parts: dict[tuple[int, int], Samples], chunks: int) -> Drawn:
    samples = []
    for number in range(len(experiment.conditions)):
        own = [parts[number, chunk] for chunk in range(chunks)]
        samples.append({name: np.concatenate([part[name] for part in own]) for name in own[0]})
    return Drawn(conditions=experiment.conditions, samples=samples, random=experiment.random)


@contextmanager
def worker_pool(jobs: int) -> Iterator[Executor | None]:
    """Give a pool of ``jobs`` processes, or None for one job; at an error or Ctrl-C, what has not begun is dropped."""
    if jobs == 1:
        yield None
        return
    pool = ProcessPoolExecutor(jobs, mp_context=get_context("spawn"), initializer=_begin_work)
    try:
        yield pool
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Let Ctrl-C wait for the end of the block, and for ever in the processes that begin in it."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin_work() -> None:
    """Leave Ctrl-C to the parent, and end when it is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
