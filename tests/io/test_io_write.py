"""Writing tables: complete files or none, and the same bytes for any blocks."""

from __future__ import annotations

import csv
import gzip
import io
import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
from reading_support import FIXTURES, read

from nlosctl.errors import DataError
from nlosctl.io.paths.inputs import Part
from nlosctl.io.paths.locations import FileFormat
from nlosctl.io.readers.open_file import open_part
from nlosctl.io.writers.table_writer import BadRowWriter, TableWriter

TABLE = pa.table({
    "snapshot": np.arange(25),
    "x_m": pa.array([None if place % 5 == 0 else place / 3.0 for place in range(25)]),
    "status": pa.array(["ok", "too_few, really"] * 12 + [None]).dictionary_encode(),
    "used": [True] * 25,
})  # fmt: skip
EXTENSIONS = ["parquet", "csv", "csv.gz", "arrow", "arrows", "jsonl", "jsonl.gz"]


def write(path: Path, step: int = 25, **options: object) -> bytes:
    """Write TABLE in steps and return the bytes."""
    with TableWriter(str(path), TABLE.schema, group_rows=10, **options) as writer:
        for start in range(0, TABLE.num_rows, step):
            writer.write(TABLE.slice(start, step))
        writer.set_metadata({"nlosctl": "{}"})
    return path.read_bytes()


@pytest.mark.parametrize("extension", EXTENSIONS)
def test_bytes_do_not_depend_on_feeding(tmp_path: Path, extension: str) -> None:
    """Row groups depend on the table, not on the blocks written."""
    assert write(tmp_path / f"a.{extension}", 25) == write(tmp_path / f"b.{extension}", 3)


def test_parquet_reads_back_with_its_metadata(tmp_path: Path) -> None:
    """Row groups have the set size, text is plain, metadata are present."""
    write(tmp_path / "a.parquet")
    file = pa.parquet.ParquetFile(tmp_path / "a.parquet")
    assert [file.metadata.row_group(place).num_rows for place in range(3)] == [10, 10, 5]
    assert file.schema_arrow.field("status").type == pa.string()
    assert file.metadata.metadata[b"nlosctl"] == b"{}"
    assert (
        open_part(Part(name="a", format=FileFormat.PARQUET, path=tmp_path / "a.parquet"), 10, False).metadata[
            b"nlosctl"
        ]
        == b"{}"
    )
    assert file.read().column("x_m").to_pylist() == TABLE.column("x_m").to_pylist()


def test_text_formats_write_null_as_nothing(tmp_path: Path) -> None:
    """CSV: empty fields and shortest floats; JSON Lines: null; gzip: no time stamp."""
    lines = write(tmp_path / "a.csv").decode().splitlines()
    assert lines[:3] == ["snapshot,x_m,status,used", '0,,"ok",true', '1,0.3333333333333333,"too_few, really",true']
    assert gzip.decompress(write(tmp_path / "a.csv.gz")).decode().splitlines() == lines
    rows = [json.loads(line) for line in write(tmp_path / "a.jsonl").decode().splitlines()]
    assert rows == TABLE.to_pylist()


def fail_within(path: Path, error: type[BaseException]) -> None:
    """Begin to write, then raise."""
    with TableWriter(str(path), TABLE.schema, overwrite=True) as writer:
        writer.write(TABLE)
        raise error


def test_names_are_quoted_where_they_must_be(tmp_path: Path) -> None:
    """A CSV header quotes only names with a comma, a quote or a line end."""
    names = ["snapshot", "x, y", 'the "true" one', "two\nlines"]
    table = pa.table({name: [1] for name in names})
    with TableWriter(str(tmp_path / "a.csv"), table.schema, group_rows=10) as writer:
        writer.write(table)
    text = (tmp_path / "a.csv").read_bytes().decode()
    assert text == 'snapshot,"x, y","the ""true"" one","two\nlines"\n1,1,1,1\n'
    assert next(csv.reader(io.StringIO(text, newline=""))) == names


def test_a_failure_leaves_nothing(tmp_path: Path) -> None:
    """An exception or Ctrl-C within the block leaves no file and keeps an older one."""
    old = tmp_path / "a.csv"
    old.write_text("old")
    for stop in (KeyboardInterrupt, ValueError):
        with pytest.raises(stop):
            fail_within(old, stop)
    assert [path.name for path in tmp_path.iterdir()] == ["a.csv"]
    assert old.read_text() == "old"


def test_an_existing_file_is_kept_without_overwrite(tmp_path: Path) -> None:
    """Overwriting requires the option, and an input is never overwritten."""
    path = tmp_path / "a.csv"
    path.write_text("old")
    with pytest.raises(DataError, match="`overwrite`"):
        TableWriter(str(path), TABLE.schema)
    with pytest.raises(DataError, match="is the input"):
        TableWriter(str(path), TABLE.schema, overwrite=True, inputs=[path])
    assert write(path, overwrite=True).startswith(b"snapshot,")


def test_targets_that_cannot_be_written(tmp_path: Path) -> None:
    """A folder, or a file in a missing folder, is an error before any work is done."""
    with pytest.raises(DataError, match="is a folder"):
        TableWriter(str(tmp_path), TABLE.schema, format=FileFormat.CSV)
    with pytest.raises(DataError, match="no folder"):
        TableWriter(str(tmp_path / "no" / "a.csv"), TABLE.schema)


@pytest.mark.parametrize("name", ["parquet", "csv", "arrow", "jsonl"])
def test_stdout_carries_the_table(name: str) -> None:
    """On a pipe Arrow is a stream; stdout stays open."""
    pipe = io.BytesIO()
    with TableWriter("-", TABLE.schema, format=FileFormat(name), stdout=pipe, metadata={"k": "v"}) as writer:
        writer.write(TABLE)
    assert not pipe.closed
    if name == "arrow":
        found = pa.ipc.open_stream(pipe.getvalue()).read_all()
        assert found.schema.metadata == {b"k": b"v"}
        assert found.num_rows == 25


def test_a_closed_pipe_is_a_broken_pipe_error() -> None:
    """The caller can distinguish a closed pipe from a fault."""

    class Closed(io.RawIOBase):
        def writable(self) -> bool:
            return True

        def write(self, data: object) -> int:
            raise BrokenPipeError(32, "Broken pipe")

    for format in (FileFormat.CSV, FileFormat.ARROW, FileFormat.JSON_LINES, FileFormat.PARQUET):
        with pytest.raises(BrokenPipeError), TableWriter("-", TABLE.schema, format=format, stdout=Closed()) as writer:
            writer.write(TABLE)


def test_bad_rows_are_written_as_text(tmp_path: Path) -> None:
    """The bad-rows file has the row, the problem, and the original line."""
    target = tmp_path / "bad.csv"
    columns = ["snapshot", "sensor", "bearing_rad"]
    with TableWriter(str(target), BadRowWriter.schema(columns)) as writer:
        read([FIXTURES / "bad_wrong_type.csv"], BadRowWriter(writer))
    header, row = target.read_text().splitlines()
    assert header == "row,problem,line,snapshot,sensor,bearing_rad"
    assert row.startswith("5,")
    assert "north-east" in row
