"""Importers on lines written by hand from the documentation of their formats."""

from __future__ import annotations

import io
import math
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest

from nlosctl import registry
from nlosctl.contract.formats import BadLine, ForeignFile, ImporterSpec, Row
from nlosctl.contract.options import parse_options
from nlosctl.contract.scene import Scene, Sensor
from nlosctl.errors import DataError, UsageError

ANCHORS = Scene(
    sensors=(
        Sensor(name="CCF9579B21AE", position=(0.0, 0.0), heading_deg=45.0),
        Sensor(name="CCF9579B217F", position=(10.0, 0.0), heading_deg=315.0),
        Sensor(name="blind", position=(5.0, 5.0)),
    )
)


def read(name: str, text: str | bytes, scene: Scene = ANCHORS, **parameters: Any) -> list[Row | BadLine]:
    """Return the result of an importer on a file."""
    spec = registry.resolve_format(name, "import")
    assert isinstance(spec, ImporterSpec)
    content = text.encode() if isinstance(text, str) else text
    file = ForeignFile(name="log", stream=io.BytesIO(content), scene=scene)
    return list(spec.rows(file, parse_options(spec.options, parameters, name)))


def good(name: str, text: str | bytes, scene: Scene = ANCHORS, **parameters: Any) -> list[dict[str, Any]]:
    """Return the values of a file without bad rows."""
    rows = read(name, text, scene, **parameters)
    assert not [row for row in rows if isinstance(row, BadLine)]
    return [dict(row.values) for row in rows if isinstance(row, Row)]


def bad(name: str, text: str | bytes, scene: Scene = ANCHORS, **parameters: Any) -> BadLine:
    """Return the only bad line of a file."""
    (line,) = [row for row in read(name, text, scene, **parameters) if isinstance(row, BadLine)]
    return line


def spectrum(peak_deg: float, length: int = 360) -> str:
    """Return a spectrum over the unit circle, counter-clockwise from the front of the array, with a peak."""
    return ", ".join(f"{1 - abs(math.remainder(360 * i / length - peak_deg, 360)) / 360:.4f}" for i in range(length))


HEAD = "1712000000000, {doa}, 9.5, -35.2, 433920000, UCA, 100, {station}, 47.37, 8.54, 90.0, 200.0, {main}, R, R, R, R"


def kraken(
    doa: float, peak_deg: float | None = None, *, length: int = 360, main: str = "GPS", station: str = "hill"
) -> str:
    """Return a line of the Kraken App format; without a peak it has no spectrum."""
    head = HEAD.format(doa=doa, station=station, main=main)
    return head if peak_deg is None else f"{head}, {spectrum(peak_deg, length)}"


KRAKEN = kraken(30.0, 30.0)


@pytest.mark.parametrize(
    ("software", "doa", "azimuth"), [("until March 2023", 330, 60), ("until July 2024", 30, 60), ("since", 330, 60)]
)
@pytest.mark.parametrize("length", [360, 180, 720])
def test_the_sense_of_kraken_is_that_of_the_spectrum(software: str, doa: float, azimuth: float, length: int) -> None:
    """The source is 30 degrees counter-clockwise from the front: the spectrum peaks there in every version."""
    assert software
    (row,) = good("kraken-csv", kraken(doa, 30.0, length=length))
    assert row["azimuth_deg"] == pytest.approx(azimuth)


def test_lines_without_a_decisive_spectrum_have_the_sense_of_the_others() -> None:
    """A peak in front is that of both senses, and a line without a spectrum of none; the rest of the file decides."""
    rows = good("kraken-csv", "\n".join([kraken(330.0, 30.0), kraken(0.0, 0.0), kraken(40.0)]))
    assert [row["azimuth_deg"] for row in rows] == [60.0, 90.0, 130.0]


