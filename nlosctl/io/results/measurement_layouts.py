"""Result tables with a row per measurement: flags, and the trace of sequential methods."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.compute as pc

from nlosctl.arrays import FloatArray, IntArray
from nlosctl.contract.results import Flags, Trace, Words
from nlosctl.contract.tables import FLAGS, TRACE
from nlosctl.io.arrow_columns import ARROW_TYPES, SweepColumns
from nlosctl.io.measurements.completion.calibrated_rows import STD_FACTOR
from nlosctl.io.measurements.reader import Chunk
from nlosctl.io.results.layouts import cast, nullable, plain_schema, repeated, snapshot_field

__all__ = ["ChunkTrace", "FlagsLayout", "TraceLayout", "chunk_trace"]

_KEPT_FLAGS = ("los", "ip")
_REPLACED = {column.name for column in FLAGS.columns if column.name not in ("snapshot", *_KEPT_FLAGS)}


@dataclass(frozen=True, kw_only=True)
class FlagsLayout:
    """The columns of the flags of a run: the input's columns, then the flags of the methods.

    ``names`` are the flag columns besides ``used``. ``constants`` replace missing columns and become columns, so that
    flags are valid measurements. ``sweeps`` holds the swept values of each of ``methods``, None without a sweep.
    """

    methods: tuple[str, ...]
    input_schema: pa.Schema
    names: tuple[str, ...]
    constants: Mapping[str, float]
    with_source: bool
    sweeps: SweepColumns | None = None

    @cached_property
    def schema(self) -> pa.Schema:
        """The Arrow schema; earlier flags are replaced, but ``los`` and ``ip`` only by new ones.

        Without earlier flags, columns of the input that are named like flags get the prefix ``input_``.
        """
        fields = [self.input_schema.field(name).with_name(kept) for kept, name in self._kept.items()]
        fields += [pa.field(name, pa.float64()) for name in self.constants]
        if self.with_source:
            fields.append(pa.field("source", pa.string()))
        if self._with_method:
            fields.append(pa.field("method", pa.string()))
        if self.sweeps is not None:
            fields += self.sweeps.fields
        fields.append(pa.field("used", pa.bool_()))
        fields += [pa.field(name, ARROW_TYPES[FLAGS.column(name).type]) for name in self.names]
        return plain_schema(fields)

    def table(self, flags: Sequence[Flags], chunk: Chunk) -> pa.Table:
        """Return the table of a chunk's flags (N,): for each snapshot, the rows by the first method, then the next.

        Rows of windows of time are in the order of the input instead, each by all methods.
        """
        tables = [self._method_table(number, flag, chunk) for number, flag in enumerate(flags)]
        if chunk.windows is not None:
            order = np.argsort(np.tile(chunk.windows.origin, len(tables)), kind="stable")
            return pa.concat_tables(tables).take(pa.array(order))
        if len(tables) == 1:
            return tables[0]
        counts = np.diff(chunk.offsets)
        snapshot = np.repeat(np.arange(counts.shape[0]), counts)
        method = np.repeat(np.arange(len(tables)), chunk.table.num_rows)
        order = np.lexsort((method, np.tile(snapshot, len(tables))))
        return pa.concat_tables(tables).take(pa.array(order))

    @cached_property
    def _kept(self) -> dict[str, str]:
        """The input's columns that flags have too, by their names in the flags."""
        names = [name for name in self.input_schema.names if name not in _KEPT_FLAGS or name not in self.names]
        ours = _REPLACED | {"source"}
        if "used" in names:
            return {name: name for name in names if name not in ours}
        return {_prefixed(name, names) if name in ours else name: name for name in names}

    @property
    def _with_method(self) -> bool:
        return len(self.methods) > 1 or self.sweeps is not None

    def _method_table(self, number: int, flags: Flags, chunk: Chunk) -> pa.Table:
        rows, size = chunk.table, chunk.table.num_rows
        values: dict[str, Any] = {name: pa.array(np.full(size, value)) for name, value in self.constants.items()}
        if self.with_source:
            values["source"] = repeated(chunk.source, size)
        if self._with_method:
            values["method"] = repeated(self.methods[number], size)
        if self.sweeps is not None:
            values |= {name: self.sweeps.take(name, np.full(size, number)) for name in self.sweeps.names}
        values["used"] = pa.array(flags.used)
        known = {name: chunk.columns[name] for name in (STD_FACTOR,) if name in chunk.columns} | dict(flags.columns)
        for name in self.names:
            values[name] = _flag_values(known.get(name), self.schema.field(name).type, rows, name)
        values |= {kept: rows.column(name) for kept, name in self._kept.items()}
        columns = [values[field.name] for field in self.schema]
        return pa.table(list(map(cast, columns, self.schema.types)), schema=self.schema)


