"""Ids and names: the types and texts in which other programs write them."""

from __future__ import annotations

import datetime
import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from reading_support import Gathered, bearings, read, save, whole

from nlosctl.errors import DataError
from tests.support.program import run_here

_HEADER = "snapshot,sensor,sensor_x_m,sensor_y_m,bearing_rad,bearing_std_rad"


def _csv(path: Path, ids: list[str], sensors: list[str]) -> Path:
    rows = [f"{a},{b},{at},0,0.{at + 1},0.01" for at, (a, b) in enumerate(zip(ids, sensors, strict=True))]
    path.write_text("\n".join([_HEADER, *rows, ""]))
    return path


def test_blanks_around_ids_and_names_do_not_count(tmp_path: Path) -> None:
    """Blanks around ids and names in CSV are no part of them, as around numbers; those within are."""
    rows = whole(read([_csv(tmp_path / "a.csv", ["1", " 1", "1 ", "\t1"], ["a", " b", "c c ", '" d "'])]))
    assert rows.ids == [1]
    assert rows.table.column("sensor").to_pylist() == ["a", "b", "c c", "d"]


def test_a_name_with_blanks_is_the_same_sensor(tmp_path: Path) -> None:
    """A sensor with and without blanks at one position is a duplicate measurement."""
    path = tmp_path / "a.csv"
    path.write_text(f"{_HEADER}\n1,a,0,0,0.1,0.01\n1, a ,0,0,0.2,0.01\n")
    with pytest.raises(DataError, match="duplicate measurement"):
        read([path])


