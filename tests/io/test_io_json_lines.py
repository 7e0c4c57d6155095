"""JSON Lines variants: what JSON allows and a table does not."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import pytest
from reading_support import Gathered, read, whole

from nlosctl.contract.run_options import InputOptions
from nlosctl.errors import DataError
from nlosctl.io.measurements.reader import MeasurementReader
from nlosctl.io.paths.inputs import expand_inputs
from tests.support.program import run_here


def row(place: int = 1, **more: Any) -> str:
    """Return a valid row as JSON, with values replaced or added."""
    standard = {"snapshot": 1, "sensor": f"s{place}", "sensor_x_m": 0, "sensor_y_m": 0.5, "bearing_rad": 1.0}
    return json.dumps({**standard, "bearing_std_rad": 0.1, **more})


def save_lines(path: Path, *lines: str) -> Path:
    """Write lines."""
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize(
    ("line", "column", "fault"),
    [
        (row()[:-1] + ', "sensor": "b"}', None, "duplicate name 'sensor'"),
        ("[" * 100_000, None, "nested too deeply"),
        (row(bearing_rad=10**400), "bearing_rad", "expected a number within 1e308"),
        (row(path=2**70), "path", "an integer within 64 bits"),
        (row(sensor="\ud800"), "sensor", "half a surrogate pair"),
        (row(**{"\udfff": 1}), None, "a name contains half of a surrogate pair"),
        (row(snapshot="1"), "snapshot", "got '1', expected an integer as before: text or an integer"),
        (row(snapshot=0.5), "snapshot", "got 0.5, expected text or an integer"),
        (row(snapshot=True), "snapshot", "got True, expected text or an integer"),
        (row(sensor=3), "sensor", "got 3, expected text as before"),
        (row(los="maybe"), "los", "expected true/false or 1/0"),
        (row(sensor_x_m={"a": 1}), "sensor_x_m", "expected a number"),
        (row(bearing_rad=0)[:-1] + ', "n": ' + "9" * 5000 + "}", None, "thousands of digits"),
    ],
)
def test_an_invalid_value_is_a_problem_of_its_row(tmp_path: Path, line: str, column: str, fault: str) -> None:
    """An invalid value is reported with row and column, and the other rows are read."""
    path = save_lines(tmp_path / "a.jsonl", row(1, los=True, path=1), line, row(2))
    aside = Gathered()
    assert whole(read([path], aside)).counts == [2]
    assert [(bad.problem.row, bad.problem.column) for bad in aside] == [(2, column)]
    assert fault in aside[0].problem.fault


def test_booleans_may_be_words(tmp_path: Path) -> None:
    """ "true" and "0" are booleans as in CSV."""
    path = save_lines(tmp_path / "a.jsonl", *(row(place, los=value) for place, value in enumerate(["True", "0", 1])))
    assert read([path])[0].left_out.tolist() == [False, True, False]


@pytest.mark.parametrize(
    ("values", "kept"),
    [
        ([1, 2**53 + 1, None], [1, 2**53 + 1, None]),
        ([1, 2.5, None], [1.0, 2.5, None]),
        ([2**60 + 1, 0.5, "x"], [str(2**60 + 1), "0.5", "x"]),
        ([2**60 + 1, 0.5, None], [str(2**60 + 1), "0.5", None]),
        ([2**70, None, 1], [str(2**70), None, "1"]),
        ([{"a": [1, "ü"]}, [], True], ['{"a": [1, "ü"]}', "[]", "true"]),
        ([True, None, False], [True, None, False]),
        ([1, -(2**63), None], [1, -(2**63), None]),
        ([1, 2**63, None], ["1", str(2**63), None]),
    ],
)
def test_own_columns_lose_nothing(tmp_path: Path, values: list[Any], kept: list[Any]) -> None:
    """An additional column never stops a run: values of several types are kept as JSON text."""
    path = save_lines(tmp_path / "a.jsonl", *(row(place, own=value) for place, value in enumerate(values)))
    assert whole(read([path])).table.column("own").to_pylist() == kept


def test_own_columns_are_told_by_the_whole_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A new name or type after the first block is read from a file, and is one line of error for a stream."""
    monkeypatch.setenv("NLOSCTL_JSON_BLOCK_LINES", "4")
    lines = [row(place, own=place) for place in range(20)] + [row(20, own="x"), row(21, late=1)]
    path = save_lines(tmp_path / "a.jsonl", *lines)
    found = whole(read([path])).table
    assert found.column("own").to_pylist()[-3:] == ["19", "x", None]
    assert found.column("late").to_pylist()[-2:] == [None, 1]
    for odd, fault in ((lines[20], "'own': got 'x'"), (lines[21], "'late': got 1 under a new name")):
        data = "\n".join([*lines[:20], odd]).encode()
        reader = MeasurementReader(expand_inputs(["-"], stdin=io.BytesIO(data)))
        with pytest.raises(DataError, match=f"line 21, column {fault}.*save it as a file"):
            list(reader.chunks())
    inputs = expand_inputs(["-"], stdin=io.BytesIO(path.read_bytes()))
    assert len(list(MeasurementReader(inputs, InputOptions(extra_columns=())).chunks())) > 0


