"""A run of several processes that read for themselves: each takes slices of the input, and sends back results alone."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

from nlosctl.contract.limits import size
from nlosctl.errors import MethodError, NlosctlError
from nlosctl.io.measurements.reader import MeasurementReader, ReadOptions
from nlosctl.io.measurements.survey import InputSurvey
from nlosctl.io.parts.row_group_slices import sliced
from nlosctl.io.paths.inputs import Input
from nlosctl.io.paths.locations import FileFormat
from nlosctl.pipeline.engine.id_order import IdOrder
from nlosctl.pipeline.engine.workers import CAN_FORK, map_in_processes
from nlosctl.pipeline.engine.writing import ChunkTables, Run

__all__ = ["tables_of"]

_SLICES_PER_JOB = 2


@dataclass(frozen=True, kw_only=True)
class _Work:
    inputs: tuple[Input, ...]
    options: ReadOptions
    found: InputSurvey
    start: Callable[[MeasurementReader], Run]

    def solve(self, place: tuple[int, int]) -> tuple[list[ChunkTables], dict[str, Any], dict[str, int], Any] | None:
        """Return the tables of a slice, what to count, the rows of its file, the span of its ids; None: a fault."""
        reader = MeasurementReader(self.inputs, self.options, found=self.found, only=place)
        run = self.start(reader)
        try:
            tables = list(run.tables())
        except NlosctlError:
            return None
        return tables, run.report.counts(), reader.report.rows_by_file, dataclasses.asdict(reader.spans[0])


def tables_of(run: Run, inputs: Sequence[Input], jobs: int) -> Iterator[ChunkTables]:
    """Yield the tables of a run, by ``jobs`` processes that read for themselves where the input allows it.

    That is where it is Parquet files with row groups enough and no bad rows are set aside. The results are the same;
    where anything is wrong the run is done over again in one go, for the errors to be the same too.
    """
    reader = run.reader
    if jobs == 1 or not CAN_FORK or reader.sets_bad_rows_aside or not _can_be_sliced(inputs):
        yield from run.tables(jobs)
        return
    pieces = sliced(inputs, size("slice_rows"))
    places = [(group, place) for group, given in enumerate(pieces) for place in range(len(given.parts))]
    if len(places) < _SLICES_PER_JOB * jobs:
        yield from run.tables(jobs)
        return
    options = dataclasses.replace(reader.options, use_threads=False)
    work = _Work(inputs=pieces, options=options, found=reader.found(), start=run.again())
    order = IdOrder(pieces, reader)
    rows = reader.report.rows_by_file
    with closing(map_in_processes(work.solve, places, jobs)) as results:
        for (group, _), solved in zip(places, results, strict=True):
            if solved is None:
                _run_in_one_go(work, inputs)
            tables, counts, rows_by_file, span = solved
            order.add(group, span)
            run.report.take(counts)
            for name, count in rows_by_file.items():
                rows[name] = rows.get(name, 0) + count
            yield from tables
    if any(not sum(rows[part.name] for part in given.parts) for given in inputs):
        _run_in_one_go(work, inputs)
    run.add_notes(reader.report.remarks)


def _can_be_sliced(inputs: Sequence[Input]) -> bool:
    # a store's connection does not bear being forked: this process reads then, the others solve
    return all(
        part.format is FileFormat.PARQUET and isinstance(part.path, Path) for given in inputs for part in given.parts
    )


def _run_in_one_go(work: _Work, inputs: Sequence[Input]) -> NoReturn:
    """Raise what the run raises when it is not cut into slices."""
    for _ in work.start(MeasurementReader(inputs, work.options, found=work.found)).tables():
        pass
    raise MethodError("a slice of the input could not be solved, but all of it can: the method is not deterministic")
