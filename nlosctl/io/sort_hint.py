"""The command that puts the rows of each snapshot together."""

from __future__ import annotations

import re
import shlex

from nlosctl.io.file_format import FileFormat
from nlosctl.io.inputs import Input

__all__ = ["sort_hint"]

_READ_BY_DUCKDB = frozenset(set(FileFormat) - {FileFormat.ARROW, FileFormat.ARROW_STREAM})


def sort_hint(given: Input, column: str) -> str:
    """Return how to sort an input by ``column``, as the file names it; the format is one that DuckDB reads."""
    formats = {part.format for part in given.parts}
    if len(formats) > 1 or not formats <= _READ_BY_DUCKDB:
        return f"sort the rows by {column!r}"
    file, first = given.name, given.parts[0]
    if first.path is None:
        file = "FILE"
    elif given.path != first.path:
        suffixes = first.path.suffixes[-2:] if first.format.compressed else first.path.suffixes[-1:]
        file = f"{file.rstrip('/')}/**/*{''.join(suffixes)}"
    name = column if re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", column) else '"' + column.replace('"', '""') + '"'
    quoted = file.replace("'", "''")
    statement = f"COPY (SELECT * FROM '{quoted}' ORDER BY {name}) TO 'sorted.parquet'"  # noqa: S608 - shown, not run
    shell = f'"{statement}"' if not re.search(r'["$`\\!]', statement) else shlex.quote(statement)
    return f"sort the file: duckdb -c {shell}"
