"""Result tables (estimates, flags) read back: batches of rows with the contract's columns in the contract's types."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import pyarrow as pa

from nlosctl.contract.tables import Table
from nlosctl.errors import DataError, did_you_mean
from nlosctl.io.inputs import Input, Part
from nlosctl.io.open_part import open_part
from nlosctl.io.open_tables import plain_type
from nlosctl.io.problems import BadRow, Problem, ProblemLog
from nlosctl.io.raw import RawBatch

__all__ = ["PlainReader"]

_BATCH_ROWS = 131_072


class PlainReader:
    """Reads the parts of one input as a table of the contract; columns that the contract lacks come as they are.

    ``schema`` is there at once. Raises DataError where a required column is missing, has a wrong type, or a cell
    can't be read.
    """

    def __init__(self, given: Input, table: Table, *, needed: Sequence[str] = ()) -> None:
        self._given, self._table = given, table
        self._needed = (*(column.name for column in table.required), *needed)
        self._log = ProblemLog()
        self.metadata: Mapping[bytes, bytes] = {}
        self._first = self._open(given.parts[0])
        self.schema: Any = self._first[1]

    def batches(self) -> Iterator[Any]:
        """Yield Arrow tables in file order, with plain text for dictionary-encoded text; call it once."""
        for part in self._given.parts:
            source, schema = self._first if part is self._given.parts[0] else self._open(part)
            try:
                for batch in source.batches():
                    self._take_faults(part, batch)
                    yield pa.table(batch.table.columns, names=schema.names).cast(_plain(schema))
            finally:
                source.close()
        self._log.raise_if_stopping()

    def _open(self, part: Part) -> tuple[Any, Any]:
        source = open_part(part, _BATCH_ROWS, True)
        missing = [name for name in self._needed if name not in source.names]
        if missing:
            source.close()
            raise DataError(
                f"{part.name}: no {self._table.name}: missing column {missing[0]!r}"
                f"{did_you_mean(missing[0], source.names)}. The file has: {', '.join(source.names)}"
            )
        self.metadata = self.metadata or source.metadata
        types = {column.name: column.type for column in self._table.columns if column.name in source.names}
        return source, source.start(types, None)

    def _take_faults(self, part: Part, batch: RawBatch) -> None:
        numbers = batch.row_numbers()
        found = [
            Problem(file=part.name, row=int(numbers[fault.position]), line=None, column=fault.column, fault=fault.fault)
            for fault in batch.cell_faults
        ]
        found += [
            Problem(file=part.name, row=fault.row, line=None, column=None, fault=fault.fault)
            for fault in batch.line_faults
        ]
        self._log.add([BadRow(problem=problem, values={}) for problem in found])


def _plain(schema: Any) -> Any:
    return pa.schema([pa.field(field.name, plain_type(field.type)) for field in schema])
