"""Multilateration logs of the OpenSky Network: a transponder message a line, with its times of arrival at receivers.

``measurements`` is a JSON array of [serial, time in ns, signal strength]. The receivers are in a table of their own,
with ``serial``, ``latitude``, ``longitude`` (degrees) and ``height`` (metres), or they are sensors of the scene. The
position that an aircraft reports, where it is known, is the truth; ``baroAltitude`` is a measured height.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from decimal import Decimal
from typing import Any

from nlosctl.contract.formats import BadLine, ForeignFile, ImporterSpec, Row, UnfitError
from nlosctl.contract.options import option
from nlosctl.formats.fields import KEEP_MEANING, integer, kept_cells, listed, number
from nlosctl.formats.positions_file import Positions, number_or_none, of_scene, of_table
from nlosctl.formats.tables import open_table

__all__ = ["FORMAT"]

_COLUMNS = (
    *("id", "timeAtServer", "aircraft", "latitude", "longitude", "baroAltitude", "geoAltitude"),
    *("numMeasurements", "measurements"),
)
_LATEST_NS = 2**62
_CURE = "`parameters` sensors=FILE with serial, latitude, longitude and height in each line"


@dataclass(frozen=True, kw_only=True)
class OpenSkyOptions:
    """The receivers, and settings that the log does not contain."""

    sensors: str | None = option(
        None, meaning="table with serial, latitude, longitude, height of the receivers; default: the scene"
    )
    altitude_std_m: float = option(
        200.0,
        meaning="standard deviation of the barometric altitude as a height above the ellipsoid",
        unit="m",
        minimum=0.0,
        exclusive=True,
    )
    arrival_std_ns: float | None = option(
        None,
        meaning="standard deviation of every arrival; otherwise set it in the next command",
        unit="ns",
        minimum=0.0,
        exclusive=True,
    )
    keep: str | None = option(None, meaning=KEEP_MEANING)


def _rows(file: ForeignFile, options: OpenSkyOptions) -> Iterator[Row | BadLine]:
    positions, on_earth = _positions(file, options)
    keep, table = listed(options.keep), open_table(file)
    table.require([*_COLUMNS, *keep])
    for line, cells in table.records:
        if isinstance(cells, BadLine):
            yield cells
            continue
        try:
            message, arrivals = _message(cells, options, on_earth), _arrivals(cells)
        except UnfitError as unfit:
            yield _bad(line, unfit, ",".join(cells.values()))
            continue
        kept = kept_cells(cells, keep)
        for serial, arrival_ns, strength in arrivals:
            try:
                place = positions(serial, {"time_s": message["time_s"]}, "measurements")
            except UnfitError as unfit:
                yield _bad(line, unfit, f"[{serial},{arrival_ns}]")
                continue
            row = {**message, "sensor": serial, **place, "arrival_ns": arrival_ns, "signal_strength": strength}
            yield Row(line=line, values=row, kept=kept)


def _bad(line: int, unfit: UnfitError, text: str) -> BadLine:
    return BadLine(line=line, fault=unfit.fault, column=unfit.column, text=text)


def _message(cells: Mapping[str, str], options: OpenSkyOptions, on_earth: bool) -> dict[str, Any]:
    """Return the columns that the rows of a message have in common."""
    altitude = number_or_none(cells["baroAltitude"], "baroAltitude", -1e4, 1e5)
    height = "target_height" if on_earth else "target_z"
    message = {
        "snapshot": integer(cells["id"], "id"),
        "time_s": number(cells["timeAtServer"], "timeAtServer"),
        "aircraft": cells["aircraft"],
        "arrival_std_ns": options.arrival_std_ns,
        f"{height}_m": altitude,
        f"{height}_std_m": None if altitude is None else options.altitude_std_m,
    }
    if on_earth:
        message |= {
            "truth_lat_deg": number_or_none(cells["latitude"], "latitude", -90.0, 90.0),
            "truth_lon_deg": number_or_none(cells["longitude"], "longitude", -180.0, 180.0),
            "truth_z_m": number_or_none(cells["geoAltitude"], "geoAltitude", -1e4, 1e5),
        }
    return message


def _arrivals(cells: Mapping[str, str]) -> list[tuple[str, int, float | None]]:
    """Return serial, time in ns as an integer, and signal strength of each measurement of a message."""
    wanted = "expected a list of [serial, time in ns, signal strength]"
    try:
        measurements = json.loads(cells["measurements"], parse_float=Decimal, parse_constant=str)
        found = [
            (str(int(serial)), int(Decimal(time_ns).to_integral_value()), None if strength is None else float(strength))
            for serial, time_ns, strength in measurements
        ]
    except (ValueError, TypeError, ArithmeticError, RecursionError):
        raise UnfitError(f"got {cells['measurements'][:60]!r}, {wanted}", "measurements") from None
    count = integer(cells["numMeasurements"], "numMeasurements", 0)
    if count != len(found):
        raise UnfitError(f"got {len(found)} measurements, expected {count} as in numMeasurements", "measurements")
    for _, time_ns, _ in found:
        if abs(time_ns) > _LATEST_NS:
            raise UnfitError(f"got {time_ns} ns, expected at most {_LATEST_NS}", "measurements")
    return found


def _positions(file: ForeignFile, options: OpenSkyOptions) -> tuple[Positions, bool]:
    """Return the positions of the receivers, and whether they are on earth: those of a scene are metres of a plane."""
    if options.sensors is None:
        return of_scene(file, _CURE), False
    return of_table(options.sensors, ("serial", "latitude", "longitude", "height"), _receiver), True


def _receiver(cells: Mapping[str, str]) -> tuple[str, dict[str, Any]] | None:
    """Return serial and position of a receiver, None for one whose position is unknown."""
    place = {
        "sensor_lat_deg": number_or_none(cells["latitude"], "latitude", -90.0, 90.0),
        "sensor_lon_deg": number_or_none(cells["longitude"], "longitude", -180.0, 180.0),
        "sensor_height_m": number_or_none(cells["height"], "height"),
    }
    if None in place.values():
        return None
    return str(integer(cells["serial"], "serial")), {**place, "sensor_type": cells.get("type") or None}


FORMAT = ImporterSpec(
    name="opensky",
    summary="Times of arrival of transponder messages at receivers (OpenSky Network, LocaRDS), with altitudes",
    reference="OpenSky Network, aircraft localization competition, documentation of the data; LocaRDS: Schäfer, "
    "Strohmeier, Leonardi, Lenders 2021",
    options=OpenSkyOptions,
    kind=lambda options: "arrivals",
    rows=_rows,
    begins_like=r'"?id"?\s*,\s*"?timeAtServer"?\s*,\s*"?aircraft"?\s*,',
    extra={
        "sensor_z_m": "number",
        "sensor_height_m": "number",
        "sensor_type": "text",
        "target_z_m": "number",
        "target_z_std_m": "number",
        "target_height_m": "number",
        "target_height_std_m": "number",
        "truth_z_m": "number",
        "time_s": "number",
        "aircraft": "text",
        "signal_strength": "number",
    },
)
"""The specification of the importer."""
