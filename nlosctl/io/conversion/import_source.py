"""Files of other programs: opened as bytes for an importer, and the importer's rows as an Arrow table."""

from __future__ import annotations

import re
import shutil
import sys
import tempfile
import zipfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import pyarrow as pa
import pyarrow.parquet as pq

from nlosctl.contract.formats import BadLine, Row
from nlosctl.contract.tables import ColumnType, Table
from nlosctl.errors import DataError, MethodError, UsageError
from nlosctl.io.arrow_columns import ARROW_TYPES
from nlosctl.io.measurements.row_checks import BadRow, Problem, ProblemLog
from nlosctl.io.paths.locations import Location, location, near_name, require_utf8

__all__ = ["array_names", "cut_epochs_remark", "import_files", "import_path", "imported_table", "open_import"]

_IN_MEMORY_BYTES = 64 << 20


def import_path(name: str) -> Location | None:
    """Return the path of a file or a folder, None for stdin (``-``); raise DataError if it does not exist."""
    if name == "-":
        return None
    path = location(name)
    if not path.exists():
        raise DataError(f"{name}: there is no such file{near_name(path)}")
    require_utf8(name)
    return path


def import_files(name: str) -> list[str]:
    """Return the files of a folder in the order of their names, or the file itself; raise DataError for no file."""
    path = import_path(name)
    if path is None or not path.is_dir():
        return [name]
    if not isinstance(path, Path):
        raise DataError(f"{name}: is a folder, expected a file or a local folder")
    files = sorted(str(file) for file in path.iterdir() if file.is_file() and not file.name.startswith("."))
    if not files:
        raise DataError(f"{name}: is a folder without files")
    return files


@contextmanager
def open_import(name: str) -> Iterator[IO[bytes]]:
    """Open a file, or stdin, as a seekable stream of bytes; raise DataError if it can't be read."""
    path = import_path(name)
    try:
        if path is not None and path.is_file():
            with path.open("rb") as file:
                yield file
            return
        source: Any = sys.stdin.buffer if path is None else path.open("rb")
        with tempfile.SpooledTemporaryFile(max_size=_IN_MEMORY_BYTES) as spooled:
            shutil.copyfileobj(source, spooled)
            spooled.seek(0)
            yield spooled
    except OSError as error:
        raise DataError(f"{name}: can't be read: {error.strerror or error}") from error


def array_names(stream: IO[bytes]) -> list[str] | None:
    """Return the names of the arrays of an NPZ file or the columns of a Parquet file; None for any other file."""
    head = stream.read(4)
    stream.seek(0)
    try:
        if head == b"PK\x03\x04":
            with zipfile.ZipFile(stream) as archive:
                return [name.removesuffix(".npy") for name in archive.namelist()]
        if head == b"PAR1":
            return list(pq.read_schema(stream).names)
    except (zipfile.BadZipFile, pa.ArrowException, OSError, ValueError):
        return []
    return None


def imported_table(
    rows: Iterable[Row | BadLine], table: Table, extra: Mapping[str, ColumnType], file: str, log: ProblemLog
) -> Any:
    """Return the rows as a table: the contract's columns first, in its order, without columns that are empty.

    Bad lines go to ``log``. Raises DataError if a bad line stops the run or no row is good, MethodError for a column
    of neither the contract nor the importer.
    """
    types: dict[str, ColumnType] = {}
    for column in table.columns:
        types.update({name: column.type for name in column.accepted_names if name not in extra})
    types.update(extra)
    columns: dict[str, list[Any]] = {name: [] for name in types}
    kept: dict[str, list[str | None]] = {}
    count = 0
    for row in rows:
        if isinstance(row, BadLine):
            problem = Problem(file=row.file or file, row=None, line=row.line, column=row.column, fault=row.fault)
            log.add([BadRow(problem=problem, values={}, raw_line=row.text)])
            continue
        unknown = [name for name in row.values if name not in types]
        if unknown:
            raise MethodError(f"the importer gives a column {unknown[0]!r} that it does not declare")
        for name, cells in columns.items():
            cells.append(row.values.get(name))
        for name, cell in row.kept.items():
            if name in types:
                raise UsageError(f"`parameters` keep: {name!r} is the name of a column of measurements; leave it out")
            kept.setdefault(name, []).append(cell)
        count += 1
    log.raise_if_stopping()
    if not count:
        raise DataError(f"{file}: no rows: the file contains no measurement")
    filled = {name: cells for name, cells in columns.items() if any(cell is not None for cell in cells)}
    arrays = {name: _array(name, cells, types[name]) for name, cells in filled.items()}
    return pa.table(arrays | {name: pa.array(cells, pa.string()) for name, cells in kept.items()})


def cut_epochs_remark(table: Any) -> list[str]:
    """Return a line if windows have cut epochs in two: sensors repeat in some snapshots, and others lack them."""
    if not {"snapshot", "sensor"} <= set(table.column_names):
        return []
    sensors: dict[Any, list[str]] = {}
    for snapshot, sensor in zip(table["snapshot"].to_pylist(), table["sensor"].to_pylist(), strict=True):
        sensors.setdefault(snapshot, []).append(re.sub(r"#\d+$", "", str(sensor)))
    most = max((len(set(names)) for names in sensors.values()), default=0)
    repeated = sum(len(set(names)) < len(names) for names in sensors.values())
    short = sum(len(set(names)) < most for names in sensors.values())
    if not repeated or not short:
        return []
    return [
        f"of {len(sensors)} snapshots {repeated} have a sensor more than once, and {short} lack a sensor that others "
        f"have: the window may cut epochs in two; `window` auto ends a snapshot when a sensor reports again"
    ]


def _array(name: str, cells: list[Any], kind: ColumnType) -> Any:
    if kind == "identifier":
        whole = all(isinstance(cell, int) for cell in cells)
        return pa.array(cells if whole else [None if cell is None else str(cell) for cell in cells])
    if kind == "exact" and all(isinstance(cell, int) for cell in cells if cell is not None):
        return pa.array(cells, pa.int64())
    try:
        return pa.array(cells, ARROW_TYPES[kind])
    except (pa.ArrowInvalid, pa.ArrowTypeError, TypeError) as error:
        raise MethodError(f"the importer's column {name!r} has values of another type than {kind}: {error}") from error
