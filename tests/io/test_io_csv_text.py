"""CSV variants: quotes, blank lines, line ends, separators, additional columns."""

from __future__ import annotations

import bz2
import csv
import ctypes
import gzip
import io
import signal
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.csv
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from reading_support import Gathered, pa, read, whole

from nlosctl.contract.run_options import InputOptions
from nlosctl.errors import DataError
from nlosctl.io.measurements.reader import MeasurementReader
from nlosctl.io.paths.inputs import expand_inputs
from nlosctl.io.readers.csv_records import RecordBlocks

HEADER = "snapshot,sensor,sensor_x_m,sensor_y_m,bearing_rad,bearing_std_rad"
SMALL_BLOCK = 400


@pytest.fixture
def small_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Read CSV in blocks of a few rows."""
    monkeypatch.setenv("NLOSCTL_MAX_LINE_BYTES", str(SMALL_BLOCK))


def save_csv(path: Path, *lines: str, header: str = HEADER, end: str = "\n") -> Path:
    """Write a header and lines."""
    path.write_bytes((end.join([header, *lines]) + end).encode())
    return path


def good(place: int, note: str = "") -> str:
    """Return a valid line."""
    return f"{place},a{place},0,0,1,0.1{note}"


@pytest.mark.parametrize("rows_after", [1, 3, 200_000])
def test_a_quote_that_is_not_closed_is_told_by_its_line(tmp_path: Path, rows_after: int) -> None:
    """An unclosed quote is an error, whether the rest of the file is short or longer than a block."""
    lines = [good(1), '2,"a,0,0,1,0.1', *(good(place) for place in range(3, 3 + rows_after))]
    with pytest.raises(DataError, match="line 3: a quote opens here and is not closed"):
        read([save_csv(tmp_path / "a.csv", *lines)])


def test_a_quote_closed_by_the_next_one_is_told(tmp_path: Path) -> None:
    """A quote closed by the next quoted cell is an error if a row would be lost."""
    path = save_csv(tmp_path / "a.csv", good(1), '2,"abc,0,0,1,0.1', '3,"x",0,0,1,0.1', good(4))
    with pytest.raises(DataError, match="line 3: a quote opens"):
        read([path])


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_bad_rows_have_their_line_after_blank_and_broken_lines(tmp_path: Path, small_blocks: None, end: str) -> None:
    """Row numbers count data rows; line numbers count all lines: blank, ragged, and within quotes."""
    note = f',"a note{end}of ""two"" lines{end}"'
    lines = [good(1, note), "", good(2, ",x"), "5,6", "", *(good(place, ',5" screen') for place in range(3, 30))]
    lines.append("30,z,0,0,north,0.1,")
    path = save_csv(tmp_path / "a.csv", *lines, header=HEADER + ",note", end=end)
    aside = Gathered()
    found = whole(read([path], aside, chunk_rows=7))
    assert [(row.problem.row, row.problem.line) for row in aside] == [(3, 7), (31, 36)]
    assert path.read_bytes().decode().split(end)[35].startswith("30,z")
    assert found.ids == list(range(1, 30))
    assert found.table.column("note")[0].as_py() == f'a note{end}of "two" lines{end}'


@settings(max_examples=150, deadline=None)
@given(
    rows=st.lists(st.lists(st.text(alphabet='a",\n\r ', max_size=6), min_size=2, max_size=2), min_size=1, max_size=25),
    end=st.sampled_from(["\n", "\r\n"]),
    block=st.integers(40, 200),
)
def test_records_are_cut_as_the_csv_module_cuts_them(rows: list[list[str]], end: str, block: int) -> None:
    """For any quoted text and block ends, records and line numbers equal those of a plain reader."""
    text = io.StringIO()
    csv.writer(text, quoting=csv.QUOTE_ALL, lineterminator=end).writerows(rows)
    data = text.getvalue().encode()
    expected, line = [], 1
    for row in rows:
        expected.append(line)
        single = io.StringIO()
        csv.writer(single, quoting=csv.QUOTE_ALL, lineterminator=end).writerow(row)
        written = single.getvalue().replace("\r\n", "\n").replace("\r", "\n")
        line += written.count("\n")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("NLOSCTL_MAX_LINE_BYTES", str(block))
        blocks = list(RecordBlocks(io.BytesIO(data), "f").blocks())
    assert b"".join(block.content for block in blocks) == data
    assert np.concatenate([block.lines for block in blocks]).tolist() == expected


def test_types_of_own_columns_hold_for_the_whole_file(tmp_path: Path, small_blocks: None) -> None:
    """An additional column has the narrowest lossless type, for any position of the unusual value."""
    notes = {30: ",x,1.5,7,2,", 40: ",,2,,-,true"}
    lines = [good(place, notes.get(place, ",1,1,007,1,")) for place in range(60)]
    path = save_csv(tmp_path / "a.csv", *lines, header=HEADER + ",word,number,code,dash,flag")
    table = whole(read([path])).table
    types = {name: str(table.schema.field(name).type) for name in table.column_names[6:]}
    assert types == {"word": "string", "number": "double", "code": "string", "dash": "string", "flag": "bool"}
    assert table.column("code")[0].as_py() == "007"
    assert table.num_rows == 60


@pytest.mark.parametrize(
    ("cells", "kept"),
    [
        (["007", "1.5"], ["007", "1.5"]),
        (["12345678901234567", "0.5"], ["12345678901234567", "0.5"]),
        (["9" * 20, "1"], ["9" * 20, "1"]),
        (["1e3", " 2", ""], [1000.0, 2.0, None]),
        ([" 1", "-2", ""], [1, -2, None]),
    ],
)
def test_numbers_that_are_names_stay_text(tmp_path: Path, cells: list[str], kept: list[object]) -> None:
    """An additional column becomes numbers only if no digit is lost."""
    path = save_csv(tmp_path / "a.csv", *(good(n, f",{cell}") for n, cell in enumerate(cells)), header=HEADER + ",own")
    assert whole(read([path])).table.column("own").to_pylist() == kept


def test_a_duplicate_has_its_line_after_bad_rows(tmp_path: Path) -> None:
    """Line numbers are not shifted by earlier rows that were set aside, in any batch."""
    path = save_csv(tmp_path / "a.csv", "1,a,0,0,x,1", "", "1,b,0,0,1,1", "1,c,0,0,1,1", "", "1,b,0,0,1,1")
    for chunk_rows in (1, 100):
        aside = Gathered()
        read([path], aside, chunk_rows=chunk_rows)
        assert [(row.problem.row, row.problem.line) for row in aside] == [(1, 2), (4, 7)]


def test_a_stream_tells_the_cure_for_own_columns(small_blocks: None) -> None:
    """A stream can't be read twice: a later value of another type is one line with the cure, if the column is used."""
    lines = [HEADER + ",n", *(good(place, f",{place if place < 40 else 'x'}") for place in range(50))]
    data = "\n".join(lines).encode()
    for extra in (None, ("n",)):
        inputs = expand_inputs(["-"], stdin=io.BytesIO(data))
        reader = MeasurementReader(inputs, InputOptions(extra_columns=extra))
        with pytest.raises(DataError, match=r"line 42, column 'n': got 'x'.*save it as a file"):
            list(reader.chunks())
    reader = MeasurementReader(expand_inputs(["-"], stdin=io.BytesIO(data)), InputOptions(extra_columns=("sweep_*",)))
    assert sum(chunk.table.num_rows for chunk in reader.chunks()) == 50
    assert reader.column_names[-1] == "n"
    assert "n" not in reader.schema.names


