"""A run into folders: a part file for each part of the input, what is done kept, the manifest at the end."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from contextlib import closing
from typing import Any

from nlosctl.errors import DataError, UsageError
from nlosctl.io.parts.part_names import part_names
from nlosctl.io.parts.run_folder import RunFolder
from nlosctl.io.paths.inputs import Input
from nlosctl.io.paths.locations import FileFormat
from nlosctl.io.scenes.scene_file import scene_to_toml
from nlosctl.pipeline.engine.id_order import IdOrder
from nlosctl.pipeline.engine.parts import PartWork
from nlosctl.pipeline.engine.provenance import describe_inputs
from nlosctl.pipeline.engine.workers import map_in_processes
from nlosctl.pipeline.engine.writing import Run
from nlosctl.version import __version__

__all__ = ["Engine", "FolderRun", "Records", "in_this_machine"]

Records = Generator[tuple[int, dict[str, Any]], None, None]
Engine = Callable[[PartWork, Sequence[int]], Records]
"""Makes the parts of these numbers, and gives the record of each as it is done, in any order."""

_KEPT_IN_PLAN = ("kind", "renames", "constants", "all_rows", "max_snapshot_rows")


def in_this_machine(jobs: int) -> Engine:
    """Return the engine of this machine: ``jobs`` processes, each at a part; at a single part they share its rows."""

    def make(work: PartWork, numbers: Sequence[int]) -> Records:
        if len(numbers) == 1 or work.is_remote:  # a store's connection does not bear being forked
            yield from ((number, work.make(number, jobs)) for number in numbers)
            return
        try:
            with closing(map_in_processes(work.make, numbers, jobs)) as records:
                yield from zip(numbers, records, strict=True)
        except BaseException:  # processes that are stopped leave what they are writing
            RunFolder(work.roots).remove_temporary_files(work.names)
            raise

    return make


class FolderRun:
    """``run`` (not begun) over ``inputs``, its tables into the folders ``roots`` (table name -> folder).

    Raises UsageError where an input is a stream.
    """

    def __init__(
        self,
        run: Run,
        command: str,
        inputs: Sequence[Input],
        roots: Mapping[str, str],
        *,
        format: FileFormat | None,
        with_hash: bool,
    ) -> None:
        if any(part.path is None for given in inputs for part in given.parts):
            raise UsageError("standard input has no parts: give -o a file, or save the input as one")
        self._run, self._command, self._inputs, self._with_hash = run, command, tuple(inputs), with_hash
        self._folder = RunFolder(roots)
        self._format = format or FileFormat.PARQUET
        self._names = part_names(inputs, self._format)

    def write(self, engine: Engine, *, resume: bool, overwrite: bool, progress: Callable[[int], None]) -> None:
        """Make every part that is missing, then the manifests; the run's report tells all parts.

        ``progress`` is told how many rows have been done. Raises DataError as `RunFolder.open` and the parts do.
        """
        described = describe_inputs(self._inputs, {}, with_hash=self._with_hash)
        plan = self._plan(described)
        records = self._folder.open(plan, self._modified(), resume=resume, overwrite=overwrite)
        order, places = IdOrder(self._inputs, self._run.reader), self._places()
        for number in sorted(records):
            order.add(places[number][0], records[number]["span"])
        missing = [number for number in range(len(self._names)) if number not in records]
        rows = _rows(records.values())
        with closing(engine(self._work(), missing)) as made:
            for number, record in made if missing else ():
                records[number] = record
                order.add(places[number][0], record["span"])
                rows += _rows([record])
                progress(rows)
        self._tell(records)
        self._folder.finish(plan, records, self._run.report.as_dict())

    def _work(self) -> PartWork:
        reader = self._run.reader
        return PartWork(
            command=self._command,
            inputs=self._inputs,
            options=reader.options,
            found=reader.found(),
            start=self._run.again(),
            roots=self._folder.roots,
            names=tuple(self._names),
            places=tuple(self._places()),
            format=self._format,
            with_hash=self._with_hash,
        )

    def _places(self) -> list[tuple[int, int]]:
        return [(group, place) for group, given in enumerate(self._inputs) for place in range(len(given.parts))]

    def _plan(self, described: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
        """Return everything that the bytes of the part files depend on."""
        reader = self._run.reader
        options = {name: getattr(reader.options, name) for name in _KEPT_IN_PLAN}
        return {
            "version": __version__,
            "command": self._command,
            **self._run.provenance(),
            **self._run.choices(),
            **options,
            "kind": reader.kind,
            "scene": scene_to_toml(reader.scene),
            "tables": list(self._folder.roots),
            "format": self._format.value,
            "inputs": list(described),
            "parts": self._names,
        }

    def _modified(self) -> dict[str, int]:
        parts = [part for given in self._inputs for part in given.parts]
        return {part.name: part.path.stat().st_mtime_ns for part in parts if part.path is not None}

    def _tell(self, records: Mapping[int, Mapping[str, Any]]) -> None:
        report, remarks = self._run.report, list(self._run.reader.report.remarks)
        for number in sorted(records):
            try:
                report.take(records[number]["counts"])
            except (KeyError, TypeError, ValueError, AttributeError) as error:
                name = self._names[number]
                raise DataError(
                    f"{name}: its record was changed after it was written; begin anew with --overwrite"
                ) from error
        rows_by_group = [0] * len(self._inputs)
        for number, (group, _) in enumerate(self._places()):
            rows_by_group[group] += _rows([records[number]])
        for given, rows in zip(self._inputs, rows_by_group, strict=True):
            if not rows:
                raise DataError(f"{given.name}: no rows: the files have columns and nothing else")
        lost = getattr(report, "snapshots_lost", 0)
        if lost:
            remarks.append(f"all rows of {lost} snapshots are bad: they are left out")
        self._run.add_notes(remarks)


def _rows(records: Iterable[Mapping[str, Any]]) -> int:
    """Return how many rows the inputs of these parts have."""
    return sum(record["rows"] for record in records)
