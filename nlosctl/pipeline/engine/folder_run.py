"""A run into folders: one part file per part of the input; finished parts are kept, the manifest is written last."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from contextlib import closing
from itertools import pairwise
from typing import Any

from nlosctl.errors import DataError, MethodError, UsageError
from nlosctl.io.measurements.reader import MeasurementReader, refuse_no_rows
from nlosctl.io.parts.part_files import part_names
from nlosctl.io.parts.run_folder import RunFolder
from nlosctl.io.paths.inputs import Input
from nlosctl.io.paths.locations import FileFormat
from nlosctl.io.scenes.scene_file import scene_to_toml
from nlosctl.pipeline.engine.parts import BAD_ROWS, PartWork
from nlosctl.pipeline.engine.slices import Engine, IdOrder, SliceError, SliceWork, positions_of, task_slices
from nlosctl.pipeline.engine.workers import map_in_processes
from nlosctl.pipeline.engine.writing import Run, describe_inputs
from nlosctl.version import __version__

__all__ = ["FolderRun"]

Records = Generator[tuple[int, dict[str, Any]], None, None]


class FolderRun:
    """Writes the tables of ``run`` (not started) over ``inputs`` into the folders ``roots`` (table name -> folder).

    ``start`` returns an equal run over another reader. Raises UsageError if an input is a stream.
    """

    def __init__(
        self,
        run: Run,
        start: Callable[[MeasurementReader], Run],
        command: str,
        inputs: Sequence[Input],
        roots: Mapping[str, str],
        *,
        format: FileFormat | None,
        with_hash: bool,
    ) -> None:
        if any(part.path is None for given in inputs for part in given.parts):
            raise UsageError("standard input has no parts: set `output` to a file, or save the input as one")
        self._run, self._start, self._command = run, start, command
        self._inputs, self._with_hash = tuple(inputs), with_hash
        self._folder = RunFolder(roots)
        self._format = format or FileFormat.PARQUET
        self._names = part_names(inputs, self._format)
        self._positions = positions_of(inputs)

    def write(
        self, engine: Engine | None, jobs: int, *, resume: bool, overwrite: bool, progress: Callable[[int], None]
    ) -> None:
        """Write every missing part, then the manifests; the run's report covers all parts.

        Without ``engine``, ``jobs`` processes of this machine do the work. ``progress`` receives the number of rows
        done. Raises DataError if another run writes into a folder, and the errors of `RunFolder.open` and of the parts.
        """
        with self._folder.locked():
            self._write(engine, jobs, resume=resume, overwrite=overwrite, progress=progress)

    def _write(
        self, engine: Engine | None, jobs: int, *, resume: bool, overwrite: bool, progress: Callable[[int], None]
    ) -> None:
        described = describe_inputs(self._inputs, {}, with_hash=self._with_hash)
        plan = self._plan(described)
        records = self._folder.open(plan, self._modified(), resume=resume, overwrite=overwrite)
        order = IdOrder(self._inputs, self._run.reader)
        for number in sorted(records):
            order.add(self._positions[number][0], records[number]["span"])
        missing = [number for number in range(len(self._names)) if number not in records]
        rows = _rows(records.values())
        work = self._work(overwrite=overwrite)
        made = _made_here(work, missing, jobs) if engine is None else _made_by(engine, work, missing)
        with closing(made):
            for number, record in made if missing else ():
                records[number] = record
                order.add(self._positions[number][0], record["span"])
                rows += _rows([record])
                progress(rows)
        self._count(records)
        self._folder.finish(plan, records, self._run.report.as_dict())

    def _work(self, *, overwrite: bool) -> PartWork:
        reader = self._run.reader
        return PartWork(
            command=self._command,
            inputs=self._inputs,
            options=reader.options,
            survey=reader.survey(),
            start=self._start,
            roots=self._folder.roots,
            names=tuple(self._names),
            positions=self._positions,
            format=self._format,
            with_hash=self._with_hash,
            overwrite=overwrite,
        )

    def _plan(self, described: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
        """Return everything that the bytes of the part files depend on."""
        reader = self._run.reader
        read = reader.options
        return {
            "version": __version__,
            "command": self._command,
            **self._run.provenance(),
            **self._run.choices(),
            "kind": reader.kind,
            "max_snapshot_rows": read.max_snapshot_rows,
            "scene": scene_to_toml(reader.scene),
            "tables": list(self._folder.roots),
            "format": self._format.value,
            "inputs": list(described),
            "parts": self._names,
        }

    def _modified(self) -> dict[str, int]:
        parts = [part for given in self._inputs for part in given.parts]
        return {part.name: part.path.stat().st_mtime_ns for part in parts if part.path is not None}

    def _count(self, records: Mapping[int, Mapping[str, Any]]) -> None:
        report, read = self._run.report, self._run.reader.report
        for number in sorted(records):
            try:
                report.take(records[number]["counts"])
                read.unused_rows.update(records[number]["unused_rows"])
                read.valid_sensors.update(records[number]["valid_sensors"])
                read.uncalibrated.update(records[number].get("uncalibrated", ()))
            except (KeyError, TypeError, ValueError, AttributeError) as error:
                name = self._names[number]
                raise DataError(
                    f"{name}: its record was changed after it was written; start over with `overwrite`"
                ) from error
        rows_by_group = [0] * len(self._inputs)
        for number, (group, _) in enumerate(self._positions):
            rows_by_group[group] += _rows([records[number]])
        for given, rows in zip(self._inputs, rows_by_group, strict=True):
            if not rows:
                raise DataError(f"{given.name}: no rows: the files have columns only")
        refuse_no_rows(self._inputs, sum(rows_by_group) - read.unused_rows.total(), read)
        remarks = [*read.remarks, *read.remarks_on_all(self._run.reader.scene)]
        lost = getattr(report, "snapshots_lost", 0)
        if lost:
            remarks.append(f"all rows of {lost} snapshots are bad: they are left out")
        self._run.add_notes(remarks)


def _rows(records: Iterable[Mapping[str, Any]]) -> int:
    """Return the number of input rows of these parts."""
    return sum(record["rows"] for record in records)


def _made_here(work: PartWork, numbers: Sequence[int], jobs: int) -> Records:
    """Write parts by processes of this machine, one part each at a time; all of them share a single part."""
    if len(numbers) == 1 or work.is_remote:  # the connection to a store cannot be used in a forked process
        yield from ((number, work.make(number, jobs)) for number in numbers)
        return
    try:
        with closing(map_in_processes(work.make, numbers, jobs)) as records:
            yield from zip(numbers, records, strict=True)
    except BaseException:  # killed processes leave temporary files
        RunFolder(work.roots).remove_temporary_files(work.names)
        raise


def _made_by(engine: Engine, work: PartWork, numbers: Sequence[int]) -> Records:
    """Write parts by an engine; a part with more slices than there are parts is cut into them, unless it has bad rows.

    After a fault in a slice the part is solved as a whole, which raises the error.
    """
    slices = task_slices(work.inputs, work.options)
    of_part = _slices_of_parts(work, slices)
    shared = [n for n in numbers if len(of_part[n]) > len(numbers) and BAD_ROWS not in work.roots]
    single = [number for number in numbers if number not in shared]
    if single:
        with closing(engine(work, single)) as records:
            yield from zip(single, records, strict=True)
    for number in shared:
        try:
            record = _made_from_slices(engine, work, number, slices, of_part[number])
        except (SliceError, DataError, MethodError):
            record = work.make(number)
        yield number, record


def _slices_of_parts(work: PartWork, slices: Sequence[Input]) -> list[list[tuple[int, int]]]:
    """Return the positions of the slices of each part."""
    names = [[part.name for part in given.parts] for given in slices]
    return [
        [(group, index) for index, name in enumerate(names[group]) if name == work.inputs[group].parts[part].name]
        for group, part in work.positions
    ]


def _made_from_slices(
    engine: Engine, work: PartWork, number: int, slices: tuple[Input, ...], positions: Sequence[tuple[int, int]]
) -> dict[str, Any]:
    """Write the files of a part from the results of its slices, and return its record."""
    reader = work.reader(number)
    run = work.start(reader)
    slice_work = SliceWork(
        inputs=slices, options=work.options, survey=work.survey, start=work.start, positions=tuple(positions)
    )
    spans: list[dict[str, Any]] = []
    return work.write(number, reader, run, slice_work.tables(run, engine, spans), lambda: _joined(spans))


def _joined(spans: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the span of the ids of consecutive slices, equal to that of one read of all of them."""
    ends = [end for span in spans if span["first"] is not None for end in {span["first"]: 0, span["last"]: 0}]
    if not ends:
        return {"first": None, "last": None, "ordered": True}
    steps = list(pairwise(ends))
    sorted_ends = all(a < b for a, b in steps) or all(a > b for a, b in steps)
    return {"first": ends[0], "last": ends[-1], "ordered": sorted_ends and all(span["ordered"] for span in spans)}
