"""Tables of simulated measurements, of bounds, of posterior maps, of scores and of calibrations."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from nlosctl.arrays import FloatArray, IntArray
from nlosctl.contract.calibration import Calibration
from nlosctl.contract.tables import BOUND, CALIBRATION, DEVIATIONS, KINDS, POSTERIOR, SCORES, is_swept
from nlosctl.io.arrow_columns import ARROW_TYPES, SweepColumns
from nlosctl.io.calibrations.calibration_file import entry_values
from nlosctl.io.calibrations.harmonic_entries import harmonic_values
from nlosctl.io.readers.base import plain_type
from nlosctl.io.results.layouts import snapshot_field

__all__ = [
    "MEAN_TIME",
    "bound_schema",
    "bound_table",
    "calibration_schema",
    "calibration_table",
    "measurement_table",
    "posterior_schema",
    "posterior_table",
    "score_table",
]

MEAN_TIME = "time_s"
"""The column of the mean time of a window's rows."""

_LABELS = {column.name for column in SCORES.columns if column.type == "text"}


def measurement_table(
    kind: str,
    columns: Mapping[str, npt.NDArray[Any]],
    sweeps: SweepColumns | None = None,
    point: int = 0,
    further: Sequence[str] = (),
) -> Any:
    """Return flat columns (N,) of a kind of measurement as a table in the order of the contract; NaN becomes null.

    The columns ``further`` follow, and those of ``sweeps`` with the values of the sweep's point of this index.
    """
    arrays: dict[str, Any] = {}
    for column in KINDS[kind].all_columns:
        for name in filter(columns.__contains__, column.accepted_names):
            values = columns[name]
            arrow_type = pa.string() if values.dtype.kind not in "iu" else pa.int64()
            missing = np.isnan(values) if values.dtype.kind == "f" else None
            arrays[name] = pa.array(values, ARROW_TYPES.get(column.type, arrow_type), mask=missing)
    arrays |= {name: pa.array(columns[name]) for name in further}
    if sweeps is not None:
        points = np.full(len(arrays["snapshot"]), point)
        arrays |= {name: sweeps.take(name, points) for name in sweeps.names}
    return pa.table(arrays)


def bound_schema(
    input_schema: Any | None, dimension: int = 2, by: Sequence[str] | None = None, of_motion: Collection[str] = ()
) -> Any:
    """Return the Arrow schema of bounds in a dimension; without an input (a map) there is no ``snapshot``.

    Of snapshots that are windows of time it has ``time_s`` and the columns ``by``; None: they are not. ``of_motion``
    are the columns of sources that move.
    """
    wanted = {MEAN_TIME, *of_motion} if by is not None and input_schema is not None else {*of_motion}
    wanted |= {"z_m", *(f"bound_{axes}_m2" for axes in ("xz", "yz", "zz"))} if dimension == 3 else set()
    columns = (column for column in BOUND.columns[1:] if column.required or column.name in wanted)
    fields = [pa.field(column.name, ARROW_TYPES[column.type]) for column in columns]
    if input_schema is None:
        return pa.schema(fields)
    swept = [field for field in input_schema if is_swept(field.name)]
    fields += [pa.field(field.name, plain_type(field.type)) for field in swept]
    fields += [pa.field(name, plain_type(input_schema.field(name).type)) for name in by or ()]
    return pa.schema([pa.field("snapshot", snapshot_field(input_schema).type), *fields])


def bound_table(
    arrays: Mapping[str, npt.NDArray[Any]],
    schema: Any,
    snapshot: Any = None,
    rows: Any = None,
    first_row: IntArray | None = None,
) -> Any:
    """Return a table of bounds from arrays (B,) by column name; NaN becomes null. ``snapshot`` (B,) is an Arrow array.

    ``first_row`` (B,) is the first row of each snapshot in the input's table ``rows``, the source of all other columns.
    """
    columns = []
    for field in schema:
        if field.name == "snapshot":
            columns.append(snapshot.cast(field.type))
        elif field.name in arrays:
            values = arrays[field.name]
            columns.append(pa.array(values, field.type, from_pandas=values.dtype.kind == "f"))
        else:
            columns.append(rows.column(field.name).take(pa.array(first_row)).cast(field.type))
    return pa.table(columns, schema=schema)


