"""Run of an experiment from samples to files, for `nlosctl reproduce`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from nlosctl.errors import DataError, MissingExtraError
from nlosctl.io.results.array_file import write_arrays
from nlosctl.io.writers.locks import WriterLock
from nlosctl.reproduce.experiment import Experiment
from nlosctl.reproduce.outcome import ClaimRow, claim_rows, figure_columns
from nlosctl.reproduce.samples import Results
from nlosctl.reproduce.sampling import draw_samples
from nlosctl.reproduce.store import SampleStore
from nlosctl.version import __version__

__all__ = ["Outcome", "output_folder", "run_experiment"]


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """A finished experiment: rows of its claims, numbers of its figure, files written, trials per condition.

    ``resumed`` trials were already in the folder. ``without_pictures`` explains how to get pictures, if they could not
    be drawn.
    """

    experiment: Experiment
    rows: list[ClaimRow]
    numbers: Mapping[str, Any]
    files: list[Path]
    trials: int
    seed: int
    resumed: int
    without_pictures: str | None


def run_experiment(
    experiment: Experiment,
    *,
    seed: int,
    trials: int,
    folder: Path | None,
    overwrite: bool,
    jobs: int,
    progress: Callable[[int, int | None], None],
) -> Outcome:
    """Sample the trials, or read them from ``folder``, and write the figure's numbers and picture there.

    Raises DataError if ``folder`` has samples of another seed, number of trials or version, without ``overwrite``, or
    if another run of the experiment writes there.
    """
    with _locked(folder, experiment.name):
        return _run(
            experiment, seed=seed, trials=trials, folder=folder, overwrite=overwrite, jobs=jobs, progress=progress
        )


def _locked(folder: Path | None, name: str) -> AbstractContextManager[object]:
    if folder is None:
        return nullcontext()
    return WriterLock(folder / f".{name}.lock", f"{folder}, {name}")


def _run(
    experiment: Experiment,
    *,
    seed: int,
    trials: int,
    folder: Path | None,
    overwrite: bool,
    jobs: int,
    progress: Callable[[int, int | None], None],
) -> Outcome:
    store = None
    if folder is not None:
        store = SampleStore(folder, experiment, experiment.fingerprint(seed, trials, __version__))
        store.open(overwrite=overwrite)
    results, resumed = draw_samples(experiment, seed=seed, trials=trials, store=store, jobs=jobs, progress=progress)
    files: list[Path] = []
    numbers = figure_columns(experiment, results)
    without_pictures = None
    if folder is not None:
        files.append(folder / f"{experiment.name}.parquet")
        metadata = {"nlosctl.reproduce": experiment.fingerprint(seed, trials, __version__)}
        write_arrays(files[0], numbers, metadata)
        try:
            files += _pictures(experiment, results, folder)
        except MissingExtraError as error:
            without_pictures = str(error)
    return Outcome(
        experiment=experiment,
        rows=claim_rows(experiment, results),
        numbers=numbers,
        files=files,
        trials=trials,
        seed=seed,
        resumed=resumed,
        without_pictures=without_pictures,
    )


def _pictures(experiment: Experiment, results: Results, folder: Path) -> list[Path]:
    from nlosctl.plotting.figures import save_figure
    from nlosctl.plotting.panel_drawing import draw_panels

    paths = [folder / f"{experiment.name}.{extension}" for extension in ("png", "svg")]
    panels = experiment.panels(results)
    if not panels:
        return []
    figure = draw_panels(experiment.title, panels)
    for path in paths:
        save_figure(figure, path, overwrite=True)
    return paths


def output_folder(name: str) -> Path:
    """Return the folder ``name``, created if necessary; raise DataError if that fails."""
    folder = Path(name)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DataError(f"{name}: can't create the folder for the results: {error.strerror}") from error
    return folder
