"""Wide tables: a column for each sensor (``az_N``, ``az_S``) becomes a row for each sensor."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.compute as pc

from nlosctl.contract.tables import ColumnType, contract_names, declared_type, measured_names
from nlosctl.errors import DataError, UsageError, did_you_mean
from nlosctl.io.arrow_columns import ARROW_TYPES
from nlosctl.io.readers.base import CellFault, RecordBatch, plain
from nlosctl.io.row_steps.chosen_rows import kept_rows

__all__ = ["WideColumns", "WidePattern", "parse_wide"]

_SENSOR = "sensor"
_JOINTS = "_-. "


@dataclass(frozen=True, kw_only=True)
class WidePattern:
    """Columns that match ``pattern`` (one ``*``: the sensor) hold the values of the contract's column ``name``."""

    name: str
    pattern: str

    def sensor(self, column: str) -> str | None:
        """Return the sensor that a column is of, None if it does not match."""
        before, _, after = self.pattern.partition("*")
        match = re.fullmatch(f"{re.escape(before)}(.+){re.escape(after)}", column)
        return None if match is None else match[1]


def parse_wide(text: str) -> WidePattern:
    """Return the pattern ``NAME=PATTERN``, or ``NAME_*`` for the contract's NAME; raises UsageError."""
    name, equals, pattern = (word.strip() for word in text.partition("="))
    if not equals:
        pattern, name = name, name.replace("*", "").strip(_JOINTS)
    if pattern.count("*") != 1 or not name:
        raise UsageError(f"`wide` takes NAME=PATTERN with one * for the sensor, or NAME_*. Got {text!r} instead.")
    known = contract_names() - {_SENSOR, "snapshot"}
    if name not in known:
        raise UsageError(
            f"`wide` {text}: measurements have no column {name!r}{did_you_mean(name, known)}; "
            f"give NAME=PATTERN, such as azimuth_deg={pattern}"
        )
    return WidePattern(name=name, pattern=pattern)


