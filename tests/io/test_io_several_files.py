"""Several files, their scenes and types; repeated and lost snapshots."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from reading_support import Gathered, bearings, pa, read, save, whole

from nlosctl.contract.run_options import InputOptions
from nlosctl.contract.scene import LineReflector, Scene
from nlosctl.errors import DataError
from nlosctl.io.measurements.reader import MeasurementReader
from nlosctl.io.measurements.snapshot_ids import LostSnapshots
from nlosctl.io.paths.inputs import expand_inputs
from nlosctl.io.scenes.scene_file import SCENE_KEY, scene_from_toml, scene_to_toml


def scene(slope: float) -> str:
    """Return a scene of one wall, as text."""
    return scene_to_toml(Scene(reflectors=(LineReflector(name="w", point=(0.0, 1.0), direction=(1.0, slope)),)))


def save_with_scene(path: Path, slope: float | None, ids: list[int]) -> Path:
    """Write bearings with or without a scene."""
    metadata = {} if slope is None else {SCENE_KEY: scene(slope).encode()}
    return save(bearings(ids).replace_schema_metadata(metadata), path)


@pytest.mark.parametrize("slopes", [(1.0, 2.0), (None, 1.0), (1.0, None)])
@pytest.mark.parametrize("as_folder", [True, False])
def test_files_of_different_scenes_are_refused(tmp_path: Path, slopes: tuple[Any, Any], as_folder: bool) -> None:
    """No file is read with the scene of another; a scene option applies to all."""
    folder = tmp_path / "parts"
    folder.mkdir()
    paths = [save_with_scene(folder / f"{n}.parquet", slope, [n]) for n, slope in enumerate(slopes)]
    words: list[Path] = [folder] if as_folder else paths
    with pytest.raises(DataError, match=r"1\.parquet: its scene is not that of .*0\.parquet; .*`scene` FILE"):
        read(words)
    (tmp_path / "given.toml").write_text(scene(3.0))
    assert len(read(words, scene=str(tmp_path / "given.toml"))) > 0
    assert len(read(words, scene=Scene())) > 0


def test_files_of_equal_scenes_are_read(tmp_path: Path) -> None:
    """Equal scenes in the metadata of one file and beside another are one scene."""
    first = save_with_scene(tmp_path / "a.parquet", 1.0, [1])
    second = save_with_scene(tmp_path / "b.parquet", None, [2])
    (tmp_path / "b.scene.toml").write_text(scene(1.0))
    assert len(read([first, second])) == 2


def test_a_part_of_a_folder_has_its_scene_beside_it(tmp_path: Path) -> None:
    """If the folder has no scene, each part uses its scene."""
    save_with_scene(tmp_path / "a.parquet", None, [1])
    (tmp_path / "a.scene.toml").write_text(scene(1.0))
    reader = MeasurementReader(expand_inputs([str(tmp_path)]))
    assert reader.scene.reflector_names == ("w",)
    save_with_scene(tmp_path / "b.parquet", None, [2])
    with pytest.raises(DataError, match="its scene is not that of"):
        read([tmp_path])


def test_a_scene_kind_that_is_no_word_is_told() -> None:
    """A list instead of the kind is an error of that key."""
    with pytest.raises(DataError, match=r"reflector\[0\].kind: got \['a'\], expected one of"):
        scene_from_toml('[[reflector]]\nname = "w"\nkind = ["a"]\n', "s.toml")


@pytest.mark.parametrize(
    ("one", "other", "kept"),
    [
        ([[1, 2]], ["x"], ["[1, 2]", "x"]),
        ([b"\xff"], ["x"], ["\\xff", "x"]),
        ([1], ["x"], ["1", "x"]),
        (pa.array([2**63], pa.uint64()), [-1], [str(2**63), "-1"]),
        ([1], [2.5], [1.0, 2.5]),
    ],
)
def test_own_columns_of_two_types_meet(tmp_path: Path, one: Any, other: Any, kept: list[Any]) -> None:
    """An additional column may have different types in different parts, without loss or error."""
    save(bearings([1], own=one), tmp_path / "a.parquet")
    save(bearings([2], own=other), tmp_path / "b.parquet")
    assert whole(read([tmp_path])).table.column("own").to_pylist() == kept


@pytest.mark.parametrize(
    ("name", "renames", "hint"),
    [
        ("a.parquet", {}, r"""duckdb -c "COPY (SELECT * FROM '{folder}/a.parquet' ORDER BY \"snapshot\") TO"""),
        ("a.parquet", {"snapshot": "id"}, r"""ORDER BY \"id\") TO"""),
        ("a.parquet", {"snapshot": "the id"}, r"""ORDER BY \"the id\") TO"""),
        ("it's.parquet", {}, "it''s.parquet' ORDER BY"),
        ("a.arrow", {}, "sort the rows by 'snapshot'"),
        ("", {}, "FROM '{folder}/part.parquet' ORDER BY"),
    ],
)
def test_a_message_shows_how_to_sort(tmp_path: Path, name: str, renames: dict[str, str], hint: str) -> None:
    """The suggested command works for this input: its name, its parts, its column name."""
    table = bearings([1, 2, 1])
    table = table.rename_columns([renames.get("snapshot", "snapshot"), *table.column_names[1:]])
    path = save(table, tmp_path / (name or "part.parquet"))
    if name.endswith(".arrow"):
        with pa.ipc.new_file(path, table.schema) as writer:
            writer.write_table(table)
    with pytest.raises(DataError, match="comes back") as caught:
        read([path if name else tmp_path], columns=renames)
    assert hint.format(folder=tmp_path) in str(caught.value).replace("""'"'"'""", "'")
    assert f"column '{renames.get('snapshot', 'snapshot')}'" in str(caught.value)


