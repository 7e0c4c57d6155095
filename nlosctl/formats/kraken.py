"""Options and rows shared by the KrakenSDR formats: a direction relative to the array becomes a compass azimuth.

XML and JSON have the direction counter-clockwise from the front of the array; df-aggregator converts it to an azimuth
as heading + 360 - DoA (receivers.py). The sense of the CSV depends on the version of the software, see
`nlosctl.formats.kraken_csv`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from nlosctl.contract.formats import Row, UnfitError
from nlosctl.contract.options import option
from nlosctl.formats.epochs import WINDOW_MEANING
from nlosctl.formats.own_fields import OwnFieldOptions, OwnFields

__all__ = ["EXTRA", "KrakenOptions", "reading"]

EXTRA: dict[str, Any] = {
    "time_s": "number",
    "frequency_hz": "number",
    "confidence": "number",
    "power_db": "number",
    "heading_deg": "number",
}


@dataclass(frozen=True, kw_only=True)
class KrakenOptions(OwnFieldOptions):
    """Settings that a log of readings does not contain."""

    window: str = option("all", meaning=WINDOW_MEANING)
    sense: Literal["auto", "counter-clockwise", "clockwise"] = option(
        "auto",
        meaning="positive sense of the direction from the front of the array; auto: that of the spectra of a CSV,"
        " counter-clockwise in XML and JSON",
    )
    heading_deg: float | None = option(
        None, meaning="heading of the array, clockwise from north, instead of the logged one", unit="deg"
    )
    bearing_std_deg: float | None = option(
        None,
        meaning="standard deviation of every bearing; otherwise set it in the next command",
        unit="deg",
        minimum=0.0,
        exclusive=True,
    )


def reading(
    *,
    line: int,
    station: str,
    time_s: float,
    frequency_hz: float,
    doa_deg: float,
    heading_deg: float,
    lat_deg: float,
    lon_deg: float,
    confidence: float,
    power_db: float,
    clockwise: bool,
    options: KrakenOptions,
    own: OwnFields,
    cells: Mapping[str, str],
) -> Row:
    """Return the row of one reading, with ``doa_deg`` clockwise or not; raise UnfitError without a position.

    ``cells`` are the log's own fields, some of them kept by ``own``.
    """
    if lat_deg == 0.0 and lon_deg == 0.0:
        raise UnfitError("got 0, 0: the station had no position, expected its latitude and longitude", "latitude")
    heading = heading_deg if options.heading_deg is None else options.heading_deg
    clockwise_deg = doa_deg if clockwise else -doa_deg
    return Row(
        line=line,
        epoch_s=time_s,
        group=own.group(cells, f"{frequency_hz:.0f}"),
        values={
            "sensor": station,
            "sensor_lat_deg": lat_deg,
            "sensor_lon_deg": lon_deg,
            "azimuth_deg": (heading + clockwise_deg) % 360.0,
            "bearing_std_deg": options.bearing_std_deg,
            "time_s": time_s,
            "frequency_hz": frequency_hz,
            "confidence": confidence,
            "power_db": power_db,
            "heading_deg": heading,
        },
        kept=own.kept(cells),
    )
