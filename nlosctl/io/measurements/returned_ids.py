"""The message on a snapshot whose rows are not together, and how to bring them together or keep them apart."""

from __future__ import annotations

import re
import shlex
from collections.abc import Sequence

import numpy as np

from nlosctl.io.measurements.row_batch import RowBatch
from nlosctl.io.measurements.snapshot_ids import SeenId
from nlosctl.io.paths.inputs import Input, Part
from nlosctl.io.paths.locations import FileFormat

__all__ = ["APART", "rejoined", "rejoined_remark", "returned_id"]

APART = "if the parts number their own snapshots, name the files one by one, or make the ids unique"
"""How to keep parts apart whose snapshots have the same ids: each file that is named is an input of its own."""

_NOT_READ_BY_DUCKDB = {FileFormat.ARROW, FileFormat.ARROW_STREAM, *(f for f in FileFormat if f.compression == "bz2")}


def returned_id(rows: RowBatch, index: int, earlier: SeenId, given: Input, column: str) -> str:
    """Return the message for row ``index`` of ``rows``, whose id in ``column`` occurred before other snapshots."""
    part = next(part for part in given.parts if part.name == rows.file)
    cure = _sort_hint(part, column) if earlier.part == rows.file else _parts_hint(given)
    return (
        f"{rows.file}, row {rows.rows[index]}, column {column!r}: {rows.ids[index].as_py()!r} comes back after other "
        f"snapshots (before: {earlier.part}, row {earlier.row}), expected the rows of a snapshot together; {cure}"
    )


def _parts_hint(given: Input) -> str:
    """Return how to keep apart parts whose snapshots have the same ids; sorting would merge different snapshots."""
    first = given.parts[0]
    suffixes = [] if first.path is None else first.path.suffixes[-2 if first.format.compression else -1 :]
    pattern = shlex.quote(f"{given.name.rstrip('/')}/**/*{''.join(suffixes)}")
    return (
        f"ids are not unique across the parts: name the files one by one ({pattern} names them all), "
        "or make the ids unique"
    )


def _sort_hint(part: Part, column: str) -> str:
    """Return how to sort a file by ``column``: a command of DuckDB if it can read the format."""
    if part.format in _NOT_READ_BY_DUCKDB:
        return f"sort the rows by {column!r}"
    file, name = ("FILE" if part.path is None else part.name).replace("'", "''"), column.replace('"', '""')
    statement = f"COPY (SELECT * FROM '{file}' ORDER BY \"{name}\") TO 'sorted.parquet'"  # noqa: S608 - shown, not run
    plain = not re.search(r"[$`\\!]", statement)
    shell = '"' + statement.replace('"', '\\"') + '"' if plain else shlex.quote(statement)
    return f"sort the file: duckdb -c {shell}"


def rejoined(batches: Sequence[RowBatch], whole: RowBatch, column: str) -> list[str]:
    """Return the snapshots of ``whole``, the joined ``batches``, that may be several: a description of each.

    Their rows are in several parts, with values of ``column`` that are unique within each part but not in all.
    """
    if column not in whole.columns:
        return []
    files = [batch.file for batch in batches]
    ends = np.append(whole.starts[1:], len(whole))
    part = np.repeat([files.index(file) for file in files], [len(batch) for batch in batches])
    found = []
    for start, end in zip(whole.starts.tolist(), ends.tolist(), strict=True):
        if part[start] != part[end - 1]:
            pairs = np.stack([whole.columns[column][start:end], part[start:end]])
            if np.unique(pairs, axis=1).shape[1] == end - start > np.unique(pairs[0]).size:
                found.append(f"{whole.ids[start].as_py()!r} in {files[part[start]]} and {files[part[end - 1]]}")
    return found


def rejoined_remark(found: Sequence[str]) -> list[str]:
    """Return a line on the `rejoined` snapshots of a run; there are some."""
    few = "1 snapshot continues" if len(found) == 1 else f"{len(found)} snapshots continue"
    return [f"{few} in the next part with the same sensors (the first: {found[0]}): {APART}"]