@pytest.mark.parametrize(
    ("lines", "says"),
    [
        ([kraken(30.0)], "no line has a spectrum"),
        ([kraken(30.0) + ", " + ", ".join(["0.00"] * 360)], "no line has a spectrum"),
        ([kraken(30.0, 90.0), kraken(0.0, 0.0)], "no line has a spectrum"),
        ([kraken(30.0, 30.0), kraken(40.0, 320.0)], "line 1 shows counter-clockwise, that of line 2 clockwise"),
    ],
)
def test_an_unknown_sense_of_kraken_is_an_error(lines: list[str], says: str) -> None:
    """No, flat, unrelated or contradicting spectra: the parameter must be set, and the message names it."""
    with pytest.raises(DataError, match=says) as raised:
        read("kraken-csv", "\n".join(lines))
    assert "`parameters` sense=clockwise" in str(raised.value)
    assert good("kraken-csv", "\n".join(lines), sense="clockwise")[0]["azimuth_deg"] == pytest.approx(120.0)
    assert good("kraken-csv", "\n".join(lines), sense="counter-clockwise")[0]["azimuth_deg"] == pytest.approx(60.0)


def test_the_main_heading_of_kraken_is_the_one_that_its_field_names() -> None:
    """Field 13 names the heading that counts: that of the GPS, or of the compass."""
    assert good("kraken-csv", kraken(30.0, 30.0, main="GPS"))[0]["azimuth_deg"] == pytest.approx(60.0)
    assert good("kraken-csv", kraken(30.0, 30.0, main="Compass"))[0]["azimuth_deg"] == pytest.approx(170.0)


@pytest.mark.parametrize("text", ["1_0.5", "\N{FULLWIDTH DIGIT ONE}0.5"])
def test_numbers_of_logs_are_plain(text: str) -> None:
    """Underscores and digits of other scripts are faults, as in tables."""
    line = bad("kraken-csv", f"{KRAKEN}\n{KRAKEN.replace('9.5', text, 1)}\n")
    assert (line.line, line.column) == (2, "confidence")


def test_xml_declarations_in_one_line() -> None:
    """Any number of declarations may precede the elements of a line."""
    assert (
        len(good("kraken-xml", "<?xml version='1.0'?>" * 2000 + XML.partition("?>")[2].replace("\n", "") + "\n")) == 1
    )


def test_kraken_directions_by_parameter() -> None:
    """Azimuth is heading + 360 - DoA where the DoA is counter-clockwise, heading + DoA where it is clockwise."""
    (row,) = good("kraken-csv", KRAKEN + " \n")
    assert row["azimuth_deg"] == pytest.approx(60.0)
    assert (row["sensor"], row["sensor_lat_deg"], row["sensor_lon_deg"]) == ("hill", 47.37, 8.54)
    assert (row["time_s"], row["frequency_hz"], row["confidence"], row["power_db"]) == (1.712e9, 433.92e6, 9.5, -35.2)
    assert good("kraken-csv", KRAKEN, sense="clockwise")[0]["azimuth_deg"] == pytest.approx(120.0)
    assert good("kraken-csv", KRAKEN, heading_deg=10.0)[0]["azimuth_deg"] == pytest.approx(340.0)


@pytest.mark.parametrize(
    ("old", "new", "column", "says"),
    [
        ("30.0,", "due north,", "DoA", "got 'due north', expected a number from -360 to 360"),
        ("47.37", "147.37", "latitude", "got '147.37', expected a number from -90 to 90"),
        ("47.37, 8.54", "0.0, 0.0", "latitude", "got 0, 0: the station had no position"),
        (" hill", "", "station ID", "empty, expected the name of the station"),
        (KRAKEN[KRAKEN.index(", UCA") :], "", None, "got 5 fields"),
        ("1712000000000", "nan", "time in ms", "got 'nan', expected a number of at least 0"),
    ],
)
def test_invalid_kraken_lines(old: str, new: str, column: str | None, says: str) -> None:
    """A bad field is reported by name, with the value and the expectation; other lines are read."""
    line = bad("kraken-csv", f"{KRAKEN}\n{KRAKEN.replace(old, new, 1)}\n")
    assert (line.line, line.column) == (2, column)
    assert says in line.fault


