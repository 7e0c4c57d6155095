"""Estimates and flags as Arrow tables: from flat arrays and the input's own columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.compute as pc

from nlosctl.arrays import BoolArray, IntArray
from nlosctl.contract.results import Words
from nlosctl.contract.statuses import Status
from nlosctl.contract.tables import ELLIPSE, ESTIMATES, FLAGS, PRECISION, TRACE, Column
from nlosctl.errors import DataError, UsageError, did_you_mean
from nlosctl.io.sweep_columns import SWEEP_PREFIX, SweepColumns

__all__ = ["EstimatesLayout", "FlagsLayout", "TraceLayout", "carried_columns", "carried_names"]

Arrays = Mapping[str, npt.NDArray[Any]]
Said = Mapping[str, npt.NDArray[Any] | Words]

_TYPES = {"number": pa.float64(), "integer": pa.int64(), "boolean": pa.bool_(), "text": pa.string()}
_TRUTH = ("truth_x_m", "truth_y_m", "truth_lat_deg", "truth_lon_deg")
_ON_EARTH = ("lat_deg", "lon_deg", "frame")
_ON_REQUEST = ("covariance_kind", *_ON_EARTH, *(column.name for column in (*ELLIPSE, *PRECISION)))
_ALWAYS_CARRIED = (*_TRUTH, "scene")
_KEPT_FLAGS = ("los", "ip")
_NO_SWEEP = SweepColumns()
_STATUS_WORDS = pa.array([status.word for status in Status])


def carried_names(wanted: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the columns that estimates carry over, as far as an input has them (``*`` ends a prefix)."""
    return (*_ALWAYS_CARRIED, f"{SWEEP_PREFIX}*", *wanted)


def carried_columns(input_names: Sequence[str], wanted: Sequence[str]) -> tuple[str, ...]:
    """Return the input's columns that estimates carry over: truth, scene, ``sweep_*``, and the ``wanted`` ones.

    Rows of several targets (``truth_target``) have no one truth to carry. Raises DataError where a wanted column is
    not there, UsageError where estimates have one of that name.
    """
    own = {column.name for column in ESTIMATES.columns if column.name not in _ALWAYS_CARRIED} | {"source"}
    for name in wanted:
        if name in own - {"snapshot"}:
            raise UsageError(f"--carry {name}: estimates have a column {name!r} of their own")
        if name not in input_names:
            raise DataError(f"--carry {name}: the input has no such column{did_you_mean(name, input_names)}")
    truth = () if "truth_target" in input_names else _TRUTH
    chosen = {"scene", *truth, *wanted}
    return tuple(name for name in input_names if (name in chosen or name.startswith(SWEEP_PREFIX)) and name not in own)


