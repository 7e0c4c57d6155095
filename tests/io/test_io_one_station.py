"""Files without a column ``sensor``: one station, which may move, with its repeated readings numbered."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
from reading_support import read, whole

from nlosctl.errors import DataError
from tests.support.program import run_here

_HEADER = "snapshot,sensor_x_m,sensor_y_m,bearing_deg,bearing_std_deg"
_ROWS = ("1,0,0,45,1", "1,0,0,45.5,1", "1,100,0,135,1", "1,0,0,45,1", "1,100,0,134,1", "2,100,0,134,1", "2,0,0,44,1")
_NAMES = ["station", "station#2", "station", "station#3", "station#2", "station", "station"]


def _file(path: Path, header: str = _HEADER, rows: tuple[str, ...] = _ROWS) -> Path:
    path.write_text("\n".join([header, *rows, ""]))
    return path


@pytest.mark.parametrize("chunk_rows", [1, 2, 3, 1000])
def test_repeats_at_one_position_are_numbered_whatever_the_chunks(tmp_path: Path, chunk_rows: int) -> None:
    """The n-th reading at a position in a snapshot is `station#n`; positions and snapshots count for themselves."""
    rows = whole(read([_file(tmp_path / "a.csv")], chunk_rows=chunk_rows))
    assert rows.table.column("sensor").to_pylist() == _NAMES
    assert rows.counts == [5, 2]
    codes = rows.columns["sensor"]
    assert len(set(codes.tolist())) == len(set(_NAMES))
    assert [codes.tolist().index(code) for code in codes] == [_NAMES.index(name) for name in _NAMES]


def test_parquet_and_latitudes(tmp_path: Path) -> None:
    """The same in Parquet, by latitude and longitude, and with a renamed bearing."""
    table = {"snapshot": [1, 1, 1], "sensor_lat_deg": [47.3, 47.3, 47.4], "sensor_lon_deg": [8.5, 8.5, 8.5]}
    table |= {"Az": [10.0, 11.0, 90.0], "bearing_std_deg": [1.0, 1.0, 1.0]}
    pyarrow.parquet.write_table(pa.table(table), tmp_path / "a.parquet")
    rows = whole(read([tmp_path / "a.parquet"], columns={"azimuth_deg": "Az"}))
    assert rows.table.column("sensor").to_pylist() == ["station", "station#2", "station"]


def test_the_fix_is_that_of_the_file_with_names(tmp_path: Path) -> None:
    """The fixes are those of the file with the names written out; the flags name the readings."""
    _file(tmp_path / "a.csv")
    named = tuple(f"{row},{name}" for row, name in zip(_ROWS, _NAMES, strict=True))
    _file(tmp_path / "b.csv", f"{_HEADER},sensor", named)
    for method in ("ml", "mixture-ml"):
        done = [
            run_here("localize", name, "-m", method, "--flags-out", f"flags_{name}", "-o", "-", folder=tmp_path)
            for name in ("a.csv", "b.csv")
        ]
        assert done[0].stdout == done[1].stdout
        assert b"all rows are of one station; repeated readings are numbered" in done[0].stderr
        flags = list(csv.DictReader(io.StringIO((tmp_path / "flags_a.csv").read_text())))
        assert [row["sensor"] for row in flags] == _NAMES
        for name in ("a.csv", "b.csv"):
            (tmp_path / f"flags_{name}").unlink()


def test_paths_of_one_reading_compete(tmp_path: Path) -> None:
    """Rows with path numbers are paths of one reading, not repeated readings."""
    path = _file(tmp_path / "a.csv", f"{_HEADER},path", ("1,0,0,45,1,0", "1,0,0,50,1,1", "1,100,0,135,1,0"))
    assert whole(read([path])).table.column("sensor").to_pylist() == ["station"] * 3


def test_ranges_are_repeated_measurements(tmp_path: Path) -> None:
    """Ranges may repeat at a position in any case: they keep the one name."""
    path = _file(
        tmp_path / "a.csv",
        "snapshot,sensor_x_m,sensor_y_m,range_m,range_std_m",
        ("1,0,0,50,1", "1,0,0,51,1", "1,100,0,70,1", "1,0,90,80,1"),
    )
    rows = whole(read([path]))
    assert rows.table.column("sensor").to_pylist() == ["station"] * 4
    done = run_here("localize", str(path), "-o", "-")
    assert done.returncode == 0
    assert b"all rows are of one station\n" in done.stderr


def test_the_only_sensor_of_the_scene(tmp_path: Path) -> None:
    """Without positions the rows are of the scene's only sensor; with two there it must be named."""
    only = '[[sensor]]\nname = "r1"\nposition = [5.0, 7.0]\n'
    path = _file(tmp_path / "a.csv", "bearing_deg,bearing_std_deg", ("45,1", "44,1"))
    (tmp_path / "scene.toml").write_text(only)
    rows = whole(read([path]))
    assert rows.table.column("sensor").to_pylist() == ["r1", "r1#2"]
    assert np.array_equal(rows.columns["sensor_x_m"], [5.0, 5.0])
    (tmp_path / "scene.toml").write_text(only + only.replace("r1", "r2"))
    with pytest.raises(DataError, match="missing column 'sensor'"):
        read([path])


@pytest.mark.parametrize("name", ["Station", "anchor_id", "Sensors", "receiver"])
def test_a_column_named_like_it_is_proposed(tmp_path: Path, name: str) -> None:
    """A file that seems to name its sensors under another header is not taken as one station."""
    path = _file(tmp_path / "a.csv", f"{_HEADER},{name}", tuple(f"{row},x" for row in _ROWS))
    with pytest.raises(DataError, match=f"missing column 'sensor' \\(did you mean '{name}'\\?\\)"):
        read([path])


def test_files_with_and_without(tmp_path: Path) -> None:
    """Parts of a folder all have the column, or none has it."""
    (tmp_path / "in").mkdir()
    _file(tmp_path / "in" / "1.csv")
    _file(tmp_path / "in" / "2.csv", f"{_HEADER},sensor", tuple(f"3{row},a" for row in _ROWS[5:]))
    with pytest.raises(DataError, match="some of the files have a 'sensor' column and some don't"):
        read([tmp_path / "in"])