def test_snapshots_by_frequency_and_window() -> None:
    """Snapshots are split by frequency and, optionally, by time; repeated readings are numbered."""
    other = KRAKEN.replace("433920000", "868000000")
    later = KRAKEN.replace("1712000000000", "1712000010000")
    rows = good("kraken-csv", "\n".join([KRAKEN, other, later]))
    assert [(row["snapshot"], row["sensor"]) for row in rows] == [
        ("frequency_hz-433920000/1712000000", "hill"),
        ("frequency_hz-433920000/1712000000", "hill#2"),
        ("frequency_hz-868000000/1712000000", "hill"),
    ]
    rows = good("kraken-csv", "\n".join([KRAKEN, later]), window="5s")
    assert [(row["snapshot"], row["sensor"]) for row in rows] == [
        ("frequency_hz-433920000/1712000000", "hill"),
        ("frequency_hz-433920000/1712000010", "hill"),
    ]


XML = """<?xml version='1.0' encoding='utf-8'?>
<DATA>
  <STATION_ID>hill &amp; dale</STATION_ID>
  <TIME>1712000000000</TIME>
  <FREQUENCY>433.92</FREQUENCY>
  <LOCATION><LATITUDE>47.37</LATITUDE><LONGITUDE>8.54</LONGITUDE><HEADING>90.0</HEADING></LOCATION>
  <DOA>30.0</DOA><PWR>-35.2</PWR><CONF>95</CONF>
</DATA>
"""


def test_concatenated_df_aggregator_documents() -> None:
    """Each DATA element is a reading, with any declarations between; frequencies are in MHz or Hz."""
    rows = good("kraken-xml", XML + XML.replace("433.92", "433920000").replace("hill", "van"))
    assert [row["sensor"] for row in rows] == ["hill & dale", "van & dale"]
    assert {row["frequency_hz"] for row in rows} == {433.92e6}
    assert rows[0]["azimuth_deg"] == pytest.approx(60.0)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('<!DOCTYPE d [<!ENTITY a "aaaa">]>\n<DATA>&a;</DATA>', "log, line 1: contains a document type or an entity"),
        (
            '<?xml version="1.0"?><!DOCTYPE d SYSTEM "file:///etc/passwd"><DATA/>',
            "log, line 1: contains a document type",
        ),
        ("<DATA>\n<DOA>3</DATA>", "log, line 2: not XML: mismatched tag"),
        ("<DATA><DOA>&nbsp;</DOA></DATA>", "log, line 1: not XML: undefined entity"),
        ("<HTML></HTML>", "log: no <DATA> element"),
        ("<a>" * 20, "elements nested 9 deep"),
        ("<DATA>", "not XML"),
    ],
)
def test_invalid_and_hostile_xml(text: str, says: str) -> None:
    """Entities and document types are refused, and invalid XML is reported with its line."""
    with pytest.raises(DataError) as caught:
        read("kraken-xml", text)
    assert says in str(caught.value)


def test_missing_xml_elements() -> None:
    """A reading without one of its elements is a bad line, reported where its DATA begins."""
    line = bad("kraken-xml", XML + XML.replace("<DOA>30.0</DOA>", ""))
    assert (line.line, line.column) == (10, "DOA")
    assert line.fault == "absent or empty, expected <DOA> in <DATA>"


UUDF = '+UUDF:6C1DEBA4241B,-52,10,5,-43,37,"CCF9579B21AE","",15869'


def test_angle_events_are_relative_to_the_boresight() -> None:
    """The azimuth is heading plus angle, clockwise, from the anchor's position in the scene."""
    (row,) = good("uudf", f"+STARTUP\r\nOK\r\n{UUDF},23\r\n")
    assert row["azimuth_deg"] == pytest.approx(55.0)
    assert (row["sensor"], row["sensor_x_m"], row["sensor_y_m"]) == ("CCF9579B21AE", 0.0, 0.0)
    assert (row["rssi_dbm"], row["elevation_deg"], row["channel"], row["time_s"]) == (-52.0, 5.0, 37, 15.869)
    assert good("uudf", UUDF)[0]["tag"] == "6C1DEBA4241B"


