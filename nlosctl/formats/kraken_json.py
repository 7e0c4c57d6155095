"""KrakenSDR readings as JSON, as krakensdr_doa sends them to the apps (``Kraken Pro``): an object each, or an array.

`wr_json` of kraken_sdr_signal_processor.py writes most numbers as text. ``radioBearing`` is counter-clockwise from the
front of the array in all versions, ``gpsBearing`` the array's heading, ``tStamp`` the time in ms.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from nlosctl.contract.formats import BadLine, ForeignFile, ImporterSpec, Row, UnfitError
from nlosctl.formats.epochs import in_epochs, parse_window
from nlosctl.formats.fields import number
from nlosctl.formats.json_objects import cells_of, read_objects
from nlosctl.formats.kraken import EXTRA, KrakenOptions, reading
from nlosctl.formats.own_fields import OwnFields

__all__ = ["FORMAT"]

_NEEDED = ("station_id", "tStamp", "latitude", "longitude", "gpsBearing", "radioBearing", "conf", "power", "freq")


def _rows(file: ForeignFile, options: KrakenOptions) -> Iterator[Row | BadLine]:
    width = parse_window(options.window, "importer 'kraken-json'")
    yield from in_epochs(_readings(file, options), width, file, options.group or "frequency_hz")


def _readings(file: ForeignFile, options: KrakenOptions) -> Iterator[Row | BadLine]:
    own = OwnFields(options.group, options.keep)

    def parse(line: int, record: Mapping[str, Any]) -> Row:
        cells = cells_of(record)
        for name in _NEEDED:
            if not cells.get(name):
                raise UnfitError(f"absent or empty, expected the value of {name!r}", name)
        return reading(
            line=line,
            station=cells["station_id"],
            time_s=number(cells["tStamp"], "tStamp", 0.0) / 1e3,
            doa_deg=number(cells["radioBearing"], "radioBearing", -360.0, 360.0),
            confidence=number(cells["conf"], "conf"),
            power_db=number(cells["power"], "power"),
            frequency_hz=number(cells["freq"], "freq", 0.0),
            lat_deg=number(cells["latitude"], "latitude", -90.0, 90.0),
            lon_deg=number(cells["longitude"], "longitude", -180.0, 180.0),
            heading_deg=number(cells["gpsBearing"], "gpsBearing", -360.0, 360.0),
            clockwise=options.sense == "clockwise",
            options=options,
            own=own,
            cells=cells,
        )

    yield from read_objects(file, parse)
    own.check(file)


FORMAT = ImporterSpec(
    name="kraken-json",
    summary="KrakenSDR readings in the JSON of the Kraken apps, an object a line or an array",
    reference="krakensdr_doa, kraken_sdr_signal_processor.py, wr_json (names, units, radioBearing = theta_0)",
    options=KrakenOptions,
    kind=lambda options: "bearings",
    rows=_rows,
    begins_like=r'.{0,300}?"(?:radioBearing|gpsBearing|tStamp)"\s*:',
    extra=EXTRA,
)
"""The specification of the importer."""
