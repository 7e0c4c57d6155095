"""URLs in place of paths: the store is fsspec's, in this process, so that only reading and sending are tested here."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import fsspec
import pyarrow as pa
import pyarrow.parquet
import pytest
from cli_support import FIXTURES, Outcome

Cli = Callable[..., Outcome]
NAMES = [f"good_bearings{end}" for end in (".csv", ".csv.gz", ".jsonl", ".arrow", ".arrows", ".parquet")]
SCENE = "good_bearings.scene.toml"


@pytest.fixture
def store() -> Iterator[Any]:
    """Give a store with the good bearings and their scene in ``/in``; it is empty before and after."""
    memory = fsspec.filesystem("memory")
    memory.rm("/", recursive=True)
    for name in [*NAMES, SCENE]:
        memory.pipe(f"/in/{name}", (FIXTURES / name).read_bytes())
    yield memory
    memory.rm("/", recursive=True)


def rows(content: bytes) -> Any:
    """Return the table in the bytes of a Parquet file, without its metadata."""
    return pa.parquet.read_table(pa.BufferReader(content)).replace_schema_metadata(None)


@pytest.mark.parametrize("name", NAMES)
def test_a_url_is_read_and_written_as_a_path_is(cli: Cli, store: Any, tmp_path: Path, name: str) -> None:
    """In every format, with the scene beside it, the rows are those of the same file on disk."""
    assert cli("localize", FIXTURES / name, "-o", "local.parquet").code == 0
    assert cli("localize", f"memory://in/{name}", "-o", "memory://out/fixes.parquet").code == 0
    assert rows(store.cat("/out/fixes.parquet")).equals(rows((tmp_path / "local.parquet").read_bytes()))


def test_all_outputs_may_be_urls(cli: Cli, store: Any) -> None:
    """Flags, report, bad rows and an explicit scene go by URLs too; the bytes do not depend on the jobs."""
    source = (FIXTURES / "good_bearings.csv").read_text().splitlines()
    source[3] = source[3].replace(source[3].split(",")[2], "nowhere")
    store.pipe("/bad/rows.csv", "\n".join(source).encode())
    written = []
    for jobs in (1, 2):
        words = ["--flags-out", "memory://out/flags.parquet", "--bad-rows", "memory://out/bad.csv", "--overwrite"]
        words += ["--report", "memory://out/report.json", "--scene", f"memory://in/{SCENE}", "--jobs", jobs]
        told = cli("localize", "memory://bad/rows.csv", "-o", "memory://out/fixes.parquet", *words)
        assert told.code == 0, told.err
        written.append([store.cat(f"/out/{name}") for name in ("fixes.parquet", "flags.parquet", "bad.csv")])
    assert written[0] == written[1]
    assert b"nowhere" in written[0][2]
    assert store.cat("/out/report.json").startswith(b"{")


def test_a_folder_of_a_store_is_one_table_with_its_keys(cli: Cli, store: Any, tmp_path: Path) -> None:
    """Parts in the order of their names, hidden ones left out, ``key=value`` a column; also into a folder of a disk."""
    table = pa.parquet.read_table(FIXTURES / "good_bearings.parquet")
    for year, (first, rows_) in {2025: (0, 101), 2026: (101, 139)}.items():
        sink = pa.BufferOutputStream()
        pa.parquet.write_table(table.slice(first, rows_), sink)
        store.pipe(f"/all/year={year}/p.parquet", sink.getvalue().to_pybytes())
    store.pipe("/all/_log/x.parquet", b"no table")
    told = cli("localize", "memory://all", "--scene", f"memory://in/{SCENE}", "--carry", "year", "-o", "fixes.parquet")
    assert told.code == 0, told.err
    found = pa.parquet.read_table(tmp_path / "fixes.parquet")
    assert found.num_rows == 40
    assert set(found["year"].to_pylist()) == {2025, 2026}
    told = cli(
        "localize", "memory://all/", "--scene", f"memory://in/{SCENE}", "--carry", "year", "-o", "parts/", "--jobs", 2
    )
    assert told.code == 0, told.err
    names = ["year=2025/p.parquet", "year=2026/p.parquet"]
    parts = pa.concat_tables([rows((tmp_path / "parts" / name).read_bytes()) for name in names])
    assert parts.equals(found.replace_schema_metadata(None))


def test_a_pattern_matches_names_in_a_store(cli: Cli, store: Any) -> None:
    """``*`` stays within a folder, ``**`` goes down; each file is a table of its own, as with a pattern of a disk."""
    store.pipe("/in/deep/er/good_bearings.csv", store.cat("/in/good_bearings.csv"))
    words = ("--scene", f"memory://in/{SCENE}", "-o", "fixes.csv", "--overwrite")
    assert "40 snapshots" in cli("localize", "memory://in/*.csv", *words).err
    told = cli("localize", "memory://in/**/*.csv", *words).err
    assert "80 snapshots" in told
    assert "no file matches" in cli("localize", "memory://in/*.pq").err


def test_file_urls_are_paths(cli: Cli, tmp_path: Path) -> None:
    """``file:///...`` reads and writes the path, ``%20`` a space; another host is refused."""
    (tmp_path / "a b.parquet").write_bytes((FIXTURES / "good_bearings.parquet").read_bytes())
    (tmp_path / "scene.toml").write_bytes((FIXTURES / SCENE).read_bytes())
    told = cli("localize", f"file://{tmp_path}/a%20b.parquet", "-o", f"file://{tmp_path}/out.parquet")
    assert told.code == 0, told.err
    assert pa.parquet.read_table(tmp_path / "out.parquet").num_rows == 40
    assert cli("localize", "file://elsewhere/a.parquet").code == 2


def test_nothing_is_replaced_without_leave_and_no_half_is_sent(cli: Cli, store: Any) -> None:
    """An object that is there stays, also when the run fails; the input is never the output."""
    store.pipe("/out/fixes.parquet", b"mine")
    source, target = "memory://in/good_bearings.csv", "memory://out/fixes.parquet"
    assert "--overwrite replaces it" in cli("localize", source, "-o", target).err
    store.pipe("/bad/rows.csv", store.cat("/in/good_bearings.csv").replace(b"0.", b"x", 1))
    assert cli("localize", "memory://bad/rows.csv", "-o", target, "--overwrite").code == 1
    assert store.cat("/out/fixes.parquet") == b"mine"
    assert "is the input" in cli("localize", source, "-o", source, "--overwrite").err
    assert cli("localize", source, "-o", target, "--overwrite").code == 0
    assert rows(store.cat("/out/fixes.parquet")).num_rows == 40


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["memory://in/nothing.csv"], 1, "memory://in/nothing.csv: there is no such file or folder"),
        (["memry://in/a.csv"], 2, "unknown scheme 'memry' (did you mean 'memory'?)"),
        (["s3://key:secret@bucket/a.csv"], 2, "a password in a name"),
        (["memory://in/good_bearings.csv", "-o", "memory://out/"], 1, "a folder output lies on a disk"),
        (
            ["memory://in/good_bearings.csv", "--scene", "memory://in/no.toml"],
            1,
            "the scene can't be read: No such file",
        ),
        (["memory://in/good_bearings.csv", "-o", "memory://out/x.what"], 2, "the extension tells no format"),
    ],
)
def test_what_a_url_can_be_wrong_about_is_one_line(
    cli: Cli, store: Any, words: list[str], code: int, said: str
) -> None:
    """Each fault is told in one line that names the URL, and no secret."""
    told = cli("localize", *words)
    assert (told.code, told.err.count("\n")) == (code, 1), told.err
    assert said in told.err
    assert "secret" not in told.err
