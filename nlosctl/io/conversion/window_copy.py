"""Tables copied with snapshots that are made of their times."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pyarrow as pa

from nlosctl.contract.run_options import InputOptions
from nlosctl.contract.tables import KINDS
from nlosctl.errors import UsageError
from nlosctl.io.conversion.table_copy import TableCopy
from nlosctl.io.measurements.column_mapping import kind_of_columns
from nlosctl.io.measurements.reader import MeasurementReader
from nlosctl.io.measurements.row_checks import BadRowSink, ProblemLog
from nlosctl.io.measurements.windows.window_tally import window_remarks
from nlosctl.io.paths.inputs import Input

__all__ = ["WindowCopy"]


class WindowCopy:
    """Copies one input with a column ``snapshot``, sorted by window, without the rows that windows do not keep.

    Missing standard deviations are not needed for that.
    """

    def __init__(self, given: Input, options: InputOptions) -> None:
        if options.window_keep == "mean":
            raise UsageError(
                "`window_keep` mean is for commands that solve; convert keeps rows: set it to all or nearest"
            )
        plain = TableCopy(given, replace(options, window=None, by=()))
        self.metadata = plain.metadata
        plain.close()
        self._reader = MeasurementReader([given], replace(options, constants=_any_stds(plain.schema.names, options)))
        self.schema: Any = self._reader.table_schema
        self.remarks: list[str] = []

    @property
    def log(self) -> ProblemLog:
        """The log of the bad rows."""
        return self._reader.log

    @property
    def unused_rows(self) -> Counter[str]:
        """The number of rows that options leave out."""
        return self._reader.report.unused_rows

    def set_bad_rows_aside(self, sink: BadRowSink) -> None:
        """Send bad rows to ``sink`` and continue with the others; call it before the rows are read."""
        self._reader.set_bad_rows_aside(sink)

    def tables(self) -> Iterator[Any]:
        """Yield the rows; raise DataError for a bad row that is not set aside. ``remarks`` are complete afterwards."""
        for chunk in self._reader.chunks():
            assert chunk.windows is not None  # noqa: S101 - windows were asked for
            kept = chunk.windows.leader == np.arange(chunk.table.num_rows)
            yield chunk.table if kept.all() else chunk.table.filter(pa.array(kept))
        self.remarks += window_remarks(self._reader.report.windows, self._reader.options.window)

    def close(self) -> None:
        """Close the input."""
        self._reader.close()


def _any_stds(names: list[str], options: InputOptions) -> dict[str, float]:
    """Return 1 for each standard deviation that a table with the columns ``names`` lacks."""
    given = {*names, *options.columns}
    table = KINDS[options.kind or kind_of_columns(given)]
    columns = (column for column in table.columns if column.required and column.constant_allowed)
    return {column.name: 1.0 for column in columns if given.isdisjoint(column.accepted_names)}
