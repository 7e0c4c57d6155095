"""Values of a wrong size or type: a bad row if few, a fault of the file if many."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from reading_support import Gathered, bearings, pa, read, save, whole

from nlosctl.contract.run_options import InputOptions
from nlosctl.errors import DataError
from nlosctl.io.measurements.reader import MeasurementReader
from nlosctl.io.paths.inputs import expand_inputs


def with_bearings(path: Path, values: Sequence[Any], kind: Any = None) -> Path:
    """Write bearings, one snapshot each."""
    column = pa.array(values, kind or pa.float64())
    return save(bearings(list(range(len(values))), bearing_rad=column), path)


@pytest.mark.parametrize("value", [math.inf, -math.inf, math.nan, 7.0, -100.0])
@pytest.mark.parametrize("aside", [True, False])
def test_a_lone_wild_bearing_is_a_row_problem(tmp_path: Path, value: float, aside: bool) -> None:
    """An infinite or too large bearing is reported with its row, or set aside."""
    path = with_bearings(tmp_path / "a.parquet", [0.1] * 10 + [value] + [0.2] * 9)
    expected = "expected a finite number" if not math.isfinite(value) else "expected -6.283 to 6.283 rad"
    if aside:
        sink = Gathered()
        assert len(whole(read([path], sink)).ids) == 19
        assert [row.problem.row for row in sink] == [11]
    else:
        with pytest.raises(DataError, match=f"row 11, column 'bearing_rad': got .*{expected}"):
            read([path])


def test_a_full_turn_is_no_fault(tmp_path: Path) -> None:
    """2 pi is accepted as float32 and with the rounding of a sum; a slightly larger value is not."""
    for kind in (pa.float32(), pa.float64()):
        path = with_bearings(tmp_path / "a.parquet", [2.0 * math.pi + 1e-12, -2.0 * math.pi - 1e-12], kind)
        assert len(whole(read([path])).ids) == 2
    with pytest.raises(DataError, match="row 2"):
        read([with_bearings(tmp_path / "a.parquet", [1.0, 6.2833])])


@pytest.mark.parametrize(
    ("beyond", "rows", "plainly"),
    [(1, 1, True), (1, 2, False), (4, 20, False), (5, 50, True), (5, 60, False), (12, 20, True)],
)
@pytest.mark.parametrize("aside", [True, False])
@pytest.mark.parametrize("chunk_rows", [1, 7, 100])
def test_many_wild_bearings_are_plainly_degrees(
    tmp_path: Path, beyond: int, rows: int, plainly: bool, aside: bool, chunk_rows: int
) -> None:
    """More than a tenth of the rows and five, or more than half, is a fault of the file, for any chunks."""
    path = with_bearings(
        tmp_path / "a.parquet", [1.0] * (rows - beyond) + [90.0] * (beyond - 1) + [math.nan, 90.0][-1:]
    )
    if plainly:
        with pytest.raises(DataError, match=f"{beyond} of {rows} values are beyond ±6.283 rad; they seem"):
            read([path], Gathered() if aside else None, chunk_rows=chunk_rows)
    elif aside:
        assert sum(chunk.table.num_rows for chunk in read([path], Gathered(), chunk_rows=chunk_rows)) == rows - beyond
    else:
        with pytest.raises(DataError, match=f"row {rows}, column"):
            read([path], chunk_rows=chunk_rows)


def test_no_chunk_follows_the_first_degrees(tmp_path: Path) -> None:
    """A file in degrees is refused before any estimates are written."""
    path = with_bearings(tmp_path / "a.parquet", [1.0, 90.0] * 50)
    chunks = MeasurementReader(expand_inputs([str(path)]), InputOptions(chunk_rows=5)).chunks()
    with pytest.raises(DataError, match="50 of 100"):
        next(chunks)


@pytest.mark.parametrize("kind", [pa.int8(), pa.uint64()])
def test_an_integer_flag_is_zero_or_one(tmp_path: Path, kind: Any) -> None:
    """los = 2 in a typed file is a bad row, as in CSV; flags that are only carried are checked too."""
    for name in ("los", "truth_los"):
        path = save(bearings([1] * 4, **{name: pa.array([0, 1, None, 2], kind)}), tmp_path / "a.parquet")
        with pytest.raises(DataError, match=f"row 4, column '{name}': got 2, expected true/false or 1/0"):
            read([path])
        assert not read([path], Gathered())[0].left_out[1:].any()


def test_integers_beyond_64_bits(tmp_path: Path) -> None:
    """A path beyond int64 is a bad row, such an id is an error only beside signed ones, such a sensor a name."""
    path = save(bearings([1, 1, 1], path=pa.array([1, 2**63, None], pa.uint64())), tmp_path / "a.parquet")
    with pytest.raises(DataError, match=f"row 2, column 'path': got {2**63}, expected at most {2**63 - 1}"):
        read([path])
    path = save(bearings(pa.array([2**63], pa.uint64())), tmp_path / "b.parquet")
    assert read([path])[0].snapshot.to_pylist() == [2**63]
    mixed = [save(bearings([1]), tmp_path / "d.parquet"), path]
    with pytest.raises(DataError, match="'snapshot': beyond 64-bit integers; store it as text"):
        read(mixed)
    path = save(bearings([1], sensor=pa.array([2**63], pa.uint64())), tmp_path / "c.parquet")
    assert read([path])[0].columns["sensor"].tolist() == [0]


def test_a_csv_column_of_mixed_degrees_keeps_its_text(tmp_path: Path) -> None:
    """The bad row contains the original cells, so that they can be corrected."""
    text = bearings(list(range(20)), bearing_rad=[1.0] * 19 + [np.float64(90.0)])
    pa.csv.write_csv(text, tmp_path / "a.csv")
    sink = Gathered()
    read([tmp_path / "a.csv"], sink)
    assert (sink[0].problem.line, sink[0].values["bearing_rad"]) == (21, "90")
