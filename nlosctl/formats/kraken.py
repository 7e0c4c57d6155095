"""What KrakenSDR and df-aggregator have in common: a direction relative to the array becomes a compass azimuth.

The software writes the direction in the unit-circle sense, counter-clockwise from the front of the array; df-aggregator
turns it to an azimuth as heading + 360 - DoA (receivers.py). The wiki calls it "compass convention", which its
authors name a mistake of the page; builds that follow it take ``sense=clockwise``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from nlosctl.contract.formats import Row, UnfitError
from nlosctl.contract.options import option
from nlosctl.formats.epochs import WINDOW_MEANING

__all__ = ["EXTRA", "KrakenOptions", "reading"]

EXTRA: dict[str, Any] = {
    "time_s": "number",
    "frequency_hz": "number",
    "confidence": "number",
    "power_db": "number",
    "heading_deg": "number",
}


@dataclass(frozen=True, kw_only=True)
class KrakenOptions:
    """What a log of readings leaves open."""

    window: str = option("all", meaning=WINDOW_MEANING)
    sense: Literal["counter-clockwise", "clockwise"] = option(
        "counter-clockwise", meaning="how the direction counts from the front of the array"
    )
    heading_deg: float | None = option(
        None, meaning="heading of the array, clockwise from north, in place of the logged one", unit="deg"
    )
    bearing_std_deg: float | None = option(
        None, meaning="std of every bearing; else give it to the next command", unit="deg", minimum=0.0, exclusive=True
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
    options: KrakenOptions,
) -> Row:
    """Return the row of one reading; raises UnfitError where the station does not know its place."""
    if lat_deg == 0.0 and lon_deg == 0.0:
        raise UnfitError(
            "got 0, 0: the station did not know its place, expected its latitude and longitude", "latitude"
        )
    heading = heading_deg if options.heading_deg is None else options.heading_deg
    turned = doa_deg if options.sense == "clockwise" else -doa_deg
    return Row(
        line=line,
        epoch_s=time_s,
        group=f"{frequency_hz:.0f}",
        values={
            "sensor": station,
            "sensor_lat_deg": lat_deg,
            "sensor_lon_deg": lon_deg,
            "azimuth_deg": (heading + turned) % 360.0,
            "bearing_std_deg": options.bearing_std_deg,
            "time_s": time_s,
            "frequency_hz": frequency_hz,
            "confidence": confidence,
            "power_db": power_db,
            "heading_deg": heading,
        },
    )