@dataclass(frozen=True, kw_only=True)
class EstimatesLayout:
    """How the estimates table of a run looks: same columns in every chunk.

    ``measurement_name`` is the input's column that an estimate of a single measurement carries, if there is one;
    ``sweeps`` tells the swept values of each of ``methods``. ``frame`` is how the plane lies on earth, in words, where
    it does. ``wanted`` are further columns of the contract: the ellipse, cep50_m, gdop.
    """

    methods: tuple[str, ...]
    input_schema: pa.Schema
    carried: tuple[str, ...]
    with_covariance_kind: bool
    with_source: bool
    measurement_name: str = ""
    frame: str | None = None
    wanted: tuple[str, ...] = ()
    sweeps: SweepColumns = _NO_SWEEP

    @property
    def schema(self) -> pa.Schema:
        """The Arrow schema."""
        asked = {*self.wanted, *(() if self.frame is None else _ON_EARTH)}
        if self.with_covariance_kind:
            asked.add("covariance_kind")
        fields = [_snapshot_field(self.input_schema)]
        for column in ESTIMATES.columns[1:]:
            if column.name in _ALWAYS_CARRIED or (column.name in _ON_REQUEST and column.name not in asked):
                continue
            fields.append(pa.field(column.name, _TYPES[column.type]))
        if self.measurement_name:
            fields.append(self.input_schema.field(self.measurement_name).with_metadata(None).with_nullable(True))
        fields += self.sweeps.fields
        fields += [self.input_schema.field(name).with_metadata(None) for name in self.carried]
        if self.with_source:
            fields.append(pa.field("source", pa.string()))
        return pa.schema([_plain(field) for field in fields])

    def table(self, arrays: Arrays, *, ids: pa.Array, first_row: IntArray, rows: pa.Table, source: str) -> pa.Table:
        """Return the table of a chunk's estimates.

        ``arrays`` holds the fields of flat estimates (E,), ``ids`` (S,) the snapshot ids, ``first_row`` (S,) each
        snapshot's first row in ``rows``, the chunk's input.
        """
        snapshot = arrays["snapshot"]
        values: dict[str, Any] = {
            "snapshot": ids.take(pa.array(snapshot)),
            "method": pa.array(self.methods).take(pa.array(arrays["method"])),
            "x_m": _nullable(arrays["position_m"][:, 0]),
            "y_m": _nullable(arrays["position_m"][:, 1]),
            "cov_xx_m2": _nullable(arrays["covariance_m2"][:, 0]),
            "cov_xy_m2": _nullable(arrays["covariance_m2"][:, 1]),
            "cov_yy_m2": _nullable(arrays["covariance_m2"][:, 2]),
            "cost": _nullable(arrays["cost"]),
            "status": _STATUS_WORDS.take(pa.array(arrays["status"])),
        }
        for name in ("target", "alternative", "n_measurements", "n_used"):
            values[name] = pa.array(arrays[name])
        if self.with_covariance_kind:
            values["covariance_kind"] = pa.array(arrays["covariance_kind"], pa.string())
        if self.frame is not None:
            values["frame"] = _repeated(self.frame, snapshot.shape[0])
            values |= {name: _nullable(arrays[name]) for name in ("lat_deg", "lon_deg")}
        values |= {name: _nullable(arrays[name]) for name in self.wanted}
        single = arrays["row"]
        places = pa.array(np.where(single >= 0, single, first_row[snapshot]))
        for name in self.sweeps.names:
            values[name] = self.sweeps.take(name, arrays["method"])
        for name in self.carried:
            values[name] = rows.column(name).take(places)
        if self.measurement_name:
            values[self.measurement_name] = rows.column(self.measurement_name).take(pa.array(single, mask=single < 0))
        if self.with_source:
            values["source"] = _repeated(source, snapshot.shape[0])
        schema = self.schema
        return pa.table([_cast(values[field.name], field.type) for field in schema], schema=schema)


@dataclass(frozen=True, kw_only=True)
class FlagsLayout:
    """How the flags table of a run looks: the input's columns, and what the methods say of each row.

    ``constants`` were given for missing columns: they become columns, so that flags are measurements again.
    ``sweeps`` tells the swept values of each of ``methods``.
    """

    methods: tuple[str, ...]
    input_schema: pa.Schema
    said: tuple[str, ...]
    constants: Mapping[str, float]
    with_source: bool
    sweeps: SweepColumns = _NO_SWEEP

    @property
    def schema(self) -> pa.Schema:
        """The Arrow schema; earlier flags are replaced, but ``los`` and ``ip`` are kept where nothing new is said."""
        replaced = {column.name for column in FLAGS.columns if column.name not in ("snapshot", *_KEPT_FLAGS)}
        replaced |= set(self.said)
        fields = [field for field in self.input_schema if field.name not in replaced and field.name != "source"]
        fields += [pa.field(name, pa.float64()) for name in self.constants]
        if self.with_source:
            fields.append(pa.field("source", pa.string()))
        if self._told:
            fields += [pa.field("method", pa.string()), *self.sweeps.fields]
        fields.append(pa.field("used", pa.bool_()))
        fields += [pa.field(name, _said_type(name)) for name in self.said]
        return pa.schema([_plain(field) for field in fields])

    def table(
        self, flags: Sequence[tuple[Any, Said]], *, rows: pa.Table, snapshot_of_row: IntArray, source: str
    ) -> pa.Table:
        """Return the table of a chunk's flags: for each snapshot, the rows by the first method, then the next.

        ``flags`` holds for each method ``used`` (N,) and its columns (N,).
        """
        if self.with_source:
            rows = _with_source(rows, source)
        tables = [self._of_method(number, used, columns, rows) for number, (used, columns) in enumerate(flags)]
        if len(tables) == 1:
            return tables[0]
        method = np.repeat(np.arange(len(tables)), rows.num_rows)
        order = np.lexsort((method, np.tile(snapshot_of_row, len(tables))))
        return pa.concat_tables(tables).take(pa.array(order))

    @property
    def _told(self) -> bool:
        """Whether rows tell their method and swept values: there are several, or a sweep."""
        return len(self.methods) > 1 or bool(self.sweeps.names)

    def _of_method(self, number: int, used: BoolArray, said: Said, rows: pa.Table) -> pa.Table:
        columns: list[Any] = []
        for field in self.schema:
            if field.name == "method" and self._told:
                values: Any = _repeated(self.methods[number], used.shape[0])
            elif field.name in self.sweeps.names:
                values = self.sweeps.take(field.name, np.full(used.shape[0], number))
            elif field.name in self.constants:
                values = pa.array(np.full(used.shape[0], self.constants[field.name]))
            elif field.name == "used":
                values = pa.array(used)
            elif field.name in self.said:
                values = _said(said.get(field.name), field.type, rows, field.name)
            else:
                values = rows.column(field.name)
            columns.append(_cast(values, field.type))
        return pa.table(columns, schema=self.schema)