def test_whole_numbers_with_a_zero_fraction_are_integers(tmp_path: Path) -> None:
    """`1.0` and `1` in a column of whole numbers are the same id, in CSV and in JSON Lines."""
    rows = whole(read([_csv(tmp_path / "a.csv", ["1", "1.0", "2.", "2.00"], ["7.0", "8", "7", "8.0"])]))
    assert (rows.ids, rows.counts) == ([1, 2], [2, 2])
    assert rows.table.column("sensor").to_pylist() == [7, 8, 7, 8]
    lines = [
        dict(zip(_HEADER.split(","), [i, s, float(s), 0.5, 0.1, 0.01], strict=True)) for i, s in ((1.0, 7), (1, 8))
    ]
    (tmp_path / "a.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    assert whole(read([tmp_path / "a.jsonl"])).ids == [1]


def test_other_numbers_stay_text(tmp_path: Path) -> None:
    """Ids with a fraction, such as versions, are text with all their digits."""
    assert whole(read([_csv(tmp_path / "a.csv", ["1.0", "1.1", "1.10"], ["a", "b", "c"])])).ids == [
        "1.0",
        "1.1",
        "1.10",
    ]


_TIMES = [datetime.datetime(2024, 7, 1, 12, 0, second, tzinfo=datetime.UTC) for second in (0, 0, 1)]


@pytest.mark.parametrize(
    ("ids", "expected"),
    [
        (pa.array(_TIMES, pa.timestamp("us")), ["2024-07-01 12:00:00.000000", "2024-07-01 12:00:01.000000"]),
        (pa.array(_TIMES, pa.timestamp("ms", "UTC")), ["2024-07-01 12:00:00.000Z", "2024-07-01 12:00:01.000Z"]),
        (pa.array([time.date() for time in _TIMES]), ["2024-07-01"]),
        (pa.array([1.0, 1.0, 2.0]), [1, 2]),
        (pa.array(np.array([1.0, 1.0, 2.0], np.float16)), [1, 2]),
        (pa.array([2**64 - 2, 2**64 - 2, 2**64 - 1], pa.uint64()), [2**64 - 2, 2**64 - 1]),
        (pa.array([5, 5, 2**63], pa.uint64()), [5, 2**63]),
    ],
    ids=str,
)
@pytest.mark.parametrize("suffix", ["parquet", "arrow"])
def test_ids_of_every_type(tmp_path: Path, ids: pa.Array, expected: list[Any], suffix: str) -> None:
    """Times, whole floats and unsigned integers beyond 2^63 are ids and names, in every command and format."""
    table = bearings([0, 0, 0]).drop_columns(["snapshot", "sensor"])
    table = table.append_column("snapshot", ids).append_column("sensor", ids)
    path = tmp_path / f"in.{suffix}"
    if suffix == "parquet":
        save(table, path, row_group_size=1)
    else:
        with pa.ipc.new_file(str(path), table.schema) as writer:
            writer.write_table(table)
    rows = whole(read([path]))
    assert [str(name) for name in rows.ids] == [str(name) for name in expected]
    (tmp_path / "parts").mkdir()
    for number in range(3):
        save(table.slice(number, 1), tmp_path / "parts" / f"{number}.parquet")
    commands = [
        ("localize", "-m", "ls", "-q", str(path), "-o", "e.csv", "--flags-out", "f.parquet"),
        ("localize", "-m", "ls", "-q", "parts", "-o", "parts.csv", "--jobs", "1"),
        ("localize", "-m", "suppress", "-q", "f.parquet", "-o", "again.csv"),
        ("convert", "-q", str(path), "-o", "c.csv"),
        ("localize", "-m", "ls", "-q", "c.csv", "-o", "e_of_c.csv"),
    ]
    for command in commands:
        assert (done := run_here(*command, folder=tmp_path)).returncode == 0, (command, done.stderr)
    assert (tmp_path / "e_of_c.csv").read_bytes() == (tmp_path / "e.csv").read_bytes()
    assert (tmp_path / "parts.csv").read_bytes() == (tmp_path / "e.csv").read_bytes()
    lines = (tmp_path / "e.csv").read_text().splitlines()[1:]
    assert [line.split(",")[0] for line in lines] == [str(name) for name in expected]


def test_a_column_of_pandas_with_gaps(tmp_path: Path) -> None:
    """Whole numbers that pandas made floats for a gap are paths and ids; the gap is a null, a fraction a bad row."""
    frame = pd.DataFrame(bearings([1.0, 1.0, 1.0, 2.5]).to_pandas()).assign(path=[1.0, np.nan, 2.0, 1.0])
    frame.to_parquet(tmp_path / "in.parquet")
    bad = Gathered()
    rows = whole(read([tmp_path / "in.parquet"], bad))
    assert rows.columns["path"].tolist() == [1, -1, 2]
    assert "row 4, column 'snapshot': got 2.5, expected text or a whole number" in str(bad[0].problem)
    assert bad[0].values["snapshot"] == "2.5"


def test_a_negative_path_is_a_bad_row(tmp_path: Path) -> None:
    """-1 is not taken for a path without number."""
    path = save(bearings([1, 1], path=[-1, 0]), tmp_path / "in.parquet")
    with pytest.raises(DataError, match="column 'path': got -1, expected an integer from 0"):
        read([path])


def test_arrow_streams_one_after_the_other(tmp_path: Path) -> None:
    """All of several concatenated streams are read, from files and from standard input; other columns are an error."""
    one, two = bearings([1, 1]), bearings([2, 2])
    content = b""
    for table in (one, two):
        sink = pa.BufferOutputStream()
        with pa.ipc.new_stream(sink, table.schema) as writer:
            writer.write_table(table)
        content += sink.getvalue().to_pybytes()
    (tmp_path / "in.arrows").write_bytes(content)
    assert whole(read([tmp_path / "in.arrows"])).ids == [1, 2]
    done = run_here("localize", "-m", "ls", "-", "-q", stdin=content)
    assert [line[:2] for line in done.stdout.decode().splitlines()[1:]] == ["1,", "2,"]
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, two.rename_columns([*two.column_names[:-1], "x"]).schema) as writer:
        pass
    (tmp_path / "in.arrows").write_bytes(content + sink.getvalue().to_pybytes())
    with pytest.raises(DataError, match="Arrow streams one after the other, whose columns differ"):
        read([tmp_path / "in.arrows"])


