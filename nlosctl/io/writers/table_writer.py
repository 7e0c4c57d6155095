"""Writing a table: whole or not at all, and with bytes that don't depend on how it was fed."""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from types import TracebackType
from typing import IO, Any

import pyarrow as pa

from nlosctl.io.measurements.bad_rows import BadRow
from nlosctl.io.paths.file_format import FileFormat, format_of_path, known_format_of_path
from nlosctl.io.paths.locations import Location, location
from nlosctl.io.readers.arrow_text import plain_type
from nlosctl.io.writers.atomic_file import writing
from nlosctl.io.writers.byte_output import ByteOutput
from nlosctl.io.writers.encoders import Encoder, make_encoder
from nlosctl.io.writers.targets import check_targets

__all__ = [
    "BadRowWriter",
    "TableWriter",
    "provenance_text",
]

GROUP_ROWS = 65_536
"""Rows of a row group (of a record batch, in Arrow) of results: while one is encoded it is in memory twice."""

MEASUREMENT_GROUP_ROWS = 131_072
"""The same of measurements: what reads them holds what the end of a Parquet file tells of each row group."""

_SPOOL_IN_MEMORY_BYTES = 64 << 20


class TableWriter:
    """A context manager that writes tables of one schema to ``target``: a path, or ``-`` for stdout.

    A file appears under its name only when the block ends without an exception; until then nothing is there, and
    afterwards nothing is left of a failure. On stdout the rows go out as they come (Parquet: at the end).
    ``schema`` is the Arrow schema of the file. ``metadata`` goes into formats that have room for it;
    ``set_metadata`` adds to it, for Parquet until the end.

    Raises DataError where the file exists (without ``overwrite``), is one of ``inputs``, or can't be written, and
    UsageError for an unknown extension. A closed pipe is a BrokenPipeError, for the caller to take quietly.
    """

    def __init__(
        self,
        target: str,
        schema: Any,
        *,
        format: FileFormat | None = None,
        overwrite: bool = False,
        inputs: Sequence[Location] = (),
        metadata: Mapping[str, str] | None = None,
        stdout: IO[bytes] | None = None,
        group_rows: int = GROUP_ROWS,
    ) -> None:
        self.target = target
        self.rows = 0
        self.schema = pa.schema([column.with_type(plain_type(column.type)) for column in schema])
        self._metadata = dict(metadata or {})
        self._output = ByteOutput(target, stdout)
        self._group_rows = group_rows
        self._format = _format_for(target, format)
        self._waiting: list[Any] = []
        self._waiting_rows = 0
        self._sink: Any = None
        self._encoder: Encoder | None = None
        self._closed = False
        check_targets([target], overwrite=overwrite, inputs=inputs)

    def __enter__(self) -> TableWriter:
        self._sink = self._output.__enter__().sink
        if self.target == "-" and self._format is FileFormat.PARQUET:
            self._sink = tempfile.SpooledTemporaryFile(max_size=_SPOOL_IN_MEMORY_BYTES)
        return self

    @property
    def passes_on(self) -> bool:
        """Whether the rows go where they can't be taken back from: standard output, a pipe, a device."""
        return self._output.passes_on

    def set_metadata(self, metadata: Mapping[str, str]) -> None:
        """Add metadata; for Arrow this must come before the first full group of rows is written."""
        self._metadata.update(metadata)

    def write(self, table: Any) -> None:
        """Take rows; dictionary-encoded columns are written plain."""
        self._waiting.append(_plain(table, self.schema))
        self._waiting_rows += table.num_rows
        self.rows += table.num_rows
        while self._waiting_rows >= self._group_rows:
            self._encode(self._take_waiting(self._group_rows))

    def _take_waiting(self, rows: int) -> Any:
        """Return the first rows that wait, in one piece; the tables that they came in are let go."""
        waiting = pa.concat_tables(self._waiting) if self._waiting else self.schema.empty_table()
        self._waiting = [waiting.slice(rows)]
        self._waiting_rows -= rows
        return waiting.slice(0, rows).combine_chunks()

    def complete(self) -> None:
        """Write all that waits, so that nothing is left but to take the name; see `nlosctl.io.writers.output_set`."""
        with writing(self.target):
            self._close_encoder()
        self._output.complete()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self._output.end(kind, self.complete)
        finally:
            if self._sink is not self._output.sink:
                self._sink.close()

    def _encode(self, table: Any) -> None:
        with writing(self.target):
            if self._encoder is None:
                self._encoder = make_encoder(self._format, self._sink, self.schema, self._metadata)
            self._encoder.write(table)
        pa.default_memory_pool().release_unused()  # what encoding a group took is not kept for the rest of the run

    def _close_encoder(self) -> None:
        if self._closed:
            return
        if self._waiting_rows or self._encoder is None:
            self._encode(self._take_waiting(self._waiting_rows))
        assert self._encoder is not None  # noqa: S101 - made by _encode
        self._encoder.close(self._metadata)
        self._closed = True
        if self._sink is not self._output.sink:
            self._sink.seek(0)
            shutil.copyfileobj(self._sink, self._output.sink)


class BadRowWriter:
    """Sets bad rows aside in a table file: ``row``, ``problem``, ``line``, then the columns as text.

    Call it with bad rows (it is a `nlosctl.io.measurements.bad_rows.BadRowSink`).
    ``line`` is the raw text of a line that is no row. With several inputs ``problem`` names the file.
    """

    def __init__(self, writer: TableWriter) -> None:
        self._writer = writer

    _OWN = ("row", "problem", "line")

    @classmethod
    def schema(cls, names: Sequence[str]) -> Any:
        """Return the schema of the file for an input with columns ``names``; those called like ours get a prefix."""
        own = [("row", pa.int64()), ("problem", pa.string()), ("line", pa.string())]
        return pa.schema([*own, *((cls._renamed(name), pa.string()) for name in names)])

    @classmethod
    def _renamed(cls, name: str) -> str:
        return f"input_{name}" if name in cls._OWN else name

    def __call__(self, rows: Sequence[BadRow]) -> None:
        """Write the rows."""
        records = [
            {
                **{self._renamed(name): value for name, value in row.values.items()},
                "row": row.problem.row,
                "problem": str(row.problem),
                "line": row.raw_line,
            }
            for row in rows
        ]
        self._writer.write(pa.Table.from_pylist(records, schema=self._writer.schema))


def provenance_text(provenance: Mapping[str, Any]) -> str:
    """Return provenance as JSON whose bytes are the same for the same content."""
    return json.dumps(provenance, sort_keys=True, ensure_ascii=False)


def _format_for(target: str, format: FileFormat | None) -> FileFormat:
    """Return the format of an output: what its name tells, and ``format`` where that tells none."""
    if target != "-":
        return known_format_of_path(location(target).name) or format or format_of_path(target)
    return FileFormat.ARROW_STREAM if format is FileFormat.ARROW else format or FileFormat.CSV


def _plain(table: Any, schema: Any) -> Any:
    table = table.replace_schema_metadata(None)
    if table.schema.equals(schema):
        return table
    return table.select(schema.names).cast(schema)