@settings(max_examples=100, deadline=None)
@given(
    rows=st.lists(st.tuples(st.integers(1, 4), st.booleans()), min_size=1, max_size=20),
    cuts=st.lists(st.integers(1, 19), max_size=4),
)
def test_lost_snapshots_are_those_without_a_good_row(rows: list[tuple[int, bool]], cuts: list[int]) -> None:
    """For any batches, a snapshot whose rows are all bad counts once."""
    runs = [count for count, _ in rows]
    ids = np.repeat(np.arange(len(runs)), runs)
    bad = np.array([lost or (place % 3 == 0 and run > 1) for run, lost in rows for place in range(run)])
    expected = sum(bad[ids == place].all() for place in range(len(runs)))
    watch = LostSnapshots()
    edges = sorted({0, len(ids), *(cut for cut in cuts if cut < len(ids))})
    for start, stop in pairwise(edges):
        part = bad[start:stop]
        watch.add(pa.array(ids[start:stop]), part if part.any() else None)
    assert watch.count == expected


def test_a_snapshot_of_bad_rows_alone_is_counted(tmp_path: Path) -> None:
    """Rows, bad rows and lost snapshots add up, and a remark reports the lost ones."""
    std = [0.1, 0.0, 0.0, 0.0, 0.1, 0.1]
    table = bearings([1, 1, 2, 2, 3, 3], sensor=["a", "b", "a", "b", "c", "c"], bearing_std_rad=std)
    path = save(table.set_column(2, "sensor_x_m", pa.array([0.0] * 6)), tmp_path / "a.parquet")
    for chunk_rows in (1, 3, 100):
        options = InputOptions(chunk_rows=chunk_rows)
        reader = MeasurementReader(expand_inputs([str(path)]), options, Gathered())
        assert [value for chunk in reader.chunks() for value in chunk.snapshot.to_pylist()] == [1, 3]
        report = reader.report
        assert (report.rows, report.bad_rows, report.rows_in_all) == (2, 4, 6)
        assert (report.snapshots, report.snapshots_lost) == (2, 1)
        assert report.rows_by_file == {str(path): 6}
        assert "1 snapshot" in report.remarks[-1]