def test_snapshots_end_when_an_anchor_repeats() -> None:
    """Without a common clock a snapshot of a tag ends when one of its anchors repeats."""
    other = UUDF.replace("CCF9579B21AE", "CCF9579B217F")
    rows = good("uudf", "\n".join([UUDF, other, UUDF, other.replace("6C1DEBA4241B", "B" * 12), other]))
    assert [row["snapshot"] for row in rows] == [
        "6C1DEBA4241B_0",
        "6C1DEBA4241B_0",
        "6C1DEBA4241B_1",
        "6C1DEBA4241B_1",
        f"{'B' * 12}_0",
    ]


@pytest.mark.parametrize(
    ("old", "new", "column", "says"),
    [
        (",10,5", ",100,5", "angle_azimuth", "got '100', expected a number from -90 to 90"),
        ("CCF9579B21AE", "CCF9579B21AF", "anchor_id", "the scene has no sensor 'CCF9579B21AF' (did you mean"),
        ("CCF9579B21AE", "blind", "anchor_id", "the scene's sensor 'blind' has no heading_deg"),
        (",15869", "", None, "got 8 fields after +UUDF:, expected 9, or 10"),
        (",37,", ",99,", "channel", "got '99', expected an integer from 0 to 39"),
    ],
)
def test_invalid_angle_events(old: str, new: str, column: str | None, says: str) -> None:
    """A bad field is reported under the name of the manual."""
    line = bad("uudf", UUDF.replace(old, new))
    assert (line.line, line.column) == (1, column)
    assert says in line.fault


@pytest.mark.parametrize("name", ["uudf", "anchor-azimuths"])
def test_anchors_need_a_scene(name: str) -> None:
    """Directions relative to a boresight without a scene are an error."""
    with pytest.raises(DataError, match="need a scene with the anchors"):
        read(name, UUDF, Scene())


def test_logs_without_events() -> None:
    """A file without a single event is an error."""
    with pytest.raises(DataError, match=r"no line contains '\+UUDF:'"):
        read("uudf", "OK\nOK\n")


def test_sense_of_rotation_of_anchors() -> None:
    """Clockwise from the boresight by default; windows split snapshots."""
    text = "t,who,angle\n0.00,CCF9579B21AE,10\n0.05,CCF9579B217F,-20\n0.30,CCF9579B21AE,12\n"
    names = {"time": "t", "sensor": "who", "azimuth": "angle"}
    rows = good("anchor-azimuths", text, **names)
    assert [row["azimuth_deg"] for row in rows] == pytest.approx([55.0, 295.0, 57.0])
    assert [row["snapshot"] for row in rows] == ["0", "0", "0.3"]
    rows = good("anchor-azimuths", text, sense="counter-clockwise", **names)
    assert [row["azimuth_deg"] for row in rows] == pytest.approx([35.0, 335.0, 33.0])


def test_units_and_order_of_ranges() -> None:
    """Units become metres and seconds, a variance a std; lines in any order are assigned to their windows."""
    text = "time,anchor,range,var\n1150,CCF9579B217F,250,4\n1000,CCF9579B21AE,100,4\n1040,CCF9579B217F,200,1\n"
    rows = good("uwb", text, time_unit="ms", range_unit="cm", variance="var", window="100ms")
    assert [row["snapshot"] for row in rows] == ["1", "1", "1.1"]
    assert [row["range_m"] for row in rows] == pytest.approx([1.0, 2.0, 2.5])
    assert [row["range_std_m"] for row in rows] == pytest.approx([0.02, 0.01, 0.02])
    assert [row["sensor_x_m"] for row in rows] == [0.0, 10.0, 10.0]


@pytest.mark.parametrize(
    ("cells", "column", "says"),
    [
        ("0,a,-1", "range", "got '-1', expected a number from 1e-09 to 1e+15"),
        ("0,,1", "anchor", "empty, expected the name of the anchor"),
        ("0,a", None, "got 2 fields, expected 3 as in the header"),
        ('0,"a,1', None, "the quotes don't match"),
    ],
)
def test_invalid_ranges(cells: str, column: str | None, says: str) -> None:
    """A bad cell is reported with column and line."""
    line = bad("uwb", f"time,anchor,range\n0,a,1\n{cells}\n")
    assert (line.line, line.column) == (3, column)
    assert says in line.fault


