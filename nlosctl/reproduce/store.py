"""The samples of an experiment in a folder, so that an interrupted run continues where it stopped.

During a run there is a file for each chunk of each condition in ``NAME.parts/``, after it ``NAME.samples.parquet``.
Each file holds the experiment's fingerprint and a digest of its content: files of another run, and damaged ones, are
not used.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.errors import DataError
from nlosctl.io.results.array_file import read_arrays, write_arrays
from nlosctl.reproduce.experiment import Experiment
from nlosctl.reproduce.samples import Results, Samples

__all__ = ["SampleStore"]

_KEY = "nlosctl.reproduce"
_CONDITION = "condition"


class SampleStore:
    """The samples of one experiment in ``folder`` that have this ``fingerprint``."""

    def __init__(self, folder: Path, experiment: Experiment, fingerprint: str) -> None:
        self._experiment, self._fingerprint = experiment, fingerprint
        self._complete = folder / f"{experiment.name}.samples.parquet"
        self._parts = folder / f"{experiment.name}.parts"

    def open(self, *, overwrite: bool) -> None:
        """Prepare for a run; without ``overwrite``, raise DataError if there are complete samples of another run."""
        is_ours = self._read(self._complete) is not None
        if self._complete.exists() and not is_ours and not overwrite:
            raise DataError(
                f"{self._complete}: has another seed, number of trials or version, or is damaged; `overwrite` replaces "
                "it, or choose another folder with -o"
            )
        if self._parts.exists() and is_ours:
            shutil.rmtree(self._parts)

    def part(self, condition: int, chunk: int) -> Samples | None:
        """Return the samples of a finished chunk; None if absent, damaged or of another run."""
        return self._read(self._part_path(condition, chunk))

    def keep(self, condition: int, chunk: int, samples: Samples) -> None:
        """Store the samples of a finished chunk."""
        self._parts.mkdir(parents=True, exist_ok=True)
        write_arrays(self._part_path(condition, chunk), samples, {_KEY: self._fingerprint})

    def finish(self, results: Results) -> None:
        """Store all samples in one file, and remove the parts."""
        names = list(dict.fromkeys(name for samples in results.samples for name in samples))
        sizes = [next(iter(samples.values())).shape[0] for samples in results.samples]
        columns = {
            name: np.concatenate(
                [
                    samples[name].astype(np.float64) if name in samples else np.full(size, np.nan)
                    for samples, size in zip(results.samples, sizes, strict=True)
                ]
            )
            for name in names
        }
        condition = np.repeat(np.arange(len(sizes), dtype=np.int64), sizes)
        write_arrays(self._complete, {_CONDITION: condition, **columns}, {_KEY: self._fingerprint})
        shutil.rmtree(self._parts, ignore_errors=True)

    def load(self) -> Results | None:
        """Return all samples; None if absent, damaged or of another run."""
        columns = self._read(self._complete)
        if columns is None:
            return None
        condition = columns.pop(_CONDITION)
        conditions = self._experiment.conditions
        samples = [
            {name: values[condition == number] for name, values in columns.items()} for number in range(len(conditions))
        ]
        return Results(conditions=conditions, samples=samples, random=self._experiment.random)

    def _read(self, path: Path) -> dict[str, FloatArray] | None:
        """Return the samples in a file; None if absent, damaged or of another run."""
        if not path.exists():
            return None
        try:
            samples, metadata = read_arrays(path)
        except DataError:
            return None
        return samples if metadata.get(_KEY) == self._fingerprint else None

    def _part_path(self, condition: int, chunk: int) -> Path:
        return self._parts / f"{condition:04d}-{chunk:05d}.parquet"
