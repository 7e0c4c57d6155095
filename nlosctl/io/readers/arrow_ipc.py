"""Reader of Arrow IPC: a file, or streams one after the other."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from itertools import chain
from typing import Any

import pyarrow as pa

from nlosctl.contract.tables import ColumnType
from nlosctl.errors import DataError
from nlosctl.io.paths.inputs import Part
from nlosctl.io.paths.locations import FileFormat, pyarrow_source
from nlosctl.io.readers.base import RecordBatch, readable
from nlosctl.io.readers.parquet_arrow import as_read, check_types, checked, in_contract, rebatch

__all__ = ["ArrowReader"]


class ArrowReader:
    """An Arrow IPC file, or streams one after the other."""

    accepted_texts: Collection[str] = ()

    def __init__(self, part: Part, batch_rows: int) -> None:
        self._part, self._batch_rows = part, batch_rows
        with readable(part.name, "Arrow file"):
            # not memory-mapped: truncating the file meanwhile would kill the process
            source: Any = part.stream if part.path is None else pyarrow_source(part.path)
            self._handle: Any = pa.OSFile(source) if isinstance(source, str) else source
            opener = pa.ipc.open_file if part.format is FileFormat.ARROW else pa.ipc.open_stream
            self._reader = opener(self._handle)
            self._schema = self._reader.schema
            self.names: tuple[str, ...] = tuple(self._schema.names)
        self.metadata: Mapping[bytes, bytes] = self._schema.metadata or {}
        self._columns: list[str] | None = None
        self._types: dict[str, ColumnType] = {}
        self._later: list[Any] = []

    def start(self, types: Mapping[str, ColumnType], columns: Sequence[str] | None) -> Any:
        """See FormatReader."""
        check_types(self._part.name, as_read(self._schema, {}), types)
        self._columns = list(columns) if columns is not None else None
        self._types = dict(types)
        schema = as_read(self._schema.remove_metadata(), types)
        return schema if columns is None else pa.schema([schema.field(name) for name in columns])

    def batches(self) -> Iterator[RecordBatch]:
        """See FormatReader."""
        row = 1
        with readable(self._part.name, "Arrow file"):
            for batch in rebatch(self._record_batches(), self._batch_rows):
                yield in_contract(batch, self._types, row)
                row += batch.num_rows

    def _record_batches(self) -> Iterator[Any]:
        if self._part.format is FileFormat.ARROW:
            batches: Iterator[Any] = map(self._reader.get_batch, range(self._reader.num_record_batches))
        else:
            batches = chain.from_iterable(self._streams())
        for batch in batches:
            batch = batch if self._columns is None else batch.select(self._columns)
            yield checked(batch)

    def _streams(self) -> Iterator[Any]:
        """Yield the readers of the streams in the file, in order; raise DataError if their columns differ."""
        yield self._reader
        while _has_more(self._handle):
            reader = pa.ipc.open_stream(self._handle)
            if not reader.schema.equals(self._reader.schema):
                raise DataError(
                    f"{self._part.name}: contains Arrow streams one after the other, whose columns differ; "
                    f"write them to files of their own"
                )
            self._later.append(reader)
            yield reader

    def close(self) -> None:
        """Close the file."""
        self._handle.close()


def _has_more(handle: Any) -> bool:
    return bool(handle.peek(1)) if hasattr(handle, "peek") else handle.seek(0, 1) < handle.size()
