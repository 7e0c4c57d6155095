"""The bad rows of a record batch, each with its first fault, for the log."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from nlosctl.arrays import BoolArray
from nlosctl.io.measurements.row_checks import BadRow, Fault, Problem, ProblemLog
from nlosctl.io.measurements.survey import OpenTable
from nlosctl.io.readers.base import RecordBatch, text_at

__all__ = ["bad_rows_of", "log_bad_rows"]


def bad_rows_of(
    file: str, batch: RecordBatch, names: Sequence[str], faults: Mapping[int, tuple[str, str]]
) -> list[BadRow]:
    """Return the bad rows of a batch in file order: those at the indices of ``faults``, and lines that are not rows.

    ``names`` are the columns, ``faults`` the column and the message for each index.
    """
    rows = [
        BadRow(
            problem=Problem(file=file, row=line.row, line=line.line, column=None, fault=line.fault),
            values={},
            raw_line=line.text,
        )
        for line in batch.line_faults
    ]
    numbers = batch.row_numbers()
    cells = batch.table if batch.text is None else batch.text
    for index, (column, fault) in faults.items():
        line = None if batch.lines is None else int(batch.lines[index])
        problem = Problem(file=file, row=int(numbers[index]), line=line, column=column, fault=fault)
        values = {name: text_at(cells.column(at), index) for at, name in enumerate(names)}
        rows.append(BadRow(problem=problem, values=values))
    return sorted(rows, key=lambda row: row.problem.row or 0)


def log_bad_rows(
    file: str, batch: RecordBatch, faults: Sequence[Fault], opened: OpenTable, log: ProblemLog
) -> BoolArray:
    """Log each bad row with its first fault, under the file's own column; return their mask (N,)."""
    first: dict[int, tuple[str, str]] = {}
    for cell in batch.cell_faults:
        first.setdefault(cell.index, (cell.column, cell.fault))
    bad = np.zeros(batch.table.num_rows, dtype=np.bool_)
    bad[list(first)] = True
    wanted = log.wanted()
    for fault in faults:
        for index in np.flatnonzero(fault.mask & ~bad)[:wanted].tolist():
            column = batch.origins[fault.column][index] if fault.column in batch.origins else fault.column
            first[index] = (opened.file_name_of.get(column, column), fault.describe(index))
        bad |= fault.mask
    log.add(bad_rows_of(file, batch, opened.names, first)[:wanted], total=int(bad.sum()) + len(batch.line_faults))
    return bad
