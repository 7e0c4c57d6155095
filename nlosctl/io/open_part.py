"""Opening a file with the reader of its format."""

from __future__ import annotations

from nlosctl.errors import DataError
from nlosctl.io.csv_file import CsvSource
from nlosctl.io.file_format import FileFormat
from nlosctl.io.inputs import Part
from nlosctl.io.jsonl_file import JsonLinesSource
from nlosctl.io.raw import RawSource, readable
from nlosctl.io.typed_files import ArrowSource, ParquetSource

__all__ = ["open_part"]


def open_part(part: Part, batch_rows: int, use_threads: bool) -> RawSource:
    """Return the open file; raise DataError where it is empty or not what its name says."""
    if _is_empty(part):
        raise DataError(f"{part.name}: no rows: the file is empty (0 bytes)")
    if part.format is FileFormat.PARQUET:
        return ParquetSource(part, batch_rows, use_threads)
    if part.format in (FileFormat.ARROW, FileFormat.ARROW_STREAM):
        return ArrowSource(part, batch_rows)
    if part.format in (FileFormat.CSV, FileFormat.CSV_GZ):
        return CsvSource(part, batch_rows)
    return JsonLinesSource(part, batch_rows)


def _is_empty(part: Part) -> bool:
    if part.path is not None:
        with readable(part.name, "file"):
            return part.path.stat().st_size == 0
    peek = getattr(part.stream, "peek", None)
    return peek is not None and not peek(1)