def _prefixed(name: str, taken: Sequence[str]) -> str:
    """Return the name with the prefix ``input_``, as often as needed for a name that is not taken."""
    while (name := f"input_{name}") in taken:
        pass
    return name


@dataclass(frozen=True, kw_only=True)
class ChunkTrace:
    """The states (T,) of sequential methods, by snapshot, method and step; indices are those of the chunk."""

    snapshot: IntArray
    method: IntArray
    step: IntArray
    measurement: IntArray
    position_m: FloatArray
    covariance_m2: FloatArray


def chunk_trace(parts: Sequence[tuple[int, IntArray, IntArray, Trace]]) -> ChunkTrace:
    """Return the states of dense batches in the order of the chunk.

    A part is the index of the method, the chunk's indices of the batch's snapshots (B,) and rows (B, K), and the trace.
    """
    nothing = np.empty(0, dtype=np.int64)
    method = [np.full(trace.row.shape, number, dtype=np.int64) for number, _, _, trace in parts]
    arrays = {
        "snapshot": np.concatenate([nothing, *(snapshot[trace.row] for _, snapshot, _, trace in parts)]),
        "method": np.concatenate([nothing, *method]),
        "step": np.concatenate([nothing, *(trace.step for *_, trace in parts)]),
        "measurement": np.concatenate([nothing, *(row[trace.row, trace.measurement] for _, _, row, trace in parts)]),
        "position_m": np.concatenate([np.empty((0, 2)), *(trace.position_m for *_, trace in parts)]),
        "covariance_m2": np.concatenate([np.empty((0, 3)), *(trace.covariance_m2 for *_, trace in parts)]),
    }
    order = np.lexsort((arrays["step"], arrays["method"], arrays["snapshot"]))
    return ChunkTrace(**{name: array[order] for name, array in arrays.items()})


@dataclass(frozen=True, kw_only=True)
class TraceLayout:
    """The columns of the trace of a run."""

    methods: tuple[str, ...]
    input_schema: pa.Schema
    with_source: bool
    sweeps: SweepColumns | None = None

    @cached_property
    def schema(self) -> pa.Schema:
        """The Arrow schema."""
        own = {"snapshot": snapshot_field(self.input_schema), "sensor": self.input_schema.field("sensor")}
        fields = [
            own[column.name] if column.name in own else pa.field(column.name, ARROW_TYPES[column.type])
            for column in TRACE.columns
        ]
        if self.sweeps is not None:
            fields += self.sweeps.fields
        if self.with_source:
            fields.append(pa.field("source", pa.string()))
        return plain_schema(fields)

    def table(self, trace: ChunkTrace, chunk: Chunk) -> pa.Table:
        """Return the table of a chunk's states."""
        values: dict[str, Any] = {
            "snapshot": chunk.snapshot.take(pa.array(trace.snapshot)),
            "method": pa.array(self.methods).take(pa.array(trace.method)),
            "step": pa.array(trace.step),
            "sensor": chunk.table.column("sensor").take(pa.array(trace.measurement)),
        }
        for index, name in enumerate(("x_m", "y_m")):
            values[name] = pa.array(trace.position_m[:, index])
        for index, name in enumerate(("cov_xx_m2", "cov_xy_m2", "cov_yy_m2")):
            values[name] = pa.array(trace.covariance_m2[:, index])
        if self.sweeps is not None:
            values |= {name: self.sweeps.take(name, trace.method) for name in self.sweeps.names}
        if self.with_source:
            values["source"] = repeated(chunk.source, trace.snapshot.shape[0])
        return pa.table([cast(values[field.name], field.type) for field in self.schema], schema=self.schema)


def _flag_values(
    values: npt.NDArray[Any] | Words | None, arrow_type: pa.DataType, rows: pa.Table, name: str
) -> pa.Array:
    """Return a flag column (N,); ``los`` and ``ip`` of an earlier step stay where the new flag is null."""
    if values is None:
        new = pa.nulls(rows.num_rows, arrow_type)
    elif isinstance(values, Words):
        new = pa.array(values.words, arrow_type).take(pa.array(values.code))
    elif values.dtype.kind == "f":
        new = nullable(values)
    else:
        new = pa.array(values, arrow_type)
    if name in _KEPT_FLAGS and name in rows.column_names:
        return pc.coalesce(new, cast(rows.column(name), arrow_type))
    return new
