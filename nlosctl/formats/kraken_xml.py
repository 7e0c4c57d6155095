"""KrakenSDR readings in the DF Aggregator format: DATA elements, each a document of its own or within any root.

The text is given to expat within an enclosing element, where document types, and with them entities, are not valid XML.
krakensdr_doa (`wr_xml`) writes an element in one line without a declaration, so a log may be a single line.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from xml.parsers import expat

from nlosctl.contract.formats import BadLine, ForeignFile, ImporterSpec, Row, UnfitError
from nlosctl.errors import DataError
from nlosctl.formats.epochs import in_epochs, parse_window
from nlosctl.formats.fields import decoded, number
from nlosctl.formats.kraken import EXTRA, KrakenOptions, reading
from nlosctl.formats.own_fields import OwnFields

__all__ = ["FORMAT"]

_DECLARATION = re.compile(r"<\?xml.*?\?>", re.DOTALL)
"""Each document may begin with one."""

_REFUSED = re.compile(r"<!(?:DOCTYPE|ENTITY)")
_PIECE = 1 << 20
_DEEPEST = 8
_LONGEST_TEXT = 10_000
_SHOWN = 200
_LARGEST_MHZ = 1e5
_LOCATION = ("LOCATION/LATITUDE", "LOCATION/LONGITUDE", "LOCATION/HEADING")
_FIELDS = ("STATION_ID", "TIME", "FREQUENCY", *_LOCATION, "DOA", "PWR", "CONF")


class _Readings:
    """Collects the fields of DATA elements, and the text outside of them; ``done`` has both, by their first lines."""

    def __init__(self) -> None:
        self.done: list[tuple[int, dict[str, str] | str]] = []
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
            raise DataError(f"elements nested {len(self._path)} deep, expected <DATA> with <STATION_ID> and so on")
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
            self._fields[key] = (self._fields.get(key, "") + text)[:_LONGEST_TEXT]
        elif len(self._path) == 1 and text.strip():
            self.done.append((self.parser.CurrentLineNumber, text.strip()))


def _rows(file: ForeignFile, options: KrakenOptions) -> Iterator[Row | BadLine]:
    width = parse_window(options.window, "importer 'kraken-xml'")
    yield from in_epochs(_readings(file, options), width, file, options.group or "frequency_hz")


def _readings(file: ForeignFile, options: KrakenOptions) -> Iterator[Row | BadLine]:
    text = decoded(file)
    refused = _REFUSED.search(text)
    if refused is not None:
        line = text.count("\n", 0, refused.start()) + 1
        raise DataError(
            f"{file.name}, line {line}: contains a document type or an entity, expected neither; they are not supported"
        )
    text = _DECLARATION.sub(lambda found: "\n" * found[0].count("\n"), text)
    readings, own, has_data = _Readings(), OwnFields(options.group, options.keep), False
    try:
        for start in range(0, len(text) + 1, _PIECE):
            readings.parser.Parse(text[start : start + _PIECE], False)
            for line, found in readings.done:
                has_data |= isinstance(found, dict)
                yield _outside(line, found) if isinstance(found, str) else _reading(line, found, options, own)
            readings.done.clear()
        readings.parser.Parse("</LOG>", True)
    except expat.ExpatError as error:
        raise DataError(f"{file.name}, line {error.lineno}: not XML: {expat.errors.messages[error.code]}") from None
    except DataError as error:
        raise DataError(f"{file.name}, line {readings.parser.CurrentLineNumber}: {error}") from None
    if not has_data:
        raise DataError(f"{file.name}: no <DATA> element; not DF Aggregator output")
    own.check(file)


def _outside(line: int, text: str) -> BadLine:
    return BadLine(line=line, fault="got text outside of the elements, expected <DATA>", text=text[:_SHOWN])


def _reading(line: int, fields: dict[str, str], options: KrakenOptions, own: OwnFields) -> Row | BadLine:
    cells = {name.rpartition("/")[2]: value.strip() for name, value in fields.items() if name}
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
            clockwise=options.sense == "clockwise",
            options=options,
            own=own,
            cells=cells,
        )
    except UnfitError as unfit:
        text = " ".join(f"{name}={value}" for name, value in cells.items() if value)
        return BadLine(line=line, fault=unfit.fault, column=unfit.column, text=text)


def _hertz(frequency: float) -> float:
    """Return a frequency in Hz: versions of the software write MHz or Hz, and no receiver covers both ranges."""
    return frequency * 1e6 if frequency < _LARGEST_MHZ else frequency


FORMAT = ImporterSpec(
    name="kraken-xml",
    summary="KrakenSDR readings in the DF Aggregator format (XML)",
    reference="krakensdr_doa, kraken_sdr_signal_processor.py, wr_xml; df-aggregator, receivers.py (how it reads them)",
    options=KrakenOptions,
    kind=lambda options: "bearings",
    rows=_rows,
    begins_like=r"(?:<(?!DATA>)[^>]*>\s*)*<DATA>",
    extra=EXTRA,
)
"""The specification of the importer."""
