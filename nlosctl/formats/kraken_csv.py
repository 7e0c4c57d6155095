"""KrakenSDR logs in the "Kraken App" format: one line per reading, without a header."""

from __future__ import annotations

from collections.abc import Iterator

from nlosctl.contract.formats import BadLine, ForeignFile, ImporterSpec, Row, UnfitError
from nlosctl.formats.epochs import in_epochs, parse_window
from nlosctl.formats.fields import lines, number, take_apart
from nlosctl.formats.kraken import EXTRA, KrakenOptions, reading

__all__ = ["FORMAT"]

_FEWEST = 12
"""Time, DoA, confidence, power, frequency, array, latency, station, latitude, longitude and two headings. The fields
after them (source of the main heading, reserved fields, spectrum) are not used."""


def _rows(file: ForeignFile, options: KrakenOptions) -> Iterator[Row | BadLine]:
    def parse(line: int, text: str) -> Row:
        fields = [field.strip() for field in text.split(",")]
        if len(fields) < _FEWEST:
            raise UnfitError(f"got {len(fields)} fields, expected at least {_FEWEST}: time, DoA, confidence, ...")
        station = fields[7]
        if not station:
            raise UnfitError("empty, expected the name of the station", "station ID")
        return reading(
            line=line,
            station=station,
            time_s=number(fields[0], "time in ms", 0.0) / 1e3,
            doa_deg=number(fields[1], "DoA", -360.0, 360.0),
            confidence=number(fields[2], "confidence"),
            power_db=number(fields[3], "power"),
            frequency_hz=number(fields[4], "frequency", 0.0),
            lat_deg=number(fields[8], "latitude", -90.0, 90.0),
            lon_deg=number(fields[9], "longitude", -180.0, 180.0),
            heading_deg=number(fields[10], "heading", -360.0, 360.0),
            options=options,
        )

    window_s = parse_window(options.window, "importer 'kraken-csv'")
    yield from in_epochs(take_apart(lines(file), parse), window_s)


FORMAT = ImporterSpec(
    name="kraken-csv",
    summary="KrakenSDR readings in the Kraken App format (CSV, one line per reading)",
    reference="KrakenSDR wiki, 'Kraken App' output format, and krakensdr_doa, kraken_sdr_signal_processor.py",
    options=KrakenOptions,
    kind=lambda options: "bearings",
    rows=_rows,
    extra=EXTRA,
)
"""The specification of the importer."""
