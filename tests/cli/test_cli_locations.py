"""URLs instead of paths, in a store of fsspec in this process."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import fsspec
import pyarrow as pa
import pyarrow.fs
import pyarrow.parquet
import pytest
from cli_support import FIXTURES, Outcome
from plugins import ActInCall, calls_made

from nlosctl.errors import DataError
from nlosctl.io.paths.locations import location
from nlosctl.pipeline.engine.slices import SliceWork

pytestmark = pytest.mark.extensive

Cli = Callable[..., Outcome]
NAMES = [f"good_bearings{end}" for end in (".csv", ".csv.gz", ".jsonl", ".arrow", ".arrows", ".parquet")]
SCENE = "good_bearings.scene.toml"


@pytest.fixture
def store() -> Iterator[Any]:
    """Yield a store with the valid bearings and their scene in ``/in``, empty before and after."""
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


@pytest.mark.process
def test_all_outputs_may_be_urls(cli: Cli, store: Any) -> None:
    """Flags, report, bad rows and an explicit scene are URLs too; bytes do not depend on the jobs."""
    source = (FIXTURES / "good_bearings.csv").read_text().splitlines()
    source[3] = source[3].replace(source[3].split(",")[2], "nowhere")
    store.pipe("/bad/rows.csv", "\n".join(source).encode())
    written = []
    for jobs in (1, 2):
        words = ["--flags-out", "memory://out/flags.parquet", "--bad-rows", "memory://out/bad.csv", "--overwrite"]
        words += ["--report", "memory://out/report.json", "--scene", f"memory://in/{SCENE}", "--jobs", jobs]
        outcome = cli("localize", "memory://bad/rows.csv", "-o", "memory://out/fixes.parquet", *words)
        assert outcome.code == 0, outcome.err
        written.append([store.cat(f"/out/{name}") for name in ("fixes.parquet", "flags.parquet", "bad.csv")])
    assert written[0] == written[1]
    assert b"nowhere" in written[0][2]
    assert store.cat("/out/report.json").startswith(b"{")


@pytest.mark.process
def test_a_folder_of_a_store_is_one_table_with_its_keys(cli: Cli, store: Any, tmp_path: Path) -> None:
    """Parts in order of their names without hidden ones; ``key=value`` is a column; also into a folder on disk."""
    table = pa.parquet.read_table(FIXTURES / "good_bearings.parquet")
    for year, (first, rows_) in {2025: (0, 101), 2026: (101, 139)}.items():
        sink = pa.BufferOutputStream()
        pa.parquet.write_table(table.slice(first, rows_), sink)
        store.pipe(f"/all/year={year}/p.parquet", sink.getvalue().to_pybytes())
    store.pipe("/all/_log/x.parquet", b"no table")
    outcome = cli(
        "localize", "memory://all", "--scene", f"memory://in/{SCENE}", "--carry", "year", "-o", "fixes.parquet"
    )
    assert outcome.code == 0, outcome.err
    found = pa.parquet.read_table(tmp_path / "fixes.parquet")
    assert found.num_rows == 40
    assert set(found["year"].to_pylist()) == {2025, 2026}
    outcome = cli(
        "localize", "memory://all/", "--scene", f"memory://in/{SCENE}", "--carry", "year", "-o", "parts/", "--jobs", 2
    )
    assert outcome.code == 0, outcome.err
    names = ["year=2025/p.parquet", "year=2026/p.parquet"]
    parts = pa.concat_tables([rows((tmp_path / "parts" / name).read_bytes()) for name in names])
    assert parts.equals(found.replace_schema_metadata(None))


@pytest.mark.process
def test_a_pattern_matches_names_in_a_store(cli: Cli, store: Any) -> None:
    """``*`` matches within a folder, ``**`` descends; each file is a table of its own, as on disk."""
    store.pipe("/in/deep/er/good_bearings.csv", store.cat("/in/good_bearings.csv"))
    words = ("--scene", f"memory://in/{SCENE}", "-o", "fixes.csv", "--overwrite")
    assert "40 snapshots" in cli("localize", "memory://in/*.csv", *words).err
    output = cli("localize", "memory://in/**/*.csv", *words).err
    assert "80 snapshots" in output
    assert "no file matches" in cli("localize", "memory://in/*.pq").err


def test_file_urls_are_paths(cli: Cli, tmp_path: Path) -> None:
    """``file:///...`` reads and writes the path, ``%20`` a space; another host is refused."""
    (tmp_path / "a b.parquet").write_bytes((FIXTURES / "good_bearings.parquet").read_bytes())
    (tmp_path / "scene.toml").write_bytes((FIXTURES / SCENE).read_bytes())
    outcome = cli("localize", f"file://{tmp_path}/a%20b.parquet", "-o", f"file://{tmp_path}/out.parquet")
    assert outcome.code == 0, outcome.err
    assert pa.parquet.read_table(tmp_path / "out.parquet").num_rows == 40
    assert cli("localize", "file://elsewhere/a.parquet").code == 2


