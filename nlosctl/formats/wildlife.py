"""Compass bearings of wildlife telemetry: a table with one line per bearing, grouped by animal and time."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

from nlosctl.contract.formats import BadLine, ForeignFile, ImporterSpec, Row
from nlosctl.contract.options import option
from nlosctl.formats.fields import KEEP_MEANING, kept_cells, listed, number
from nlosctl.formats.tables import open_table

__all__ = ["FORMAT"]


_KNOWN = (
    ("GID", "obs_id", "Group"),
    ("Easting", "utm_x", "X"),
    ("Northing", "utm_y", "Y"),
    ("Azimuth", "azimuth", "Bearing"),
)
"""The columns of group, x, y and azimuth, in sigloc, in razimuth and in other tables."""


@dataclass(frozen=True, kw_only=True)
class WildlifeOptions:
    """Names of the columns (default: those of the R packages sigloc and razimuth), and settings."""

    group: str | None = option(
        None,
        meaning="column, or several (A,B), with one value for the bearings of a location; default: GID, obs_id, Group",
    )
    x: str | None = option(
        None, meaning="column with easting (m), or longitude with degrees=true; default: Easting, utm_x, X"
    )
    y: str | None = option(
        None, meaning="column with northing (m), or latitude with degrees=true; default: Northing, utm_y, Y"
    )
    azimuth: str | None = option(
        None, meaning="column with the bearing in degrees clockwise from north; default: Azimuth, azimuth, Bearing"
    )
    station: str | None = option(None, meaning="column with the observer's or station's name; default: numbered")
    keep: str | None = option(None, meaning=KEEP_MEANING)
    degrees: bool = option(False, meaning="whether x and y are longitude and latitude (WGS 84)")
    declination_deg: float = option(
        0.0,
        meaning="magnetic declination, east positive, added to each bearing",
        unit="deg",
        minimum=-180.0,
        maximum=180.0,
    )
    bearing_std_deg: float | None = option(
        None,
        meaning="standard deviation of every bearing; otherwise set it in the next command",
        unit="deg",
        minimum=0.0,
        exclusive=True,
    )


def _rows(file: ForeignFile, options: WildlifeOptions) -> Iterator[Row | BadLine]:
    table = open_table(file)
    group, x, y, bearing = (
        next((name for name in known if name in table.columns), known[0]) if given is None else given
        for given, known in zip((options.group, options.x, options.y, options.azimuth), _KNOWN, strict=True)
    )
    by, keep = listed(group), listed(options.keep)
    wanted = [*by, *keep, x, y, bearing, *([options.station] if options.station else [])]
    names = ("sensor_lon_deg", "sensor_lat_deg") if options.degrees else ("sensor_x_m", "sensor_y_m")
    limits = (180.0, 90.0) if options.degrees else (1e9, 1e9)

    def parse(line: int, cells: Mapping[str, str]) -> Row:
        azimuth = number(cells[bearing], bearing, -360.0, 360.0)
        values: dict[str, Any] = {
            "sensor": cells[options.station] if options.station else "",
            names[0]: number(cells[x], x, -limits[0], limits[0]),
            names[1]: number(cells[y], y, -limits[1], limits[1]),
            "azimuth_deg": (azimuth + options.declination_deg) % 360.0,
            "bearing_std_deg": options.bearing_std_deg,
        }
        group = "/".join(cells[name] for name in by)
        return Row(line=line, group=group, values=values, kept=kept_cells(cells, keep))

    groups: dict[str, list[Row]] = {}
    for row in table.rows(wanted, parse):
        if isinstance(row, BadLine):
            yield row
        else:
            groups.setdefault(row.group, []).append(row)
    for group, rows in groups.items():
        yield from _named(group, rows)


def _named(group: str, rows: list[Row]) -> Iterator[Row]:
    """Yield the bearings of a location; stations without a name, and repeated ones, are numbered."""
    counts: Counter[str] = Counter()
    for row in rows:
        station = str(row.values["sensor"])
        counts[station] += 1
        count = counts[station]
        name = str(count) if not station else station if count == 1 else f"{station}#{count}"
        yield replace(row, values={"snapshot": group, **row.values, "sensor": name})


FORMAT = ImporterSpec(
    name="wildlife",
    summary="Compass bearings of wildlife telemetry (CSV: GID, Easting, Northing, Azimuth, or as named)",
    reference="R packages sigloc 0.0.4, data 'bear' and as.receiver, and razimuth, sim_atd (columns); those of LOAS "
    "and Locate are named by group, x, y, azimuth",
    options=WildlifeOptions,
    kind=lambda options: "bearings",
    rows=_rows,
    begins_like=r"(?![\d<]|.*\bsnapshot\b)(?=.*\b(?:GID|obs_id|Group)\b)(?=.*\b(?:Easting|utm_x|X)\b)"
    r"(?=.*\b(?:Northing|utm_y|Y)\b)(?=.*\b(?:[Aa]zimuth|Bearing)\b)",
)
"""The specification of the importer."""
