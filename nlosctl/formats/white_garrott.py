"""Azimuths from towers as in White and Garrott (1990): ``azimuth.dat``, a location attempt in each line.

A line has date, time, animal and sex, then pairs of a tower's number and its azimuth in degrees clockwise from north; 0
means that there was no bearing. The towers are sensors of the scene named by their numbers, or the lines of a file.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from nlosctl.contract.formats import BadLine, ForeignFile, ImporterSpec, Row, UnfitError
from nlosctl.contract.options import option
from nlosctl.errors import DataError
from nlosctl.formats.fields import lines, listed, number
from nlosctl.formats.own_fields import OwnFields

__all__ = ["FORMAT"]

_FIELDS = ("date", "time", "animal", "sex")
_TIMES = ("%m/%d/%y %H:%M:%S", "%m/%d/%Y %H:%M:%S", "%m/%d/%y %H:%M", "%m/%d/%Y %H:%M")


@dataclass(frozen=True, kw_only=True)
class WhiteGarrottOptions:
    """The towers, and settings that the file does not contain."""

    towers: str | None = option(None, meaning="file with x,y of a tower in each line, in metres; default: the scene")
    group: str | None = option(
        None, meaning="fields (A,B) of date, time, animal, sex whose values make a snapshot; default: a snapshot a line"
    )
    keep: str | None = option("animal,sex", meaning="fields to copy as text, separated by commas")
    declination_deg: float = option(
        0.0,
        meaning="magnetic declination, east positive, added to each azimuth",
        unit="deg",
        minimum=-180.0,
        maximum=180.0,
    )
    bearing_std_deg: float | None = option(
        None,
        meaning="standard deviation of every azimuth; otherwise set it in the next command",
        unit="deg",
        minimum=0.0,
        exclusive=True,
    )


def _rows(file: ForeignFile, options: WhiteGarrottOptions) -> Iterator[Row | BadLine]:
    towers = _towers(file, options)
    own = OwnFields(options.group, options.keep)
    by = listed(options.group)
    snapshots: dict[str, list[Row]] = {}
    seen: Counter[str] = Counter()
    for line, text in lines(file):
        try:
            bearings, cells, time = _attempt(text, towers)
        except UnfitError as unfit:
            yield BadLine(line=line, fault=unfit.fault, column=unfit.column, text=text)
            continue
        name = own.group(cells, f"{cells['animal']}/{time}")
        seen[name] += 1
        snapshot = name if by or seen[name] == 1 else f"{name}#{seen[name]}"
        rows = snapshots.setdefault(snapshot, [])
        kept = own.kept(cells)
        for tower, azimuth_deg in bearings:
            values = {
                "snapshot": snapshot,
                "sensor": tower,
                "sensor_x_m": towers[tower][0],
                "sensor_y_m": towers[tower][1],
                "azimuth_deg": (azimuth_deg + options.declination_deg) % 360.0,
                "bearing_std_deg": options.bearing_std_deg,
                "time": time,
            }
            rows.append(Row(line=line, values=values, kept=kept))
    own.check(file)
    for rows in snapshots.values():
        yield from _numbered(rows)


def _numbered(rows: list[Row]) -> Iterator[Row]:
    """Yield the rows of a snapshot; repeated bearings of a tower get the sensor names #2, #3."""
    counts: Counter[str] = Counter()
    for row in rows:
        tower = str(row.values["sensor"])
        counts[tower] += 1
        name = tower if counts[tower] == 1 else f"{tower}#{counts[tower]}"
        yield Row(line=row.line, values={**row.values, "sensor": name}, kept=row.kept)


def _attempt(
    text: str, towers: Mapping[str, tuple[float, float]]
) -> tuple[list[tuple[str, float]], dict[str, str], str]:
    """Return the bearings of a line by tower, its named fields, and its time as ISO 8601 without a zone."""
    fields = text.split()
    if len(fields) < len(_FIELDS) + 2 or len(fields) % 2:
        raise UnfitError(f"got {len(fields)} fields, expected date, time, animal, sex and pairs of tower and azimuth")
    cells = dict(zip(_FIELDS, fields, strict=False))
    bearings = []
    for tower, azimuth in zip(fields[4::2], fields[5::2], strict=True):
        azimuth_deg = number(azimuth, f"azimuth of tower {tower}", 0.0, 360.0)
        if azimuth_deg == 0.0:
            continue
        if tower not in towers:
            raise UnfitError(f"got {tower!r}, expected a tower: {', '.join(towers)}", "tower")
        bearings.append((tower, azimuth_deg))
    return bearings, cells, _iso(cells)


def _iso(cells: Mapping[str, str]) -> str:
    stamp = f"{cells['date']} {cells['time']}"
    for form in _TIMES:
        try:
            return datetime.strptime(stamp, form).isoformat()
        except ValueError:
            continue
    raise UnfitError(f"got {stamp[:40]!r}, expected month/day/year and hours:minutes:seconds", "date")


def _towers(file: ForeignFile, options: WhiteGarrottOptions) -> dict[str, tuple[float, float]]:
    """Return the positions of the towers by number, from the lines of a file or from the scene."""
    if options.towers is None:
        if not file.scene.sensors:
            raise DataError(
                f"{file.name}: has no positions of the towers: `parameters` towers=FILE with x,y in each line, or "
                "`scene` FILE with [[sensor]], name = the tower's number, and position"
            )
        sensors = file.scene.stationary_sensors("importer 'white-garrott'")
        return {name: sensor.position for name, sensor in sensors.items()}
    try:
        texts = Path(options.towers).read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(f"{options.towers}: can't be read: {error}") from error
    towers = {}
    for line, text in enumerate((text for text in texts if text.strip()), 1):
        cells = [cell for cell in re.split(r"[,;\s]+", text.strip()) if cell]
        try:
            if len(cells) != 2:
                raise UnfitError(f"got {len(cells)} numbers, expected x and y")
            towers[str(line)] = (number(cells[0], "x", -1e9, 1e9), number(cells[1], "y", -1e9, 1e9))
        except UnfitError as unfit:
            raise DataError(f"{options.towers}, line {line}: {unfit.fault}") from None
    if not towers:
        raise DataError(f"{options.towers}: no towers: the file is empty")
    return towers


FORMAT = ImporterSpec(
    name="white-garrott",
    summary="Azimuths from towers, a location attempt in each line (azimuth.dat of White and Garrott)",
    reference="White and Garrott (1990), Analysis of Wildlife Radio-Tracking Data, and the R package telemetr, "
    "inst/samples/azimuth.dat and towers.dat",
    options=WhiteGarrottOptions,
    kind=lambda options: "bearings",
    rows=_rows,
    begins_like=r"\d{1,2}/\d{1,2}/\d{2,4}\s+\d{1,2}:\d\d(?::\d\d)?\s+\S+\s+[A-Za-z]\s+\d+\s+\d",
    extra={"time": "text"},
)
"""The specification of the importer."""
