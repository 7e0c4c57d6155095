"""Reading measurement files: the same result for every format and batch size."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from reading_support import FIXTURES, bearings, read, save, scene_of, whole

from nlosctl.contract.run_options import InputOptions
from nlosctl.contract.scene import Scene, Sensor
from nlosctl.errors import DataError, UsageError
from nlosctl.io.measurements.reader import MeasurementReader
from nlosctl.io.paths.inputs import expand_inputs
from nlosctl.io.paths.locations import FileFormat, format_named, format_of_bytes, format_of_path

FORMATS = ["parquet", "csv", "csv.gz", "arrow", "arrows", "jsonl"]
SCENE = scene_of(FIXTURES / "good_bearings.parquet")


@pytest.mark.parametrize("extension", FORMATS)
def test_every_format_gives_the_same_rows(extension: str) -> None:
    """The same data in another format give the same snapshots, to the bit."""
    expected = whole(read([FIXTURES / "good_bearings.parquet"], scene=SCENE))
    found = whole(read([FIXTURES / f"good_bearings.{extension}"], scene=SCENE, chunk_rows=37))
    assert found.ids == expected.ids == list(range(40))
    assert found.counts == expected.counts
    for name, values in expected.columns.items():
        np.testing.assert_array_equal(found.columns[name], values)
    plain = [expected.table.column(name).to_pylist() for name in expected.table.column_names]
    assert [found.table.column(name).to_pylist() for name in found.table.column_names] == plain


@pytest.mark.parametrize("extension", FORMATS)
def test_stdin_is_recognized_by_its_first_bytes(extension: str) -> None:
    """The format of a stream is detected without a name."""
    stream = io.BytesIO((FIXTURES / f"good_bearings.{extension}").read_bytes())
    inputs = expand_inputs(["-"], stdin=stream)
    chunks = list(MeasurementReader(inputs, InputOptions(scene=SCENE, use_threads=False)).chunks())
    assert sum(len(chunk.snapshot) for chunk in chunks) == 40


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    counts=st.lists(st.integers(1, 9), min_size=1, max_size=12), chunk_rows=st.integers(1, 40), group=st.integers(1, 20)
)
def test_chunk_size_changes_nothing(tmp_path: Path, counts: list[int], chunk_rows: int, group: int) -> None:
    """Snapshots across row groups and batches are complete, for any sizes."""
    ids = [place for place, count in enumerate(counts) for _ in range(count)]
    path = save(bearings(ids), tmp_path / "straddling.parquet", row_group_size=group)
    found = whole(read([path], chunk_rows=chunk_rows))
    assert found.ids == list(range(len(counts)))
    assert found.counts == counts
    np.testing.assert_array_equal(found.columns["sensor_x_m"], np.arange(len(ids)))


def test_parts_of_a_folder_are_one_table(tmp_path: Path) -> None:
    """A snapshot may start in one part of a folder and end in the next."""
    save(bearings([1, 1, 2]), tmp_path / "a.parquet")
    save(bearings([2, 3], sensor=["t0", "t1"]), tmp_path / "b.parquet")
    found = whole(read([tmp_path]))
    assert (found.ids, found.counts) == ([1, 2, 3], [2, 2, 1])


def test_named_files_are_kept_apart(tmp_path: Path) -> None:
    """The same snapshot id in two named files is two snapshots, each with its source."""
    first, second = (save(bearings([1, 1]), tmp_path / name) for name in ("a.parquet", "b.parquet"))
    chunks = read([first, second])
    assert [chunk.source for chunk in chunks] == [str(first), str(second)]


def test_files_of_different_columns_share_a_schema(tmp_path: Path) -> None:
    """A column that one file lacks is null there, and the schema is known before the first chunk."""
    first = save(bearings([1, 1], note=["x", "y"]), tmp_path / "a.parquet")
    second = save(bearings([2, 2]), tmp_path / "b.parquet")
    assert read([first, second])[1].table.column("note").to_pylist() == [None, None]


def test_without_snapshot_column_a_file_is_one_snapshot(tmp_path: Path) -> None:
    """Without ids all rows are one snapshot, and the report states it."""
    path = save(bearings([1, 2, 3]).drop_columns(["snapshot"]), tmp_path / "one.parquet")
    reader = MeasurementReader(expand_inputs([str(path)]), InputOptions(use_threads=False))
    (chunk,) = reader.chunks()
    assert chunk.offsets.tolist() == [0, 3]
    assert "snapshot" in reader.report.remarks[0]


def test_azimuth_is_turned_into_a_bearing() -> None:
    """Compass degrees become radians counter-clockwise from +x, standard deviations become radians."""
    direct = whole(read([FIXTURES / "good_bearings.parquet"], scene=SCENE)).columns
    rows = direct["reflector"] == -1
    found = whole(read([FIXTURES / "good_bearings_azimuth.csv"])).columns
    turn = np.exp(1j * (found["bearing_rad"] - direct["bearing_rad"][rows]))
    np.testing.assert_allclose(turn, 1.0, atol=1e-12)
    np.testing.assert_allclose(found["bearing_std_rad"], direct["bearing_std_rad"][rows], rtol=1e-14)


def test_sensor_positions_come_from_the_scene() -> None:
    """Rows without positions take those of the scene's sensor of that name."""
    path = FIXTURES / "good_bearings_scene_sensors.csv"
    found = whole(read([path], scene=scene_of(path))).columns
    assert not np.isnan(found["sensor_x_m"]).any()
    assert set(found["sensor_y_m"]) == {900.0, 50.0, -950.0, 0.0, 250.0, 380.0}


