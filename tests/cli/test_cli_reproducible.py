"""Convention 7: the same bytes for the same input, whatever the workers and blocks."""

from __future__ import annotations

from functools import cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory

import pyarrow.parquet
import pytest
from cli_support import GOOD
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from nlosctl.cli.main import run
from nlosctl.io import measurements
from nlosctl.io.write import GROUP_ROWS, TableWriter

EXTENSIONS = ["parquet", "csv", "csv.gz", "arrow", "arrows", "jsonl"]
Files = tuple[bytes, bytes]


def solved(folder: Path, extension: str, jobs: int, block_size: int, chunk_rows: int, group_rows: int = 50) -> Files:
    """Return the bytes of estimates and flags of the good file by three methods, read and written in small pieces."""
    estimates, flags = folder / f"e.{extension}", folder / f"f.{extension}"
    words = ["localize", GOOD, "-q", "--overwrite", "-o", estimates, "--flags-out", flags]
    words += ["-m", "ml", "-m", "ls", "-m", "stansfield", "--jobs", jobs, "--block-size", block_size]
    keywords = TableWriter.__init__.__kwdefaults__
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(measurements, "ReadOptions", partial(measurements.ReadOptions, chunk_rows=chunk_rows))
        patch.setitem(keywords, "group_rows", group_rows)
        assert run([str(word) for word in words]) == 0
    return estimates.read_bytes(), flags.read_bytes()


@cache
def reference(extension: str) -> Files:
    """Return estimates and flags by one worker, all in one chunk and block."""
    with TemporaryDirectory() as folder:
        return solved(Path(folder), extension, 1, 4096, 131_072)


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
    """Estimates and flags are the same to the byte for any ``--jobs``, ``--block-size`` and cut of the input."""
    assert solved(tmp_path, extension, jobs, block_size, chunk_rows) == reference(extension)


@pytest.mark.parametrize(("jobs", "block_size", "chunk_rows"), [(1, 4096, 131_072), (3, 2, 11), (2, 7, 64)])
def test_row_groups_do_not_follow_blocks(tmp_path: Path, jobs: int, block_size: int, chunk_rows: int) -> None:
    """The row groups of the output have the writer's size, whatever the pieces in which rows came."""
    solved(tmp_path, "parquet", jobs, block_size, chunk_rows, group_rows=50)
    for name, rows in (("e", 120), ("f", 720)):
        told = pyarrow.parquet.read_metadata(tmp_path / f"{name}.parquet")
        sizes = [told.row_group(place).num_rows for place in range(told.num_row_groups)]
        assert sizes == [50] * (rows // 50) + [rows % 50]


def test_a_long_file_has_row_groups_of_a_fixed_size(tmp_path: Path) -> None:
    """Beyond one row group too: its size is the writer's own, not that of the blocks drawn or solved."""
    drawn, flags = tmp_path / "m.parquet", tmp_path / "f.parquet"
    assert run(["simulate", "ring", "-n", "45000", "-p", "sensors=3", "-q", "-o", str(drawn)]) == 0
    words = ["localize", str(drawn), "-m", "ls", "--block-size", "999", "-q", "-o", str(tmp_path / "e.parquet")]
    assert run([*words, "--flags-out", str(flags)]) == 0
    for path in (drawn, flags):
        told = pyarrow.parquet.read_metadata(path)
        assert [told.row_group(place).num_rows for place in range(told.num_row_groups)] == [
            GROUP_ROWS,
            135_000 - GROUP_ROWS,
        ]


@pytest.mark.parametrize("extension", EXTENSIONS)
def test_equal_seeds_draw_equal_files(tmp_path: Path, extension: str) -> None:
    """``simulate`` writes the same bytes for the same seed, and other bytes for another."""
    paths = [tmp_path / f"{name}.{extension}" for name in "abc"]
    for path, seed in zip(paths, ("5", "5", "6"), strict=True):
        assert run(["simulate", "random", "-n", "20", "--seed", seed, "-q", "-o", str(path)]) == 0
    first, second, third = (path.read_bytes() for path in paths)
    assert first == second != third
