"""Slices of the input, solved independently and joined in order."""

from __future__ import annotations

import dataclasses
from bisect import bisect_left
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NoReturn, Protocol

from nlosctl.contract.limits import size
from nlosctl.contract.run_options import InputOptions
from nlosctl.errors import MethodError, NlosctlError, UsageError
from nlosctl.io.measurements.reader import WHOLE, MeasurementReader, refuse_no_rows
from nlosctl.io.measurements.survey import InputSurvey
from nlosctl.io.parts.part_files import sliced
from nlosctl.io.paths.inputs import Input
from nlosctl.io.paths.locations import FileFormat
from nlosctl.pipeline.engine.workers import CAN_FORK, map_in_processes
from nlosctl.pipeline.engine.writing import ChunkTables, Run

__all__ = [
    "Engine",
    "IdOrder",
    "SliceError",
    "SliceWork",
    "absolute",
    "cluster_tables",
    "local_tables",
    "parallel_slices",
    "positions_of",
    "refuse_streams",
    "task_positions",
    "task_slices",
]

_SLICES_PER_JOB = 2


class Work(Protocol):
    """Work that is cut into numbered tasks and can be sent to another process."""

    def make(self, number: int) -> Any:
        """Execute a task and return its result."""

    def with_absolute_paths(self) -> Any:
        """Return the same work for a process with another current folder."""


Engine = Callable[[Work, Sequence[int]], Generator[Any, None, None]]
"""Executes the tasks with these numbers and yields their results in order."""


class SliceError(Exception):
    """A slice has a fault; the whole input is solved at once then, so that the error does not depend on the slices."""


@dataclass(frozen=True, kw_only=True)
class SliceWork:
    """Everything that is needed to solve any slice of the input: names and options, no data.

    ``inputs`` are cut into slices; task N solves the slice at ``positions[N]`` (index of the input, index of the slice
    within it).
    """

    inputs: tuple[Input, ...]
    options: InputOptions
    survey: InputSurvey
    start: Callable[[MeasurementReader], Run]
    positions: tuple[tuple[int, int], ...]

    def make(
        self, number: int
    ) -> (
        tuple[
            list[ChunkTables], dict[str, Any], tuple[dict[str, int], dict[str, int], set[str], set[str]], dict[str, Any]
        ]
        | None
    ):
        """Return the tables of a slice, its counts, what is known of its file, and the span of its ids.

        Of the file: its rows (all, and unused), the sensors that are valid, those without calibration. None: a fault.
        """
        reader = MeasurementReader(self.inputs, self.options, survey=self.survey, only=self.positions[number])
        run = self.start(reader)
        try:
            tables = list(run.tables())
        except NlosctlError:
            return None
        read = reader.report
        rows = read.rows_by_file, dict(read.unused_rows), read.valid_sensors, read.uncalibrated
        return tables, run.report.counts(), rows, dataclasses.asdict(reader.spans[0])

    def with_absolute_paths(self) -> SliceWork:
        """Return the same work for a process with another current folder."""
        return replace(self, inputs=absolute(self.inputs))

    def tables(self, run: Run, engine: Engine, spans: list[dict[str, Any]] | None = None) -> Iterator[ChunkTables]:
        """Yield the tables of all slices in order; the counts go to ``run`` and its reader, the spans to ``spans``.

        Raises SliceError for a fault.
        """
        order = IdOrder(self.inputs, run.reader)
        rows = run.reader.report.rows_by_file
        with closing(engine(self, range(len(self.positions)))) as results:
            for (group, _), result in zip(self.positions, results, strict=True):
                if result is None:
                    raise SliceError
                tables, counts, (rows_by_file, unused_rows, valid_sensors, uncalibrated), span = result
                order.add(group, span)
                if spans is not None:
                    spans.append(span)
                run.report.take(counts)
                run.reader.report.unused_rows.update(unused_rows)
                run.reader.report.valid_sensors |= valid_sensors
                run.reader.report.uncalibrated |= uncalibrated
                for name, count in rows_by_file.items():
                    rows[name] = rows.get(name, 0) + count
                yield from tables


def local_tables(
    run: Run, start: Callable[[MeasurementReader], Run], inputs: Sequence[Input], jobs: int
) -> Iterator[ChunkTables]:
    """Yield the tables of a run by ``jobs`` processes, which read the input themselves if it is large Parquet files.

    Otherwise, and if bad rows are set aside, this process reads and the others solve.
    """
    slices = () if run.reader.sets_bad_rows_aside else parallel_slices(inputs, run.reader.options, jobs)
    if slices:
        yield from _tables(run, start, inputs, slices, lambda work, numbers: map_in_processes(work.make, numbers, jobs))
    else:
        yield from run.tables(jobs)