def test_extra_columns_are_named_by_their_beginning_too(tmp_path: Path) -> None:
    """``sweep_*`` keeps all columns with this prefix."""
    path = save_csv(tmp_path / "a.csv", good(1, ",1,2,3"), header=HEADER + ",sweep_a,sweep_b,other")
    assert whole(read([path], extra_columns=("sweep_*",))).table.column_names[6:] == ["sweep_a", "sweep_b"]


@pytest.mark.parametrize(
    ("header", "message"),
    [
        (HEADER.replace(",", "|"), "separated by bars, expected commas, tabs or semicolons"),
        ("# made by a script", "begins with '#', expected the header"),
        ("# made by a script, 2024", "begins with '#', expected the header"),
        ("# " + HEADER, "got '# snapshot', expected 'snapshot'"),
        ('"' + HEADER, "line 1: a quote opens here"),
    ],
)
def test_a_missing_header_is_an_error(tmp_path: Path, header: str, message: str) -> None:
    """Another separator, and comments, are reported as such."""
    with pytest.raises(DataError, match=message):
        read([save_csv(tmp_path / "a.csv", good(1), header=header)])


def test_columns_without_a_name_get_one(tmp_path: Path) -> None:
    """Trailing commas of a spreadsheet, and R's column of row names, are ignored."""
    path = save_csv(tmp_path / "a.csv", good(1, ",,"), header=HEADER + ",,")
    assert whole(read([path])).table.column_names[6:] == ["unnamed_7", "unnamed_8"]


def test_a_wholly_wrong_column_is_one_line(tmp_path: Path) -> None:
    """Text in all rows of a column of numbers is a fault of the file, not of each row."""
    path = save_csv(tmp_path / "a.csv", *(good(place).replace(",1,", ",north,") for place in range(30)))
    with pytest.raises(DataError, match="'bearing_rad': wrong type: contains text such as 'north'") as e:
        read([path], Gathered())
    assert "\n" not in str(e.value)


def test_a_line_without_end_is_no_csv(tmp_path: Path, small_blocks: None) -> None:
    """A line longer than a block is refused with its number, in bounded memory."""
    path = save_csv(tmp_path / "a.csv", good(1), good(2, "," + "x" * 2 * SMALL_BLOCK), header=HEADER + ",note")
    with pytest.raises(DataError, match=r"line 3: the line is longer than"):
        read([path])


