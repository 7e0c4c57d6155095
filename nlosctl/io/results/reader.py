"""Reader of result tables (estimates, flags): batches of rows with the contract's columns and types."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa

from nlosctl.contract.limits import LARGEST_NUMBER, size
from nlosctl.contract.tables import KINDS, ColumnType, Table
from nlosctl.errors import DataError, did_you_mean
from nlosctl.io.measurements.row_checks import BadRow, Problem, ProblemLog
from nlosctl.io.paths.inputs import Input, Part
from nlosctl.io.readers.base import RecordBatch, plain_type
from nlosctl.io.readers.open_file import TableFile, open_part

__all__ = ["PlainReader"]

_CARRIED = {column.name: column.type for table in KINDS.values() for column in table.all_columns if column.carried}
"""The types of the truth and flags that results carry."""


class PlainReader:
    """Reads the parts of one input as the first of several tables of the contract whose columns it has.

    Other columns are kept as they are, those in ``types`` with these types. ``table`` and ``schema`` are known before
    the first batch. Raises DataError if the file is not one of the tables, a column has a wrong type, or a cell can't
    be read.
    """

    def __init__(self, given: Input, *tables: Table, types: Mapping[str, ColumnType] | None = None) -> None:
        self._given, self._types = given, types or {}
        self._log = ProblemLog()
        source = open_part(given.parts[0], size("chunk_rows"), True)
        self.table = _table_of(given.parts[0], source, tables)
        self._first = self._start(given.parts[0], source)
        self.schema: Any = self._first[1]

    def read_all(self) -> Any:
        """Return all rows as one Arrow table; raise DataError without rows. Call it, or ``batches``, once."""
        batches = list(self.batches())
        if not batches:
            raise DataError(f"{self._given.name}: no rows")
        return pa.concat_tables(batches)

    def batches(self) -> Iterator[Any]:
        """Yield Arrow tables in file order, with plain text for dictionary-encoded text; call it once."""
        for part in self._given.parts:
            source, schema = self._first if part is self._given.parts[0] else self._open(part)
            try:
                for batch in source.batches():
                    self._take_faults(part, batch)
                    table = pa.table(batch.table.columns, names=schema.names).cast(_plain(schema))
                    _refuse_too_large(part, table)
                    yield table
            finally:
                source.close()
        self._log.raise_if_stopping()

    def close(self) -> None:
        """Close the file, if the rows are not read."""
        self._first[0].close()

    def _open(self, part: Part) -> tuple[TableFile, Any]:
        source = open_part(part, size("chunk_rows"), True)
        _table_of(part, source, [self.table])
        return self._start(part, source)

    def _start(self, part: Part, source: TableFile) -> tuple[TableFile, Any]:
        types = {**_CARRIED, **self._types, **{column.name: column.type for column in self.table.columns}}
        types = {name: kind for name, kind in types.items() if name in source.names}
        try:
            return source, source.start(types, None)
        except BaseException:
            source.close()
            raise

    def _take_faults(self, part: Part, batch: RecordBatch) -> None:
        numbers = batch.row_numbers()
        problems = [
            Problem(file=part.name, row=int(numbers[fault.index]), line=None, column=fault.column, fault=fault.fault)
            for fault in batch.cell_faults
        ]
        problems += [
            Problem(file=part.name, row=fault.row, line=None, column=None, fault=fault.fault)
            for fault in batch.line_faults
        ]
        self._log.add([BadRow(problem=problem, values={}) for problem in problems])


def _refuse_too_large(part: Part, table: Any) -> None:
    """Raise DataError for a number that is infinite or too large for the evaluation."""
    for field in table.schema:
        if pa.types.is_floating(field.type):
            values = table.column(field.name).drop_null().to_numpy()
            largest = float(np.fmax.reduce(np.abs(values), initial=0.0))
            if largest > LARGEST_NUMBER**2:
                raise DataError(
                    f"{part.name}, column {field.name!r}: got {largest:g}, expected finite numbers within "
                    f"{LARGEST_NUMBER**2:g}"
                )


def _table_of(part: Part, source: TableFile, tables: Sequence[Table]) -> Table:
    twice = sorted({name for name in source.names if source.names.count(name) > 1})
    if twice:
        source.close()
        raise DataError(f"{part.name}: column {twice[0]!r} occurs twice; rename or drop one")
    for table in tables:
        if all(column.name in source.names for column in table.required):
            return table
    source.close()
    lacks = []
    for table in tables:
        missing = next(column.name for column in table.required if column.name not in source.names)
        lacks.append(f"{table.name} need a column {missing!r}{did_you_mean(missing, source.names)}")
    raise DataError(f"{part.name}: {'; '.join(lacks)}. The file has: {', '.join(source.names)}")


def _plain(schema: Any) -> Any:
    return pa.schema([pa.field(field.name, plain_type(field.type)) for field in schema])
