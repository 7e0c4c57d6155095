"""Row batches: the good rows of one record batch with the contract's columns, checked and in its units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from nlosctl.arrays import BoolArray, IntArray
from nlosctl.contract.scene import Scene
from nlosctl.contract.tables import Column
from nlosctl.errors import DataError
from nlosctl.io.measurements.bad_rows import log_bad_rows
from nlosctl.io.measurements.column_mapping import NULL_CODE, SNAPSHOT, NameCodes
from nlosctl.io.measurements.completion.exact_numbers import REST, exact_numbers
from nlosctl.io.measurements.row_checks import TICKS, Fault, ReadReport, RowTally, ValueChecks, is_null, null_mask
from nlosctl.io.measurements.row_consistency import half_filled_faults, indefinite_faults, missing_std_faults
from nlosctl.io.measurements.scene_columns import SceneColumns, from_north
from nlosctl.io.measurements.snapshot_ids import id_type
from nlosctl.io.measurements.survey import OpenTable
from nlosctl.io.measurements.table_schemas import conformed
from nlosctl.io.readers.base import RecordBatch, plain

__all__ = ["ReadReport", "RowBatch", "RowConverter", "RowTally", "join_rows", "split_whole"]

_HEIGHT = 2
"""The axis of the scene's positions that is a height."""


@dataclass(frozen=True, kw_only=True)
class RowBatch:
    """Good rows (N,) of one file: table, snapshot ids, contract columns, row numbers, lines of a text file.

    ``starts`` (S,) are the indices of rows that begin a snapshot, once they are known.
    """

    file: str
    table: Any
    ids: Any
    rows: IntArray
    columns: Mapping[str, npt.NDArray[Any]]
    left_out: BoolArray
    lines: IntArray | None
    starts: IntArray = field(default_factory=lambda: np.empty(0, dtype=np.int64))

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.ids)

    def slice(self, start: int, stop: int) -> RowBatch:
        """Return the rows from ``start`` to ``stop``."""
        within = (self.starts >= start) & (self.starts < stop)
        return replace(
            self,
            table=self.table.slice(start, stop - start),
            ids=self.ids.slice(start, stop - start),
            rows=self.rows[start:stop],
            lines=None if self.lines is None else self.lines[start:stop],
            columns={name: values[start:stop] for name, values in self.columns.items()},
            left_out=self.left_out[start:stop],
            starts=self.starts[within] - start,
        )

    def filter(self, keep: BoolArray) -> RowBatch:
        """Return the rows where ``keep`` (N,) is true, which must include the first of each snapshot."""
        mask = pa.array(keep)
        return replace(
            self,
            table=self.table.filter(mask),
            ids=self.ids.filter(mask),
            rows=self.rows[keep],
            lines=None if self.lines is None else self.lines[keep],
            columns={name: values[keep] for name, values in self.columns.items()},
            left_out=self.left_out[keep],
            starts=np.cumsum(keep)[self.starts] - 1 if self.starts.shape[0] else self.starts,
        )

    def take(self, indices: IntArray) -> RowBatch:
        """Return the rows at ``indices``, without the begins of snapshots."""
        return replace(
            self,
            table=self.table.take(pa.array(indices)),
            ids=self.ids.take(pa.array(indices)),
            rows=self.rows[indices],
            lines=None if self.lines is None else self.lines[indices],
            columns={name: values[indices] for name, values in self.columns.items()},
            left_out=self.left_out[indices],
            starts=np.empty(0, dtype=np.int64),
        )

    def rises(self, column: str) -> bool:
        """Return whether a column rises strictly within each snapshot, so that no row repeats another."""
        values = self.columns[column]
        falls = values[1:] <= values[:-1]
        falls[self.starts[1:] - 1] = False
        return not bool(falls.any())


def join_rows(batches: Sequence[RowBatch]) -> RowBatch:
    """Return the batches as one, without their lines; a single one is not copied.

    A column that is absent from a file is NaN in its rows (only numbers can be absent).
    """
    if len(batches) == 1:
        return batches[0]
    shifts = np.cumsum([0, *(len(batch) for batch in batches[:-1])])
    names = dict.fromkeys(name for batch in batches for name in batch.columns)
    absent = [np.full(len(batch), np.nan) for batch in batches]
    return replace(
        batches[0],
        table=pa.concat_tables([batch.table for batch in batches]),
        ids=pa.concat_arrays([batch.ids for batch in batches]),
        rows=np.concatenate([batch.rows for batch in batches]),
        lines=None,
        columns={
            name: np.concatenate([batch.columns.get(name, nan) for batch, nan in zip(batches, absent, strict=True)])
            for name in names
        },
        left_out=np.concatenate([batch.left_out for batch in batches]),
        starts=np.concatenate([batch.starts + shift for batch, shift in zip(batches, shifts, strict=True)]),
    )


