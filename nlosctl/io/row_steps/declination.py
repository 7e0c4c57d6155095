"""Magnetic azimuths to true ones: the declination, east positive, is added."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pyarrow as pa

from nlosctl.contract.tables import ColumnType, azimuth_units, measured_names
from nlosctl.errors import DataError, UsageError, did_you_mean
from nlosctl.io.readers.base import CellFault, RecordBatch, plain

__all__ = ["Declination"]

_LARGEST_DEG = 180.0


class Declination:
    """A `Step` that adds the declination (degrees, or the name of its column) to azimuths clockwise from north.

    Raises UsageError for a number beyond 180 degrees, DataError for a file without azimuths or without the column. A
    declination that is empty or beyond 180 degrees is a fault of its cell.
    """

    names: tuple[str, ...] = ()
    replaces: Sequence[str] = ()

    def __init__(self, text: str, names: Sequence[str], renames: Mapping[str, str], file: str) -> None:
        self._constant_deg, self._column = _number_or_name(text), ""
        by_header = {header: name for name, header in renames.items()}
        standard = {name: by_header.get(name, name) for name in names}
        units = azimuth_units()
        self._units = {name: units[known] for name, known in standard.items() if known in units}
        others = [name for name, known in standard.items() if known in measured_names() - units.keys()]
        if not self._units:
            have = f"the angles are in column {others[0]!r}" if others else "there are no angles"
            raise DataError(f"{file}: `declination_deg` is added to azimuths from north (azimuth_deg), but {have}")
        if self._constant_deg is None:
            self._column = text if text in names else renames.get(text, text)
            if self._column not in names:
                near = did_you_mean(text, names)
                raise DataError(
                    f"{file}: `declination_deg` {text}: no column {text!r}{near}; give degrees or a column of them"
                )

    def request(
        self, types: Mapping[str, ColumnType], columns: list[str] | None
    ) -> tuple[Mapping[str, ColumnType], list[str] | None]:
        """See Step."""
        wanted: dict[str, ColumnType] = {**types, **{name: types.get(name, "number") for name in self._units}}
        if not self._column:
            return wanted, columns
        wanted[self._column] = "number"
        return wanted, columns if columns is None else list(dict.fromkeys([*columns, self._column]))

    def extend(self, schema: Any) -> Any:
        """See Step."""
        return pa.schema([field.with_type(pa.float64()) if field.name in self._units else field for field in schema])

    def apply(self, batch: RecordBatch) -> RecordBatch:
        """See Step."""
        table, faults = batch.table, list(batch.cell_faults)
        added: Any = self._constant_deg
        if self._constant_deg is None:
            cells = plain(table.column(self._column)).cast(pa.float64(), safe=False)
            added = np.array(cells.to_numpy(zero_copy_only=False))
            faults = _with_faults(faults, self._column, added)
        for name, unit_deg in self._units.items():
            if name not in table.schema.names:
                continue
            cells = plain(table.column(name)).cast(pa.float64(), safe=False)
            values = cells.to_numpy(zero_copy_only=False) + added / unit_deg
            turned = pa.array(values, mask=np.asarray(cells.is_null().to_numpy(zero_copy_only=False)))
            at = table.schema.names.index(name)
            table = table.set_column(at, pa.field(name, pa.float64()), turned)
        return replace(batch, table=table, cell_faults=faults)


def _number_or_name(text: str) -> float | None:
    """Return the degrees that a text states, None for the name of a column; raises UsageError beyond 180 degrees."""
    try:
        number = float(text)
    except ValueError:
        return None
    if not abs(number) <= _LARGEST_DEG:
        raise UsageError(f"`declination_deg` must be from -180 to 180 degrees, or a column. Got {text} instead.")
    return number


def _with_faults(faults: list[CellFault], column: str, values: Any) -> list[CellFault]:
    """Return the faults with those of declinations, which are set to 0; ``values`` (N,) in degrees."""
    known = {fault.index for fault in faults if fault.column == column}
    for index in np.flatnonzero(~(np.abs(values) <= _LARGEST_DEG)).tolist():
        got = "an empty cell (null)" if np.isnan(values[index]) else f"{values[index]:g}"
        if index not in known:
            faults.append(CellFault(index=index, column=column, fault=f"got {got}, expected -180 to 180 degrees"))
        values[index] = 0.0
    return sorted(faults, key=lambda fault: fault.index)