@dataclass(frozen=True, kw_only=True)
class TraceLayout:
    """How the trace of a run looks: the states of its sequential methods."""

    methods: tuple[str, ...]
    input_schema: pa.Schema
    with_source: bool
    sweeps: SweepColumns = _NO_SWEEP

    @property
    def schema(self) -> pa.Schema:
        """The Arrow schema."""
        own = {
            "snapshot": _snapshot_field(self.input_schema),
            "sensor": self.input_schema.field("sensor").with_metadata(None),
        }
        fields = [
            own[column.name] if column.name in own else pa.field(column.name, _TYPES[column.type])
            for column in TRACE.columns
        ]
        fields += self.sweeps.fields
        if self.with_source:
            fields.append(pa.field("source", pa.string()))
        return pa.schema([_plain(field) for field in fields])

    def table(self, arrays: Arrays, *, ids: pa.Array, rows: pa.Table, source: str) -> pa.Table:
        """Return the table of a chunk's states; ``arrays`` holds the fields of a flat trace (T,)."""
        values: dict[str, Any] = {
            "snapshot": ids.take(pa.array(arrays["snapshot"])),
            "method": pa.array(self.methods).take(pa.array(arrays["method"])),
            "step": pa.array(arrays["step"]),
            "sensor": rows.column("sensor").take(pa.array(arrays["measurement"])),
            "x_m": pa.array(arrays["position_m"][:, 0]),
            "y_m": pa.array(arrays["position_m"][:, 1]),
        }
        for place, name in enumerate(("cov_xx_m2", "cov_xy_m2", "cov_yy_m2")):
            values[name] = pa.array(arrays["covariance_m2"][:, place])
        for name in self.sweeps.names:
            values[name] = self.sweeps.take(name, arrays["method"])
        if self.with_source:
            values["source"] = _repeated(source, arrays["snapshot"].shape[0])
        schema = self.schema
        return pa.table([_cast(values[field.name], field.type) for field in schema], schema=schema)


def _snapshot_field(schema: pa.Schema) -> pa.Field:
    return schema.field("snapshot") if "snapshot" in schema.names else pa.field("snapshot", pa.int64())


def _with_source(rows: pa.Table, source: str) -> pa.Table:
    kept = rows.drop_columns(["source"]) if "source" in rows.column_names else rows
    return kept.append_column("source", _repeated(source, rows.num_rows))


def _repeated(text: str, size: int) -> pa.Array:
    return pa.array([text]).take(pa.array(np.zeros(size, dtype=np.int64)))


def _said(values: npt.NDArray[Any] | Words | None, kind: pa.DataType, rows: pa.Table, name: str) -> Any:
    if values is None:
        new = pa.nulls(rows.num_rows, kind)
    elif isinstance(values, Words):
        new = pa.array(values.words, kind).take(pa.array(values.code))
    elif values.dtype.kind == "f":
        new = _nullable(values)
    else:
        new = pa.array(values, kind)
    if name in _KEPT_FLAGS and name in rows.column_names:
        return pc.coalesce(new, _cast(rows.column(name), kind))
    return new


def _said_type(name: str) -> pa.DataType:
    column: Column = FLAGS.column(name)
    return _TYPES[column.type]


def _nullable(values: npt.NDArray[Any]) -> pa.Array:
    return pa.array(values, mask=np.isnan(values))


def _plain(field: pa.Field) -> pa.Field:
    """Return the field with plain text for dictionary-encoded text: each file then reads the same everywhere."""
    kind = field.type.value_type if pa.types.is_dictionary(field.type) else field.type
    return pa.field(field.name, kind)


def _cast(values: Any, kind: pa.DataType) -> Any:
    return values if values.type == kind else values.cast(kind)
