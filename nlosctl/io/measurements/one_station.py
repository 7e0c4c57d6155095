"""A file without a ``sensor`` column: all of its rows are of one station, and repeated readings are numbered."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pyarrow as pa

from nlosctl.contract.scene import Scene
from nlosctl.contract.tables import ColumnType
from nlosctl.io.measurements.column_mapping import NameCodes
from nlosctl.io.measurements.duplicates import find_duplicates
from nlosctl.io.measurements.row_batch import RowBatch
from nlosctl.io.readers.base import RecordBatch

__all__ = ["OneStation", "number_repeats"]

_SENSOR = "sensor"
_NAME = "station"


class OneStation:
    """A `Step` that adds the column ``sensor`` with one name: that of the scene's only sensor, or ``station``."""

    names: tuple[str, ...] = (_SENSOR,)
    replaces: Sequence[str] = ()

    def __init__(self, scene: Scene) -> None:
        self._name = scene.sensors[0].name if len(scene.sensor_names) == 1 else _NAME

    def request(
        self, types: Mapping[str, ColumnType], columns: list[str] | None
    ) -> tuple[Mapping[str, ColumnType], list[str] | None]:
        """See Step."""
        wanted = {name: kind for name, kind in types.items() if name != _SENSOR}
        return wanted, None if columns is None else [name for name in columns if name != _SENSOR]

    def extend(self, schema: Any) -> Any:
        """See Step."""
        return pa.schema([*schema, pa.field(_SENSOR, pa.string())])

    def apply(self, batch: RecordBatch) -> RecordBatch:
        """See Step."""
        names = pa.repeat(pa.scalar(self._name), batch.table.num_rows)
        text = None if batch.text is None else batch.text.append_column(_SENSOR, names)
        return replace(batch, table=batch.table.append_column(_SENSOR, names), text=text)


def number_repeats(rows: RowBatch, row_key: Sequence[str], sensors: NameCodes) -> RowBatch:
    """Return whole snapshots with the second and later rows of equal ``row_key`` renamed to ``station#2``, ``#3``, ...

    They are further readings at one position, not competing paths; ``sensors`` are the codes of the names.
    """
    names = [name for name in row_key if name in rows.columns]
    repeated, first = find_duplicates(np.append(rows.starts, len(rows)), [rows.columns[name] for name in names])
    if repeated.shape[0] == 0:
        return rows
    by_first = np.argsort(first, kind="stable")
    heads = np.concatenate([[True], first[by_first][1:] != first[by_first][:-1]])
    numbers = np.empty_like(first)
    position = np.arange(first.shape[0])
    numbers[by_first] = position - np.maximum.accumulate(np.where(heads, position, 0)) + 2
    own = sensors.names[rows.columns[_SENSOR][0]]
    codes = rows.columns[_SENSOR].copy()
    codes[repeated] = sensors.encode(pa.array([f"{own}#{number}" for number in numbers.tolist()]))
    column = pa.array(sensors.names).take(pa.array(codes))
    table = rows.table.set_column(rows.table.column_names.index(_SENSOR), _SENSOR, column)
    return replace(rows, table=table, columns={**rows.columns, _SENSOR: codes})
