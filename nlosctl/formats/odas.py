"""Directions from ODAS (open embedded audition system): the JSON of its sinks for potential and tracked sources.

Each object has a ``timeStamp``, which counts hops, and ``src``, a list of unit vectors in the axes of the array: with
``E`` (energy; `snk_pots.c`) or with ``id``, ``tag`` and ``activity`` (`snk_tracks.c`). An unused slot is 0, 0, 0. The
axes are those of the frame, or turned so that +x has the azimuth ``heading_deg`` of the array in the scene.
Several files, one of each array, make one table.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import PurePath
from typing import Any

from nlosctl.contract.formats import BadLine, ForeignFile, ImporterSpec, Row, UnfitError
from nlosctl.contract.options import option
from nlosctl.contract.scene import Sensor
from nlosctl.errors import DataError, UsageError, did_you_mean
from nlosctl.formats.fields import KEEP_MEANING, integer, number
from nlosctl.formats.json_objects import cells_of, json_objects
from nlosctl.formats.own_fields import OwnFields

__all__ = ["FORMAT"]

_UNIT_WITHIN = 0.02
"""Vectors have three decimals; whatever is not of length 1 is not a direction."""


@dataclass(frozen=True, kw_only=True)
class OdasOptions:
    """Settings that the files do not contain."""

    sensor: str | None = option(None, meaning="name of the array in the scene; default: the file's stem")
    group: str | None = option(None, meaning="fields (A,B), such as tag, that separate snapshots of a time")
    keep: str | None = option(None, meaning=KEEP_MEANING)
    bearing_std_deg: float | None = option(
        None,
        meaning="standard deviation of every azimuth; otherwise set it in the next command",
        unit="deg",
        minimum=0.0,
        exclusive=True,
    )


def _rows(file: ForeignFile, options: OdasOptions) -> Iterator[Row | BadLine]:
    files = [file, *file.more]
    if options.sensor is not None and len(files) > 1:
        raise UsageError("importer 'odas' takes the parameter 'sensor' only with one file; name files as arrays")
    own = OwnFields(options.group, options.keep)
    rows: list[Row] = []
    arrays = [_array(part, options) for part in files]
    if len({array.heading_deg is None for array in arrays}) > 1:
        raise DataError(f"{file.name}: only some arrays have a heading_deg in the scene; give it for all or none")
    for part, array in zip(files, arrays, strict=True):
        latest = -1
        for line, record in json_objects(part):
            if isinstance(record, BadLine):
                yield BadLine(line=line, fault=record.fault, text=record.text, file=part.name)
                continue
            try:
                stamp, found = _frame(line, record, array, options, own)
            except UnfitError as unfit:
                text = str(record)[:200]
                yield BadLine(line=line, fault=unfit.fault, column=unfit.column, text=text, file=part.name)
                continue
            if stamp < latest:
                raise DataError(
                    f"{part.name}, line {line}: the timeStamp goes back from {latest} to {stamp}: several "
                    f"recordings in one file; split it"
                )
            latest = stamp
            rows += found
        own.check(part)
    rows.sort(key=lambda row: (row.epoch_s or 0.0, row.group))
    yield from _with_paths(rows)


def _array(file: ForeignFile, options: OdasOptions) -> Sensor:
    name = options.sensor or PurePath(file.name).stem
    known = file.scene.stationary_sensors("importer 'odas'")
    if name not in known:
        raise DataError(
            f"{file.name}: the scene has no sensor {name!r}{did_you_mean(name, known)}: name the file or `parameters` "
            f"sensor=NAME as in `scene` FILE with [[sensor]], name, position and heading_deg (of the array's +x axis)"
        )
    return known[name]


def _frame(
    line: int, record: Mapping[str, Any], array: Sensor, options: OdasOptions, own: OwnFields
) -> tuple[int, list[Row]]:
    """Return the time stamp of an object and the rows of its slots, without those that are unused or straight up."""
    if "timeStamp" not in record or not isinstance(record.get("src"), list):
        raise UnfitError("absent, expected an object with timeStamp and a list src", "timeStamp, src")
    stamp = integer(str(record["timeStamp"]), "timeStamp", 0, 2**62)
    rows = []
    for slot in record["src"]:
        cells = cells_of(slot) if isinstance(slot, dict) else {}
        x, y, z = (number(cells.get(axis, ""), axis, -1.1, 1.1) for axis in ("x", "y", "z"))
        if x == 0.0 and y == 0.0:
            continue
        if abs(math.hypot(x, y, z) - 1.0) > _UNIT_WITHIN:
            raise UnfitError(f"got a vector of length {math.hypot(x, y, z):.3g}, expected 1", "x, y, z")
        rows.append(_row(line, stamp, (x, y, z), cells, array, options, own))
    return stamp, rows


def _row(
    line: int,
    stamp: int,
    vector: tuple[float, float, float],
    cells: Mapping[str, str],
    array: Sensor,
    options: OdasOptions,
    own: OwnFields,
) -> Row:
    x, y, z = vector
    angle_deg = math.degrees(math.atan2(y, x))
    heading = array.heading_deg
    group = own.group(cells, "")
    values: dict[str, Any] = {
        "snapshot": f"{group}/{stamp}" if group else stamp,
        "sensor": array.name,
        "sensor_x_m": array.position[0],
        "sensor_y_m": array.position[1],
        "sensor_z_m": array.z_m,
        "bearing_deg": angle_deg if heading is None else None,
        "azimuth_deg": None if heading is None else (heading - angle_deg) % 360.0,
        "bearing_std_deg": options.bearing_std_deg,
        "elevation_deg": math.degrees(math.atan2(z, math.hypot(x, y))),
        "source_id": integer(cells["id"], "id") if "id" in cells else None,
        "activity": number(cells["activity"], "activity") if "activity" in cells else None,
        "energy": number(cells["E"], "E") if "E" in cells else None,
    }
    return Row(line=line, epoch_s=float(stamp), group=group, values=values, kept=own.kept(cells))


def _with_paths(rows: list[Row]) -> Iterator[Row]:
    """Yield the rows with a ``path`` number, if a sensor has several directions in a snapshot."""
    counts: dict[tuple[object, object], int] = {}
    numbers = []
    for row in rows:
        key = (row.values["snapshot"], row.values["sensor"])
        counts[key] = counts.get(key, -1) + 1
        numbers.append(counts[key])
    several = any(numbers)
    for row, path in zip(rows, numbers, strict=True):
        values = {**row.values, "path": path} if several else row.values
        yield Row(line=row.line, values=values, kept=row.kept)


FORMAT = ImporterSpec(
    name="odas",
    summary="Directions of the audition system ODAS (JSON of potential or tracked sources), of one array or several",
    reference="introlab/odas, src/sink/snk_pots.c and snk_tracks.c (names, order and digits)",
    options=OdasOptions,
    kind=lambda options: "bearings",
    rows=_rows,
    begins_like=r'\{?\s*"timeStamp"\s*:\s*\d+\s*,',
    several=True,
    extra={
        "sensor_z_m": "number",
        "elevation_deg": "number",
        "source_id": "integer",
        "activity": "number",
        "energy": "number",
    },
)
"""The specification of the importer."""
