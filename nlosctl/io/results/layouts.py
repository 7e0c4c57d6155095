"""The table of estimates: its columns and schema, and its rows from the estimates of a chunk."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from nlosctl.arrays import BoolArray, FloatArray, IntArray
from nlosctl.contract.statuses import Status
from nlosctl.contract.tables import ESTIMATES, PART, SWEEP_PREFIX, TRUTH_HEIGHT, is_swept
from nlosctl.errors import DataError, UsageError, did_you_mean
from nlosctl.io.arrow_columns import ARROW_TYPES, SweepColumns
from nlosctl.io.measurements.reader import Chunk
from nlosctl.io.readers.base import plain_type

__all__ = [
    "COVARIANCE",
    "MEAN_OF_ROWS",
    "OF_SPACE",
    "POSITION",
    "TRUTH_NAMES",
    "ChunkEstimates",
    "EstimatesLayout",
    "carried_columns",
    "carried_names",
    "cast",
    "nullable",
    "plain_schema",
    "repeated",
    "snapshot_field",
    "truth_positions",
]

OF_SPACE = ("z_m", "cov_xz_m2", "cov_yz_m2", "cov_zz_m2")
"""The columns of estimates in three dimensions beside those of the plane."""

MEAN_OF_ROWS = "mean_time_s"
"""The column of a chunk with the mean time of each row's snapshot, where its source moves within it."""

TRUTH_NAMES = ("truth_x_m", "truth_y_m")
POSITION = ("x_m", "y_m", "z_m")
COVARIANCE = ("cov_xx_m2", "cov_xy_m2", "cov_yy_m2", "cov_xz_m2", "cov_yz_m2", "cov_zz_m2")
_TRUTH = tuple(column.name for column in ESTIMATES.columns if column.carried)
_SOMETIMES = {"time_s", PART.name}
_OWN = {column.name for column in ESTIMATES.columns if not column.carried} | {"source"}
_STATUS_WORDS = pa.array([status.word for status in Status])


@dataclass(frozen=True, kw_only=True)
class ChunkEstimates:
    """Estimates (E,) of a chunk, by snapshot, then method, target and alternative.

    ``snapshot`` and ``method`` are indices. ``measurement`` is the row of the chunk that an estimate is of, where every
    measurement is solved by itself, else -1. ``on_edge`` marks estimates on the edge of the search region. ``columns``
    are further columns (E,) by name.
    """

    snapshot: IntArray
    measurement: IntArray
    method: IntArray
    target: IntArray
    alternative: IntArray
    position_m: FloatArray
    covariance_m2: FloatArray
    n_measurements: IntArray
    n_used: IntArray
    cost: FloatArray
    fit_p_value: FloatArray
    search_failure: FloatArray
    status: npt.NDArray[np.uint8]
    covariance_kind: npt.NDArray[np.object_]
    on_edge: BoolArray
    columns: Mapping[str, FloatArray] = dataclasses.field(default_factory=dict)

    @classmethod
    def join(cls, parts: Sequence[ChunkEstimates]) -> ChunkEstimates:
        """Return the estimates of all parts, NaN in a further column that a part doesn't have."""
        arrays: dict[str, Any] = {
            name: np.concatenate([getattr(part, name) for part in parts]) for name in cls._names()
        }
        columns = {
            name: np.concatenate([part.columns.get(name, np.full(part.cost.shape, np.nan)) for part in parts])
            for name in dict.fromkeys(name for part in parts for name in part.columns)
        }
        return cls(**arrays, columns=columns)

    def take(self, rows: IntArray) -> ChunkEstimates:
        """Return some of the estimates."""
        columns = {name: values[rows] for name, values in self.columns.items()}
        return ChunkEstimates(**{name: getattr(self, name)[rows] for name in self._names()}, columns=columns)

    @classmethod
    def _names(cls) -> list[str]:
        return [field.name for field in dataclasses.fields(cls) if field.name != "columns"]

    def truth_m(self, chunk: Chunk) -> FloatArray:
        """Return the true position (E, D) of estimates from the chunk's truth columns, NaN where they are null."""
        return truth_positions(chunk.table, self.first_rows(chunk), self.position_m.shape[1])

    def first_rows(self, chunk: Chunk) -> IntArray:
        """Return the row (E,) of the chunk whose truth and carried columns an estimate has."""
        return np.where(self.measurement >= 0, self.measurement, chunk.offsets[:-1][self.snapshot])


