"""Convention 7: equal input gives equal bytes for any number of workers and block size."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import pyarrow.parquet
import pytest
from cli_support import GOOD, SCENE
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from nlosctl.cli.main import run
from nlosctl.pipeline.engine import slices, workers

pytestmark = pytest.mark.extensive

EXTENSIONS = ["parquet", "csv", "csv.gz", "arrow", "arrows", "jsonl"]
Files = tuple[bytes, bytes]


def solved(folder: Path, extension: str, jobs: int, block_size: int, chunk_rows: int, group_rows: int = 50) -> Files:
    """Return the bytes of estimates and flags of the valid file by three methods, in small blocks."""
    estimates, flags = folder / f"e.{extension}", folder / f"f.{extension}"
    words = ["localize", GOOD, "-q", "--overwrite", "-o", estimates, "--flags-out", flags]
    words += ["-m", "ml", "-m", "ls", "-m", "stansfield", "--jobs", jobs, "--block-size", block_size]
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("NLOSCTL_CHUNK_ROWS", str(chunk_rows))
        patch.setenv("NLOSCTL_GROUP_ROWS", str(group_rows))
        assert run([str(word) for word in words]) == 0
    return estimates.read_bytes(), flags.read_bytes()


@cache
def reference(extension: str) -> Files:
    """Return estimates and flags of one worker, in one chunk and block."""
    with TemporaryDirectory() as folder:
        return solved(Path(folder), extension, 1, 4096, 131_072)


@pytest.mark.process
@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    extension=st.sampled_from(EXTENSIONS),
    jobs=st.integers(1, 4),
    block_size=st.one_of(st.integers(1, 8), st.sampled_from([4096])),
    chunk_rows=st.integers(1, 240),
)
def test_workers_and_blocks_change_no_byte(
    tmp_path: Path, extension: str, jobs: int, block_size: int, chunk_rows: int
) -> None:
    """Estimates and flags have the same bytes for any ``--jobs``, ``--block-size`` and chunk size."""
    assert solved(tmp_path, extension, jobs, block_size, chunk_rows) == reference(extension)


@pytest.mark.process
@pytest.mark.parametrize("row_group_size", [10, 33])
@pytest.mark.parametrize("flags", [True, False])
def test_processes_that_read_slices_change_no_byte(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, row_group_size: int, flags: bool
) -> None:
    """Worker processes read slices of Parquet, cut within snapshots: the same bytes and summary."""
    table = pyarrow.parquet.read_table(GOOD)
    pyarrow.parquet.write_table(table, tmp_path / "m.parquet", row_group_size=row_group_size)
    monkeypatch.setenv("NLOSCTL_SLICE_ROWS", "1")
    used = []
    monkeypatch.setattr(
        slices, "map_in_processes", lambda *given: used.append(given) or workers.map_in_processes(*given)
    )
    words = [
        "localize",
        str(tmp_path / "m.parquet"),
        "--scene",
        str(SCENE),
        "-m",
        "ml",
        "-m",
        "ls",
        "--block-size",
        "9",
    ]
    results = []
    for jobs in "12":
        names = [str(tmp_path / f"{name}{jobs}.parquet") for name in ("e", "f", "r")]
        extra = ["--flags-out", names[1]] if flags else []
        assert run([*words, "-o", names[0], *extra, "--report", names[2], "--jobs", jobs]) == 0
        results.append([Path(name).read_bytes() for name in names if Path(name).exists()])
    assert len(used) == 1
    assert results[0] == results[1]


@pytest.mark.process
@pytest.mark.parametrize("fault", ["negative std", "comes back", "duplicate"])
def test_processes_that_read_slices_report_the_same_errors(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], fault: str
) -> None:
    """Faults have the same message for any number of jobs, and no output is written."""
    table = pyarrow.parquet.read_table(GOOD)
    columns = {name: table.column(name).to_pylist() for name in table.column_names}
    if fault == "negative std":
        for row in (7, 100, 239):
            columns["bearing_std_rad"][row] = -1.0
    elif fault == "comes back":
        columns["snapshot"] = [3 if identity == 30 else identity for identity in columns["snapshot"]]
    else:
        columns = {name: [*cells[:150], cells[149], *cells[150:]] for name, cells in columns.items()}
    corrupted = pyarrow.table(columns, schema=table.schema)
    pyarrow.parquet.write_table(corrupted, tmp_path / "m.parquet", row_group_size=20)
    monkeypatch.setenv("NLOSCTL_SLICE_ROWS", "1")
    words = ["localize", str(tmp_path / "m.parquet"), "--scene", str(SCENE), "-o", str(tmp_path / "e.csv")]
    output = []
    for jobs in "12":
        assert run([*words, "--jobs", jobs]) == 1
        output.append(capsys.readouterr().err)
    assert output[0] == output[1]
    assert {"negative std": "3 bad rows", "comes back": "comes back", "duplicate": "duplicate"}[fault] in output[0]
    assert [path.name for path in tmp_path.iterdir()] == ["m.parquet"]


@pytest.mark.process
@pytest.mark.parametrize(("jobs", "block_size", "chunk_rows"), [(1, 4096, 131_072), (3, 2, 11), (2, 7, 64)])
def test_row_groups_do_not_follow_blocks(tmp_path: Path, jobs: int, block_size: int, chunk_rows: int) -> None:
    """Row groups have the size set for the writer, for any chunks and blocks."""
    solved(tmp_path, "parquet", jobs, block_size, chunk_rows, group_rows=50)
    for name, rows in (("e", 120), ("f", 720)):
        output = pyarrow.parquet.read_metadata(tmp_path / f"{name}.parquet")
        sizes = [output.row_group(index).num_rows for index in range(output.num_row_groups)]
        assert sizes == [50] * (rows // 50) + [rows % 50]


@pytest.mark.process
def test_a_long_file_has_row_groups_of_a_fixed_size(tmp_path: Path) -> None:
    """Long files have row groups of the default size, for any block size."""
    drawn, flags = tmp_path / "m.parquet", tmp_path / "f.parquet"
    assert run(["simulate", "ring", "-n", "45000", "-p", "sensors=3", "-q", "-o", str(drawn)]) == 0
    words = ["localize", str(drawn), "-m", "ls", "--block-size", "999", "-q", "-o", str(tmp_path / "e.parquet")]
    assert run([*words, "--flags-out", str(flags)]) == 0
    for path, size in ((drawn, 131_072), (flags, 65_536)):
        output = pyarrow.parquet.read_metadata(path)
        groups = [output.row_group(index).num_rows for index in range(output.num_row_groups)]
        assert groups == [size] * (135_000 // size) + [135_000 % size]


@pytest.mark.parametrize("extension", EXTENSIONS)
def test_equal_seeds_draw_equal_files(tmp_path: Path, extension: str) -> None:
    """``simulate`` writes the same bytes for the same seed, and others for another."""
    paths = [tmp_path / f"{name}.{extension}" for name in "abc"]
    for path, seed in zip(paths, ("5", "5", "6"), strict=True):
        assert run(["simulate", "random", "-n", "20", "--seed", seed, "-q", "-o", str(path)]) == 0
    first, second, third = (path.read_bytes() for path in paths)
    assert first == second != third