def split_whole(pending: list[RowBatch], rows: RowBatch) -> tuple[list[RowBatch], list[RowBatch]]:
    """Return the rows of snapshots that ``rows`` show to be complete, and those that wait for more rows."""
    if not pending:
        return [], [rows]
    if rows.starts.shape[0] and rows.starts[0] == 0:
        return pending, [rows]
    last = max(number for number, batch in enumerate(pending) if batch.starts.shape[0])
    batch = pending[last]
    cut = int(batch.starts[-1])
    if last == cut == 0:
        return [], [*pending, rows]
    whole = [*pending[:last], *([batch.slice(0, cut)] if cut else [])]
    return whole, [batch.slice(cut, len(batch)), *pending[last + 1 :], rows]


class RowConverter:
    """Converts the record batches of one file to row batches; bad rows go to the log of ``tally``.

    ``schema`` is the Arrow schema of all files; ``names`` are the codes of names by column, the same for all files.
    """

    def __init__(
        self,
        opened: OpenTable,
        schema: Any,
        scene: Scene,
        names: dict[str, NameCodes],
        tally: RowTally,
        *,
        all_rows: bool,
    ) -> None:
        self._opened, self._plan, self._schema, self._scene = opened, opened.plan, schema, scene
        self._names, self._tally, self._all_rows = names, tally, all_rows
        self._file = opened.part.name
        self.checks = ValueChecks(opened.plan, self._file)
        self._times: Any = None
        if opened.time_column:
            from nlosctl.io.measurements.windows.times import TimeColumn

            own_name = opened.file_name_of[opened.time_column]
            self._times = TimeColumn(opened.time_column, own_name, self._file, opened.timezone)

    def convert(self, record_batch: RecordBatch) -> RowBatch:
        """Return the good rows of a record batch."""
        batch = record_batch.table.rename_columns(list(self._opened.names))
        self.checks.rows += batch.num_rows
        ids, faults = self._ids(batch)
        columns = self._columns(batch, record_batch.row_numbers(), faults)
        any_bad = record_batch.line_faults or record_batch.cell_faults or faults
        bad = log_bad_rows(self._file, record_batch, faults, self._opened, self._tally.log) if any_bad else None
        self._count(batch.num_rows, 0 if bad is None else int(bad.sum()), record_batch)
        self._tally.lost.add(ids, bad)
        rows = RowBatch(
            file=self._file,
            table=self._table(batch),
            ids=ids,
            rows=record_batch.row_numbers(),
            columns=columns,
            left_out=np.zeros(batch.num_rows, dtype=np.bool_) if self._all_rows else self._left_out(batch),
            lines=record_batch.lines,
        )
        return rows if bad is None else rows.filter(~bad)

    def _count(self, rows: int, bad: int, batch: RecordBatch) -> None:
        report, bad_lines = self._tally.report, len(batch.line_faults)
        report.rows += rows - bad
        report.bad_rows += bad + bad_lines
        if batch.left_out:
            report.unused_rows.update(batch.left_out)
            rows += sum(batch.left_out.values())
        report.rows_by_file[self._file] = report.rows_by_file.get(self._file, 0) + rows + bad_lines

    def _table(self, batch: Any) -> Any:
        if batch.schema.equals(self._schema):
            return pa.Table.from_batches([batch])
        return conformed(batch, self._schema, self._file, self._opened.file_name_of)

    def _ids(self, batch: Any) -> tuple[Any, list[Fault]]:
        """Return the snapshot ids as an Arrow array (N,), 0 in a file without, and the faults of null ones."""
        if not self._plan.has_snapshot:
            return pa.array(np.zeros(batch.num_rows, dtype=np.int64)), []
        try:
            ids = plain(batch.column(SNAPSHOT)).cast(id_type(self._schema))
        except pa.ArrowInvalid as error:
            raise DataError(f"{self._file}, column 'snapshot': beyond 64-bit integers; store it as text") from error
        if not ids.null_count:
            return ids, []
        return ids, [Fault(mask=null_mask(ids), column=SNAPSHOT, describe=is_null("text or an integer"))]

    def _columns(self, batch: Any, rows: IntArray, faults: list[Fault]) -> dict[str, npt.NDArray[Any]]:
        """Return the contract's columns (N,) of an Arrow batch; adds to ``faults``."""
        columns: dict[str, npt.NDArray[Any]] = {}
        mapped = self._plan.mapped
        if self._times is not None:
            columns[TICKS] = self._times.ticks(batch.column(self._opened.time_column), rows, faults)
        for column in self._plan.table.columns:
            if column.carried or column.name == SNAPSHOT:
                continue
            if column.type == "exact":
                columns[column.name], columns[REST] = exact_numbers(mapped[column.name], batch, faults)
                continue
            values = self._column(column, batch, columns, faults)
            if values is not None:
                columns[column.name] = values
        self.checks.booleans(batch, faults)
        if "reflector" in mapped and (self._scene.has_circles or self._scene.has_spheres):
            self._scene_columns.check_circles(columns, self._plan.table.dimension, faults)
        for group in (group for alternatives in self._plan.table.together for group in alternatives):
            if all(name in mapped for name in group):
                faults += half_filled_faults(group, self._plan, columns)
        for entries in self._plan.table.covariances:
            if all(name in mapped for name in entries):
                faults += indefinite_faults(entries, self._plan, columns)
        if any(name in mapped and batch.column(mapped[name].name).null_count for name in self._plan.scene_axes):
            self._scene_columns.half_positions(batch, faults)
        if self._times is not None and self._scene.time_column:
            valid = self._scene_columns.check_times(self._opened.time_column, batch, columns, faults)
            self._tally.report.valid_sensors |= valid
        if self._plan.table.dimension == 3 or REST in columns or "sensor_std_m" in mapped or self._scene.is_uncertain:
            from nlosctl.io.measurements.completion.completed_rows import complete_columns

            complete_columns(self._plan, self._scene_columns, batch, columns, faults)
        if self._plan.relative:
            self._scene_columns.add_headings(self._file, batch, columns, faults)
        if {"bearing_rad", "range_m", "range_std_m"} <= mapped.keys():
            faults += missing_std_faults(self._plan, columns)
        return columns

    def _column(
        self, column: Column, batch: Any, done: Mapping[str, npt.NDArray[Any]], faults: list[Fault]
    ) -> npt.NDArray[Any] | None:
        """Return one column (N,) of the contract, None for numbers that are absent; ``done`` are those before it."""
        mapped = self._plan.mapped.get(column.name)
        if column.scene_sensor and mapped is None:
            return self._scene_columns.node_positions(column, batch, done, faults)
        if column.scene_axis == _HEIGHT and mapped is None and not column.required:
            return self._scene_columns.heights(done)
        axes = (0, 1, _HEIGHT) if column.required and self._scene.has_heights else (0, 1)
        if column.scene_axis in axes and (mapped is None or batch.column(mapped.name).null_count):
            return self._scene_columns.positions(column, mapped, batch, done, faults)
        if mapped is None:
            constants = {**self._plan.units, **self._plan.constants}
            if column.name in constants:
                return np.full(batch.num_rows, constants[column.name])
            return None if column.type == "number" else np.full(batch.num_rows, NULL_CODE, dtype=np.int64)
        cells = batch.column(mapped.name)
        if column.names_reflector:
            return self._scene_columns.reflectors(mapped, cells, faults)
        if column.type in ("identifier", "text"):
            owner = "sensor" if column.name == "reference" else column.name
            codes = self._names.setdefault(owner, NameCodes()).encode(cells)
            if not column.nullable and (codes == NULL_CODE).any():
                faults.append(Fault(mask=codes == NULL_CODE, column=mapped.name, describe=is_null("a name")))
            return codes
        if column.type == "integer":
            return self.checks.integers(mapped, cells, faults)
        numbers = self.checks.numbers(mapped, cells, faults)
        frame = self._scene.frame
        return from_north(numbers, done, column.measured_at, frame) if mapped.from_north and frame else numbers

    @cached_property
    def _scene_columns(self) -> SceneColumns:
        return SceneColumns(self._scene, self._plan, self._names.setdefault("sensor", NameCodes()))

    def _left_out(self, batch: Any) -> BoolArray:
        """Return the rows (N,) that an earlier step flagged: not line of sight, or an indirect path."""
        out = np.zeros(batch.num_rows, dtype=np.bool_)
        for name, leaves_out in (("los", False), ("ip", True)):
            if name in self._plan.mapped:
                cells = plain(batch.column(self._plan.mapped[name].name)).cast(pa.bool_())
                out |= cells.fill_null(not leaves_out).to_numpy(zero_copy_only=False) == leaves_out
        return out
