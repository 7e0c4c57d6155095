"""KrakenSDR logs in the "Kraken App" format: one line per reading, without a header.

The sense of the DoA field changed with the versions of krakensdr_doa: clockwise from the front of the array until March
2023, counter-clockwise until July 2024 (commit 4de18a0), clockwise since. The spectrum at the end of a line is over the
unit circle, counter-clockwise, in all of them: its peak is at the DoA or at 360 - DoA.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial

from nlosctl.contract.formats import BadLine, ForeignFile, ImporterSpec, Row, UnfitError
from nlosctl.errors import DataError
from nlosctl.formats.epochs import in_epochs, parse_window
from nlosctl.formats.fields import lines, number, take_apart
from nlosctl.formats.kraken import EXTRA, KrakenOptions, reading
from nlosctl.formats.own_fields import OwnFields

__all__ = ["FORMAT"]

_FIELDS = (
    *("time in ms", "DoA", "confidence", "power", "frequency", "array", "latency", "station ID"),
    *("latitude", "longitude", "GPS heading", "compass heading", "main heading"),
)
_FEWEST = 12
_HEADING_SOURCE = 12
_SPECTRUM = 17
"""The indices of the name of the main heading, GPS or Compass in the order of the headings, and of the spectrum."""

_EARLY = ["R"] * 10
"""The reserved entries from the station on, in the files of the first versions."""

_FEWEST_VALUES = 8
_WIDEST_PEAK_DEG = 3.0
_WORDS = {True: "clockwise", False: "counter-clockwise"}


def _rows(file: ForeignFile, options: KrakenOptions) -> Iterator[Row | BadLine]:
    width = parse_window(options.window, "importer 'kraken-csv'")
    yield from in_epochs(iter(_readings(file, options)), width, file, options.group or "frequency_hz")


def _readings(file: ForeignFile, options: KrakenOptions) -> list[Row | BadLine]:
    """Return the rows of a file, with the sense of its spectra unless the options specify one."""
    clockwise_rows: dict[int, Row] = {}
    senses: dict[int, bool] = {}
    own = OwnFields(options.group, options.keep)

    def parse(line: int, text: str) -> Row:
        fields = [field.strip() for field in text.split(",")]
        if fields[7:17] == _EARLY:
            raise DataError(
                f"{file.name}, line {line}: an early log of krakensdr_doa, without name and position of the station; "
                f"record with a later version, or put name, latitude, longitude and heading into fields 8 to 12"
            )
        if len(fields) < _FEWEST:
            raise UnfitError(f"got {len(fields)} fields, expected at least {_FEWEST}: time, DoA, confidence, ...")
        station = fields[7]
        if not station:
            raise UnfitError("empty, expected the name of the station", "station ID")
        doa_deg = number(fields[1], "DoA", -360.0, 360.0)
        compass = len(fields) > _HEADING_SOURCE and fields[_HEADING_SOURCE].lower() == "compass"
        read = partial(
            reading,
            line=line,
            station=station,
            time_s=number(fields[0], "time in ms", 0.0) / 1e3,
            doa_deg=doa_deg,
            confidence=number(fields[2], "confidence"),
            power_db=number(fields[3], "power"),
            frequency_hz=number(fields[4], "frequency", 0.0),
            lat_deg=number(fields[8], "latitude", -90.0, 90.0),
            lon_deg=number(fields[9], "longitude", -180.0, 180.0),
            heading_deg=number(fields[11 if compass else 10], "heading", -360.0, 360.0),
            options=options,
            own=own,
            cells=dict(zip(_FIELDS, fields, strict=False)),
        )
        clockwise_rows[line] = read(clockwise=True)
        sense = _clockwise(doa_deg, fields[_SPECTRUM:])
        if sense is not None:
            senses[line] = sense
        return read(clockwise=False)

    rows = list(take_apart(lines(file), parse))
    own.check(file)
    clockwise = options.sense == "clockwise"
    if options.sense == "auto" and clockwise_rows:
        clockwise = _common_sense(file, senses)
    return [clockwise_rows[row.line] if clockwise and isinstance(row, Row) else row for row in rows]


def _clockwise(doa_deg: float, spectrum: list[str]) -> bool | None:
    """Return whether the peak of a spectrum of any length shows a clockwise DoA; None if it is not decisive.

    A flat or absent spectrum is not decisive, nor is a peak in front or behind, or one that is not at the DoA.
    """
    try:
        values = [float(value) for value in spectrum]
    except ValueError:
        return None
    if len(values) < _FEWEST_VALUES or not all(map(math.isfinite, values)):
        return None
    largest = max(values)
    peaks = [index for index, value in enumerate(values) if value == largest]
    step_deg = 360.0 / len(values)
    if (len(peaks) - 1) * step_deg > _WIDEST_PEAK_DEG or peaks[-1] - peaks[0] != len(peaks) - 1:
        return None
    peak_deg = 0.5 * (peaks[0] + peaks[-1]) * step_deg
    tolerance_deg = max(step_deg, _WIDEST_PEAK_DEG)
    same, opposite = (abs(math.remainder(peak_deg - angle, 360.0)) <= tolerance_deg for angle in (doa_deg, -doa_deg))
    return None if same == opposite else opposite


def _common_sense(file: ForeignFile, senses: dict[int, bool]) -> bool:
    """Return the sense on which all spectra that are decisive agree; raises DataError without one."""
    cure = (
        "set `parameters` sense=clockwise (software since July 2024, or until March 2023) or "
        "sense=counter-clockwise (between them)"
    )
    if not senses:
        raise DataError(
            f"{file.name}: the sense of the DoA cannot be detected: no line has a spectrum with a peak at the DoA or at"
            f" 360 - DoA, away from 0 and 180 degrees; {cure}"
        )
    first = next(iter(senses.values()))
    other = next((line for line, sense in senses.items() if sense != first), None)
    if other is not None:
        raise DataError(
            f"{file.name}: the sense of the DoA cannot be detected: the spectrum of line {next(iter(senses))} shows"
            f" {_WORDS[first]}, that of line {other} {_WORDS[not first]}; convert them separately, or {cure}"
        )
    return first


FORMAT = ImporterSpec(
    name="kraken-csv",
    summary="KrakenSDR readings in the Kraken App format (CSV, one line per reading)",
    reference="KrakenSDR wiki, 'Kraken App' output format, and krakensdr_doa, kraken_sdr_signal_processor.py",
    options=KrakenOptions,
    kind=lambda options: "bearings",
    rows=_rows,
    begins_like=r"\d{12,14}\s*,\s*-?[\d.]+\s*,(?:\s*-?[\d.eE+-]+\s*,){3}\s*[A-Za-z]+\s*,\s*\d+\s*,",
    extra=EXTRA,
)
"""The specification of the importer."""
