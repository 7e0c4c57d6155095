"""KrakenSDR logs in the exact form of the program that writes them: one-line XML, JSON, early files."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import pytest

from nlosctl import registry
from nlosctl.contract.formats import BadLine, ForeignFile, ImporterSpec, Row
from nlosctl.contract.options import parse_options
from nlosctl.contract.scene import Scene
from nlosctl.errors import DataError

FORMATS = Path(__file__).parents[2] / "fixtures" / "formats"


def read(name: str, text: str, **parameters: Any) -> list[Row | BadLine]:
    """Return the result of an importer on a text."""
    spec = registry.resolve_format(name, "import")
    assert isinstance(spec, ImporterSpec)
    file = ForeignFile(name="log", stream=io.BytesIO(text.encode()), scene=Scene())
    return list(spec.rows(file, parse_options(spec.options, parameters, name)))


def values(name: str, text: str, **parameters: Any) -> list[dict[str, Any]]:
    """Return the values of a log without bad lines."""
    rows = read(name, text, **parameters)
    assert [row for row in rows if isinstance(row, BadLine)] == []
    return [dict(row.values) for row in rows if isinstance(row, Row)]


ONE_LINE = (FORMATS / "kraken_one_line.xml").read_text()
JSON = (FORMATS / "kraken_pro.jsonl").read_text()


@pytest.mark.parametrize(
    "text",
    [
        ONE_LINE,
        f"<LOG>{ONE_LINE}</LOG>",
        f"<?xml version='1.0'?>\n<READINGS>\n{ONE_LINE}\n</READINGS>\n",
        ONE_LINE.replace("<DATA>", "<?xml version='1.0' encoding='utf-8'?><DATA>"),
        ONE_LINE.replace("</DATA>", "</DATA>\r\n"),
        ONE_LINE.replace("><", ">\n  <"),
    ],
)
def test_any_number_of_elements_in_any_lines(text: str) -> None:
    """Elements in one line, in a root, with declarations between or with line ends are the same readings."""
    assert values("kraken-xml", text) == values("kraken-xml", ONE_LINE)
    assert [row["sensor"] for row in values("kraken-xml", text)] == ["hill", "tower", "van"]


def test_a_line_of_more_than_a_mebibyte() -> None:
    """A log that is a single line has any length."""
    assert len(values("kraken-xml", ONE_LINE * 900)) == 2700


def test_text_outside_of_the_elements_is_a_fault() -> None:
    """What follows the elements is not skipped: it is a bad line with its number and text."""
    *rows, line = read("kraken-xml", ONE_LINE + "\nhalf a file\n")
    assert isinstance(line, Row)  # rows follow bad lines, which are reported first
    (bad,) = [row for row in rows if isinstance(row, BadLine)]
    assert (bad.text, bad.fault) == ("half a file", "got text outside of the elements, expected <DATA>")


def test_csv_xml_and_json_of_the_same_readings_agree() -> None:
    """Station, place, time, frequency and azimuth are those of the other formats."""
    names = ("sensor", "sensor_lat_deg", "sensor_lon_deg", "time_s", "frequency_hz", "azimuth_deg", "heading_deg")
    csv = values("kraken-csv", (FORMATS / "kraken_app.csv").read_text())
    for name, text in (("kraken-xml", ONE_LINE), ("kraken-json", JSON)):
        for row, expected in zip(values(name, text), csv, strict=True):
            assert {key: row[key] for key in names} == pytest.approx({key: expected[key] for key in names})


@pytest.mark.parametrize("indent", [None, 2])
def test_json_as_an_array(indent: int | None) -> None:
    """An array, in one line or many, is the same as an object a line; so are objects over several lines."""
    records = [json.loads(line) for line in JSON.splitlines()]
    assert values("kraken-json", json.dumps(records, indent=indent)) == values("kraken-json", JSON)
    assert values("kraken-json", "\n".join(json.dumps(record, indent=4) for record in records)) == values(
        "kraken-json", JSON
    )


@pytest.mark.parametrize(
    ("old", "new", "column", "says"),
    [
        ('"radioBearing":"', '"radioBearing":"x', "radioBearing", "expected a number from -360 to 360"),
        ('"freq":433920000', '"freq":null', "freq", "absent or empty, expected the value of 'freq'"),
        ('"latitude":', '"lat":', "latitude", "absent or empty"),
        ('"47.37"', '"147.37"', "latitude", "got '147.37', expected a number from -90 to 90"),
        ('{"station_id"', '{station_id"', None, "not JSON: "),
        ('{"station_id"', '7\n{"station_id"', None, "expected an object {...}"),
    ],
)
def test_bad_json_readings(old: str, new: str, column: str | None, says: str) -> None:
    """A bad value is reported under the name of the writing program, and the next object is read."""
    rows = read("kraken-json", JSON.replace(old, new, 1))
    (bad,) = [row for row in rows if isinstance(row, BadLine)]
    assert (bad.line, bad.column) == (1, column)
    assert says in bad.fault
    assert len(rows) == (4 if new.startswith("7") else 3)


def test_deep_json_is_refused() -> None:
    """Objects nested without end are an error, not a crash."""
    with pytest.raises(DataError, match="nested too deep"):
        read("kraken-json", '{"a":' * 100_000)


def test_early_csv_is_refused_in_one_line() -> None:
    """The first versions wrote ten reserved entries after the latency: no station, no position."""
    early = f"1650000000000, 30, 9.5, -35.2, 433.92, UCA, 100, {', '.join(['R'] * 10)}, 0.00, 1.00 \n"
    with pytest.raises(DataError, match="log, line 1: an early log of krakensdr_doa, without name and position"):
        read("kraken-csv", early * 3)


@pytest.mark.parametrize(
    ("name", "text", "field"),
    [
        ("kraken-xml", ONE_LINE, "SNR_DB"),
        ("kraken-json", JSON, "snr_db"),
        ("kraken-csv", (FORMATS / "kraken_app.csv").read_text(), "latency"),
    ],
)
def test_fields_are_kept_and_group(name: str, text: str, field: str) -> None:
    """``keep`` copies a field of the log as text; ``group`` separates snapshots by fields; a misspelt one is named."""
    (first, *_) = [row for row in read(name, text, keep=field) if isinstance(row, Row)]
    assert first.kept == {field: "100" if field == "latency" else "21.5"}
    station = {"kraken-xml": "STATION_ID", "kraken-json": "station_id", "kraken-csv": "station ID"}[name]
    snapshots = [row["snapshot"] for row in values(name, text, group=f"{station},{field}")]
    starts = {"hill": "1712000000", "tower": "1712000000.25", "van": "1712000000.5"}
    assert snapshots == [f"{station}-{who}/{field}-{first.kept[field]}/{start}" for who, start in starts.items()]
    with pytest.raises(DataError, match=f"no field '{field}s' \\(did you mean '{field}'\\?\\). The log has: "):
        read(name, text, keep=f"{field}s")
