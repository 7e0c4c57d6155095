"""Rows of an importer as an Arrow table with the contract's types."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import pyarrow as pa

from nlosctl.contract.formats import BadLine, Row
from nlosctl.contract.tables import ColumnType, Table
from nlosctl.errors import DataError, MethodError
from nlosctl.io.arrow_columns import ARROW_TYPES
from nlosctl.io.measurements.row_checks import BadRow, Problem, ProblemLog

__all__ = ["imported_table"]


def imported_table(
    rows: Iterable[Row | BadLine], table: Table, extra: Mapping[str, ColumnType], file: str, log: ProblemLog
) -> Any:
    """Return the rows as a table: the contract's columns first, in its order; those without a value are left out.

    Bad lines go to ``log``. Raises DataError where a bad line stops the run or no row is good, MethodError for a column
    that neither the contract nor the importer knows.
    """
    types: dict[str, ColumnType] = {}
    for column in table.columns:
        types[column.name] = column.type
        types.update(dict.fromkeys((spelling.name for spelling in column.spellings), column.type))
    types.update(extra)
    columns: dict[str, list[Any]] = {name: [] for name in types}
    count = 0
    for row in rows:
        if isinstance(row, BadLine):
            problem = Problem(file=file, row=None, line=row.line, column=row.column, fault=row.fault)
            log.add([BadRow(problem=problem, values={}, raw_line=row.text)])
            continue
        unknown = [name for name in row.values if name not in types]
        if unknown:
            raise MethodError(f"the importer gives a column {unknown[0]!r} that it does not declare")
        for name, cells in columns.items():
            cells.append(row.values.get(name))
        count += 1
    log.raise_if_stopping()
    if not count:
        raise DataError(f"{file}: no row: nothing in it is a measurement")
    return pa.table({name: _array(name, cells, types[name]) for name, cells in columns.items() if _told(cells)})


def _told(cells: list[Any]) -> bool:
    return any(cell is not None for cell in cells)


def _array(name: str, cells: list[Any], kind: ColumnType) -> Any:
    if kind == "identifier":
        whole = all(isinstance(cell, int) for cell in cells)
        return pa.array(cells if whole else [None if cell is None else str(cell) for cell in cells])
    try:
        return pa.array(cells, ARROW_TYPES[kind])
    except (pa.ArrowInvalid, pa.ArrowTypeError, TypeError) as error:
        raise MethodError(f"the importer's column {name!r} holds values that are no {kind}: {error}") from error
