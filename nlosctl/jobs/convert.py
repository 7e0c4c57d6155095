"""Job: convert other programs' files to tables, tables to other formats, and estimates to maps."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from nlosctl.contract.run_options import InputOptions, OutputOptions
from nlosctl.errors import UsageError, hide_secrets
from nlosctl.io.conversion.table_copy import TableCopy
from nlosctl.io.conversion.window_copy import WindowCopy
from nlosctl.io.measurements.row_checks import ProblemLog
from nlosctl.io.paths.inputs import Input
from nlosctl.io.paths.locations import FileFormat, Location, format_named, format_of_path, location
from nlosctl.io.results.in_memory import input_of_table
from nlosctl.io.row_steps.unused_rows import unused_rows_remark
from nlosctl.io.scenes.scene_file import plane_of
from nlosctl.io.writers.output_set import OutputSet, check_targets
from nlosctl.jobs.files import bad_row_writer, naming_importer, open_inputs, open_output, require_window
from nlosctl.pipeline.convert.importer import Import
from nlosctl.pipeline.convert.map_writer import MapWriter, exporter_of
from nlosctl.pipeline.engine.writing import file_metadata

__all__ = ["ConversionReport", "convert"]


@dataclass(frozen=True, kw_only=True)
class ConversionReport:
    """Rows written, bad rows set aside, whether the output format cannot store the scene, importer, and remarks."""

    rows: int
    bad_rows: int
    loses_scene: bool
    importer: str | None = None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class _Source:
    """An open input: the tables of its rows, their schema and metadata, and the log of its bad rows.

    ``remarks`` are complete after the last table.
    """

    tables: Iterator[Any]
    schema: Any
    metadata: dict[str, str]
    log: ProblemLog
    importer: str | None = None
    notes: tuple[str, ...] = ()
    remarks: Sequence[str] = ()
    unused_rows: Counter[str] = field(default_factory=Counter)

    @property
    def scene(self) -> str | None:
        """The scene as TOML, or None."""
        return self.metadata.get("nlosctl.scene")


def convert(
    inputs: Sequence[str] | Sequence[Input],
    read: InputOptions,
    write: OutputOptions,
    *,
    importer: str | None = None,
    exporter: str | None = None,
    parameters: dict[str, Any],
    protected: Sequence[str | None] = (),
    receiver: Callable[[Any, dict[str, str]], Any] | None = None,
) -> ConversionReport:
    """Convert one input to one output, by an importer or as a table, and by an exporter or as a table.

    An importer may take several files. ``parameters`` are those of the exporter, else of the importer. ``receiver``
    returns, for schema and metadata, a receiver of the rows of a table that replaces the output. Raises DataError for
    faults of the data, UsageError for options that do not apply.
    """
    if read.frame is not None:
        plane_of(read.frame)  # report an unusable CRS before anything is read
    names = [
        *(name for name in inputs if isinstance(name, str) and name != "-"),
        read.scene if isinstance(read.scene, str) else None,
        *protected,
    ]
    paths = [location(name) for name in names if name is not None]
    to_importer = {} if exporter is not None else parameters
    to_exporter = {} if importer is not None and exporter is None else parameters
    exporter = exporter or exporter_of(write.output, write.format)
    with OutputSet() as outputs:
        check_targets([write.output, write.scene_out, write.bad_rows], overwrite=write.overwrite, inputs=paths)
        require_window(read)
        if importer is not None:
            opened = _imported([str(name) for name in inputs], importer, to_importer, read, write, outputs, paths)
        else:
            opened = _table(inputs, read, write, outputs, paths)
        with opened as source:
            if read.constants or read.default_constants:
                source = _with_constants(source, read, exporter, str(inputs[0]))
            if write.scene_out is not None:
                outputs.write_text(write.scene_out, source.scene or "", overwrite=write.overwrite)
            common: dict[str, Any] = {"overwrite": write.overwrite, "inputs": paths, "metadata": source.metadata}
            loses_scene = False
            if exporter is not None:
                sink: Any = outputs.take(MapWriter(write.output, exporter, to_exporter, frame=read.frame, **common))
            elif to_exporter:
                raise UsageError("`param` is for importers and exporters; a table has none")
            elif receiver is not None:
                sink = receiver(source.schema, source.metadata)
            else:
                chosen = None if write.format is None else format_named(write.format)
                kind = chosen or (FileFormat.CSV if write.output == "-" else format_of_path(write.output))
                loses_scene = source.scene is not None and not kind.carries_metadata
                sink = outputs.take(
                    open_output(write.output, source.schema, write, paths, source.metadata, of_measurements=True)
                )
            rows = 0
            for table in source.tables:
                sink.write(table)
                rows += table.num_rows
    unused = [unused_rows_remark(source.unused_rows)] if source.unused_rows else []
    return ConversionReport(
        rows=rows,
        bad_rows=source.log.total,
        loses_scene=loses_scene,
        importer=source.importer,
        notes=(*source.notes, *source.remarks, *unused),
    )


def _with_constants(source: _Source, read: InputOptions, exporter: str | None, name: str) -> _Source:
    """Return the source with columns of constants; raise UsageError for a map, which has no measurements."""
    from nlosctl.io.conversion.constant_columns import new_constants, with_constants

    if exporter is not None:
        if read.constants:
            raise UsageError(f"`constants[{next(iter(read.constants))!r}]` is for tables of measurements, not for maps")
        return source
    constants = new_constants(read, source.schema, name)
    schema = next(with_constants(iter([source.schema.empty_table()]), constants)).schema
    return dataclasses.replace(source, tables=with_constants(source.tables, constants), schema=schema)


@contextmanager
def _imported(
    names: Sequence[str],
    importer: str,
    parameters: dict[str, Any],
    read: InputOptions,
    write: OutputOptions,
    outputs: OutputSet,
    paths: Sequence[Location],
) -> Iterator[_Source]:
    """Read another program's file, or several, by an importer."""
    if read.input_format is not None:
        raise UsageError("`input_format` is for tables; `from` names the importer")
    if read.window_keep != "all":
        raise UsageError("`window_keep` is for tables; give it to the command that reads the table")
    if read.window is not None:
        if "window" in parameters:
            raise UsageError("`param` window and `window` are the same; give one")
        parameters = {**parameters, "window": read.window}
    job = Import(
        importer,
        parameters,
        scene_file=read.scene if isinstance(read.scene, str) else None,
        frame=read.frame,
        bad_rows=bad_row_writer(write, (), outputs, paths),
        by=read.by,
    )
    imported = job.read(*names)
    content = {
        "importer": imported.importer,
        "parameters": parameters,
        "inputs": [{"name": hide_secrets(name)} for name in names],
    }
    metadata = file_metadata("convert", content, imported.scene)
    tables, schema, unused_rows = iter([imported.table]), imported.table.schema, Counter[str]()
    if read.changes_rows:
        copy = TableCopy(dataclasses.replace(input_of_table(imported.table), name=hide_secrets(names[0])), read)
        tables, schema, unused_rows = copy.tables(), copy.schema, copy.unused_rows
    yield _Source(
        tables=tables,
        schema=schema,
        metadata=metadata,
        log=job.log,
        importer=imported.importer,
        notes=imported.notes,
        unused_rows=unused_rows,
    )


@contextmanager
def _table(
    inputs: Sequence[str] | Sequence[Input],
    read: InputOptions,
    write: OutputOptions,
    outputs: OutputSet,
    paths: Sequence[Location],
) -> Iterator[_Source]:
    """Read a table unchanged."""
    with naming_importer(inputs):
        try:
            (given, *more) = open_inputs(inputs, read.input_format)
        except UsageError as error:
            hint = "a file of another program: `from` NAME ('nlosctl convert' lists them)"
            raise UsageError(f"{error}; {hint}") from None
        if more:
            raise UsageError("convert takes one input; convert the files of a glob one by one, or name their folder")
        copy = TableCopy(given, read) if read.window is None else WindowCopy(given, read)
    try:
        bad_rows = bad_row_writer(write, copy.schema.names, outputs, paths)
        if bad_rows is not None:
            copy.set_bad_rows_aside(bad_rows)
        yield _Source(
            tables=copy.tables(),
            schema=copy.schema,
            metadata=copy.metadata,
            log=copy.log,
            notes=given.remarks,
            remarks=copy.remarks,
            unused_rows=copy.unused_rows,
        )
    finally:
        copy.close()