def test_a_late_column_of_the_contract_in_a_stream_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """A flag that first occurs after the first block of a stream is not ignored."""
    monkeypatch.setenv("NLOSCTL_JSON_BLOCK_LINES", "2")
    data = "\n".join([*(row(place) for place in range(5)), row(5, los=False)]).encode()
    reader = MeasurementReader(expand_inputs(["-"], stdin=io.BytesIO(data)), InputOptions(extra_columns=()))
    with pytest.raises(DataError, match="row 6, column 'los': the name is not among those"):
        list(reader.chunks())


def test_a_wholly_wrong_column_is_one_line(tmp_path: Path) -> None:
    """Text in all rows of a column of numbers is a fault of the file."""
    path = save_lines(tmp_path / "a.jsonl", *(row(place, bearing_rad="0.5") for place in range(30)))
    with pytest.raises(DataError, match=r"'bearing_rad': wrong type: .* got '0.5', expected a number") as caught:
        read([path], Gathered())
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", [f"[{row()}, {row(2)}]", f"[\n{row()},\n{row(2)}\n]", f"[{row()},\n{row(2)}]"])
def test_a_json_array_is_told(tmp_path: Path, text: str) -> None:
    """An array of objects is reported with the way to convert it."""
    with pytest.raises(DataError, match=r"JSON array, expected JSON Lines.*jq"):
        read([save_lines(tmp_path / "a.jsonl", text)])


def test_text_that_is_no_json_is_told(tmp_path: Path) -> None:
    """CSV under the name of JSON Lines gets a hint."""
    with pytest.raises(DataError, match=r"line 1: not JSON.*`input_format` csv"):
        read([save_lines(tmp_path / "a.jsonl", "snapshot,sensor", "1,a")])


def test_integers_beyond_64_bits_are_names(tmp_path: Path) -> None:
    """Ids and names beyond 64 bits are kept, digit by digit, as text; so are those of a column that is carried."""
    ids = [2**70, 2**70, 2**63, -(2**80)]
    lines = [row(place, snapshot=number, sensor=10**30 + place, note=10**25) for place, number in enumerate(ids)]
    rows = whole(read([save_lines(tmp_path / "in.jsonl", *lines)]))
    assert (rows.ids, rows.counts) == ([str(2**70), str(2**63), str(-(2**80))], [2, 1, 1])
    assert rows.table.column("sensor").to_pylist() == [str(10**30 + place) for place in range(4)]
    assert rows.table.column("note").to_pylist() == [str(10**25)] * 4


@pytest.mark.parametrize("rows", [3, 20000])
@pytest.mark.parametrize("compression", ["bz2", "zst"])
@pytest.mark.parametrize("extension", ["jsonl", "csv"])
def test_compressed_lines_on_standard_input(tmp_path: Path, extension: str, compression: str, rows: int) -> None:
    """The content decides between JSON Lines and CSV, however much of it is in a block of the compression."""
    lines = [row(place, note=f"{place * 7919 % 10007}") for place in range(rows)]
    save_lines(tmp_path / "in.jsonl", *lines)
    name = f"in.{extension}.{compression}"
    assert run_here("convert", "in.jsonl", "-o", name, "-q", folder=tmp_path).returncode == 0
    done = run_here("convert", "-", "-o", "-", stdin=(tmp_path / name).read_bytes(), folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout == run_here("convert", "in.jsonl", "-o", "-", folder=tmp_path).stdout
    cut = run_here("validate", "-", stdin=(tmp_path / name).read_bytes()[:-20], folder=tmp_path)
    assert cut.returncode == 1
    assert b"cut short" in cut.stderr
