"""Reading arrival times: exact integers, speeds, differences to a reference, and the faults of rows and files."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
from test_io_space import written

from nlosctl.contract.flags import parse_speed
from nlosctl.contract.run_options import InputOptions
from nlosctl.contract.scene import Scene
from nlosctl.errors import DataError, UsageError
from nlosctl.io.measurements.completion.references import Form
from nlosctl.io.measurements.reader import Chunk, MeasurementReader
from nlosctl.io.paths.inputs import expand_inputs
from nlosctl.pipeline.solve.reference_rows import alike_blocks, difference_form
from nlosctl.pipeline.solve.solve_chunk import dense_batch

EPOCH_NS = 1_733_011_200_123_456_789
PLACES: dict[str, list[Any]] = {
    "sensor": ["a", "b", "c"],
    "sensor_x_m": [0.0, 10.0, 0.0],
    "sensor_y_m": [0.0, 1.0, 20.0],
}
STATIONS = {name: values[1:] for name, values in PLACES.items()}
SCENE = '[[sensor]]\nname = "a"\nposition = [3, 4]\n'


def chunk_of(path: Path, **options: Any) -> Chunk:
    """Return the only chunk of a file."""
    (chunk,) = MeasurementReader(expand_inputs([str(path)]), InputOptions(use_threads=False, **options)).chunks()
    return chunk


def batch_of(path: Path, **options: Any) -> Any:
    """Return the dense batch of a file of one snapshot."""
    chunk = chunk_of(path, **options)

    return dense_batch("arrivals", chunk.columns, np.arange(chunk.table.num_rows)[None], scene=Scene())


def failed(path: Path, **options: Any) -> str:
    """Return the message of the error that reading a file raises."""
    with pytest.raises((DataError, UsageError)) as caught:
        chunk_of(path, **options)
    return str(caught.value)


@pytest.mark.parametrize("form", ["csv", "parquet", "jsonl"])
def test_nanoseconds_since_1970_are_subtracted_as_integers(tmp_path: Path, form: str) -> None:
    """Differences of integers beyond 2^53 are those of exact arithmetic, in every format."""
    times = [EPOCH_NS, EPOCH_NS + 3, EPOCH_NS + 60]
    columns = {**PLACES, "arrival_ns": times, "arrival_std_m": [1.0] * 3}
    path = tmp_path / f"in.{form}"
    if form == "csv":
        path = written(tmp_path, columns)
    elif form == "parquet":
        pyarrow.parquet.write_table(pa.table(columns), path)
    else:
        rows = pa.table(columns).to_pylist()
        path.write_text("\n".join(str(row).replace("'", '"') for row in rows) + "\n")
    batch = batch_of(path)
    exact = [float(Fraction(time - EPOCH_NS) * Fraction(299_792_458, 10**9)) for time in times]
    assert batch.arrival_m[0] - batch.arrival_m[0, 0] == pytest.approx(exact, abs=1e-6)
    assert batch.origin_m[0] == pytest.approx(EPOCH_NS * 0.299792458, rel=1e-15)


def test_times_in_a_column_for_each_sensor_stay_integers(tmp_path: Path) -> None:
    """The wide form keeps nanoseconds since 1970 exact."""
    path = tmp_path / "in.csv"
    path.write_text(f"snapshot,toa_a,toa_b\n1,{EPOCH_NS},{EPOCH_NS + 7}\n")
    (tmp_path / "in.scene.toml").write_text(SCENE + SCENE.replace('"a"', '"b"').replace("3, 4", "5, 6"))
    batch = batch_of(path, wide=("arrival_ns=toa_*",), constants={"arrival_std_m": 1.0})
    assert np.diff(batch.arrival_m[0]) == pytest.approx([7 * 0.299792458], abs=1e-6)


@pytest.mark.parametrize(("speed", "metres"), [("light", 299_792_458.0), ("sound", 343.0), ("1500", 1500.0)])
def test_a_time_is_a_length_by_the_speed(tmp_path: Path, speed: str, metres: float) -> None:
    """Times and their standard deviations, of columns and constants, are multiplied with the speed."""
    columns = {**PLACES, "arrival_ms": [1.0, 2.0, 4.0], "arrival_std_us": [5.0] * 3}
    batch = batch_of(written(tmp_path, columns), speed_m_s=parse_speed(speed))
    assert batch.arrival_m[0] == pytest.approx(np.array([0.0, 1.0, 3.0]) * 1e-3 * metres, rel=1e-12)
    assert batch.arrival_std_m[0] == pytest.approx([5e-6 * metres] * 3, rel=1e-12)
    del columns["arrival_std_us"]
    path = written(tmp_path, columns)
    batch = batch_of(path, speed_m_s=parse_speed(speed), constants={"arrival_std_s": 2e-6})
    assert batch.arrival_std_m[0] == pytest.approx([2e-6 * metres] * 3, rel=1e-12)


@pytest.mark.parametrize(("values", "std", "fault"), [
    ([float(EPOCH_NS), 1.0, 2.0], 1e3, "floating-point number, which is only exact to 256, expected an integer or "
     "a smaller number; give whole nanoseconds in a column of integers"),
    ([EPOCH_NS * 1e-9, 1.5, 2.0], 1e-8, "only exact to 71.5 m, more than its standard deviation 3 m; give integers in "
     "a smaller unit, such as nanoseconds, in a column of integers"),
    ([float("nan"), 1.0, 2.0], 1.0, "got an empty cell (null), expected a finite number"),
])  # fmt: skip
def test_rounded_times_are_bad_rows(tmp_path: Path, values: list[float], std: float, fault: str) -> None:
    """Floating-point numbers that cannot carry the time as exactly as its standard deviation are refused."""
    name = "arrival_ns" if values[0] > 1e12 else "arrival_s"
    table = pa.table({**PLACES, name: values, f"{name.replace('arrival', 'arrival_std')}": [std] * 3})
    table = table.set_column(3, name, pa.array(values, pa.float64(), from_pandas=True))
    pyarrow.parquet.write_table(table, tmp_path / "in.parquet")
    message = failed(tmp_path / "in.parquet")
    assert f"row 1, column {name!r}: " in message
    assert fault in message


@pytest.mark.parametrize(("columns", "fault"), [
    ({"arrival_ns": ["5", "six", "7"]}, "row 2 (line 3), column 'arrival_ns': got 'six', expected an integer"),
    ({"arrival_ns": [1, 2, 3], "arrival_s": [1, 2, 3]}, "'arrival_s' and 'arrival_ns' are the same quantity"),
    ({"arrival_ns": [1, 2, 3], "arrival_std_m": [1, 0, 1]}, "row 2 (line 3), column 'arrival_std_m': got 0, expected"),
    ({"arrival_furlong": [1, 2, 3]}, "unknown unit 'furlong', expected one of the suffixes _m, _s, _ms, _us, _ns"),
    ({"tdoa_ns": [1, 2, 3]}, "column 'tdoa_ns' needs 'reference', the sensor whose arrival is subtracted"),
    ({"tdoa_ns": [1, 2, 3], "reference": ["z"] * 3}, "sensor 'z' has no row there and no position; add columns ref"),
    ({"tdoa_ns": [1, 2, 3], "reference": ["a"] * 3}, "got 0.299792 m in the row of the reference itself, expected 0"),
    ({"tdoa_ns": [1, 2, 3], "reference": ["b", "z", "a"]}, "sensor 'z' has no row there and no position; add columns"),
    ({"tdoa_m": [1, 2, 3], "reference": ["b", "c", "a"], "reference_std_m": ["", 2.0, ""]},
     "column 'reference_std_m': got 2 m for 'c', but the differences there are to several references: each is"),
    ({"tdoa_ns": [0, 2, 3], "reference": ["b", "b", "a"]},
     "got 0.599585 m in the row of the reference itself, expected 0"),
    ({"sensor": ["a", "b", "b"], "sensor_x_m": [0, 1, 1], "sensor_y_m": [0, 1, 1], "arrival_ns": [1, 2, 3]},
     "duplicate measurement: same snapshot, sensor, sensor_x_m, sensor_y_m as row 2"),
])  # fmt: skip
def test_faults_are_named(tmp_path: Path, columns: dict[str, list[Any]], fault: str) -> None:
    """A wrong column or row is named with what was found and what was expected."""
    constants = {} if "arrival_std_m" in columns else {"arrival_std_m": 1.0}
    assert fault in failed(written(tmp_path, {**PLACES, **columns}), kind="arrivals", constants=constants)


@pytest.mark.parametrize("place", ["row", "columns", "scene"])
def test_a_reference_is_a_row_of_zero(tmp_path: Path, place: str) -> None:
    """With its row, with columns or with the scene, differences become the same arrivals: the reference's is 0."""
    path = tmp_path
    if place == "row":
        columns = {**PLACES, "sensor_x_m": [3.0, 10.0, 0.0], "sensor_y_m": [4.0, 1.0, 20.0], "tdoa_m": [0.0, 5.0, -6.0]}
        columns |= {"arrival_std_m": [2.0, 1.0, 3.0], "reference": ["a"] * 3}
    else:
        columns = {**STATIONS, "tdoa_m": [5.0, -6.0], "arrival_std_m": [1.0, 3.0], "reference": ["a"] * 2}
        columns |= {"reference_std_m": [2.0] * 2}
        if place == "columns":
            columns |= {"reference_x_m": [3.0] * 2, "reference_y_m": [4.0] * 2}
    chunk = chunk_of(written(path, columns, SCENE if place == "scene" else ""))
    (block,) = alike_blocks(chunk, np.zeros(1, dtype=np.int64), np.arange(chunk.table.num_rows)[None])
    form = Form.WITH_REFERENCE if place == "row" else Form.WITHOUT_REFERENCE
    assert difference_form(chunk.columns, block[1]) == form
    batch: Any = dense_batch("arrivals", chunk.columns, block[1], scene=Scene())
    order = [2, 0, 1] if place != "row" else [0, 1, 2]
    assert batch.arrival_m[0, order] + batch.origin_m[0] == pytest.approx([0.0, 5.0, -6.0])
    assert batch.arrival_std_m[0, order] == pytest.approx([2.0, 1.0, 3.0])
    assert batch.sensor_xy_m[0, order].tolist() == [[3.0, 4.0], [10.0, 1.0], [0.0, 20.0]]


