"""The samples of an experiment in a folder, so that an interrupted run goes on where it stopped.

While it runs: a file for each chunk of each condition in ``NAME.parts/``; when all are there:
``NAME.samples.parquet``. Each carries the fingerprint of what it depends on, and a digest of what is in it: one of
another run, or a damaged one, is never used.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.errors import DataError
from nlosctl.io.results.array_file import read_arrays, write_arrays
from nlosctl.reproduce.experiment import Experiment
from nlosctl.reproduce.samples import Drawn, Samples

__all__ = ["SampleStore"]

_KEY = "nlosctl.reproduce"
_CONDITION = "condition"


class SampleStore:
    """The samples of one experiment in ``folder``, those with ``fingerprint`` alone."""

    def __init__(self, folder: Path, experiment: Experiment, fingerprint: str) -> None:
        self._experiment, self._fingerprint = experiment, fingerprint
        self._whole = folder / f"{experiment.name}.samples.parquet"
        self._parts = folder / f"{experiment.name}.parts"

    def open(self, *, overwrite: bool) -> None:
        """Make ready for a run; raises DataError where whole samples are there that are not its own, and must stay."""
        complete = self._read(self._whole) is not None
        if self._whole.exists() and not complete and not overwrite:
            raise DataError(
                f"{self._whole}: is of another seed, number of trials or version, or damaged; --overwrite replaces it, "
                "or choose another folder with -o"
            )
        if self._parts.exists() and complete:
            shutil.rmtree(self._parts)

    def part(self, condition: int, chunk: int) -> Samples | None:
        """Return the samples of a finished chunk, None where it is not there as it was written."""
        return self._read(self._part_path(condition, chunk))

    def keep(self, condition: int, chunk: int, samples: Samples) -> None:
        """Store the samples of a finished chunk."""
        self._parts.mkdir(parents=True, exist_ok=True)
        write_arrays(self._part_path(condition, chunk), samples, {_KEY: self._fingerprint})

    def finish(self, drawn: Drawn) -> None:
        """Store all samples as one file, and remove the parts."""
        names = list(dict.fromkeys(name for samples in drawn.samples for name in samples))
        sizes = [next(iter(samples.values())).shape[0] for samples in drawn.samples]
        columns = {
            name: np.concatenate(
                [
                    samples[name].astype(np.float64) if name in samples else np.full(size, np.nan)
                    for samples, size in zip(drawn.samples, sizes, strict=True)
                ]
            )
            for name in names
        }
        place = np.repeat(np.arange(len(sizes), dtype=np.int64), sizes)
        write_arrays(self._whole, {_CONDITION: place, **columns}, {_KEY: self._fingerprint})
        shutil.rmtree(self._parts, ignore_errors=True)

    def load(self) -> Drawn | None:
        """Return all samples, None where they are not all there as they were written."""
        columns = self._read(self._whole)
        if columns is None:
            return None
        place = columns.pop(_CONDITION)
        conditions = self._experiment.conditions
        samples = [
            {name: values[place == number] for name, values in columns.items()} for number in range(len(conditions))
        ]
        return Drawn(conditions=conditions, samples=samples, random=self._experiment.random)

    def _read(self, path: Path) -> dict[str, FloatArray] | None:
        """Return the samples in a file, None where it is not there, damaged, or another run's."""
        if not path.exists():
            return None
        try:
            samples, metadata = read_arrays(path)
        except DataError:
            return None
        return samples if metadata.get(_KEY) == self._fingerprint else None

    def _part_path(self, condition: int, chunk: int) -> Path:
        return self._parts / f"{condition:04d}-{chunk:05d}.parquet"
