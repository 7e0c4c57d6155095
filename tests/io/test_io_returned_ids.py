"""Snapshots whose rows are not together: the advice works when it is followed, and never merges different snapshots."""

from __future__ import annotations

from pathlib import Path

import pytest
from doc_pages import run_shell
from reading_support import read, whole

from nlosctl.errors import DataError
from nlosctl.io.measurements.reader import MeasurementReader
from nlosctl.io.paths.inputs import expand_inputs

HEADER = "{id},sensor,sensor_x_m,sensor_y_m,bearing_deg,bearing_std_deg"
FIRST = ["{n},a,0,0,45,3", "{n},b,100,0,135,3"]
SECOND = ["{n},a,0,10,30,3", "{n},b,100,10,150,3"]


def write(path: Path, *lines: str, column: str = "snapshot") -> Path:
    """Write lines of bearings under a header whose id column is ``column``."""
    quoted = f'"{column}"' if " " in column or '"' in column else column
    path.write_text("\n".join([HEADER.format(id=quoted), *lines]) + "\n")
    return path


def numbered(rows: list[str], number: int) -> list[str]:
    """Rows with this snapshot id."""
    return [row.format(n=number) for row in rows]


@pytest.mark.process
@pytest.mark.parametrize("column", ["snapshot", "Group", "Order", "Animal ID", "a$b", "select"])
def test_the_command_sorts_the_file(tmp_path: Path, column: str) -> None:
    """The DuckDB command of the message, pasted into a shell, makes a file that is read; any column name works."""
    if run_shell("command -v duckdb", tmp_path).returncode:
        pytest.skip("no duckdb: pip install duckdb-cli")
    mixed = [row.format(n=number) for row in FIRST for number in (0, 1)]
    path = write(tmp_path / "it is.csv", *mixed, column=column)
    with pytest.raises(DataError, match="comes back") as caught:
        read([path], columns={"snapshot": column})
    command = str(caught.value).partition("sort the file: ")[2]
    assert run_shell(command, tmp_path).returncode == 0
    rows = whole(read([tmp_path / "sorted.parquet"], columns={"snapshot": column}))
    assert (rows.ids, rows.counts) == ([0, 1], [2, 2])


def test_ids_of_another_part_are_not_sorted_together(tmp_path: Path) -> None:
    """Parts that each count from 0: the cure names the files one by one, and keeps their snapshots apart."""
    for name, rows in (("d1.csv", FIRST), ("d2.csv", SECOND)):
        write(tmp_path / name, *numbered(rows, 0), *numbered(rows, 1))
    with pytest.raises(DataError, match="not unique across the parts: name the files one by one") as caught:
        read([tmp_path])
    assert "sort" not in str(caught.value)
    pattern = str(caught.value).partition("one by one (")[2].partition(" names them all")[0].strip("'")
    reader = MeasurementReader(expand_inputs([pattern]))
    assert [len(chunk.snapshot) for chunk in reader.chunks()] == [2, 2]


def test_fixed_sensors_of_another_part_are_not_duplicates_to_drop(tmp_path: Path) -> None:
    """The same sensors in a snapshot of two parts: the message names the other file and how to keep the parts apart."""
    for name in ("d1.csv", "d2.csv"):
        write(tmp_path / name, *numbered(FIRST, 0))
    with pytest.raises(DataError, match=r"d1\.csv, row 1; .*name the files one by one"):
        read([tmp_path])


@pytest.mark.parametrize(
    ("second", "noted"), [(SECOND, True), (["{n},c,0,10,30,3"], False), (["{n},a,0,10,30,3", "{n},a,0,20,30,3"], False)]
)
def test_a_snapshot_that_may_be_two_is_noted(tmp_path: Path, second: list[str], noted: bool) -> None:
    """Rows that continue in the next part are noted if each part has the same sensors once; not for a moving sensor."""
    write(tmp_path / "d1.csv", *numbered(FIRST, 0))
    write(tmp_path / "d2.csv", *numbered(second, 0))
    reader = MeasurementReader(expand_inputs([str(tmp_path)]))
    assert [len(chunk.snapshot) for chunk in reader.chunks()] == [1]
    assert [text.startswith("0 in ") for text in reader.report.rejoined] == [True] * noted


def test_path_numbers_per_receiver_are_no_duplicates(tmp_path: Path) -> None:
    """Paths are numbered from 1 for each receiver and transmitter; the same path twice is a duplicate."""
    header = "snapshot,path,tx_x_m,tx_y_m,rx_x_m,rx_y_m,toa_ns,dod_deg,doa_deg,dod_std_deg,doa_std_deg,toa_std_ns"
    rows = ["1,1,0.5,0.5,9.5,1.0,40.4,20.6,107.3,1,1,1", "1,1,0.5,0.5,9.0,7.0,52.1,25.0,200.0,1,1,1"]
    rows.append("1,1,0.5,7.0,9.0,7.0,52.1,25.0,200.0,1,1,1")
    (tmp_path / "t.csv").write_text("\n".join([header, *rows]) + "\n")
    assert whole(read([tmp_path / "t.csv"])).counts == [3]
    (tmp_path / "t.csv").write_text("\n".join([header, *rows, rows[1]]) + "\n")
    with pytest.raises(DataError, match=r"row 4 .*duplicate measurement: .* as row 2; drop one"):
        read([tmp_path / "t.csv"])