@pytest.mark.parametrize("window", ["0s", "-1s", "fast", "1", "1 parsec", "infs", "1e400s"])
def test_invalid_windows(window: str) -> None:
    """A window is a time with its unit, or all."""
    with pytest.raises(UsageError, match="must be a width larger than 0 with its unit"):
        read("uwb", "time,anchor,range\n0,a,1\n", window=window)


def test_std_options_exclude_each_other() -> None:
    """std, variance and range_std_m exclude each other."""
    with pytest.raises(UsageError, match="takes only one of the parameters"):
        read("uwb", "time,anchor,range,s\n0,a,1,1\n", std="s", range_std_m=0.1)


def test_missing_columns_are_reported() -> None:
    """A missing column is reported with the columns of the file."""
    with pytest.raises(DataError, match=r"no column 'range' \(did you mean 'rangee'\?\). The file has: time, anchor"):
        read("uwb", "time,anchor,rangee\n0,a,1\n")


def test_declination_is_added_to_compass_bearings() -> None:
    """Magnetic bearings plus declination are relative to true north; stations are numbered."""
    text = "GID,Easting,Northing,Azimuth\n7,500,0,350\n8,1,2,3\n7,0,500,100.5\n"
    rows = good("wildlife", text, declination_deg=12.0)
    assert [(row["snapshot"], row["sensor"]) for row in rows] == [("7", "1"), ("7", "2"), ("8", "1")]
    assert [row["azimuth_deg"] for row in rows] == pytest.approx([2.0, 112.5, 15.0])
    named = good("wildlife", "g,lon,lat,b\n1,8.5,47.3,10\n", group="g", x="lon", y="lat", azimuth="b", degrees=True)
    assert (named[0]["sensor_lon_deg"], named[0]["sensor_lat_deg"]) == (8.5, 47.3)


@pytest.mark.parametrize("text", [b"\xff\xfeG\x00", b"a\x00b\n1,2\n", b"", b"\n\n"])
def test_files_that_are_not_text(text: bytes) -> None:
    """Other encodings, zero bytes and empty files are reported in one line."""
    with pytest.raises(DataError):
        read("wildlife", text)


def arrays(**changed: Any) -> dict[str, Any]:
    """Return one receiver at (0, 0) and one transmitter at (3, 4): a direct path, and one over a bounce at (0, 4)."""
    made = {
        "tau": np.array([[[5.0, 7.0, -1.0]]]) / 299_792_458.0,
        "phi_r": np.array([[[math.atan2(4, 3), math.pi / 2, 0.0]]]),
        "phi_t": np.array([[[math.atan2(-4, -3), math.pi, 0.0]]]),
        "interactions": np.array([[[[0, 1, 0]]]], dtype=np.uint32),
        "vertices": np.array([[[[[0, 0, 0], [0, 4, 0], [0, 0, 0]]]]], dtype=np.float64),
        "sources": np.array([[3.0], [4.0], [1.0]]),
        "targets": np.array([[0.0], [0.0], [1.0]]),
    }
    return {**made, **changed}


def npz(**changed: Any) -> bytes:
    """Return the arrays as a file; None omits one."""
    held = {name: array for name, array in arrays(**changed).items() if array is not None}
    buffer = io.BytesIO()
    np.savez(buffer, **held)
    return buffer.getvalue()


def test_traced_paths_are_bearings_with_their_truth() -> None:
    """Existing paths are sorted by length (from the delay); no interaction is line of sight."""
    rows = good("sionna", npz(), range_std_m=0.1)
    assert [(row["path"], row["truth_los"], row["interactions"]) for row in rows] == [(0, True, 0), (1, False, 1)]
    assert [row["range_m"] for row in rows] == pytest.approx([5.0, 7.0])
    assert [row["bearing_rad"] for row in rows] == pytest.approx([math.atan2(4, 3), math.pi / 2])
    assert {(row["truth_x_m"], row["truth_y_m"]) for row in rows} == {(3.0, 4.0)}