def test_a_null_position_is_filled_by_row(tmp_path: Path) -> None:
    """An empty position is filled from the scene, a given one is kept."""
    scene = Scene(sensors=(Sensor(name="s1", position=(7.0, 8.0)),))
    path = save(bearings([1, 1], sensor_x_m=[3.0, None], sensor_y_m=[4.0, None]), tmp_path / "a.parquet")
    columns = whole(read([path], scene=scene)).columns
    assert (columns["sensor_x_m"].tolist(), columns["sensor_y_m"].tolist()) == ([3.0, 7.0], [4.0, 8.0])


def test_renamed_and_constant_columns(tmp_path: Path) -> None:
    """--column reads a column under another name; a constant replaces a missing one."""
    table = (
        bearings([1, 1])
        .rename_columns(["snapshot", "sensor", "sensor_x_m", "sensor_y_m", "AZ", "old_std"])
        .drop_columns(["old_std"])
    )
    path = save(table, tmp_path / "a.parquet")
    found = whole(read([path], columns={"bearing_deg": "AZ"}, constants={"bearing_std_rad": 0.03}))
    np.testing.assert_allclose(found.columns["bearing_rad"], np.radians(0.1))
    assert found.columns["bearing_std_rad"].tolist() == [0.03, 0.03]
    assert "bearing_deg" in found.table.column_names


@pytest.mark.parametrize(
    ("options", "error", "word"),
    [
        ({"columns": {"bearing_deg": "AZZ"}}, DataError, "AZZ"),
        ({"columns": {"baering_deg": "bearing_rad"}}, UsageError, "bearing_deg"),
        ({"constants": {"bearing_std_rad": 0.1}}, UsageError, r"`constants\['bearing_std_rad'\]`"),
        ({"constants": {"bearing_rad": 0.1}}, UsageError, "bearing_std_rad"),
        ({"kind": "bearing"}, UsageError, "bearings"),
        ({"max_snapshot_rows": 1}, DataError, "`max_snapshot_rows`"),
    ],
)
def test_wrong_options_are_told(tmp_path: Path, options: dict[str, object], error: type, word: str) -> None:
    """Each wrong argument is reported with its cure."""
    path = save(bearings([1, 1]), tmp_path / "a.parquet")
    with pytest.raises(error, match=word):
        read([path], **options)


def test_two_spellings_of_one_column_are_refused(tmp_path: Path) -> None:
    """A file with both bearing_rad and bearing_deg is ambiguous: an error."""
    path = save(bearings([1], bearing_deg=[5.0]), tmp_path / "a.parquet")
    with pytest.raises(DataError, match="are the same quantity"):
        read([path])


def test_rows_flagged_before_are_left_out(tmp_path: Path) -> None:
    """Rows with los false or ip true are marked, unless all rows are wanted."""
    table = bearings([1] * 4, los=[True, False, None, True], ip=[None, False, False, True])
    path = save(table, tmp_path / "a.parquet")
    assert read([path])[0].left_out.tolist() == [False, True, False, True]
    assert not read([path], all_rows=True)[0].left_out.any()


def test_snapshot_ids_with_leading_zeros_stay_text(tmp_path: Path) -> None:
    """007 is a name, 7 a number."""
    header = "snapshot,sensor,sensor_x_m,sensor_y_m,bearing_rad,bearing_std_rad\n"
    path = tmp_path / "a.csv"
    path.write_text("\ufeff" + header + "007,a,0,0,1,0.1\n", encoding="utf-8")
    assert read([path])[0].snapshot.to_pylist() == ["007"]


def test_sensor_codes_hold_across_batches_and_types(tmp_path: Path) -> None:
    """Equal names have equal codes in the whole run, integers counting as their text."""
    first = save(bearings([1, 1], sensor=["2", "1"]), tmp_path / "a.parquet")
    second = save(bearings([1, 1], sensor=[1, 2]), tmp_path / "b.parquet")
    found = [chunk.columns["sensor"].tolist() for chunk in read([first, second])]
    assert found == [[0, 1], [1, 0]]


def test_formats_are_told_by_extension_name_and_bytes() -> None:
    """The longest extension counts; for unknown ones the nearest known one is suggested."""
    assert format_of_path("dir.csv/a.CSV.GZ") is FileFormat.CSV_GZ
    assert format_of_bytes(b"\xff\xff\xff\xff\x10") is FileFormat.ARROW_STREAM
    assert format_of_bytes(b' {"snapshot"') is FileFormat.JSON_LINES
    with pytest.raises(UsageError, match="parquet"):
        format_named("parqet")
    with pytest.raises(UsageError, match=r"\.arrows"):
        format_of_path("a.xlsx")