def test_objects_are_not_overwritten(cli: Cli, store: Any) -> None:
    """An existing object stays, also if the run fails; the input is never the output."""
    store.pipe("/out/fixes.parquet", b"mine")
    source, target = "memory://in/good_bearings.csv", "memory://out/fixes.parquet"
    assert "--overwrite replaces it" in cli("localize", source, "-o", target).err
    store.pipe("/bad/rows.csv", store.cat("/in/good_bearings.csv").replace(b"0.", b"x", 1))
    assert cli("localize", "memory://bad/rows.csv", "-o", target, "--overwrite").code == 1
    assert store.cat("/out/fixes.parquet") == b"mine"
    assert "is the input" in cli("localize", source, "-o", source, "--overwrite").err
    assert cli("localize", source, "-o", target, "--overwrite").code == 0
    assert rows(store.cat("/out/fixes.parquet")).num_rows == 40


def in_parts(folder: Path) -> Path:
    """Write the good bearings and their scene in three parts, the second within folders, cut within snapshots."""
    table = pa.parquet.read_table(FIXTURES / "good_bearings.parquet")
    for name, first, rows_ in (("a", 0, 61), ("key=1/b", 61, 80), ("z", 141, 99)):
        path = folder / f"{name}.parquet"
        path.parent.mkdir(parents=True, exist_ok=True)
        pa.parquet.write_table(table.slice(first, rows_), path)
    (folder / "scene.toml").write_bytes((FIXTURES / SCENE).read_bytes())
    return folder