def test_without_its_std_a_reference_is_like_the_others(tmp_path: Path) -> None:
    """The std of a reference's arrival is the root mean square of the others' unless it is given."""
    columns = {**STATIONS, "tdoa_m": [5.0, -6.0], "arrival_std_m": [1.0, 7.0], "reference": ["a"] * 2}
    batch = batch_of(written(tmp_path, columns, SCENE))
    assert batch.arrival_std_m[0] == pytest.approx([1.0, 7.0, 5.0])


@pytest.mark.parametrize("place", ["rows", "columns", "scene"])
def test_several_references_are_independent_differences(tmp_path: Path, place: str) -> None:
    """Each row has its reference's position, of its own columns, the scene or a row of that sensor, and no origin."""
    columns = {**PLACES, "tdoa_m": [5.0, -6.0, 1.0], "arrival_std_m": [1.0, 3.0, 2.0], "reference": ["b", "c", "a"]}
    expected = [[10.0, 1.0], [0.0, 20.0], [0.0, 0.0]]
    if place == "columns":
        columns |= {"reference_x_m": [11.0, "", ""], "reference_y_m": [2.0, "", ""]}
        expected[0] = [11.0, 2.0]
    if place == "scene":
        expected[2] = [3.0, 4.0]
    batch = batch_of(written(tmp_path, columns, SCENE if place == "scene" else ""))
    assert batch.arrival_m[0] == pytest.approx([5.0, -6.0, 1.0])
    assert batch.arrival_std_m[0] == pytest.approx([1.0, 3.0, 2.0])
    assert batch.origin_m[0] == 0.0
    assert batch.reference_xy_m[0].tolist() == expected
    assert batch.sensor_xy_m[0].T.tolist() == [PLACES["sensor_x_m"], PLACES["sensor_y_m"]]


def test_rows_of_a_reference_itself_take_no_part_among_others(tmp_path: Path) -> None:
    """Where a snapshot has several references a row of 0 to itself has no information; elsewhere it is an arrival."""
    columns = {**PLACES, "tdoa_m": [0.0, -6.0, 1.0], "arrival_std_m": [1.0] * 3, "reference": ["a", "c", "a"]}
    chunk = chunk_of(written(tmp_path, columns))
    assert chunk.left_out.tolist() == [True, False, False]
    chunk = chunk_of(written(tmp_path, {**columns, "reference": ["a"] * 3}))
    assert not chunk.left_out.any()