def carried_names(wanted: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the columns that estimates carry if the input has them (``*`` ends a prefix)."""
    return (*_TRUTH, "scene", f"{SWEEP_PREFIX}*", *wanted)


def carried_columns(input_names: Sequence[str], wanted: Sequence[str], by: Sequence[str] = ()) -> tuple[str, ...]:
    """Return the input's columns that estimates carry: truth, ``scene``, ``sweep_*``, the ``wanted`` ones and ``by``.

    The truth is not carried if the rows are of several targets (``truth_target``). Raises DataError if a wanted column
    does not exist, UsageError if estimates have a column of that name.
    """
    for option, name in [*(("carry", name) for name in wanted), *(("by", name) for name in by)]:
        if name in _OWN - {"snapshot", *_SOMETIMES}:
            raise UsageError(f"`{option}` {name}: estimates have a column {name!r} of their own")
        if name not in input_names:
            raise DataError(f"`{option}` {name}: the input has no such column{did_you_mean(name, input_names)}")
    truth = () if "truth_target" in input_names else _TRUTH
    chosen = {"scene", *truth, *wanted, *by}
    return tuple(
        name
        for name in input_names
        if (name in chosen or (name.startswith(SWEEP_PREFIX) and is_swept(name)))
        and (name not in _OWN or name in _SOMETIMES)
    )


def truth_positions(table: Any, rows: IntArray, dimension: int = 2) -> FloatArray:
    """Return the true positions (N, D) in rows (N,) of a table that has the truth columns; NaN where they are null."""
    names = [*TRUTH_NAMES, TRUTH_HEIGHT.name][:dimension]
    columns = [table.column(name).take(pa.array(rows)).cast(pa.float64()) for name in names]
    return np.stack([np.asarray(column.to_numpy(), dtype=np.float64) for column in columns], axis=1)


@dataclass(frozen=True, kw_only=True)
class EstimatesLayout:
    """The columns of the estimates of a run, the same in every chunk.

    ``optional`` are the columns of the contract that are not always there. ``measurement_name`` is the input's column
    that estimates of single measurements carry, ``frame`` the local plane on earth as text, both empty if there is
    none. ``sweeps`` holds the swept values of each of ``methods``, None without a sweep.
    """

    methods: tuple[str, ...]
    input_schema: pa.Schema
    carried: tuple[str, ...]
    optional: frozenset[str]
    with_source: bool
    measurement_name: str = ""
    frame: str = ""
    sweeps: SweepColumns | None = None

    @cached_property
    def schema(self) -> pa.Schema:
        """The Arrow schema."""
        fields = [snapshot_field(self.input_schema)]
        for column in ESTIMATES.columns[1:]:
            if column.required or column.every_run or column.name in self.optional:
                fields.append(pa.field(column.name, ARROW_TYPES[column.type]))
        if self.measurement_name:
            fields.append(self.input_schema.field(self.measurement_name))
        if self.sweeps is not None:
            fields += self.sweeps.fields
        fields += [self.input_schema.field(name) for name in self.carried if name not in self.optional]
        if self.with_source:
            fields.append(pa.field("source", pa.string()))
        return plain_schema(fields)

    def table(self, estimates: ChunkEstimates, chunk: Chunk) -> pa.Table:
        """Return the table of a chunk's estimates; NaN becomes null."""
        values: dict[str, Any] = {
            "snapshot": chunk.snapshot.take(pa.array(estimates.snapshot)),
            "method": pa.array(self.methods).take(pa.array(estimates.method)),
            "used_share": pa.array(estimates.n_used / estimates.n_measurements),
            "cost": nullable(estimates.cost),
            "fit_p_value": nullable(estimates.fit_p_value),
            "status": _STATUS_WORDS.take(pa.array(estimates.status)),
        }
        for name in ("target", "alternative", "n_measurements", "n_used"):
            values[name] = pa.array(getattr(estimates, name))
        missing = pa.nulls(estimates.snapshot.shape[0])
        values |= dict.fromkeys(self.optional, missing)
        values |= dict(zip(POSITION, map(nullable, estimates.position_m.T), strict=False))
        values |= dict(zip(COVARIANCE, map(nullable, estimates.covariance_m2.T), strict=False))
        if chunk.windows is not None:
            values["time_s"] = pa.array(chunk.windows.time_s[estimates.snapshot])
        elif MEAN_OF_ROWS in chunk.columns:
            values["time_s"] = pa.array(chunk.columns[MEAN_OF_ROWS][estimates.first_rows(chunk)])
        values |= {name: nullable(column) for name, column in estimates.columns.items()}
        if "covariance_kind" in self.optional:
            values["covariance_kind"] = pa.array(estimates.covariance_kind, pa.string())
        if "frame" in self.optional:
            values["frame"] = repeated(self.frame, estimates.snapshot.shape[0])
        if self.sweeps is not None:
            values |= {name: self.sweeps.take(name, estimates.method) for name in self.sweeps.names}
        first_rows = pa.array(estimates.first_rows(chunk))
        for name in set(self.carried) - self.optional:
            values[name] = chunk.table.column(name).take(first_rows)
        if self.measurement_name:
            single = pa.array(estimates.measurement, mask=estimates.measurement < 0)
            values[self.measurement_name] = chunk.table.column(self.measurement_name).take(single)
        if self.with_source:
            values["source"] = repeated(chunk.source, estimates.snapshot.shape[0])
        return pa.table([cast(values[field.name], field.type) for field in self.schema], schema=self.schema)


def snapshot_field(schema: pa.Schema) -> pa.Field:
    """Return the field ``snapshot`` of an input, integers if it has none."""
    return schema.field("snapshot") if "snapshot" in schema.names else pa.field("snapshot", pa.int64())


def plain_schema(fields: Sequence[pa.Field]) -> pa.Schema:
    """Return the schema without metadata and with plain text for dictionary-encoded text: equal for every input."""
    return pa.schema([pa.field(field.name, plain_type(field.type)) for field in fields])


def repeated(text: str, size: int) -> pa.Array:
    """Return an array (N,) of one text."""
    return pa.array([text]).take(pa.array(np.zeros(size, dtype=np.int64)))


def nullable(values: npt.NDArray[Any]) -> pa.Array:
    """Return floats (N,) as an array in which NaN is null."""
    return pa.array(values, mask=np.isnan(values))


def cast(values: Any, arrow_type: pa.DataType) -> Any:
    """Return the values in a type, unchanged if they have it."""
    return values if values.type == arrow_type else values.cast(arrow_type)