def test_traced_paths_are_triplets_over_a_target() -> None:
    """The line of sight is not a triplet; a single bounce on the target is direct, others are indirect."""
    (row,) = good("sionna", npz(), kind="triplets", target="0,4.2")
    assert (row["tx_x_m"], row["rx_x_m"], row["truth_ip"]) == (3.0, 0.0, False)
    assert row["path_length_m"] == pytest.approx(7.0)
    assert (row["dod_rad"], row["doa_rad"]) == pytest.approx((math.pi, math.pi / 2))
    assert good("sionna", npz(), kind="triplets", target="2,2")[0]["truth_ip"] is True


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"tau": np.zeros((1, 2, 1, 2, 3))}, r"got shape \(1, 2, 1, 2, 3\).*synthetic_array=True"),
        ({"phi_r": None}, "no array 'phi_r'"),
        ({"phi_r": np.zeros((1, 1, 2))}, "array 'phi_r': got float64 of shape"),
        ({"phi_r": np.array([[[2.0, 0.0, 0.0]]])}, "a line-of-sight path arrives"),
        ({"tau": np.array([[[{"a": 1}, 2, 3]]], dtype=object)}, "an array can't be read: Object arrays"),
    ],
)
def test_invalid_arrays(changed: dict[str, Any], says: str) -> None:
    """Missing arrays, wrong shapes, inconsistent angles and pickled objects are reported."""
    with pytest.raises(DataError, match=says):
        read("sionna", npz(**changed))


def test_tables_of_paths_equal_arrays() -> None:
    """A Parquet file with a row per path is read as the NPZ file of the same paths."""
    held = arrays()
    rows = {name: held[name][0, 0, :2] for name in ("tau", "phi_r", "phi_t")}
    ends = {"rx_x": [0.0] * 2, "rx_y": [0.0] * 2, "tx_x": [3.0] * 2, "tx_y": [4.0] * 2}
    bounces = {"interactions": [0, 1], "vertex_x": [0.0, 0.0], "vertex_y": [0.0, 4.0]}
    table = pa.table({"rx": ["a", "a"], "tx": [7, 7], **rows, **ends, **bounces})
    buffer = io.BytesIO()
    pyarrow.parquet.write_table(table, buffer)
    assert good("sionna", buffer.getvalue()) == good("sionna", npz())
    words = {"kind": "triplets", "target": "0,4.2"}
    assert good("sionna", buffer.getvalue(), **words) == good("sionna", npz(), **words)
    buffer = io.BytesIO()
    pyarrow.parquet.write_table(table.drop_columns(["phi_t"]), buffer)
    with pytest.raises(DataError, match="no column 'phi_t'"):
        read("sionna", buffer.getvalue())


@pytest.mark.parametrize(
    ("bounces", "links", "says"),
    [
        ([0, 2**31], 1, "column 'interactions': got 2.14748e\\+09, expected 0 to 1000"),
        ([0.0, np.nan], 1, "column 'interactions': got nan"),
        ([-1, 0], 1, "column 'interactions': got -1"),
        ([0, 0], 20_000, "20000 x 20000 x 1 receivers, transmitters and paths, expected at most 134217728"),
        ([0, 1000], 400, "1000 interactions of 160000 paths, expected at most 134217728"),
    ],
)
def test_a_table_of_paths_that_asks_for_too_much_memory(bounces: list[float], links: int, says: str) -> None:
    """Indices that would require arrays of many gigabytes are reported without allocating them."""
    count = max(links, 2)
    ends = np.zeros(2, dtype=np.int64) if links == 1 else np.arange(count)
    columns = {name: np.full(count, 1e-8) for name in ("tau", "phi_r", "phi_t", "rx_x", "rx_y", "tx_x", "tx_y")}
    interactions = np.resize(np.array(bounces), count)
    buffer = io.BytesIO()
    pyarrow.parquet.write_table(pa.table({"rx": ends, "tx": ends, **columns, "interactions": interactions}), buffer)
    with pytest.raises(DataError, match=says):
        read("sionna", buffer.getvalue())


def test_files_that_are_not_npz() -> None:
    """Other bytes are reported in one line."""
    with pytest.raises(DataError, match="not a complete NPZ file"):
        read("sionna", b"PK\x03\x04 no more")