def test_columns_named_like_flags_are_kept_beside_them(tmp_path: Path) -> None:
    """Columns `target`, `reason`, `source` and `method` of the input are in flags as `input_...`, and in theirs."""
    own = {"target": [5, 6], "source": ["s", "t"], "reason": ["why", None], "method": ["x", "y"]}
    save(bearings([1, 1], **own), tmp_path / "in.parquet")
    for source, target in (("in.parquet", "f.parquet"), ("f.parquet", "g.parquet")):
        done = run_here(
            "localize", "-m", "ls", "-q", source, "--flags-out", target, "-o", "e.csv", "--overwrite", folder=tmp_path
        )
        assert done.returncode == 0, done.stderr
        flags = pa.parquet.read_table(tmp_path / target)
        assert {name: flags.column(f"input_{name}").to_pylist() for name in own} == own
        assert not {*own} & {*flags.column_names}


def test_the_number_of_a_radars_sweep_is_no_sweep(tmp_path: Path) -> None:
    """A column `sweep_id` does not divide an evaluation into groups, and may differ within a snapshot of flags."""
    truth = {"truth_x_m": [1.0, 1.0], "truth_y_m": [2.0, 2.0]}
    save(bearings([1, 1], sweep_id=[7, 8], sensor_y_m=[0.0, 9.0], **truth), tmp_path / "in.parquet")
    done = run_here(
        "localize", "-m", "ls", "-q", "in.parquet", "--flags-out", "f.parquet", "-o", "e.parquet", folder=tmp_path
    )
    assert done.returncode == 0
    assert run_here("localize", "-m", "ls", "-q", "f.parquet", "-o", "again.csv", folder=tmp_path).returncode == 0
    groups = json.loads(run_here("evaluate", "e.parquet", "--json", folder=tmp_path).stdout)["groups"]
    assert [group.get("sweep_id") for group in groups] == [None]


def test_linked_folders_are_read_and_loops_are_reported_once(tmp_path: Path) -> None:
    """A linked subfolder of an input is read; a link to a folder above is a remark, not an endless search."""
    (tmp_path / "in" / "day1").mkdir(parents=True)
    (tmp_path / "other").mkdir()
    save(bearings([1, 1]), tmp_path / "in" / "day1" / "a.parquet")
    save(bearings([2, 2]), tmp_path / "other" / "b.parquet")
    (tmp_path / "in" / "day2").symlink_to(tmp_path / "other")
    (tmp_path / "other" / "up").symlink_to(tmp_path / "in")
    report = json.loads(run_here("validate", "in", "--json", folder=tmp_path).stdout)
    assert report["snapshots"] == 2
    assert [remark for remark in report["remarks"] if "links" in remark] == [
        "in/day2/up: links to a folder that it is in"
    ]


def test_files_with_other_endings_in_a_folder_are_counted(tmp_path: Path) -> None:
    """Files that are left out of a folder are counted by ending; scenes and hidden files are not."""
    (tmp_path / "in").mkdir()
    save(bearings([1, 1]), tmp_path / "in" / "a.parquet")
    for name in ("b.csv.xz", "c.txt", "d.txt", "README", "scene.toml", "a.scene.toml", ".hidden", "_log"):
        (tmp_path / "in" / name).write_text("")
    report = json.loads(run_here("validate", "in", "--json", folder=tmp_path).stdout)
    assert "in: files with other endings are left out: 2 .txt, 1 .xz, 1 no ending" in report["remarks"]
    done = run_here("convert", "in", "-o", "c.csv", folder=tmp_path)
    assert b"note: in: files with other endings are left out" in done.stderr


