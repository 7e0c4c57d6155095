"""The Monte-Carlo loop: chunks of trials for each condition, in one process or several, resumable."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from functools import partial

import numpy as np

from nlosctl.pipeline.engine.workers import map_in_processes
from nlosctl.reproduce.experiment import Chunk, Experiment
from nlosctl.reproduce.samples import Results, Samples
from nlosctl.reproduce.store import SampleStore

__all__ = ["draw_samples"]

Task = tuple[int, Chunk]


def draw_samples(
    experiment: Experiment,
    *,
    seed: int,
    trials: int,
    store: SampleStore | None,
    jobs: int,
    progress: Callable[[int, int | None], None],
) -> tuple[Results, int]:
    """Return the samples of all conditions, and how many trials of them were already in the store.

    They depend neither on the number of jobs nor on the store. ``progress`` is called with the number of finished
    trials and their total.
    """
    complete = store.load() if store is not None else None
    total = trials * len(experiment.conditions)
    if complete is not None:
        return complete, total
    chunks = experiment.chunks(seed, trials)
    parts: dict[tuple[int, int], Samples] = {}
    missing: list[Task] = []
    resumed = 0
    for number, chunk in ((number, chunk) for number in range(len(experiment.conditions)) for chunk in chunks):
        stored = store.part(number, chunk.number) if store is not None else None
        if stored is None:
            missing.append((number, chunk))
        else:
            parts[number, chunk.number] = stored
            resumed += chunk.size
    done = resumed
    progress(done, total)
    with closing(map_in_processes(partial(_sample, experiment), missing, jobs)) as sampled:
        for (number, chunk), samples in zip(missing, sampled, strict=True):
            if store is not None:
                store.keep(number, chunk.number, samples)
            parts[number, chunk.number] = samples
            done += chunk.size
            progress(done, total)
    results = _joined(experiment, parts, len(chunks))
    if store is not None:
        store.finish(results)
    return results, resumed


def _sample(experiment: Experiment, task: Task) -> Samples:
    condition, chunk = task
    samples = experiment.sample(experiment.conditions[condition], chunk)
    for name, values in samples.items():
        if values.shape != (chunk.size,):
            raise ValueError(f"{experiment.name}: {name} has shape {values.shape}, expected {(chunk.size,)}")
    return {name: np.asarray(values, dtype=np.float64) for name, values in samples.items()}


def _joined(experiment: Experiment, parts: dict[tuple[int, int], Samples], chunks: int) -> Results:
    samples = []
    for number in range(len(experiment.conditions)):
        own = [parts[number, chunk] for chunk in range(chunks)]
        samples.append({name: np.concatenate([part[name] for part in own]) for name in own[0]})
    return Results(conditions=experiment.conditions, samples=samples, random=experiment.random)
