"""Content of a file, read without the project's readers, and its comparison with a written table."""

from __future__ import annotations

import csv
import gzip
import io
import json
import math
from collections.abc import Iterator
from typing import Any

import pyarrow as pa
import pyarrow.parquet

__all__ = ["differences", "read_independently"]

_WORDS = {"true": True, "1": True, "false": False, "0": False}


def read_independently(name: str, content: bytes) -> list[dict[str, Any]]:
    """Return the rows of a file by pyarrow, csv or json alone; values of CSV are text, empty ones None."""
    if name.endswith(".parquet"):
        return list(_rows(pa.parquet.ParquetFile(io.BytesIO(content)).read()))
    if name.endswith((".arrow", ".arrows")):
        try:  # the extension determines the format
            return list(_rows(pa.ipc.open_file(io.BytesIO(content)).read_all()))
        except pa.ArrowInvalid:
            return list(_rows(pa.ipc.open_stream(io.BytesIO(content)).read_all()))
    text = (gzip.decompress(content) if name.endswith(".gz") else content).decode("utf-8-sig")
    if ".jsonl" in name:
        return [json.loads(line) for line in text.split("\n") if line.strip()]
    records = [record for record in csv.reader(io.StringIO(text, newline="")) if record]
    names = [field.strip() for field in records[0]]
    return [{field: value or None for field, value in zip(names, record, strict=True)} for record in records[1:]]


def _rows(table: Any) -> Iterator[dict[str, Any]]:
    columns = {name: table.column(name).to_pylist() for name in table.column_names}
    for place in range(table.num_rows):
        yield {name: values[place] for name, values in columns.items()}


def differences(rows: list[dict[str, Any]], table: Any, names: set[str]) -> Iterator[str]:
    """Yield differences of the columns ``names`` of a table written by the program from ``rows``."""
    if len(rows) != table.num_rows:
        yield f"{table.num_rows} rows came out of {len(rows)}"
        return
    for name in sorted(names & set(table.column_names)):
        values = table.column(name).to_pylist()
        for place, (row, value) in enumerate(zip(rows, values, strict=True)):
            if not _same(value, row.get(name)):
                yield f"row {place + 1}, column {name!r}: {value!r} came out of {row.get(name)!r}"
                return


def _same(value: Any, raw: Any) -> bool:
    if isinstance(raw, bytes):  # text of a corrupted file that is no longer marked as text
        return bool(value == raw) or value == raw.decode("utf-8", "backslashreplace")
    if value is None or raw is None:
        return value is None and (raw is None or raw == "")
    if isinstance(value, bool):
        return _WORDS.get(str(raw).strip().lower()) is value
    if isinstance(value, int):
        return value == (raw if isinstance(raw, int) else _integer(raw))
    if isinstance(value, float):
        return _number(raw) == value or (math.isnan(value) and math.isnan(_number(raw)))
    if isinstance(raw, str):
        return value == raw or value == raw.strip()
    return str(value) in (str(raw), json.dumps(raw), json.dumps(raw, ensure_ascii=False))


def _integer(raw: Any) -> int | None:
    try:
        return int(raw)
    except (TypeError, ValueError):
        return None


def _number(raw: Any) -> float:
    try:
        return float(raw)
    except (TypeError, ValueError):
        return math.nan
