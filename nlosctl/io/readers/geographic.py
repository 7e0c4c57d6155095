"""Places on earth in a file: columns of latitude and longitude give columns of x and y, as if the file had them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from nlosctl.contract.scene import EarthFrame
from nlosctl.contract.tables import EARTH_PLACES, ColumnType
from nlosctl.errors import DataError
from nlosctl.io.readers.arrow_text import plain
from nlosctl.io.readers.base import CellFault, RawBatch, RawSource
from nlosctl.io.scenes.earth_plane import plane_of

__all__ = ["EarthSource", "with_places"]

_LIMITS = {"lat": 90.0, "lon": 180.0}


@dataclass(frozen=True, kw_only=True)
class _Place:
    """A place of each row: the file's columns of latitude and longitude, and the columns that they give."""

    lat: str
    lon: str
    x: str
    y: str
    nullable: bool


def with_places(source: RawSource, renames: Mapping[str, str], frame: EarthFrame | None) -> RawSource:
    """Return the source with x and y for each place that has latitude and longitude and no x and y of its own.

    ``renames`` (contract's name -> file's name) tells where the file has them under other names.
    """
    given = [*source.names, *renames]
    places = [
        _Place(
            lat=renames.get(f"{place}_lat_deg", f"{place}_lat_deg"),
            lon=renames.get(f"{place}_lon_deg", f"{place}_lon_deg"),
            x=f"{place}_x_m",
            y=f"{place}_y_m",
            nullable=place in ("truth", "prior"),
        )
        for place in EARTH_PLACES
        if f"{place}_x_m" not in given and f"{place}_y_m" not in given
    ]
    there = [place for place in places if place.lat in source.names and place.lon in source.names]
    return EarthSource(source, there, frame) if there else source


class EarthSource:
    """A file with places on earth. ``frame`` may be told after ``start``, but before the rows are read."""

    def __init__(self, source: RawSource, places: Sequence[_Place], frame: EarthFrame | None) -> None:
        self._source, self._places, self.frame = source, tuple(places), frame
        self.names: tuple[str, ...] = (*source.names, *self.derived)
        self.metadata = source.metadata
        self._columns: list[str] | None = None
        self._batches: Iterator[RawBatch] | None = None
        self._first: list[RawBatch] = []

    @property
    def derived(self) -> tuple[str, ...]:
        """The columns that the file itself does not have."""
        return tuple(name for place in self._places for name in (place.x, place.y))

    def start(self, types: Mapping[str, ColumnType], columns: Sequence[str] | None) -> Any:
        """See RawSource; latitudes and longitudes are numbers whatever is asked."""
        degrees = [name for place in self._places for name in (place.lat, place.lon)]
        wanted: dict[str, ColumnType] = {name: kind for name, kind in types.items() if name not in self.derived}
        wanted |= dict.fromkeys(degrees, "number")
        read = None
        if columns is not None:
            self._columns = list(columns)
            own = [name for name in self._source.names if name in {*columns, *degrees}]
            read = own
        schema = self._source.start(wanted, read)
        full = pa.schema([*schema, *(pa.field(name, pa.float64()) for name in self.derived)])
        return full if columns is None else pa.schema([full.field(name) for name in columns])

    def first_frame(self, name: str) -> EarthFrame:
        """Return the plane that touches the earth in the first place of the file; raise DataError without one."""
        place = self._places[0]
        self._batches = self._source.batches()
        for batch in self._batches:
            self._first.append(batch)
            lat, lon = (_degrees(batch.table.column(column)) for column in (place.lat, place.lon))
            usable = np.flatnonzero((np.abs(lat) <= 90.0) & (np.abs(lon) <= 180.0))
            if usable.shape[0]:
                row = usable[0]
                return EarthFrame(origin_lat_deg=float(lat[row]), origin_lon_deg=float(lon[row]))
        raise DataError(f"{name}: no row has a place: {place.lat!r} and {place.lon!r} are empty or out of range")

    def batches(self) -> Iterator[RawBatch]:
        """See RawSource."""
        first, self._first = self._first, []
        batches = self._source.batches() if self._batches is None else self._batches
        for batch in (*first,):
            yield self._placed(batch)
        for batch in batches:
            yield self._placed(batch)

    def close(self) -> None:
        """Close the file."""
        self._source.close()

    def _placed(self, batch: RawBatch) -> RawBatch:
        assert self.frame is not None  # noqa: S101 - told by look_ahead
        plane, table, text = plane_of(self.frame), batch.table, batch.text
        faults = list(batch.cell_faults)
        spoilt = {(fault.position, fault.column) for fault in faults}
        for place in self._places:
            lat, lon = (_degrees(table.column(column)) for column in (place.lat, place.lon))
            found = _faults(place, lat, lon)
            faults += [fault for fault in found if (fault.position, fault.column) not in spoilt]
            wrong = [fault.position for fault in found]
            lat[wrong], lon[wrong] = np.nan, np.nan
            for name, values in zip((place.x, place.y), plane.to_plane(lat, lon), strict=True):
                table = table.append_column(name, pa.array(values, mask=np.isnan(values)))
                text = None if text is None else text.append_column(name, pa.nulls(len(values), pa.string()))
        if self._columns is not None:
            table = table.select(self._columns)
            text = None if text is None else text.select(self._columns)
        faults.sort(key=lambda fault: fault.position)
        return replace(batch, table=table, text=text, cell_faults=faults)


def _degrees(cells: Any) -> Any:
    values = pc.cast(plain(cells), pa.float64(), safe=False).to_numpy(zero_copy_only=False)
    return np.array(values, dtype=np.float64)


def _faults(place: _Place, lat: Any, lon: Any) -> list[CellFault]:
    """Return what is wrong with places; a true or a prior one may be absent."""
    faults = []
    absent = np.isnan(lat) & np.isnan(lon) & place.nullable
    for column, values, limit in ((place.lat, lat, _LIMITS["lat"]), (place.lon, lon, _LIMITS["lon"])):
        wrong = ~(np.abs(values) <= limit) & ~absent
        for row in np.flatnonzero(wrong).tolist():
            got = "empty (null)" if np.isnan(values[row]) else f"got {values[row]:g}"
            faults.append(
                CellFault(position=row, column=column, fault=f"{got}, expected {-limit:g} to {limit:g} degrees")
            )
    return faults
