"""Inputs and outputs of a job, opened and checked before the first output is written."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from typing import Any

from nlosctl.contract.calibration import Calibration
from nlosctl.contract.limits import size
from nlosctl.contract.run_options import InputOptions, OutputOptions
from nlosctl.errors import DataError, UsageError, did_you_mean
from nlosctl.io.measurements.reader import MeasurementReader
from nlosctl.io.paths.inputs import Input, expand_inputs
from nlosctl.io.paths.locations import Location, format_named, format_of_path, known_format_of_path, location
from nlosctl.io.writers.output_set import OutputSet, check_targets
from nlosctl.io.writers.table_writer import BadRowWriter, TableWriter
from nlosctl.jobs.console import Console, Silent, json_text

__all__ = [
    "Destination",
    "Opened",
    "bad_row_writer",
    "naming_importer",
    "open_inputs",
    "open_measurements",
    "open_output",
    "require_columns",
    "require_window",
    "with_calibration",
    "write_report",
]


@dataclass(frozen=True, kw_only=True)
class Destination:
    """Targets of the tables of a job: ``targets`` by table name (None: not wanted), the main table first.

    A table of ``sinks`` is written to the sink that the function returns for its schema instead. The files of
    ``protected`` must not be overwritten, like the inputs. ``console`` shows progress.
    """

    targets: Mapping[str, str | None] = field(default_factory=dict)
    sinks: Mapping[str, Callable[[Any], Any]] = field(default_factory=dict)
    protected: Sequence[str | None] = ()
    console: Console = field(default_factory=Silent)

    @property
    def wanted(self) -> dict[str, str]:
        """The targets of the tables that are wanted, ``-`` for a table that only a sink receives."""
        targets = {name: target for name, target in self.targets.items() if target is not None}
        return {**targets, **{name: "-" for name in self.sinks if name not in targets}}


@dataclass(frozen=True, kw_only=True)
class Opened:
    """An open reader, its inputs, and the files and folders that must not be written to."""

    reader: MeasurementReader
    inputs: Sequence[Input]
    protected: Sequence[Location]

    def set_bad_rows_aside(self, write: OutputOptions, outputs: OutputSet) -> None:
        """Write bad rows to a file, one of ``outputs``, if that is wanted; call it before the first chunk is read."""
        sink = bad_row_writer(write, self.reader.schema.names, outputs, self.protected)
        if sink is not None:
            self.reader.set_bad_rows_aside(sink)


def with_calibration(read: InputOptions) -> InputOptions:
    """Return the options with the calibration in the file that they name, and its columns among those to be read."""
    if read.calibration is None:
        return read
    from nlosctl.io.calibrations.calibration_file import read_calibration

    known = read.calibration if isinstance(read.calibration, Calibration) else read_calibration(read.calibration)
    if known.harmonics and read.window_keep == "mean":
        raise UsageError("deviations depend on the heading of each row: `window_keep` must be all or nearest")
    extra = None if read.extra_columns is None else (*read.extra_columns, *known.by)
    return dataclasses.replace(read, calibration=known, extra_columns=extra)


def _check_calibration(calibration: Calibration, reader: MeasurementReader) -> None:
    """Raise DataError for a calibration of another kind, or by a column that the input lacks."""
    if calibration.kind != reader.kind and not calibration.entries:
        raise UsageError(f"`harmonics` are of bearings, and the input has {reader.kind}; leave it out")
    if calibration.kind != reader.kind:
        raise DataError(
            f"{calibration.source}: has {calibration.quantity.name}, offsets of {calibration.kind}, but the input has "
            f"{reader.kind}; calibrate with {reader.kind}"
        )
    for name in calibration.by:
        if name not in reader.column_names:
            near = did_you_mean(name, reader.column_names)
            raise DataError(
                f"{calibration.source}: its offsets are by {name!r}, a column that the input lacks{near}; add it, or "
                "correct the key"
            )


def require_window(read: InputOptions) -> None:
    """Raise UsageError for columns that part the rows without windows."""
    if read.by and read.window is None:
        raise UsageError(f"`by` {read.by[0]} separates windows of time; set `window` too, such as 2s, auto or all")


def require_columns(by: Sequence[str], reader: MeasurementReader) -> None:
    """Raise DataError for a column of ``by`` that the input lacks."""
    for name in by:
        if name not in reader.column_names:
            near = did_you_mean(name, reader.column_names)
            raise DataError(f"`by` {name}: no column {name!r}{near}. The input has: {', '.join(reader.column_names)}")


def open_inputs(inputs: Sequence[str] | Sequence[Input], input_format: str | None) -> list[Input]:
    """Return the inputs of names, folders and globs; inputs that are already open are returned unchanged."""
    opened = [given for given in inputs if isinstance(given, Input)]
    if opened:
        return opened
    names = [given for given in inputs if isinstance(given, str)]
    return expand_inputs(names, None if input_format is None else format_named(input_format))


@contextmanager
def naming_importer(inputs: Sequence[str] | Sequence[Input]) -> Iterator[None]:
    """Add to an error on opening the inputs which importer the first one looks like, if it does."""
    try:
        yield
    except (DataError, UsageError) as error:
        from nlosctl.pipeline.convert.recognition import import_hint

        names = [given if isinstance(given, str) else given.parts[0].path for given in inputs]
        hint = import_hint([str(name) for name in names if name is not None])
        if not hint or type(error) not in (DataError, UsageError):
            raise
        raise type(error)(f"{error}{hint}") from error


@contextmanager
def open_measurements(
    inputs: Sequence[str] | Sequence[Input], read: InputOptions, write: OutputOptions, destination: Destination
) -> Iterator[Opened]:
    """Open the inputs and check all targets before the first output is written."""
    require_window(read)
    read = with_calibration(read)
    if write.bad_rows is not None:
        read = dataclasses.replace(read, extra_columns=None)
    with naming_importer(inputs):
        given = open_inputs(inputs, read.input_format)
        opened = MeasurementReader(given, read)
    names = [*destination.protected, read.scene if isinstance(read.scene, str) else None]
    with closing(opened) as reader:
        if isinstance(read.calibration, Calibration):
            _check_calibration(read.calibration, reader)
        parts = [part.path for source in given for part in source.parts if part.path is not None]
        folders = [source.path for source in given if source.path is not None]
        protected = [*parts, *folders, *(location(name) for name in names if name is not None)]
        check_targets(
            [None if write.report == "-" else write.report],
            tables=[*destination.targets.values(), write.bad_rows],
            overwrite=write.overwrite,
            inputs=protected,
        )
        yield Opened(reader=reader, inputs=given, protected=protected)


def open_output(
    target: str,
    schema: Any,
    write: OutputOptions,
    inputs: Sequence[Location] = (),
    metadata: Mapping[str, str] | None = None,
    *,
    of_measurements: bool = False,
) -> Any:
    """Return the context manager of an output table, ``-`` for standard output; a file appears only when complete.

    If the extension or the format names an exporter of maps, it receives the table, which must be of estimates.
    """
    common: dict[str, Any] = {"overwrite": write.overwrite, "inputs": inputs, "metadata": metadata or {}}
    if write.format is None and target.lower().endswith(".asc") and "hpd" in schema.names:
        from nlosctl.pipeline.convert.grid_file import GridFile

        return GridFile(target, schema.names, **common)
    if write.format is not None or known_format_of_path(target) is None:
        from nlosctl.pipeline.convert.map_writer import MapWriter, exporter_of, map_extensions

        exporter = exporter_of(target, write.format)
        if exporter is not None:
            return MapWriter(target, exporter, {}, **common)
        if write.format is None and target != "-" and "cov_xx_m2" in schema.names:
            format_of_path(target, map_extensions())  # raises an error that lists the formats of maps too
    chosen = None if write.format is None else format_named(write.format)
    rows = size("measurement_group_rows" if of_measurements else "group_rows")
    return TableWriter(target, schema, format=chosen, group_rows=rows, **common)


def bad_row_writer(
    write: OutputOptions, names: Sequence[str], outputs: OutputSet, inputs: Sequence[Location]
) -> BadRowWriter | None:
    """Return a writer of bad rows, one of ``outputs``, for an input with the columns ``names``; None: not wanted."""
    if write.bad_rows is None:
        return None
    schema = BadRowWriter.schema(names)
    return BadRowWriter(outputs.take(TableWriter(write.bad_rows, schema, overwrite=write.overwrite, inputs=inputs)))


def write_report(write: OutputOptions, report: Mapping[str, Any], outputs: OutputSet, console: Console) -> None:
    """Write a report as JSON to its file, one of ``outputs``; the caller handles ``-``."""
    if write.report is not None and write.report != "-":
        outputs.write_text(write.report, console.worded(json_text(report)), overwrite=write.overwrite)
