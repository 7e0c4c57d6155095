"""Readings that KrakenSDR writes for df-aggregator: DATA elements, one to a document, any number of documents.

Parsed by expat as the lines come, within an element of our own: a document type, and with it every entity, is no XML
there.
"""

from __future__ import annotations

from collections.abc import Iterator
from xml.parsers import expat

from nlosctl.contract.formats import BadLine, ForeignFile, ImporterSpec, Row, UnfitError
from nlosctl.errors import DataError
from nlosctl.formats.epochs import in_epochs, parse_window
from nlosctl.formats.fields import lines, number
from nlosctl.formats.kraken import EXTRA, KrakenOptions, reading

__all__ = ["FORMAT"]

_DEEPEST = 8
_LONGEST_TEXT = 10_000
_LARGEST_MHZ = 1e5
_PLACE = ("LOCATION/LATITUDE", "LOCATION/LONGITUDE", "LOCATION/HEADING")
_FIELDS = ("STATION_ID", "TIME", "FREQUENCY", *_PLACE, "DOA", "PWR", "CONF")


class _Readings:
    """Gathers the fields of DATA elements; ``done`` are the whole ones, with the line where each began."""

    def __init__(self) -> None:
        self.done: list[tuple[int, dict[str, str]]] = []
        self._path: list[str] = []
        self._fields: dict[str, str] = {}
        self._line = 0
        self.parser = expat.ParserCreate()
        self.parser.buffer_text = True
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.CharacterDataHandler = self._text
        self.parser.Parse("<LOG>", False)

    def _start(self, name: str, _: object) -> None:
        self._path.append(name)
        if len(self._path) > _DEEPEST:
            raise DataError(
                f"elements within elements, {len(self._path)} deep, expected <DATA> with <STATION_ID> and so on"
            )
        if name == "DATA":
            self._fields, self._line = {}, self.parser.CurrentLineNumber

    def _end(self, name: str) -> None:
        self._path.pop()
        if name == "DATA":
            self.done.append((self._line, self._fields))
            self._fields = {}

    def _text(self, text: str) -> None:
        if "DATA" in self._path:
            key = "/".join(self._path[self._path.index("DATA") + 1 :])
            if key in _FIELDS:
                self._fields[key] = (self._fields.get(key, "") + text)[:_LONGEST_TEXT]


def _rows(file: ForeignFile, options: KrakenOptions) -> Iterator[Row | BadLine]:
    window_s = parse_window(options.window, "importer 'kraken-xml'")
    yield from in_epochs(_readings(file, options), window_s)


def _readings(file: ForeignFile, options: KrakenOptions) -> Iterator[Row | BadLine]:
    readings, line, found = _Readings(), 0, False
    try:
        for line, text in lines(file):
            if "<!DOCTYPE" in text or "<!ENTITY" in text:
                raise DataError("holds a document type or an entity, expected none: they are not read")
            behind = line - readings.parser.CurrentLineNumber
            readings.parser.Parse("\n" * behind + _without_declaration(text), False)
            for begun, fields in readings.done:
                found = True
                yield _reading(begun, fields, options)
            readings.done.clear()
        readings.parser.Parse("</LOG>", True)
    except expat.ExpatError as error:
        raise DataError(f"{file.name}, line {line}: not XML: {expat.errors.messages[error.code]}") from None
    except DataError as error:
        prefix = "" if str(error).startswith(file.name) else f"{file.name}, line {line}: "
        raise DataError(f"{prefix}{error}") from None
    if not found:
        raise DataError(f"{file.name}: no <DATA> element: this is no DF Aggregator output")


def _without_declaration(text: str) -> str:
    """Return a line without an XML declaration: one stands before each document."""
    start = text.find("<?xml")
    end = text.find("?>", start)
    return text if start < 0 or end < 0 else _without_declaration(text[:start] + text[end + 2 :])


def _reading(line: int, fields: dict[str, str], options: KrakenOptions) -> Row | BadLine:
    try:
        for name in _FIELDS:
            if not fields.get(name, "").strip():
                raise UnfitError(f"absent or empty, expected <{name.rpartition('/')[2]}> in <DATA>", name)
        return reading(
            line=line,
            station=fields["STATION_ID"].strip(),
            time_s=number(fields["TIME"], "TIME", 0.0) / 1e3,
            doa_deg=number(fields["DOA"], "DOA", -360.0, 360.0),
            confidence=number(fields["CONF"], "CONF"),
            power_db=number(fields["PWR"], "PWR"),
            frequency_hz=_hertz(number(fields["FREQUENCY"], "FREQUENCY", 0.0)),
            lat_deg=number(fields["LOCATION/LATITUDE"], "LOCATION/LATITUDE", -90.0, 90.0),
            lon_deg=number(fields["LOCATION/LONGITUDE"], "LOCATION/LONGITUDE", -180.0, 180.0),
            heading_deg=number(fields["LOCATION/HEADING"], "LOCATION/HEADING", -360.0, 360.0),
            options=options,
        )
    except UnfitError as unfit:
        text = " ".join(f"{name}={value.strip()}" for name, value in fields.items())
        return BadLine(line=line, fault=unfit.fault, column=unfit.column, text=text)


def _hertz(frequency: float) -> float:
    """Return a frequency that is in MHz or in Hz, as versions differ; no receiver reaches both."""
    return frequency * 1e6 if frequency < _LARGEST_MHZ else frequency


FORMAT = ImporterSpec(
    name="kraken-xml",
    summary="KrakenSDR readings in the DF Aggregator format (XML)",
    reference="df-aggregator, receivers.py (the elements and how they make an azimuth)",
    options=KrakenOptions,
    kind=lambda options: "bearings",
    rows=_rows,
    extra=EXTRA,
)
"""The specification of the importer."""
