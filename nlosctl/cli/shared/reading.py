"""Opening what the command line names as input, and writing what it names as output."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from nlosctl.cli.options.declarations import key_values
from nlosctl.errors import UsageError
from nlosctl.io.paths.locations import Location, location

if TYPE_CHECKING:
    from nlosctl.contract.scene import EarthFrame
    from nlosctl.io.measurements.reader import MeasurementReader
    from nlosctl.io.paths.inputs import Input
    from nlosctl.io.writers.output_set import OutputSet
    from nlosctl.io.writers.table_writer import TableWriter
    from nlosctl.pipeline.convert.map_writer import MapWriter

__all__ = ["Opened", "ReadWords", "added_columns", "open_measurements", "open_output"]


@dataclass(frozen=True, kw_only=True)
class ReadWords:
    """The words of the command line that say what to read and how.

    ``outputs`` are files that will be written, ``tables`` files or folders. ``extra_columns`` are those that will be
    needed beside the measurement's own; None: all.
    """

    inputs: Sequence[str]
    input_format: str | None = None
    kind: str | None = None
    scene: str | None = None
    crs: str | None = None
    origin: str | None = None
    columns: Sequence[str] = ()
    bearing_std_deg: float | None = None
    range_std_m: float | None = None
    dod_std_deg: float | None = None
    doa_std_deg: float | None = None
    path_length_std_m: float | None = None
    all_rows: bool = False
    max_snapshot_rows: int = 1_000_000
    bad_rows: str | None = None
    overwrite: bool = False
    one_thread: bool = False
    config: str | None = None
    outputs: Sequence[str | None] = ()
    tables: Sequence[str | None] = ()
    extra_columns: Sequence[str] | None = None

    @property
    def frame(self) -> EarthFrame | None:
        """The plane on earth that --crs or --origin names."""
        from nlosctl.contract.scene import parse_frame

        if self.crs is not None and self.origin is not None:
            raise UsageError("--crs and --origin both say how the plane lies on earth; give one")
        if self.origin is not None:
            return parse_frame(self.origin, "--origin")
        return None if self.crs is None else parse_frame(self.crs, "--crs")

    @property
    def constants(self) -> dict[str, float]:
        """The constant columns, in the contract's units."""
        constants = {}
        for option, value, name, scale in (
            ("--bearing-std-deg", self.bearing_std_deg, "bearing_std_rad", math.radians(1.0)),
            ("--range-std-m", self.range_std_m, "range_std_m", 1.0),
            ("--dod-std-deg", self.dod_std_deg, "dod_std_rad", math.radians(1.0)),
            ("--doa-std-deg", self.doa_std_deg, "doa_std_rad", math.radians(1.0)),
            ("--path-length-std-m", self.path_length_std_m, "path_length_std_m", 1.0),
        ):
            if value is None:
                continue
            if not 0.0 < value < math.inf:
                raise UsageError(f"{option} must be a finite number larger than 0. Got {value:g} instead.")
            constants[name] = value * scale
        return constants


@dataclass(frozen=True, kw_only=True)
class Opened:
    """An open reader, and the inputs that it reads."""

    reader: MeasurementReader
    inputs: Sequence[Input]
    others: Sequence[Location] = ()

    @property
    def paths(self) -> list[Location]:
        """The files and folders that must not be written to."""
        parts = [part.path for given in self.inputs for part in given.parts if part.path is not None]
        return [*parts, *(given.path for given in self.inputs if given.path is not None), *self.others]

    def set_bad_rows_aside(self, target: str, outputs: OutputSet, *, overwrite: bool) -> None:
        """Hand bad rows to a file, one of ``outputs``, and go on with the rest; before the first row is read."""
        from nlosctl.io.writers.table_writer import BadRowWriter, TableWriter

        schema = BadRowWriter.schema(self.reader.schema.names)
        writer = outputs.take(TableWriter(target, schema, overwrite=overwrite, inputs=self.paths))
        self.reader.set_bad_rows_aside(BadRowWriter(writer))


def added_columns(words: str) -> tuple[str, ...]:
    """Return the words of ``--add``."""
    return tuple(word.strip() for word in words.split(",") if word.strip())


@contextmanager
def open_measurements(words: ReadWords) -> Iterator[Opened]:
    """Open the inputs; all outputs are checked before anything is written."""
    from nlosctl.io.measurements.reader import MeasurementReader, ReadOptions
    from nlosctl.io.paths.inputs import expand_inputs
    from nlosctl.io.paths.locations import format_named
    from nlosctl.io.writers.output_set import check_targets

    input_format = None if words.input_format is None else format_named(words.input_format)
    inputs = expand_inputs(words.inputs, input_format)
    options = ReadOptions(
        kind=words.kind,
        renames=key_values(list(words.columns), "--column"),
        constants=words.constants,
        scene_file=words.scene,
        frame=words.frame,
        all_rows=words.all_rows,
        max_snapshot_rows=words.max_snapshot_rows,
        use_threads=not words.one_thread,
        extra_columns=None if words.bad_rows is not None else words.extra_columns,
    )
    with closing(MeasurementReader(inputs, options)) as reader:
        others = [location(name) for name in (words.scene, words.config) if name is not None]
        opened = Opened(reader=reader, inputs=inputs, others=others)
        check_targets(
            words.outputs, tables=[*words.tables, words.bad_rows], overwrite=words.overwrite, inputs=opened.paths
        )
        yield opened


def open_output(
    target: str,
    schema: Any,
    *,
    format_name: str | None,
    overwrite: bool,
    inputs: Sequence[Location],
    metadata: Mapping[str, str],
    of_measurements: bool = False,
) -> TableWriter | MapWriter:
    """Return the context manager of an output table, ``-`` for stdout; it appears whole when its block ends well.

    Where extension or format name an exporter of maps, it takes estimates; any other table is told as its fault.
    """
    from nlosctl.contract.limits import size
    from nlosctl.io.paths.locations import format_named
    from nlosctl.io.writers.table_writer import TableWriter
    from nlosctl.pipeline.convert.map_writer import MapWriter, exporter_of

    exporter = exporter_of(target, format_name)
    if exporter is not None:
        return MapWriter(target, exporter, {}, overwrite=overwrite, inputs=inputs, metadata=metadata)
    chosen = None if format_name is None else format_named(format_name)
    return TableWriter(
        target,
        schema,
        format=chosen,
        overwrite=overwrite,
        inputs=inputs,
        metadata=metadata,
        group_rows=size("measurement_group_rows" if of_measurements else "group_rows"),
    )
