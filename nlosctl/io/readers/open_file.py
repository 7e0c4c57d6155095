"""Opening a file with the reader of its format."""

from __future__ import annotations

from dataclasses import replace

from nlosctl.contract.limits import limit, refusal_hint
from nlosctl.errors import DataError
from nlosctl.io.paths.file_format import FileFormat, format_of_bytes
from nlosctl.io.paths.inputs import Part
from nlosctl.io.readers.base import RawSource, readable
from nlosctl.io.readers.change_guard import WatchedSource
from nlosctl.io.readers.csv_reader import CsvSource
from nlosctl.io.readers.json_lines import JsonLinesSource
from nlosctl.io.readers.parquet_arrow import ArrowSource, ParquetSource
from nlosctl.io.readers.partition_columns import KeyedSource

__all__ = ["open_part"]

_HEAD_BYTES = 4096


def open_part(part: Part, batch_rows: int, use_threads: bool) -> RawSource:
    """Return the open file; raise DataError where it is empty, not what its name says, or of columns beyond reason."""
    source = _open(part, batch_rows, use_threads)
    if len(source.names) > limit("columns"):
        source.close()
        raise DataError(
            f"{part.name}: has {len(source.names)} columns, expected at most {limit('columns')}; "
            f"{refusal_hint('columns')}"
        )
    return source if part.path is None else WatchedSource(source, part.name, part.path, part.mark)


def _open(part: Part, batch_rows: int, use_threads: bool) -> RawSource:
    head = _head(part)
    if head == b"":
        raise DataError(f"{part.name}: no rows: the file is empty (0 bytes)")
    if head is not None:
        part = _checked(part, head)
    source = _opened(part, batch_rows, use_threads)
    return KeyedSource(part, source) if part.keys else source


def _opened(part: Part, batch_rows: int, use_threads: bool) -> RawSource:
    if part.format is FileFormat.PARQUET:
        return ParquetSource(part, batch_rows, use_threads)
    if part.format in (FileFormat.ARROW, FileFormat.ARROW_STREAM):
        return ArrowSource(part, batch_rows)
    if part.format in (FileFormat.CSV, FileFormat.CSV_GZ):
        return CsvSource(part, batch_rows)
    return JsonLinesSource(part, batch_rows)


def _head(part: Part) -> bytes | None:
    """Return the first bytes of a file or of stdin; None where they can't be had without taking them."""
    if part.path is not None:
        with readable(part.name, "file"), part.path.open("rb") as file:
            return file.read(_HEAD_BYTES)
    peek = getattr(part.stream, "peek", None)
    return bytes(peek(_HEAD_BYTES)) if peek is not None else None


def _checked(part: Part, head: bytes) -> Part:
    """Return the part with the Arrow format that its bytes tell; raise DataError where they tell another format."""
    told = format_of_bytes(head)
    if {told, part.format} == {FileFormat.ARROW, FileFormat.ARROW_STREAM}:
        return replace(part, format=told)
    if told is part.format or (told is FileFormat.CSV and not _is_told_by_bytes(part.format, head)):
        return part
    what = "text, perhaps CSV" if told is FileFormat.CSV else told.title
    raise DataError(
        f"{part.name}: taken for {part.format.title}, but its bytes are {what}; give it the right extension, or say "
        f"--input-format {told.value}"
    )


def _is_told_by_bytes(format: FileFormat, head: bytes) -> bool:
    """Return whether text can't be of this format; bytes that are no text may be a spoilt file of any."""
    if format in (FileFormat.CSV, FileFormat.JSON_LINES):
        return False
    return b"\0" not in head and head.isascii()
