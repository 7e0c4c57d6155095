"""Hostile files: each gives one clear line, soon, in little memory; nothing in them is executed."""

from __future__ import annotations

import ast
import gzip
import json
import os
import resource
import subprocess
import sys
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
from guarded_run import Ending, complaints, run_guarded
from plugins import install_plugin
from writing_jobs import FIXTURES

pytestmark = pytest.mark.extensive

ROOT = Path(__file__).parents[2]
HEADER = b"snapshot,sensor,sensor_x_m,sensor_y_m,bearing_rad,bearing_std_rad\n"
ROW = b"1,a,0.0,0.0,0.5,0.01\n"
GOOD = FIXTURES / "good_bearings.csv"


def assert_refused(folder: Path, words: list[Any], message: str, *, code: int = 1) -> Ending:
    """Check that a run ends according to the rules, with a line that contains ``message``."""
    before = [path.name for path in folder.iterdir()]
    ending = run_guarded([*words, "-q"], seconds=60)
    assert list(complaints(ending, folder, [], before)) == []
    assert ending.code == code
    assert message in ending.err
    assert len(ending.err.splitlines()) == 1
    return ending


def gzip_bomb(path: Path, head: bytes, filler: bytes, mebibytes: int) -> None:
    """Write a gzipped file that expands to ``mebibytes`` of a filler after its head."""
    packer = zlib.compressobj(9, wbits=31)
    with path.open("wb") as file:
        file.write(packer.compress(head))
        block = filler * ((1 << 20) // len(filler))
        for _ in range(mebibytes):
            file.write(packer.compress(block))
        file.write(packer.flush())


@pytest.mark.parametrize("name", ["m.csv.gz", "m.jsonl.gz"])
def test_gzip_of_an_endless_line(name: str, folder: Path) -> None:
    """A gzip of zeros is refused at its first line by the limit on lines."""
    gzip_bomb(folder / name, HEADER if "csv" in name else b"{", b"0", 64)
    assert_refused(folder, ["localize", name, "-o", "e.csv"], "longer than 4194304 bytes")


@pytest.mark.parametrize("limit", [None, "2000"])
def test_gzip_bombs_of_valid_rows(limit: str | None, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A gzip that expands hundreds of times is refused, even if its rows are valid."""
    monkeypatch.setenv("NLOSCTL_MAX_UNCHECKED_EXPANSION_MB", "4")
    gzip_bomb(folder / "m.csv.gz", HEADER, ROW, 16)
    if limit is None:
        assert_refused(folder, ["validate", "m.csv.gz"], "expands to more than 250 times its compressed size")
        return
    monkeypatch.setenv("NLOSCTL_MAX_EXPANSION", limit)
    assert_refused(folder, ["localize", "m.csv.gz", "-o", "e.csv", "--max-snapshot-rows", 1000], "more than 1000 rows")


def test_parquet_bombs(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Parquet pages that expand hundreds of times are refused before they are decompressed."""
    monkeypatch.setenv("NLOSCTL_MAX_UNCHECKED_EXPANSION_MB", "1")
    rows = 1_000_000
    table = pa.table({name: np.zeros(rows) for name in HEADER.decode().strip().split(",")})
    pa.parquet.write_table(table, folder / "m.parquet", compression="zstd", use_dictionary=False)
    assert (folder / "m.parquet").stat().st_size < 100_000
    assert_refused(
        folder, ["localize", "m.parquet", "-o", "e.csv"], "expands to more than 250 times its compressed size"
    )


def constant_parquet(path: Path, rows: int) -> None:
    """Write a small Parquet file of one snapshot with many equal rows."""
    count = 1_000_000
    numbers = {name: pa.array(np.zeros(count)) for name in ("sensor_x_m", "sensor_y_m", "bearing_rad")}
    columns = {"snapshot": pa.array(np.ones(count, dtype=np.int64)), "sensor": pa.array(["a"] * count), **numbers}
    table = pa.table({**columns, "bearing_std_rad": pa.array(np.ones(count))})
    with pa.parquet.ParquetWriter(path, table.schema, compression="zstd") as writer:
        for _ in range(rows // count):
            writer.write_table(table)


def test_a_snapshot_of_ten_million_rows(folder: Path) -> None:
    """A huge snapshot is refused at the limit of rows, independent of the metadata of the file."""
    constant_parquet(folder / "m.parquet", 10_000_000)
    assert_refused(folder, ["localize", "m.parquet", "-o", "e.csv"], "a snapshot has more than 1000000 rows")
    assert_refused(folder, ["validate", "m.parquet", "--max-snapshot-rows", 5], "raise --max-snapshot-rows")


def test_arrow_buffers_with_false_sizes(folder: Path) -> None:
    """An Arrow file with a buffer that claims a billion gigabytes is refused."""
    table = pa.table({name: np.arange(500.0) for name in HEADER.decode().strip().split(",")})
    sink = pa.BufferOutputStream()
    with pa.ipc.new_file(sink, table.schema, options=pa.ipc.IpcWriteOptions(compression="zstd")) as writer:
        writer.write_table(table)
    content = sink.getvalue().to_pybytes()
    claimed = (4000).to_bytes(8, "little")
    assert content.count(claimed) >= 5
    (folder / "m.arrow").write_bytes(content.replace(claimed, (1 << 59).to_bytes(8, "little")))
    assert_refused(folder, ["localize", "m.arrow", "-o", "e.csv"], "m.arrow")


@pytest.mark.process
@pytest.mark.slow
@pytest.mark.parametrize("whose", ["ours", "the system's"])
def test_memory_limits_are_reported(whose: str, folder: Path) -> None:
    """Exceeding NLOSCTL_MAX_MEMORY_MB or the system's limit is one line that names it."""
    numbers = {name: np.zeros(20_000_000) for name in ("sensor_x_m", "sensor_y_m", "bearing_rad", "bearing_std_rad")}
    table = pa.table({"snapshot": np.arange(20_000_000), "sensor": np.arange(20_000_000), **numbers})
    options = pa.ipc.IpcWriteOptions(compression="zstd")
    with (
        pa.OSFile(str(folder / "m.arrow"), "wb") as file,
        pa.ipc.new_file(file, table.schema, options=options) as writer,
    ):
        writer.write_table(table)
    ours = {"NLOSCTL_MAX_MEMORY_MB": "700"} if whose == "ours" else {}
    limit = "" if ours else "ulimit -d 716800; "
    program = Path(sys.executable).with_name("nlosctl")
    done = subprocess.run(
        ["bash", "-c", f"{limit}exec {program} localize m.arrow -o e.csv -q --jobs 1"],
        capture_output=True,
        cwd=folder,
        env={**os.environ, **ours, "OMP_NUM_THREADS": "1"},
        check=False,
        timeout=120,
    )
    assert (done.returncode, done.stdout) == (1, b"")
    assert len(done.stderr.splitlines()) == 1
    assert b"NLOSCTL_MAX_MEMORY_MB" in done.stderr


@pytest.mark.process
@pytest.mark.slow
def test_the_memory_of_a_long_file_is_bounded(folder: Path) -> None:
    """A gzip of 400 MiB of rows is refused in less than 400 MiB of memory."""
    gzip_bomb(folder / "m.csv.gz", HEADER, ROW, 400)
    words = [Path(sys.executable).with_name("nlosctl"), "validate", "m.csv.gz", "-q"]
    script = (
        "import resource, subprocess, sys; "
        "code = subprocess.run(sys.argv[1:], stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL).returncode; "
        "print(code, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)"
    )
    done = subprocess.run([sys.executable, "-c", script, *words], capture_output=True, cwd=folder, check=True)
    code, kibibytes = map(int, done.stdout.split())
    assert code == 1
    assert kibibytes < 400 * 1024
    assert resource.getpagesize() > 0


DEEP = {
    "brackets": "x = " + "[" * 100_000,
    "tables": "x = " + "{a = " * 5_000,
    "a dotted key": ".".join(["a"] * 200_000) + " = 1",
    "a dotted header": "[" + ".".join(["a"] * 100_000) + "]",
    "quoted parts": " . ".join(['"a"'] * 100_000) + " = 1",
    "a number": "x = " + "9" * 100_000,
    "a date": "x = 2026-02-31",
    "size": "# " + "x" * (17 << 20),
    "zero bytes": "\0" * 100,
}


@pytest.mark.parametrize("text", DEEP.values(), ids=DEEP.keys())
@pytest.mark.parametrize("option", ["--scene", "--config"])
def test_deep_or_huge_toml(option: str, text: str, folder: Path) -> None:
    """Deeply nested or huge TOML is refused soon, in a line that names the file."""
    (folder / "h.toml").write_text(text)
    assert_refused(folder, ["localize", GOOD, option, "h.toml", "-o", "e.csv"], "h.toml")


def test_hostile_scenes_in_metadata(folder: Path) -> None:
    """A hostile scene in a table's metadata is refused like one in a file."""
    for text in ("x = " + "[" * 100_000, "\udcff"):
        table = pa.parquet.read_table(FIXTURES / "good_bearings.parquet")
        scene = text.encode("utf-8", "surrogateescape")
        pa.parquet.write_table(table.replace_schema_metadata({"nlosctl.scene": scene}), folder / "m.parquet")
        assert_refused(folder, ["localize", "m.parquet", "-o", "e.csv"], "the scene in the table's metadata")


@pytest.mark.parametrize(
    "line", [b"[" * 200_000, b'{"a":' * 200_000, b'{"snapshot": ' + b"9" * 100_000 + b"}", b'{"a": 1' * 3]
)
def test_deep_json(line: bytes, folder: Path) -> None:
    """Deeply nested JSON is a bad line."""
    (folder / "m.jsonl").write_bytes(line + b"\n")
    assert_refused(folder, ["localize", "m.jsonl", "-o", "e.csv"], "m.jsonl")


def test_tables_of_very_many_columns(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A header of a hundred thousand columns is refused soon; the limit has a variable."""
    names = ",".join(f"c{place}" for place in range(100_000))
    (folder / "m.csv").write_text(f"{HEADER.decode().strip()},{names}\n")
    assert_refused(folder, ["localize", "m.csv", "-o", "e.csv"], "has 100006 columns, expected at most 10000")
    monkeypatch.setenv("NLOSCTL_MAX_COLUMNS", "200000")
    assert_refused(folder, ["localize", "m.csv", "-o", "e.csv"], "no rows")


CONTROLS = ["\x1b[31mred", "\x07", "a\nb", "a\r\nb", "\u202egnp.exe", "\u2028", "\x00", "\x7f", "\x9b2J"]


@pytest.mark.parametrize("name", CONTROLS, ids=ascii)
@pytest.mark.parametrize("extension", ["parquet", "jsonl"])
def test_names_with_control_characters(extension: str, name: str, folder: Path) -> None:
    """Names of columns, sensors and snapshots reach the terminal as printable characters only."""
    table = pa.table({"snapshot": [name] * 3, "sensor": [name] * 3, name: [1, 2, 3], "bearing_rad": [1.0, 9.0, None]})
    if extension == "parquet":
        pa.parquet.write_table(table, folder / "m.parquet")
    else:
        (folder / "m.jsonl").write_text("".join(json.dumps(row) + "\n" for row in table.to_pylist()))
    assert_refused(folder, ["localize", f"m.{extension}", "-o", "e.csv"], "sensor_x_m")
    outcome = run_guarded(["localize", f"m.{extension}", "--column", f"sensor_x_m={name}", "-q"])
    assert outcome.code in (1, 2)
    assert all(character.isprintable() or character == "\n" for character in outcome.err)


@pytest.mark.parametrize("name", ["\x1b[31m.csv", "a\nb.csv", "\u202e.csv"], ids=ascii)
def test_files_with_control_characters_in_their_names(name: str, folder: Path) -> None:
    """Any file name is printed in one printable line."""
    (folder / "in").mkdir()
    (folder / "in" / name).write_bytes(HEADER + ROW.replace(b"0.5", b"x"))
    before = [path.name for path in folder.iterdir()]
    ending = run_guarded(["localize", "in", "-o", "e.csv", "-q"])
    assert list(complaints(ending, folder, [], before)) == []
    assert ending.code == 1


PLUGINS = {
    "raises": ("raise OSError('no\\nluck')", "can't be loaded: OSError: no luck"),
    "exits": ("import sys; sys.exit(0)", "can't be loaded: SystemExit"),
    "is not a method": ("METHOD = 3", "is a int, not a"),
    "lacks it": ("", "can't be loaded: AttributeError"),
    "raises on solve": ("def solve(b, o): raise ValueError('no\\nluck')", "failed: ValueError: no luck"),
    "exits on solve": ("def solve(b, o): raise SystemExit", "failed: SystemExit"),
    "gives none": ("def solve(b, o): return None", "returned a NoneType, not a Solution"),
    "gives NaN": ("solve = lambda b, o: answer(b, position_m=np.full((b.size, 2), np.nan))", "position is [nan, nan]"),
    "gives infinity": ("solve = lambda b, o: answer(b, covariance_m2=np.full((b.size, 3), np.inf))", "covariance is"),
    "gives no ellipse": ("solve = lambda b, o: answer(b, covariance_m2=np.full((b.size, 3), -1.0))", "not positive"),
    "is short": ("solve = lambda b, o: answer(b, position_m=np.zeros((1, 2)))", "position_m has shape (1, 2)"),
    "is flat": ("solve = lambda b, o: answer(b, cost=np.zeros((b.size, 2)))", "cost has shape"),
    "is text": ("solve = lambda b, o: answer(b, cost=np.full(b.size, 'x'))", "cost is"),
    "is a list": ("solve = lambda b, o: answer(b, cost=[0.0] * b.size)", "cost has shape"),
    "has no such status": ("solve = lambda b, o: answer(b, status=np.full(b.size, 77, np.uint8))", "unknown status 77"),
    "misses one": ("solve = lambda b, o: answer(b, row=np.zeros(b.size, int))", "got no estimate"),
    "knows others": ("solve = lambda b, o: answer(b, row=np.arange(b.size) + 1)", "is not one of its"),
    "has odd flags": ("solve = lambda b, o: answer(b, flags=Flags(used=np.ones(3, bool)))", "flag 'used' has shape"),
    "counts as flags": ("solve = lambda b, o: answer(b, flags=Flags(used=np.ones(b.bearing_rad.shape)))", "booleans"),
}
FRAME = """
import dataclasses
import numpy as np
from nlosctl.contract.methods import MethodSpec
from nlosctl.contract.results import Flags, Solution, single_estimates
from nlosctl.contract.statuses import Status
{fault}
def answer(b, flags=None, **changes):
    zeros = np.zeros(b.size)
    form = dict(position_m=np.zeros((b.size, 2)), covariance_m2=np.tile([1.0, 0.0, 1.0], (b.size, 1)), cost=zeros,
                n_used=np.ones(b.size, int), status=np.zeros(b.size, np.uint8))
    return Solution(estimates=dataclasses.replace(single_estimates(**form), **changes), flags=flags)
@dataclasses.dataclass(frozen=True, kw_only=True)
class Options:
    pass
{method}
"""
METHOD = """METHOD = MethodSpec(name="hostile", kind="bearings", job="localize", summary="s", reference="r",
    options=Options, solve=solve, cost="c", minimum_measurements=1, contract_version=1)"""


@pytest.mark.parametrize(("fault", "message"), PLUGINS.values(), ids=PLUGINS.keys())
def test_faulty_plugins(fault: str, message: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A plugin that raises, exits or returns nonsense is reported by name and fault; no output is written."""
    (folder / "hostile.py").write_text(FRAME.format(fault=fault, method=METHOD if "solve" in fault else ""))
    install_plugin(folder, monkeypatch, "bearings.hostile", "hostile:METHOD")
    monkeypatch.delitem(sys.modules, "hostile", raising=False)
    words = ["localize", GOOD, "-m", "hostile", "-o", "e.csv", "--flags-out", "f.csv"]
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    ending = assert_refused(folder, words, message)
    assert "hostile" in ending.err
    monkeypatch.delitem(sys.modules, "hostile", raising=False)


def package_trees() -> list[Any]:
    """Return each module of the package, parsed."""
    paths = sorted((ROOT / "nlosctl").rglob("*.py"))
    return [pytest.param(ast.parse(path.read_text()), id=str(path.relative_to(ROOT))) for path in paths]


FORBIDDEN_MODULES = {"pickle", "cPickle", "dill", "marshal", "shelve", "subprocess", "ctypes", "xml", "yaml", "code"}
FORBIDDEN_CALLS = {"eval", "exec", "compile", "__import__", "system", "popen", "fork", "spawnv", "execv", "read_pickle"}


@pytest.mark.parametrize("tree", package_trees())
def test_the_package_executes_no_data(tree: ast.Module) -> None:
    """The package uses no pickle, eval or shell, and no XML parser that expands entities."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            assert {alias.name.partition(".")[0] for alias in node.names} & FORBIDDEN_MODULES == set()
        elif isinstance(node, ast.ImportFrom):
            if node.module in ("xml.parsers", "xml.sax.saxutils"):  # expat set to refuse entities, and escaping
                continue
            assert (node.module or "").partition(".")[0] not in FORBIDDEN_MODULES
        elif isinstance(node, ast.Call) and not ast.unparse(node.func).startswith(("re.", "np.random.")):
            name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            assert name not in FORBIDDEN_CALLS
            allowed = {word.arg: ast.unparse(word.value) for word in node.keywords}
            assert allowed.get("allow_pickle", "False") == allowed.get("shell", "False") == "False"


def test_manifests_with_paths_outside_the_folder(folder: Path) -> None:
    """Paths outside the folder in a manifest or plan are neither read, replaced nor removed."""
    (folder / "in").mkdir()
    (folder / "precious").write_text("precious")
    text = GOOD.read_text().splitlines(keepends=True)
    (folder / "in" / "a.csv").write_text("".join(text[:13]))
    (folder / "in" / "b.csv").write_text("".join([text[0], *text[13:25]]))
    scene = FIXTURES / "good_bearings.scene.toml"
    words = ["localize", "in", "--scene", scene, "-o", "out/", "-q"]
    assert run_guarded(words).code == 0
    manifest = folder / "out" / "_manifest.json"
    for name in ("../precious", str(folder / "precious"), "x/../../precious", "..", ""):
        output = json.loads(manifest.read_text().replace('"a.', f'{json.dumps(name)[:-1]}" , "was": "a.', 1))
        manifest.write_text(json.dumps(output))
        run_guarded([*words, "--overwrite"])
        assert (folder / "precious").read_text() == "precious"
        run_guarded([*words, "--resume"])
        assert (folder / "precious").read_text() == "precious"


@pytest.mark.parametrize(
    "text",
    ["", "[]", "{}", "null", "{" * 9, "[" * 200_000, '{"parts": 3, "inputs": 4, "table": 5}', '{"plan": []}', "\0",
     '{"parts": [{"files": 1}], "inputs": [], "table": "estimates"}', '{"parts": [], "inputs": [], "table": {}}'],
    ids=lambda text: ascii(text)[:30],
)  # fmt: skip
@pytest.mark.parametrize("place", ["_manifest.json", "_unfinished/plan.json", "_unfinished/000000.json"])
@pytest.mark.parametrize("option", ["--resume", "--overwrite", None])
def test_corrupted_manifests(place: str, text: str, option: str | None, folder: Path) -> None:
    """With any corrupted manifest, plan or record a run succeeds or gives one clear line."""
    (folder / "in").mkdir()
    (folder / "in" / "a.csv").write_text("".join(GOOD.read_text().splitlines(keepends=True)[:13]))
    (folder / "out" / "_unfinished").mkdir(parents=True)
    (folder / "out" / place).write_text(text)
    words = ["localize", "in", "--scene", FIXTURES / "good_bearings.scene.toml", "-o", "out/", "-q"]
    ending = run_guarded([*words, *([option] if option else [])])
    assert list(complaints(ending, folder, [], ["in", "out"])) == []


@pytest.mark.parametrize(
    "declaration",
    ['<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;">]>',
     '<!DOCTYPE x [<!ENTITY a SYSTEM "file:///etc/passwd">]>', '<!DOCTYPE x SYSTEM "http://127.0.0.1:9/x.dtd">'],
    ids=["a billion laughs", "a file", "a document type from elsewhere"],
)  # fmt: skip
def test_xml_with_entities(declaration: str, folder: Path) -> None:
    """XML importers refuse declared entities and document types."""
    (folder / "h.xml").write_text(f"<?xml version='1.0'?>{declaration}<DATA><TIME>&a;&b;</TIME></DATA>")
    for ending in (
        run_guarded(["convert", "h.xml", "-o", "o.csv", "--from", "kraken-xml", "-q"]),
        run_guarded(["convert", "h.xml", "-o", "o.csv", "-q"]),
    ):
        assert ending.code in (1, 2)
        assert list(complaints(ending, folder, [], ["h.xml"])) == []
        assert "root:" not in ending.err


def test_gzip_within_gzip_is_refused(folder: Path) -> None:
    """A file compressed twice is reported as not text."""
    (folder / "m.csv.gz").write_bytes(gzip.compress(gzip.compress(HEADER + ROW)))
    assert_refused(folder, ["localize", "m.csv.gz", "-o", "e.csv"], "m.csv.gz")
