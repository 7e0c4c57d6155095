"""The format of a file or stream by its first bytes; columns of any type written as text."""

from __future__ import annotations

import gzip
import io
import json
import os
import threading
from pathlib import Path

import pytest
from reading_support import FIXTURES, bearings, pa, read, scene_of, whole

from nlosctl.contract.run_options import InputOptions
from nlosctl.errors import DataError
from nlosctl.io.measurements.reader import MeasurementReader
from nlosctl.io.paths.inputs import expand_inputs
from nlosctl.io.paths.locations import FileFormat
from nlosctl.io.writers.table_writer import TableWriter

SCENE = scene_of(FIXTURES / "good_bearings.csv")
JSON_LINES = (FIXTURES / "good_bearings.jsonl").read_bytes()


class Trickle(io.RawIOBase):
    """A stream that gives a few bytes at a time, as a slow pipe does."""

    def __init__(self, data: bytes) -> None:
        self._data = io.BytesIO(data)

    def readable(self) -> bool:
        """Return true."""
        return True

    def readinto(self, buffer: memoryview) -> int:
        """Read at most five bytes."""
        got = self._data.read(min(5, len(buffer)))
        buffer[: len(got)] = got
        return len(got)


@pytest.mark.parametrize("data", [JSON_LINES, gzip.compress(JSON_LINES), b"\xef\xbb\xbf" + JSON_LINES])
@pytest.mark.parametrize("slow", [True, False])
def test_json_lines_from_stdin_are_recognized(data: bytes, slow: bool) -> None:
    """Formats are detected if gzipped, after a byte order mark, and at any speed of the stream."""
    stdin = io.BufferedReader(Trickle(data)) if slow else io.BytesIO(data)
    reader = MeasurementReader(expand_inputs(["-"], stdin=stdin), InputOptions(scene=SCENE))
    assert sum(len(chunk.snapshot) for chunk in reader.chunks()) == 40


def test_a_json_array_from_stdin_is_told() -> None:
    """An array is JSON, not CSV, and the error says how to convert it."""
    inputs = expand_inputs(["-"], stdin=io.BytesIO(b"[" + JSON_LINES.replace(b"\n", b",\n") + b"]"))
    with pytest.raises(DataError, match="JSON array"):
        MeasurementReader(inputs)


def test_an_arrow_stream_is_read_where_arrow_is_said() -> None:
    """--input-format arrow reads from a pipe what --format arrow writes to it."""
    data = (FIXTURES / "good_bearings.arrows").read_bytes()
    inputs = expand_inputs(["-"], FileFormat.ARROW, io.BytesIO(data))
    assert sum(len(chunk.snapshot) for chunk in MeasurementReader(inputs, InputOptions(scene=SCENE)).chunks()) == 40


@pytest.mark.parametrize("name", ["a.parquet", "a.csv", "a.csv.gz", "a.arrow", "a.jsonl", "a.jsonl.gz"])
@pytest.mark.parametrize("held", ["parquet", "csv", "csv.gz", "arrow", "arrows", "jsonl"])
def test_bytes_of_another_format_are_told(tmp_path: Path, name: str, held: str) -> None:
    """A wrong extension is reported with the actual format; both Arrow formats are accepted."""
    path = tmp_path / name
    path.write_bytes((FIXTURES / f"good_bearings.{held}").read_bytes())
    named = name.removeprefix("a.")
    if named == held or {named, held} == {"arrow", "arrows"}:
        assert len(whole(read([path], scene=SCENE)).ids) == 40
        return
    with pytest.raises(DataError, match=f"`input_format` {held}") as caught:
        read([path], scene=SCENE)
    assert "\n" not in str(caught.value)


def test_a_named_pipe_is_read_once(tmp_path: Path) -> None:
    """<(...) of a shell is read like stdin."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    writing = threading.Thread(target=pipe.write_bytes, args=((FIXTURES / "good_bearings.parquet").read_bytes(),))
    writing.start()
    chunks = read([pipe], scene=SCENE)
    writing.join()
    assert sum(len(chunk.snapshot) for chunk in chunks) == 40


def test_every_type_can_be_written_as_text(tmp_path: Path) -> None:
    """Lists, structs, bytes, views and intervals become text in CSV and JSON Lines."""
    table = pa.table(
        {
            "list": pa.array([[1, 2], None]),
            "struct": pa.array([{"a": "ü", "b": b"\xff"}, None]),
            "bytes": pa.array([b"\xffa", None]),
            "view": pa.array(["x,y", None], pa.string_view()),
            "byte_view": pa.array([b"z", None], pa.binary_view()),
            "map": pa.array([[("k", 1)], None], pa.map_(pa.string(), pa.int64())),
            "interval": pa.array([(1, 2, 3), None], pa.month_day_nano_interval()),
            "number": [1.5, None],
        }
    )
    for name in ("a.csv", "a.jsonl"):
        with TableWriter(str(tmp_path / name), table.schema) as writer:
            writer.write(table)
    header, first, second = (tmp_path / "a.csv").read_text().splitlines()
    assert header == "list,struct,bytes,view,byte_view,map,interval,number"
    assert first.startswith('"[1, 2]","{""a"": ""ü"", ""b"": ""\\\\xff""}",')
    assert first.endswith(",1.5")
    assert second == ",,,,,,,"
    row = json.loads((tmp_path / "a.jsonl").read_text().splitlines()[0])
    assert (row["list"], row["bytes"], row["byte_view"]) == ([1, 2], "\\xffa", "z")


def test_an_empty_pipe_is_told() -> None:
    """An empty stdin has no rows."""
    with pytest.raises(DataError, match="0 bytes"):
        MeasurementReader(expand_inputs(["-"], stdin=io.BytesIO(b"")))


@pytest.mark.parametrize("name", ["a.csv", "a.csv.gz", "a.jsonl", "a.jsonl.gz", "a.parquet", "a.arrow", "a.arrows"])
@pytest.mark.parametrize(
    "data", [b"\n\n", b'\0\x99"\n' * 5000, b"[]\n", b"{}\n", b"\xff\xfea\0", b"\r", b'"', b"\xff" * 64]
)
def test_what_is_no_table_is_one_line(tmp_path: Path, name: str, data: bytes) -> None:
    """Blank, binary and random files give an error of one line that names the file, in every format."""
    path = tmp_path / name
    for content in (data, gzip.compress(data)):
        path.write_bytes(content)
        with pytest.raises(DataError) as caught:
            read([path])
        assert str(path) in str(caught.value)
        assert "\n" not in str(caught.value)


def test_a_table_in_memory_is_left_unread(tmp_path: Path) -> None:
    """Detecting the format consumes no byte of a stream without ``peek``."""
    from nlosctl.io.results.in_memory import input_of_table

    chunks = list(MeasurementReader([input_of_table(bearings([1, 2]))]).chunks())
    assert sum(chunk.table.num_rows for chunk in chunks) == 2