def parallel_slices(inputs: Sequence[Input], options: InputOptions, jobs: int) -> tuple[Input, ...]:
    """Return the slices that ``jobs`` processes read themselves; empty: they don't, this process reads."""
    if jobs > 1 and CAN_FORK and options.window is None and _is_local_parquet(inputs):
        slices = sliced(inputs, size("slice_rows"))
        if sum(len(given.parts) for given in slices) >= _SLICES_PER_JOB * jobs:
            return slices
    return ()


def cluster_tables(
    run: Run, start: Callable[[MeasurementReader], Run], inputs: Sequence[Input], engine: Engine
) -> Iterator[ChunkTables]:
    """Yield the tables of a run whose slices ``engine`` solves; raises UsageError if the input cannot be cut."""
    refuse_streams(inputs)
    if run.reader.sets_bad_rows_aside:
        raise UsageError("`engine` dask with `bad_rows` FILE: set `output` and `bad_rows` to a folder each")
    yield from _tables(run, start, inputs, task_slices(inputs, run.reader.options), engine)


def task_slices(inputs: Sequence[Input], options: InputOptions) -> tuple[Input, ...]:
    """Return the inputs as tasks of an engine read them: in slices, or whole if windows need all rows."""
    return tuple(inputs) if options.window is not None else sliced(inputs, size("task_rows"))


def refuse_streams(inputs: Sequence[Input]) -> None:
    """Raise UsageError if an input is a stream, which workers of a cluster can't read."""
    if any(part.path is None for given in inputs for part in given.parts):
        raise UsageError("standard input cannot be distributed; save it as a file, or leave `engine` out")


def _tables(
    run: Run,
    start: Callable[[MeasurementReader], Run],
    inputs: Sequence[Input],
    slices: tuple[Input, ...],
    engine: Engine,
) -> Iterator[ChunkTables]:
    reader = run.reader
    options = replace(reader.options, use_threads=False)
    survey = reader.survey()
    positions = task_positions(slices, options)
    work = SliceWork(inputs=slices, options=options, survey=survey, start=start, positions=positions)
    try:
        yield from work.tables(run, engine)
    except SliceError:
        _solve_at_once(work, inputs)
    rows = reader.report.rows_by_file
    if any(not sum(rows[part.name] for part in given.parts) for given in inputs):
        _solve_at_once(work, inputs)
    refuse_no_rows(inputs, sum(rows.values()) - reader.report.unused_rows.total(), reader.report)
    run.add_notes([*reader.report.remarks, *reader.report.remarks_on_all(reader.scene)])


def task_positions(slices: Sequence[Input], options: InputOptions) -> tuple[tuple[int, int], ...]:
    """Return the positions of the tasks on `task_slices`."""
    return positions_of(slices) if options.window is None else tuple((group, WHOLE) for group in range(len(slices)))


def _solve_at_once(work: SliceWork, inputs: Sequence[Input]) -> NoReturn:
    """Raise the error of the run over the whole input."""
    for _ in work.start(MeasurementReader(inputs, work.options, survey=work.survey)).tables():
        pass
    raise MethodError("the results depend on how the input is cut: the method is not deterministic")


def _is_local_parquet(inputs: Sequence[Input]) -> bool:
    # the connection to a store cannot be used in a forked process
    return all(
        part.format is FileFormat.PARQUET and isinstance(part.path, Path) for given in inputs for part in given.parts
    )


def positions_of(inputs: Sequence[Input]) -> tuple[tuple[int, int], ...]:
    """Return the position of every part: index of the input, index of the part within it."""
    return tuple((group, index) for group, given in enumerate(inputs) for index in range(len(given.parts)))


def absolute(inputs: Sequence[Input]) -> tuple[Input, ...]:
    """Return the inputs with absolute paths; they keep their names."""
    return tuple(
        replace(given, parts=tuple(replace(part, path=part.path and part.path.absolute()) for part in given.parts))
        for given in inputs
    )


@dataclass
class IdOrder:
    """Checks that no snapshot is in two parts, by the span of the ids of each part.

    Parts whose spans do not overlap share no snapshot. Otherwise all ids are read once, which raises the same DataError
    as a read of the whole input.
    """

    inputs: Sequence[Input]
    reader: MeasurementReader
    _ends: dict[int, list[tuple[Any, Any]]] = field(default_factory=dict)
    _sure: bool = False

    def add(self, group: int, span: Mapping[str, Any]) -> None:
        """Add a part of the input with index ``group``; ``span`` has the fields of `IdSpan`."""
        if self._sure or span["first"] is None or len(self.inputs[group].parts) == 1:
            return
        low, high = sorted((span["first"], span["last"]))
        ends = self._ends.setdefault(group, [])
        index = bisect_left(ends, (low, high))
        apart = (index == 0 or ends[index - 1][1] < low) and (index == len(ends) or high < ends[index][0])
        if not (apart and span["ordered"]):
            self._read_all()
        ends.insert(index, (low, high))

    def _read_all(self) -> None:
        reader = MeasurementReader(self.inputs, self.reader.options, lambda rows: None, survey=self.reader.survey())
        for _ in reader.chunks():
            pass
        self._sure = True