class WideColumns:
    """A `Step` that gives a row for each sensor of a row: the columns of the patterns, and ``sensor``.

    A column belongs to the longest pattern that it matches; columns of the contract match none. Sensors without a
    measured value in a row (all empty) have no row. Raises UsageError for a wrong pattern, DataError for one without
    columns, or a column that the file has already.
    """

    def __init__(self, texts: Sequence[str], names: Sequence[str], file: str) -> None:
        patterns = sorted(map(parse_wide, texts), key=lambda known: -len(known.pattern))
        self._sources: dict[str, dict[str, str]] = {known.name: {} for known in patterns}
        if len(self._sources) < len(patterns):
            raise UsageError("`wide` names a column twice")
        self._sensors: list[str] = []
        self._types: dict[str, Any] = {}
        for column in names:
            matches = [(known.name, sensor) for known in patterns if (sensor := known.sensor(column)) is not None]
            if matches and column not in contract_names():
                name, sensor = matches[0]
                self._sources[name][sensor] = column
                self._sensors += [sensor] if sensor not in self._sensors else []
        for known in patterns:
            if not self._sources[known.name]:
                raise DataError(
                    f"{file}: `wide` {known.name}={known.pattern}: no column matches. The file has: {', '.join(names)}"
                )
        self.names: tuple[str, ...] = (_SENSOR, *self._sources)
        self.replaces: Sequence[str] = [column for own in self._sources.values() for column in own.values()]
        twice = [name for name in self.names if name in names]
        if twice:
            raise DataError(
                f"{file}: `wide` gives a column {twice[0]!r}, which the file already has; rename or drop it"
            )
        measured = [name for name in self._sources if name in measured_names()]
        self._decisive = measured or list(self._sources)

    def request(
        self, types: Mapping[str, ColumnType], columns: list[str] | None
    ) -> tuple[Mapping[str, ColumnType], list[str] | None]:
        """See Step."""
        wanted: dict[str, ColumnType] = {name: kind for name, kind in types.items() if name not in self.names}
        for name, own in self._sources.items():
            wanted |= dict.fromkeys(own.values(), declared_type(name) or "number")
        if columns is None:
            return wanted, None
        return wanted, [*(name for name in columns if name not in self.names), *self.replaces]

    def extend(self, schema: Any) -> Any:
        """See Step."""
        own = [field for field in schema if field.name not in self.replaces]
        for name, sources in self._sources.items():
            integers = all(pa.types.is_integer(schema.field(column).type) for column in sources.values())
            is_exact = declared_type(name) == "exact"
            self._types[name] = pa.int64() if is_exact and integers else _arrow_type(name)
        added = [pa.field(name, self._types[name]) for name in self._sources]
        return pa.schema([*own, pa.field(_SENSOR, pa.string()), *added])

    def apply(self, batch: RecordBatch) -> RecordBatch:
        """See Step."""
        count, sensors = batch.table.num_rows, len(self._sensors)
        row = np.repeat(np.arange(count), sensors)
        unreadable = np.zeros(row.shape, dtype=np.bool_)
        faults = self._faults(batch.cell_faults, unreadable)
        table = self._long(batch.table, row, self._types)
        text = None if batch.text is None else self._long(batch.text, row, dict.fromkeys(self._sources, pa.string()))
        long = RecordBatch(
            table=table,
            first_row=batch.first_row,
            rows=batch.row_numbers()[row],
            lines=None if batch.lines is None else batch.lines[row],
            text=text,
            cell_faults=faults,
            line_faults=batch.line_faults,
            origins={**{name: words[row] for name, words in batch.origins.items()}, **self._origins(count)},
            left_out=batch.left_out,
        )
        empty = np.ones(row.shape, dtype=np.bool_)
        for name in self._decisive:
            empty &= np.asarray(pc.is_null(table.column(name)).to_numpy(zero_copy_only=False))
        return kept_rows(long, ~empty | unreadable, "wide")

    def _long(self, wide: Any, row: npt.NDArray[np.int64], types: Mapping[str, Any]) -> Any:
        """Return an Arrow batch of one row per row and sensor, in this order."""
        count, sensors = wide.num_rows, len(self._sensors)
        order = pa.array(np.arange(count * sensors).reshape(sensors, count).T.ravel())
        index = pa.array(row)
        own = {name: wide.column(name).take(index) for name in wide.schema.names if name not in self.replaces}
        own[_SENSOR] = pa.array(self._sensors * count, pa.string())
        for name, columns in self._sources.items():
            cells = [
                plain(wide.column(columns[sensor])).cast(types[name], safe=False)
                if sensor in columns
                else pa.nulls(count, types[name])
                for sensor in self._sensors
            ]
            own[name] = pa.concat_arrays(cells).take(order)
        return pa.RecordBatch.from_pydict(own)

    def _faults(self, faults: Sequence[CellFault], unreadable: npt.NDArray[np.bool_]) -> list[CellFault]:
        """Return the faults at their rows, in order; marks the rows whose own value is ``unreadable`` (N,)."""
        sensors = len(self._sensors)
        of_column = {column: sensor for own in self._sources.values() for sensor, column in own.items()}
        moved = []
        for fault in faults:
            if fault.column in of_column:
                index = fault.index * sensors + self._sensors.index(of_column[fault.column])
                unreadable[index] = True
                moved.append(replace(fault, index=index))
            else:
                moved += [replace(fault, index=fault.index * sensors + number) for number in range(sensors)]
        return sorted(moved, key=lambda fault: fault.index)

    def _origins(self, count: int) -> dict[str, npt.NDArray[Any]]:
        """Return for each added column the file's column of each row."""
        return {
            name: np.array([columns.get(sensor, name) for sensor in self._sensors] * count, dtype=object)
            for name, columns in self._sources.items()
        }


def _arrow_type(name: str) -> Any:
    kind = declared_type(name) or "number"
    return ARROW_TYPES.get(kind, pa.string())
