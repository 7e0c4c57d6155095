"""Geographic coordinates in a file: latitudes and longitudes give columns of x and y, as if the file had them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from nlosctl.contract.scene import EarthFrame
from nlosctl.contract.tables import ColumnType
from nlosctl.errors import DataError
from nlosctl.io.measurements.column_mapping import CoordinateColumns
from nlosctl.io.readers.base import CellFault, RecordBatch, plain
from nlosctl.io.readers.open_file import TableFile
from nlosctl.io.scenes.scene_file import plane_of

__all__ = ["PlaneCoordinates"]


class PlaneCoordinates:
    """A `Step` that adds x and y in the plane ``frame``, which may be set after `request` but before `apply`."""

    replaces: Sequence[str] = ()

    def __init__(self, pairs: Sequence[CoordinateColumns], frame: EarthFrame | None) -> None:
        self._pairs, self.frame = tuple(pairs), frame
        self.names: tuple[str, ...] = tuple(name for pair in pairs for name in (pair.x, pair.y))
        self._degrees = [name for pair in pairs for name in (pair.lat, pair.lon)]

    def frame_of(self, dimension: int) -> EarthFrame:
        """Return the frame of positions: on the ellipsoid where those of sensors are places of three dimensions."""
        assert self.frame is not None  # noqa: S101 - set before the rows are read
        return replace(self.frame, on_ellipsoid=dimension == 3 and "sensor_x_m" in self.names)

    def request(
        self, types: Mapping[str, ColumnType], columns: list[str] | None
    ) -> tuple[Mapping[str, ColumnType], list[str] | None]:
        """See Step; latitudes and longitudes are always numbers."""
        wanted: dict[str, ColumnType] = {name: kind for name, kind in types.items() if name not in self.names}
        wanted |= dict.fromkeys(self._degrees, "number")
        if columns is None:
            return wanted, None
        own = [name for name in columns if name not in self.names]
        return wanted, [*own, *(name for name in dict.fromkeys(self._degrees) if name not in own)]

    def extend(self, schema: Any) -> Any:
        """See Step."""
        return pa.schema([*schema, *(pa.field(name, pa.float64()) for name in self.names)])

    def apply(self, batch: RecordBatch) -> RecordBatch:
        """See Step; a coordinate that is missing or out of range is a fault of its cell."""
        assert self.frame is not None  # noqa: S101 - set before the rows are read
        plane, table, text = plane_of(self.frame), batch.table, batch.text
        faults = list(batch.cell_faults)
        unreadable = {(fault.index, fault.column) for fault in faults}
        for pair in self._pairs:
            lat, lon = _degrees(table, pair.lat), _degrees(table, pair.lon)
            wrong = _range_faults(pair, lat, lon)
            faults += [fault for fault in wrong if (fault.index, fault.column) not in unreadable]
            rows = [fault.index for fault in wrong]
            lat[rows], lon[rows] = np.nan, np.nan
            lon[lon > 180.0] -= 360.0
            for name, values in zip((pair.x, pair.y), plane.to_plane(lat, lon), strict=True):
                table = table.append_column(name, pa.array(values, mask=np.isnan(values)))
                text = None if text is None else text.append_column(name, pa.nulls(len(values), pa.string()))
        faults.sort(key=lambda fault: fault.index)
        return replace(batch, table=table, text=text, cell_faults=faults)

    def set_first_frame(self, file: TableFile, name: str) -> None:
        """Set the plane that touches the earth at the first location in the file; raise DataError without one."""
        pair = self._pairs[0]
        for batch in file.peek(without=self):
            lat, lon = _degrees(batch.table, pair.lat), _degrees(batch.table, pair.lon)
            usable = np.flatnonzero((np.abs(lat) <= 90.0) & (lon >= -180.0) & (lon <= 360.0))
            if usable.shape[0]:
                row = usable[0]
                self.frame = EarthFrame(
                    origin_lat_deg=float(lat[row]), origin_lon_deg=float(lon[row] - 360.0 * (lon[row] > 180.0))
                )
                return
        raise DataError(f"{name}: no row has a location: {pair.lat!r} and {pair.lon!r} are empty or out of range")


def _degrees(table: Any, column: str) -> Any:
    values = pc.cast(plain(table.column(column)), pa.float64(), safe=False).to_numpy(zero_copy_only=False)
    return np.array(values, dtype=np.float64)


def _range_faults(pair: CoordinateColumns, lat: Any, lon: Any) -> list[CellFault]:
    """Return the faults of coordinates; nullable ones may both be missing."""
    faults = []
    absent = np.isnan(lat) & np.isnan(lon) & pair.nullable
    for column, values, least, most in ((pair.lat, lat, -90.0, 90.0), (pair.lon, lon, -180.0, 360.0)):
        for row in np.flatnonzero(~((values >= least) & (values <= most)) & ~absent).tolist():
            got = "got an empty cell (null)" if np.isnan(values[row]) else f"got {values[row]:g}"
            faults.append(CellFault(index=row, column=column, fault=f"{got}, expected {least:g} to {most:g} degrees"))
    return faults
