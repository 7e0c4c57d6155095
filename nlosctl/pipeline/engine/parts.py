"""The parts of a run into folders: each task writes the part files and a record, in any order."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from nlosctl.contract.run_options import InputOptions
from nlosctl.io.measurements.reader import MeasurementReader
from nlosctl.io.measurements.survey import InputSurvey
from nlosctl.io.parts.run_folder import RunFolder, describe_file
from nlosctl.io.paths.inputs import Input
from nlosctl.io.paths.locations import FileFormat, location
from nlosctl.io.writers.output_set import OutputSet
from nlosctl.io.writers.table_writer import BadRowWriter, TableWriter
from nlosctl.pipeline.engine.slices import absolute
from nlosctl.pipeline.engine.writing import ChunkTables, Run, write_tables

__all__ = ["BAD_ROWS", "PartWork"]

BAD_ROWS = "bad_rows"


@dataclass(frozen=True, kw_only=True)
class PartWork:
    """Everything that is needed to write any part of a run: names and options, no data.

    ``roots`` are the folders of the tables by name, ``names`` the part files in each, ``positions`` the parts of the
    input (index of the input, index of the part within it) in the same order.
    """

    command: str
    inputs: tuple[Input, ...]
    options: InputOptions
    survey: InputSurvey
    start: Callable[[MeasurementReader], Run]
    roots: Mapping[str, str]
    names: tuple[str, ...]
    positions: tuple[tuple[int, int], ...]
    format: FileFormat
    with_hash: bool
    overwrite: bool

    def make(self, number: int, jobs: int = 1) -> dict[str, Any]:
        """Write the files of one part, keep its record, and return it.

        The files are complete under their names before the record is written; a repetition writes the same bytes.
        """
        reader = self.reader(number)
        run = self.start(reader)
        return self.write(number, reader, run, run.tables(jobs), lambda: asdict(reader.spans[0]))

    def reader(self, number: int) -> MeasurementReader:
        """Return a reader of the snapshots that start in one part."""
        return MeasurementReader(self.inputs, self.options, survey=self.survey, only=self.positions[number])

    def write(
        self,
        number: int,
        reader: MeasurementReader,
        run: Run,
        tables: Iterable[ChunkTables],
        span: Callable[[], dict[str, Any]],
    ) -> dict[str, Any]:
        """Write the files of one part from its tables, as `make` does; ``reader`` passes on the bad rows.

        After the last table, ``reader`` and ``run`` have counted all rows, and ``span`` returns the span of the ids.
        """
        group, index = self.positions[number]
        given = self.inputs[group]
        part = Input(name=given.name, parts=(given.parts[index],))

        def metadata() -> dict[str, str]:
            return run.metadata(self.command, [part], with_hash=self.with_hash)

        with OutputSet() as outputs:
            writers = {table: outputs.take(self._writer(table, number, run, metadata())) for table in self.roots}
            if BAD_ROWS in writers:
                reader.set_bad_rows_aside(BadRowWriter(writers[BAD_ROWS]))
            sinks = {table: writer for table, writer in writers.items() if table != BAD_ROWS}
            write_tables(tables, sinks, metadata, lambda rows: None)
        files = {
            table: describe_file(self.roots[table], self.names[number], writer.rows)
            for table, writer in writers.items()
        }
        name = part.parts[0].name
        record = {
            "input": name,
            "rows": reader.report.rows_by_file.get(name, 0),
            "unused_rows": dict(reader.report.unused_rows),
            "valid_sensors": sorted(reader.report.valid_sensors),
            **({"uncalibrated": sorted(reader.report.uncalibrated)} if reader.report.uncalibrated else {}),
            "files": files,
            "counts": run.report.counts(),
            "span": span(),
        }
        RunFolder(self.roots).keep(number, record)
        return record

    @property
    def is_remote(self) -> bool:
        """Whether an input or an output is in a store."""
        paths = [part.path for given in self.inputs for part in given.parts]
        return any(not isinstance(path, Path) for path in [*paths, *map(location, self.roots.values())])

    def with_absolute_paths(self) -> PartWork:
        """Return the same work for a process with another current folder."""
        roots = {table: str(location(root).absolute()) for table, root in self.roots.items()}
        return replace(self, inputs=absolute(self.inputs), roots=roots)

    def _writer(self, table: str, number: int, run: Run, metadata: Mapping[str, str]) -> TableWriter:
        schema = BadRowWriter.schema(self.survey.schema.names) if table == BAD_ROWS else run.schemas[table]
        target = location(self.roots[table]) / self.names[number]
        target.parent.mkdir(parents=True, exist_ok=True)
        return TableWriter(
            str(target),
            schema,
            format=self.format,
            overwrite=self.overwrite,
            repeats=True,
            metadata={} if table == BAD_ROWS else metadata,
        )
