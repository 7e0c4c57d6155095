"""Passes over the whole input before a run: the sums of a statistic of its chunks, in bounded memory.

The sums are exact, so that they have the same bits for any number of processes, any engine, and any cut of the input.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from nlosctl.contract.run_options import InputOptions
from nlosctl.errors import NlosctlError
from nlosctl.geometry.exact_sums import ExactSums
from nlosctl.io.measurements.reader import Chunk, MeasurementReader
from nlosctl.io.measurements.survey import InputSurvey
from nlosctl.io.paths.inputs import Input
from nlosctl.pipeline.engine.slices import Engine, Work, absolute, parallel_slices, task_positions, task_slices
from nlosctl.pipeline.engine.workers import map_in_processes

__all__ = ["InputPasses", "Statistic"]

Statistic = Callable[[Chunk], ExactSums]


@dataclass(frozen=True, kw_only=True)
class InputPasses:
    """Reads inputs as often as wanted, by ``jobs`` processes or by an ``engine``.

    Streams among the ``inputs`` have `Part.reopen`. Bad rows are left out if ``ignores_bad_rows``, else
    they raise the DataError of a run.
    """

    inputs: tuple[Input, ...]
    options: InputOptions
    survey: InputSurvey
    jobs: int
    engine: Engine | None = None
    ignores_bad_rows: bool = False

    def pool(self, statistic: Statistic, columns: Sequence[str] = ()) -> ExactSums:
        """Return the sums of a statistic over all chunks; raises the errors of reading and those of the statistic.

        The statistic may use the ``columns`` of a chunk's table.
        """
        total = ExactSums()
        for sums in self._parts(statistic, columns):
            if sums is None:  # the error must not depend on the slices
                return self._pool_here(statistic, columns)
            total.merge(sums)
        return total

    def _parts(self, statistic: Statistic, columns: Sequence[str]) -> Iterator[ExactSums | None]:
        if self.engine is not None:
            slices, engine = task_slices(self.inputs, self.options), self.engine
        else:
            slices, engine = parallel_slices(self.inputs, self.options, self.jobs), self._by_processes
        if not slices:
            yield self._pool_here(statistic, columns)
            return
        work = _PassWork(passes=replace(self, inputs=slices, engine=None), statistic=statistic)
        with closing(engine(work, range(len(work.positions)))) as results:
            yield from results

    def _by_processes(self, work: Work, numbers: Sequence[int]) -> Generator[Any, None, None]:
        return map_in_processes(work.make, numbers, self.jobs)

    def _pool_here(self, statistic: Statistic, columns: Sequence[str]) -> ExactSums:
        """Return the sums of chunks that this process reads."""
        total = ExactSums()
        with closing(self.reader()) as reader:
            chunks = map(partial(_with_columns, columns=list(columns)), reader.chunks())
            with closing(map_in_processes(statistic, chunks, self.jobs)) as parts:
                for sums in parts:
                    total.merge(sums)
        return total

    def reader(self, only: tuple[int, int] | None = None) -> MeasurementReader:
        """Return a reader of the inputs, or of the snapshots that begin in one part."""
        sink = (lambda rows: None) if self.ignores_bad_rows else None
        options = replace(self.options, use_threads=self.options.use_threads and only is None)
        return MeasurementReader(self.inputs, options, sink, survey=self.survey, only=only)


def _with_columns(chunk: Chunk, columns: list[str]) -> Chunk:
    """Return the chunk with only these columns of its table: it may be sent to a process."""
    return replace(chunk, table=chunk.table.select([name for name in columns if name in chunk.table.column_names]))


@dataclass(frozen=True, kw_only=True)
class _PassWork:
    """One pass over slices of the input: names and options, no data."""

    passes: InputPasses
    statistic: Statistic

    @property
    def positions(self) -> tuple[tuple[int, int], ...]:
        """The positions of the slices: index of the input, index of the slice within it."""
        return task_positions(self.passes.inputs, self.passes.options)

    def make(self, number: int) -> ExactSums | None:
        """Return the sums of a slice; None: a fault."""
        total = ExactSums()
        reader = self.passes.reader(self.positions[number])
        try:
            for chunk in reader.chunks():
                total.merge(self.statistic(chunk))
        except NlosctlError:
            return None
        return total

    def with_absolute_paths(self) -> _PassWork:
        """Return the same work for a process with another current folder."""
        return replace(self, passes=replace(self.passes, inputs=absolute(self.passes.inputs)))