def posterior_schema(input_schema: Any | None) -> Any:
    """Return the Arrow schema of posterior maps; with ``snapshot`` where the schema of an input is given."""
    fields = [pa.field(column.name, ARROW_TYPES[column.type]) for column in POSTERIOR.columns[1:]]
    if input_schema is not None:
        fields.insert(0, pa.field("snapshot", snapshot_field(input_schema).type))
    return pa.schema(fields)


def posterior_table(arrays: Mapping[str, FloatArray], schema: Any, snapshot: Any = None) -> Any:
    """Return a map as a table from arrays (P,) by column name; ``snapshot`` is its id, an Arrow scalar."""
    size = arrays["x_m"].shape[0]
    columns = {name: pa.array(values) for name, values in arrays.items()}
    if "snapshot" in schema.names:
        columns["snapshot"] = pa.repeat(snapshot.cast(schema.field("snapshot").type), size)
    return pa.table([columns[name] for name in schema.names], schema=schema)


def score_table(of: str, groups: Sequence[Mapping[str, Any]], by: Sequence[str] = ()) -> Any:
    """Return the metrics of ``groups``, a row each, in the columns of the contract; NaN and infinity become null.

    Counts by status become columns ``status_WORD``; curves are left out. Values of the columns ``by`` are text.
    """
    words = dict.fromkeys(word for group in groups for word in group.get("statuses", {}))
    rows = [_score_row(of, group, words) for group in groups]
    known = set().union(*rows)
    fields = [pa.field(column.name, ARROW_TYPES[column.type]) for column in SCORES.columns if column.name in known]
    labels = [field for field in fields if field.type == pa.string()]
    numbers = [field for field in fields if field.type != pa.string()]
    swept = [pa.field(name, pa.array([row.get(name) for row in rows]).type) for name in rows[0] if is_swept(name)]
    given = {*_LABELS, *(field.name for field in swept)}
    values = [pa.field(name, pa.string()) for name in by if name not in given]
    return pa.Table.from_pylist(rows, schema=pa.schema([*labels, *values, *swept, *numbers]))


def _score_row(of: str, group: Mapping[str, Any], words: Iterable[str]) -> dict[str, Any]:
    row: dict[str, Any] = {"of": of}
    for name, value in group.items():
        if name == "statuses":
            row |= {f"status_{word}": value.get(word, 0) for word in words}
        elif not isinstance(value, Mapping):
            row[name] = None if isinstance(value, float) and not math.isfinite(value) else value
            if name in _LABELS and value is not None:
                row[name] = str(value)
    return row


def calibration_schema(calibration: Calibration) -> Any:
    """Return the Arrow schema of a calibration as a table; that of deviations, if it has harmonics."""
    if calibration.harmonics:
        first, *rest = (pa.field(column.name, ARROW_TYPES[column.type]) for column in DEVIATIONS.columns)
        return pa.schema([first, *(pa.field(name, pa.string()) for name in calibration.by), *rest])
    own = {calibration.quantity.name, calibration.quantity.std_name, "std_scale", "std_dof"}
    fields = [pa.field(column.name, ARROW_TYPES[column.type]) for column in CALIBRATION.columns if column.name in own]
    return pa.schema([*(pa.field(name, pa.string()) for name in ("name", *calibration.by)), *fields])


def calibration_table(calibration: Calibration) -> Any:
    """Return a calibration as a table, a row per entry; a standard deviation that is not determined is null.

    With harmonics it has a row per entry and order.
    """
    if calibration.harmonics:
        rows = [
            {"sensor": entry.name, **dict(zip(calibration.by, entry.group, strict=True)), **harmonic_values(part)}
            for entry in calibration.entries
            for part in entry.harmonics
        ]
        return pa.Table.from_pylist(rows, schema=calibration_schema(calibration))
    rows = [entry_values(entry, calibration.quantity, calibration.by) for entry in calibration.entries]
    return pa.Table.from_pylist(rows, schema=calibration_schema(calibration))