def test_gzipped_csv_of_many_blocks_is_whole(tmp_path: Path, small_blocks: None) -> None:
    """Blocks of decompressed text are joined exactly, with or without a final line end."""
    text = "\n".join([HEADER, *(good(place) for place in range(200))])
    for tail in ("", "\n", "\n\n"):
        (tmp_path / "a.csv.gz").write_bytes(gzip.compress((text + tail).encode()))
        assert whole(read([tmp_path / "a.csv.gz"])).ids == list(range(200))


def test_own_columns_of_any_type_stay_with_the_rows(tmp_path: Path) -> None:
    """Views of text and bytes, lists and structs are carried through a typed file."""
    from reading_support import bearings

    table = bearings([1, 1, 1], sensor=pa.array(["a", None, "b"], pa.string_view()))
    table = table.append_column("v", pa.array(["x", None, "y"], pa.string_view()))
    table = table.append_column("b", pa.array([b"\xff", None, b"z"], pa.binary_view()))
    table = table.append_column("l", pa.array([[1], None, []]))
    with pa.ipc.new_file(tmp_path / "a.arrow", table.schema) as writer:
        writer.write_table(table)
    aside = Gathered()
    found = whole(read([tmp_path / "a.arrow"], aside)).table
    assert [row.problem.row for row in aside] == [2]
    assert found.select(["v", "b", "l"]).to_pylist() == [
        {"v": "x", "b": b"\xff", "l": [1]},
        {"v": "y", "b": b"z", "l": []},
    ]


def handler_of(number: int) -> bytes:
    """Return the handler of a signal: the first field of the C library's ``struct sigaction``."""
    action = ctypes.create_string_buffer(256)
    assert ctypes.CDLL(None).sigaction(number, None, action) == 0
    return action.raw[: ctypes.sizeof(ctypes.c_void_p)]


@pytest.mark.skipif(sys.platform != "linux", reason="the layout of the struct is that of Linux")
def test_ctrl_c_is_pythons_while_a_block_is_parsed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Arrow must not replace the signal handler while it parses: an interrupt could be lost."""
    seen = []
    parse = pyarrow.csv.read_csv

    def watched(content: Any, *, parse_options: Any, **options: Any) -> Any:
        take_bad_line = parse_options.invalid_row_handler

        def watch(line: Any) -> str:
            seen.append(handler_of(signal.SIGINT))
            return str(take_bad_line(line))

        parse_options.invalid_row_handler = watch
        return parse(content, parse_options=parse_options, **options)

    monkeypatch.setattr(pyarrow.csv, "read_csv", watched)
    read([save_csv(tmp_path / "a.csv", good(1), "2,a,0", good(3))], Gathered())
    assert seen
    assert set(seen) == {handler_of(signal.SIGINT)}


ROWS = [
    ["1", "a", "0", "0", "0.785", "0.01", "x"],
    ["1", 'b "2"', "100", "0", "2.356", "0.01", "two\nlines"],
    ["1", "c", "0", "100.5", "-0.785", "0.01", "a , ; \t"],
]


@pytest.mark.parametrize("separator", [",", ";", "\t"])
@pytest.mark.parametrize("extension", ["csv", "tsv", "csv.gz", "csv.bz2", "csv.zst", "tsv.bz2"])
def test_separators_and_compressions_give_the_same_rows(tmp_path: Path, separator: str, extension: str) -> None:
    """Commas, tabs and semicolons are detected, in plain files and in files compressed by other libraries."""
    text = io.StringIO()
    csv.writer(text, delimiter=separator, lineterminator="\n").writerows([[*HEADER.split(","), "note"], *ROWS])
    content = text.getvalue().encode()
    packed = {"gz": gzip.compress, "bz2": bz2.compress, "zst": lambda data: pa.compress(data, "zstd", asbytes=True)}
    _, _, compression = extension.partition(".")
    path = tmp_path / f"in.{extension}"
    path.write_bytes(packed[compression](content) if compression else content)
    rows = whole(read([path])).table
    assert rows.column("sensor").to_pylist() == [row[1] for row in ROWS]
    assert rows.column("sensor_y_m").to_pylist() == [float(row[3]) for row in ROWS]
    assert rows.column("note").to_pylist() == [row[6] for row in ROWS]


def test_a_tab_separates_the_cells_of_a_tsv_file_whatever_its_header_contains(tmp_path: Path) -> None:
    """In a file ``.tsv`` a tab separates, although commas are more frequent in the header."""
    path = tmp_path / "in.tsv"
    path.write_text(HEADER.replace(",", "\t") + "\ta,b,c,d,e,f,g,h\n1\ts\t0\t1\t0.5\t0.01\tx\n")
    assert whole(read([path])).table.column("a,b,c,d,e,f,g,h").to_pylist() == ["x"]


def test_a_decimal_comma_is_reported_as_such(tmp_path: Path) -> None:
    """A number with a decimal comma is not read, and the message says that a point is expected."""
    path = tmp_path / "in.csv"
    path.write_text(HEADER.replace(",", ";") + "\n1;s;0,5;1;0.5;0.01\n")
    with pytest.raises(DataError, match="got '0,5', expected a number with a decimal point"):
        read([path])
