"""Opening what the command line names as input, and writing what it names as output."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from nlosctl.cli.options import key_values

if TYPE_CHECKING:
    from nlosctl.io.inputs import Input
    from nlosctl.io.measurements import MeasurementReader
    from nlosctl.io.write import TableWriter

__all__ = ["Opened", "ReadWords", "open_measurements", "open_output"]


@dataclass(frozen=True, kw_only=True)
class ReadWords:
    """The words of the command line that say what to read and how."""

    inputs: Sequence[str]
    input_format: str | None = None
    kind: str | None = None
    scene: str | None = None
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

    @property
    def constants(self) -> dict[str, float]:
        """The constant columns, in the contract's units."""
        degrees = {
            "bearing_std_rad": self.bearing_std_deg,
            "dod_std_rad": self.dod_std_deg,
            "doa_std_rad": self.doa_std_deg,
        }
        given = {
            **{name: None if value is None else math.radians(value) for name, value in degrees.items()},
            "range_std_m": self.range_std_m,
            "path_length_std_m": self.path_length_std_m,
        }
        return {name: value for name, value in given.items() if value is not None}


@dataclass(frozen=True, kw_only=True)
class Opened:
    """An open reader, and the inputs that it reads."""

    reader: MeasurementReader
    inputs: Sequence[Input]

    @property
    def paths(self) -> list[Path]:
        """The files that must not be overwritten."""
        return [part.path for given in self.inputs for part in given.parts if part.path is not None]


@contextmanager
def open_measurements(words: ReadWords) -> Iterator[Opened]:
    """Open the inputs; with ``bad_rows`` the rows set aside are written when the block ends well."""
    from nlosctl.io.file_format import format_named
    from nlosctl.io.inputs import expand_inputs
    from nlosctl.io.measurements import MeasurementReader, ReadOptions
    from nlosctl.io.write import BadRowWriter, TableWriter

    input_format = None if words.input_format is None else format_named(words.input_format)
    inputs = expand_inputs(words.inputs, input_format)
    options = ReadOptions(
        kind=words.kind,
        renames=key_values(list(words.columns), "--column"),
        constants=words.constants,
        scene_file=words.scene,
        all_rows=words.all_rows,
        max_snapshot_rows=words.max_snapshot_rows,
        use_threads=not words.one_thread,
    )
    with ExitStack() as stack:
        reader = MeasurementReader(inputs, options)
        opened = Opened(reader=reader, inputs=inputs)
        if words.bad_rows is not None:
            schema = BadRowWriter.schema(reader.schema.names)
            writer = TableWriter(words.bad_rows, schema, overwrite=words.overwrite, inputs=opened.paths)
            reader.set_bad_rows_aside(BadRowWriter(stack.enter_context(writer)))
        yield opened


@contextmanager
def open_output(
    target: str,
    schema: Any,
    *,
    format_name: str | None,
    overwrite: bool,
    inputs: Sequence[Path],
    metadata: Mapping[str, str],
) -> Iterator[TableWriter]:
    """Open an output table, ``-`` for stdout; it appears whole when the block ends well."""
    from nlosctl.io.file_format import format_named
    from nlosctl.io.write import TableWriter

    chosen = None if format_name is None else format_named(format_name)
    with TableWriter(target, schema, format=chosen, overwrite=overwrite, inputs=inputs, metadata=metadata) as writer:
        yield writer