@pytest.fixture(params=["fsspec", "with folders"])
def root(request: pytest.FixtureRequest, store: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """The URL of a store without folders, and of one of pyarrow's with folders and visible partial files."""
    if request.param == "fsspec":
        return "memory://bucket"
    (tmp_path / "disk" / "bucket").mkdir(parents=True)
    found = pa.fs.SubTreeFileSystem(str(tmp_path / "disk"), pa.fs.LocalFileSystem())
    monkeypatch.setattr(
        "nlosctl.io.paths.remote_path.filesystem_of", lambda _, __, authority, query: (found, authority)
    )
    return "hdfs://bucket"


def content(url: str) -> dict[str, bytes]:
    """Return the bytes of every file below a URL."""
    return {"/".join(steps): path.open().read() for path, steps, _ in location(url).files(recursive=True)}


def on_disk(folder: Path) -> dict[str, bytes]:
    """Return the bytes of every file below a folder."""
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.process
def test_a_folder_of_a_store_is_filled_as_one_on_disk(cli: Cli, root: str, tmp_path: Path) -> None:
    """Parts, flags and manifests have the bytes of a local run for any number of jobs; nothing else is left."""
    in_parts(tmp_path / "in")
    assert cli("localize", "in", "-o", "local/", "--flags-out", "local_flags/").code == 0
    for number, jobs in enumerate((1, 2)):
        outcome = cli("localize", "in", "-o", f"{root}/o{number}/", "--flags-out", f"{root}/f{number}/", "--jobs", jobs)
        assert outcome.code == 0, outcome.err
        assert content(f"{root}/o{number}") == on_disk(tmp_path / "local")
        assert content(f"{root}/f{number}") == on_disk(tmp_path / "local_flags")
    assert not (location(root) / "o0" / "_unfinished").exists()


@pytest.mark.process
def test_a_run_into_a_store_is_resumed(cli: Cli, root: str, tmp_path: Path, acting_method: ActInCall) -> None:
    """A run that fails at its second part keeps the first; ``--resume`` solves the others, and a changed part."""
    in_parts(tmp_path / "in")
    acting_method(-1, lambda: None)
    assert cli("localize", "in", "-m", "acting", "-o", "local/").code == 0
    all_calls = calls_made()
    words = ("localize", "in", "-m", "acting", "--jobs", 1, "-o", f"{root}/out/")

    def fail() -> None:
        raise DataError("the store is gone")

    acting_method(all_calls // 2, fail)
    assert "the store is gone" in cli(*words).err
    assert "unfinished run" in cli(*words).err
    calls = []
    for changed, more in (
        (None, "--resume"),
        (None, "--resume"),
        ("key=1/b.parquet", "--resume"),
        (None, "--overwrite"),
    ):
        if changed:
            (tmp_path / "changed").write_bytes(b"half")
            (location(f"{root}/out") / changed).take(tmp_path / "changed")
        acting_method(-1, lambda: None)
        outcome = cli(*words, more)
        assert outcome.code == 0, outcome.err
        calls.append(calls_made())
        assert content(f"{root}/out") == on_disk(tmp_path / "local")
    others, none, one, everything = calls
    assert none == 0 < one < others < everything == all_calls
    assert "contains results already" in cli(*words).err
    assert "method" in cli(*words, "-m", "ls", "--resume").err


@pytest.mark.process
def test_slices_solved_by_an_engine_fill_a_file_of_a_store(
    cli: Cli, root: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A single file of a store is assembled from slices; nothing else is written there or in the current folder."""
    in_parts(tmp_path / "in")
    assert cli("localize", "in", "-o", "local.parquet").code == 0
    made = []

    def engine(work: SliceWork, numbers: Sequence[int]) -> Iterator[Any]:
        made.extend(numbers)
        yield from map(work.make, numbers)

    monkeypatch.setattr("nlosctl.pipeline.engine.dask_engine.dask_engine", lambda scheduler, jobs, timeout_s: engine)
    before = sorted(tmp_path.iterdir())
    outcome = cli("localize", "in", "-o", f"{root}/fixes.parquet", "--engine", "dask")
    assert outcome.code == 0, outcome.err
    assert made == [0, 1, 2]
    assert content(root) == {"fixes.parquet": (tmp_path / "local.parquet").read_bytes()}
    assert [path.name for path in location(root).iterdir()] == ["fixes.parquet"]
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.process
def test_other_objects_are_kept(cli: Cli, root: str, tmp_path: Path) -> None:
    """A folder with other files is refused, and ``--overwrite`` keeps files beside the parts."""
    in_parts(tmp_path / "in")
    words = ("localize", "in", "-o", f"{root}/out/", "--overwrite")
    (tmp_path / "mine").write_bytes(b"mine")
    (location(f"{root}/out") / "deep").mkdir()
    (location(f"{root}/out") / "deep" / "mine").take(tmp_path / "mine")
    assert "contains other files ('deep')" in cli(*words).err
    assert content(f"{root}/out") == {"deep/mine": b"mine"}
    assert cli("localize", "in", "-o", f"{root}/free/").code == 0
    (location(f"{root}/free") / "key=1" / "mine").take(tmp_path / "mine")
    assert "contains other files" in cli("localize", "in", "-o", f"{root}/free/", "--overwrite").err
    assert content(f"{root}/free") == {"key=1/mine": b"mine"}


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["memory://in/nothing.csv"], 1, "memory://in/nothing.csv: there is no such file or folder"),
        (["memry://in/a.csv"], 2, "unknown scheme 'memry' (did you mean 'memory'?)"),
        (["s3://key:secret@bucket/a.csv"], 2, "a password in a name"),
        (["memory://in/good_bearings.csv", "-o", "memory://in/"], 1, "are nested"),
        (
            ["memory://in/good_bearings.csv", "-o", "memory://in/good_bearings.jsonl/"],
            1,
            "is a file, expected a folder",
        ),
        (
            ["memory://in/good_bearings.csv", "--scene", "memory://in/no.toml"],
            1,
            "the scene can't be read: No such file",
        ),
        (["memory://in/good_bearings.csv", "-o", "memory://out/x.what"], 2, "unknown file extension"),
    ],
)
def test_invalid_urls(cli: Cli, store: Any, words: list[str], code: int, message: str) -> None:
    """Each fault is one line that names the URL, and no secret."""
    outcome = cli("localize", *words)
    assert (outcome.code, outcome.err.count("\n")) == (code, 1), outcome.err
    assert message in outcome.err
    assert "secret" not in outcome.err