def test_longitudes_up_to_360_degrees(tmp_path: Path) -> None:
    """Longitudes from 180 to 360 degrees are those from -180 to 0."""
    estimates = []
    for shift in (0.0, 360.0):
        table = pa.table(
            {
                "snapshot": [1, 1],
                "sensor": ["a", "b"],
                "sensor_lat_deg": [10.0, 10.0],
                "sensor_lon_deg": [-100.0 + shift, -99.875 + shift],
                "azimuth_deg": [45.0, 315.0],
                "bearing_std_deg": [1.0, 1.0],
            }
        )
        save(table, tmp_path / "in.parquet")
        done = run_here("localize", "-m", "ls", "-q", "in.parquet", "-o", "-", folder=tmp_path)
        assert done.returncode == 0, done.stderr
        estimates.append(done.stdout)
    assert estimates[0] == estimates[1]


_FLAGS = ("localize", "-m", "ls", "-q", "--flags-out", "f.parquet", "-o", "e.parquet")

_BAD_TEXT = {
    "latin.csv": ("note", "byte 0xe9 is not UTF-8"),
    "latin.jsonl": (None, "byte 0xe9 is not UTF-8"),
    "latin.parquet": ("note", "Invalid UTF8 sequence at string index 1"),
    "latin.arrow": ("note", "Invalid UTF8 sequence at string index 1"),
    "encoded.parquet": ("note", "Invalid UTF8"),
    "long.csv": (None, "longer than"),
    "long.jsonl": (None, "longer than"),
}


@pytest.mark.parametrize("name", _BAD_TEXT)
def test_validate_refuses_what_other_commands_refuse(tmp_path: Path, name: str) -> None:
    """Text that is not UTF-8 or too long in a column that is only carried is a fault in `validate` too."""
    (column, message), path = _BAD_TEXT[name], tmp_path / name
    note = "x" * (5 << 20) if name.startswith("long") else "caf\u00e9"
    names = [*_HEADER.split(","), "note"]
    rows = [["1", "a", "0", "0", "0.1", "0.01", "fine"], ["1", "b", "0", "9", "0.2", "0.01", note]]
    if name.endswith("csv"):
        path.write_bytes("\n".join([",".join(names), *map(",".join, rows), ""]).encode("latin-1"))
    elif name.endswith("jsonl"):
        values = [[*row[:2], *map(float, row[2:6]), row[6]] for row in rows]
        lines = [json.dumps(dict(zip(names, row, strict=True)), ensure_ascii=False) for row in values]
        path.write_bytes("\n".join([*lines, ""]).encode("latin-1"))
    else:
        cells = pa.Array.from_buffers(pa.string(), 2, pa.array([b"fine", b"caf\xe9"]).buffers())
        if name.startswith("encoded"):
            cells = pa.DictionaryArray.from_arrays(pa.array([0, 1]), cells)
        table = bearings([1, 1]).append_column("note", cells)
        if name.endswith("parquet"):
            save(table, path)
        else:
            with pa.ipc.new_file(str(path), table.schema) as writer:
                writer.write_table(table)
    for command in (("validate", name), (*_FLAGS, name), ("convert", "-q", name, "-o", "c.parquet")):
        done = run_here(*command, folder=tmp_path)
        assert done.returncode == 1, command
        assert message in done.stderr.decode()
        assert column is None or f"column {column!r}" in done.stderr.decode()


@pytest.mark.parametrize("name", ["nul.csv", "nul.jsonl", "nul.parquet"])
def test_a_zero_byte_within_text_is_read_by_all_commands(tmp_path: Path, name: str) -> None:
    """Text with a zero character passes through every command, or none."""
    table = bearings([1, 1], sensor_y_m=[0.0, 9.0]).append_column("note", pa.array(["fine", "a\0b"]))
    save(table, tmp_path / "in.parquet")
    assert run_here("convert", "-q", "in.parquet", "-o", name, folder=tmp_path).returncode == 0
    commands = (("validate", name), (*_FLAGS, name), ("convert", "-q", name, "-o", "c.parquet"))
    codes = {run_here(*command, folder=tmp_path).returncode for command in commands}
    assert len(codes) == 1
