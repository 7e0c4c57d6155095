"""Direction vectors in place of angles: ``unit_x``, ``unit_y`` and ``unit_z`` give bearings and elevations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pyarrow as pa

from nlosctl.contract.tables import BEARINGS, ColumnType
from nlosctl.errors import DataError
from nlosctl.io.readers.base import CellFault, RecordBatch, plain

__all__ = ["BEARING", "ELEVATION", "DirectionVectors", "has_vectors"]

BEARING, ELEVATION = "bearing_rad", "elevation_rad"
_ELEVATIONS = frozenset(name for column in BEARINGS.space if column.name == ELEVATION for name in column.accepted_names)
_AXES = ("unit_x", "unit_y", "unit_z")


def has_vectors(names: Sequence[str], renames: Mapping[str, str]) -> bool:
    """Return whether a file has direction vectors and no angles; ``renames`` (contract's name -> file's name)."""
    known = {*names, *renames}
    return "unit_x" in known and known.isdisjoint(BEARINGS.column(BEARING).accepted_names)


class DirectionVectors:
    """A `Step` that adds the bearing (counter-clockwise from +x, radians) of vectors of any length.

    With ``unit_z`` it adds the elevation too, unless the file has a column of elevations.
    A vector that is zero, not finite or vertical is a fault of its cell. Raises DataError without ``unit_y``.
    """

    replaces: Sequence[str] = ()

    def __init__(self, names: Sequence[str], renames: Mapping[str, str], file: str) -> None:
        given = [renames.get(axis, axis) for axis in _AXES]
        if given[1] not in names:
            raise DataError(f"{file}: column {given[0]!r} needs {given[1]!r}; give both components of the direction")
        self._columns = [name for name in given if name in names]
        has_elevation = len(self._columns) < len(_AXES) or not _ELEVATIONS.isdisjoint({*names, *renames})
        self.names: tuple[str, ...] = (BEARING,) if has_elevation else (BEARING, ELEVATION)

    def request(
        self, types: Mapping[str, ColumnType], columns: list[str] | None
    ) -> tuple[Mapping[str, ColumnType], list[str] | None]:
        """See Step; components are always numbers."""
        wanted: dict[str, ColumnType] = {name: kind for name, kind in types.items() if name not in self.names}
        wanted |= dict.fromkeys(self._columns, "number")
        if columns is None:
            return wanted, None
        return wanted, list(dict.fromkeys([*(name for name in columns if name not in self.names), *self._columns]))

    def extend(self, schema: Any) -> Any:
        """See Step."""
        return pa.schema([*schema, *(pa.field(name, pa.float64()) for name in self.names)])

    def apply(self, batch: RecordBatch) -> RecordBatch:
        """See Step."""
        cells = [plain(batch.table.column(name)).cast(pa.float64(), safe=False) for name in self._columns]
        vector = np.array([component.to_numpy(zero_copy_only=False) for component in cells]).reshape(len(cells), -1)
        faults, known = list(batch.cell_faults), {cell.index for cell in batch.cell_faults}
        wrong = ~np.isfinite(vector).all(axis=0) | ((vector[0] == 0.0) & (vector[1] == 0.0))
        for index in np.flatnonzero(wrong).tolist():
            if index not in known:
                components = vector[:, index]
                at = next((k for k, value in enumerate(components) if not np.isfinite(value)), 0)
                faults.append(CellFault(index=index, column=self._columns[at], fault=_fault(components)))
        angles = {BEARING: np.arctan2(vector[1], vector[0])}
        if ELEVATION in self.names:
            angles[ELEVATION] = np.arctan2(vector[2], np.hypot(vector[0], vector[1]))
        table, text = batch.table, batch.text
        for name, values in angles.items():
            table = table.append_column(name, pa.array(values, mask=wrong))
            text = None if text is None else text.append_column(name, pa.nulls(table.num_rows, pa.string()))
        faults.sort(key=lambda fault: fault.index)
        return replace(batch, table=table, text=text, cell_faults=faults)


def _fault(components: Any) -> str:
    if np.isnan(components).any():
        return "got an empty cell or NaN, expected the components of a direction"
    if not np.isfinite(components).all():
        return "got inf, expected finite components of a direction"
    given = ", ".join(f"{value:g}" for value in components)
    if components.any():
        return f"got the vertical direction {given}, which has no azimuth"
    return f"got {given}, expected a direction of any length except zero"
