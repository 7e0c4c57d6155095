"""Files made to do harm: each ends in one clear line, soon, in little memory; nothing of them is executed or obeyed."""

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

ROOT = Path(__file__).parents[2]
HEADER = b"snapshot,sensor,sensor_x_m,sensor_y_m,bearing_rad,bearing_std_rad\n"
ROW = b"1,a,0.0,0.0,0.5,0.01\n"
GOOD = FIXTURES / "good_bearings.csv"


def refused(folder: Path, words: list[Any], told: str, *, code: int = 1) -> Ending:
    """Run, hold the end to the law, and find ``told`` in the line."""
    before = [path.name for path in folder.iterdir()]
    ending = run_guarded([*words, "-q"], seconds=60)
    assert list(complaints(ending, folder, [], before)) == []
    assert ending.code == code
    assert told in ending.err
    assert len(ending.err.splitlines()) == 1
    return ending


def gzip_bomb(path: Path, head: bytes, filler: bytes, mebibytes: int) -> None:
    """Write a gzipped file that unpacks to ``mebibytes`` of a filler after its head."""
    packer = zlib.compressobj(9, wbits=31)
    with path.open("wb") as file:
        file.write(packer.compress(head))
        block = filler * ((1 << 20) // len(filler))
        for _ in range(mebibytes):
            file.write(packer.compress(block))
        file.write(packer.flush())


@pytest.mark.parametrize("name", ["m.csv.gz", "m.jsonl.gz"])
def test_a_line_without_end_in_a_zip(name: str, folder: Path) -> None:
    """A gzip of zeros is refused at its first line: a line has a limit."""
    gzip_bomb(folder / name, HEADER if "csv" in name else b"{", b"0", 64)
    refused(folder, ["localize", name, "-o", "e.csv"], "longer than 4194304 bytes")


@pytest.mark.parametrize("limit", [None, "2000"])
def test_a_zip_bomb_of_good_rows(limit: str | None, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A gzip that unpacks to hundreds of times its size is refused by name, however good its rows are."""
    monkeypatch.setenv("NLOSCTL_MAX_UNCHECKED_EXPANSION_MB", "4")
    gzip_bomb(folder / "m.csv.gz", HEADER, ROW, 16)
    if limit is None:
        refused(folder, ["validate", "m.csv.gz"], "expands to more than 250 times its compressed size")
        return
    monkeypatch.setenv("NLOSCTL_MAX_EXPANSION", limit)
    refused(folder, ["localize", "m.csv.gz", "-o", "e.csv", "--max-snapshot-rows", 1000], "more than 1000 rows")


def test_a_parquet_bomb(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Parquet pages that unpack to hundreds of times their size are refused before they are unpacked."""
    monkeypatch.setenv("NLOSCTL_MAX_UNCHECKED_EXPANSION_MB", "1")
    rows = 1_000_000
    table = pa.table({name: np.zeros(rows) for name in HEADER.decode().strip().split(",")})
    pa.parquet.write_table(table, folder / "m.parquet", compression="zstd", use_dictionary=False)
    assert (folder / "m.parquet").stat().st_size < 100_000
    refused(folder, ["localize", "m.parquet", "-o", "e.csv"], "expands to more than 250 times its compressed size")


def constant_parquet(path: Path, rows: int) -> None:
    """Write a small Parquet file of one snapshot of many equal rows."""
    count = 1_000_000
    numbers = {name: pa.array(np.zeros(count)) for name in ("sensor_x_m", "sensor_y_m", "bearing_rad")}
    columns = {"snapshot": pa.array(np.ones(count, dtype=np.int64)), "sensor": pa.array(["a"] * count), **numbers}
    table = pa.table({**columns, "bearing_std_rad": pa.array(np.ones(count))})
    with pa.parquet.ParquetWriter(path, table.schema, compression="zstd") as writer:
        for _ in range(rows // count):
            writer.write_table(table)


def test_a_snapshot_of_ten_million_rows(folder: Path) -> None:
    """A snapshot without end is refused at the limit of its rows, whatever the file claims to hold."""
    constant_parquet(folder / "m.parquet", 10_000_000)
    refused(folder, ["localize", "m.parquet", "-o", "e.csv"], "a snapshot has more than 1000000 rows")
    refused(folder, ["validate", "m.parquet", "--max-snapshot-rows", 5], "raise --max-snapshot-rows")


def test_buffers_that_claim_more_than_there_is(folder: Path) -> None:
    """An Arrow file whose packed buffer claims to hold a billion gigabytes is refused, not believed."""
    table = pa.table({name: np.arange(500.0) for name in HEADER.decode().strip().split(",")})
    sink = pa.BufferOutputStream()
    with pa.ipc.new_file(sink, table.schema, options=pa.ipc.IpcWriteOptions(compression="zstd")) as writer:
        writer.write_table(table)
    content = sink.getvalue().to_pybytes()
    claimed = (4000).to_bytes(8, "little")
    assert content.count(claimed) >= 5
    (folder / "m.arrow").write_bytes(content.replace(claimed, (1 << 59).to_bytes(8, "little")))
    refused(folder, ["localize", "m.arrow", "-o", "e.csv"], "m.arrow")


@pytest.mark.slow
@pytest.mark.parametrize("whose", ["ours", "the system's"])
def test_memory_has_a_limit_that_is_told(whose: str, folder: Path) -> None:
    """What asks for more than NLOSCTL_MAX_MEMORY_MB, or than the system gives, is refused in a line that names it."""
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
def test_toml_that_is_deep_or_gigantic(option: str, text: str, folder: Path) -> None:
    """TOML nested or long beyond reason is refused soon, in a line that names the file."""
    (folder / "h.toml").write_text(text)
    refused(folder, ["localize", GOOD, option, "h.toml", "-o", "e.csv"], "h.toml")


def test_a_scene_in_the_metadata_is_held_to_the_same(folder: Path) -> None:
    """A hostile scene that a table carries is refused as one in a file is."""
    for text in ("x = " + "[" * 100_000, "\udcff"):
        table = pa.parquet.read_table(FIXTURES / "good_bearings.parquet")
        scene = text.encode("utf-8", "surrogateescape")
        pa.parquet.write_table(table.replace_schema_metadata({"nlosctl.scene": scene}), folder / "m.parquet")
        refused(folder, ["localize", "m.parquet", "-o", "e.csv"], "the scene in the table's metadata")


@pytest.mark.parametrize(
    "line", [b"[" * 200_000, b'{"a":' * 200_000, b'{"snapshot": ' + b"9" * 100_000 + b"}", b'{"a": 1' * 3]
)
def test_json_that_is_deep(line: bytes, folder: Path) -> None:
    """JSON nested beyond reason is a fault of its line."""
    (folder / "m.jsonl").write_bytes(line + b"\n")
    refused(folder, ["localize", "m.jsonl", "-o", "e.csv"], "m.jsonl")


def test_a_table_of_very_many_columns(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A header of a hundred thousand columns is refused soon; the limit has a parameter."""
    names = ",".join(f"c{place}" for place in range(100_000))
    (folder / "m.csv").write_text(f"{HEADER.decode().strip()},{names}\n")
    refused(folder, ["localize", "m.csv", "-o", "e.csv"], "has 100006 columns, expected at most 10000")
    monkeypatch.setenv("NLOSCTL_MAX_COLUMNS", "200000")
    refused(folder, ["localize", "m.csv", "-o", "e.csv"], "no rows")


CONTROLS = ["\x1b[31mred", "\x07", "a\nb", "a\r\nb", "\u202egnp.exe", "\u2028", "\x00", "\x7f", "\x9b2J"]


@pytest.mark.parametrize("name", CONTROLS, ids=ascii)
@pytest.mark.parametrize("extension", ["parquet", "jsonl"])
def test_names_with_control_characters(extension: str, name: str, folder: Path) -> None:
    """A column, a sensor or a snapshot of any name reaches a terminal in printable characters alone."""
    table = pa.table({"snapshot": [name] * 3, "sensor": [name] * 3, name: [1, 2, 3], "bearing_rad": [1.0, 9.0, None]})
    if extension == "parquet":
        pa.parquet.write_table(table, folder / "m.parquet")
    else:
        (folder / "m.jsonl").write_text("".join(json.dumps(row) + "\n" for row in table.to_pylist()))
    refused(folder, ["localize", f"m.{extension}", "-o", "e.csv"], "sensor_x_m")
    told = run_guarded(["localize", f"m.{extension}", "--column", f"sensor_x_m={name}", "-q"])
    assert told.code in (1, 2)
    assert all(character.isprintable() or character == "\n" for character in told.err)


@pytest.mark.parametrize("name", ["\x1b[31m.csv", "a\nb.csv", "\u202e.csv"], ids=ascii)
def test_files_with_control_characters_in_their_names(name: str, folder: Path) -> None:
    """A file in a folder may be called anything: its name is told in one printable line."""
    (folder / "in").mkdir()
    (folder / "in" / name).write_bytes(HEADER + ROW.replace(b"0.5", b"x"))
    before = [path.name for path in folder.iterdir()]
    ending = run_guarded(["localize", "in", "-o", "e.csv", "-q"])
    assert list(complaints(ending, folder, [], before)) == []
    assert ending.code == 1


PLUGINS = {
    "raises": ("raise OSError('no\\nluck')", "can't be loaded: OSError: no luck"),
    "exits": ("import sys; sys.exit(0)", "can't be loaded: SystemExit"),
    "is none": ("METHOD = 3", "is a int, not a"),
    "lacks it": ("", "can't be loaded: AttributeError"),
    "raises on solve": ("def solve(b, o): raise ValueError('no\\nluck')", "failed: ValueError: no luck"),
    "exits on solve": ("def solve(b, o): raise SystemExit", "failed: SystemExit"),
    "gives none": ("def solve(b, o): return None", "returned a NoneType, not a Solution"),
    "gives NaN": (
        "solve = lambda b, o: answer(b, position_m=np.full((b.size, 2), np.nan))",
        "position is [nan, nan]",
    ),
    "gives infinity": (
        "solve = lambda b, o: answer(b, covariance_m2=np.full((b.size, 3), np.inf))",
        "covariance is",
    ),
    "gives no ellipse": ("solve = lambda b, o: answer(b, covariance_m2=np.full((b.size, 3), -1.0))", "no ellipse"),
    "is short": ("solve = lambda b, o: answer(b, position_m=np.zeros((1, 2)))", "position_m has shape (1, 2)"),
    "is flat": ("solve = lambda b, o: answer(b, cost=np.zeros((b.size, 2)))", "cost has shape"),
    "is text": ("solve = lambda b, o: answer(b, cost=np.full(b.size, 'x'))", "cost holds"),
    "is a list": ("solve = lambda b, o: answer(b, cost=[0.0] * b.size)", "cost has shape"),
    "has no such status": (
        "solve = lambda b, o: answer(b, status=np.full(b.size, 77, np.uint8))",
        "77 is no status",
    ),
    "misses one": ("solve = lambda b, o: answer(b, row=np.zeros(b.size, int))", "got no estimate"),
    "knows others": ("solve = lambda b, o: answer(b, row=np.arange(b.size) + 1)", "is none of its"),
    "has odd flags": ("solve = lambda b, o: answer(b, flags=Flags(used=np.ones(3, bool)))", "flag 'used' has shape"),
    "counts as flags": (
        "solve = lambda b, o: answer(b, flags=Flags(used=np.ones(b.bearing_rad.shape)))",
        "booleans",
    ),
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


@pytest.mark.parametrize(("fault", "told"), PLUGINS.values(), ids=PLUGINS.keys())
def test_plugins_that_do_harm(fault: str, told: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A plugin that raises, exits, or answers nonsense is told by its name and fault; nothing of it is written."""
    (folder / "hostile.py").write_text(FRAME.format(fault=fault, method=METHOD if "solve" in fault else ""))
    install_plugin(folder, monkeypatch, "bearings.hostile", "hostile:METHOD")
    monkeypatch.delitem(sys.modules, "hostile", raising=False)
    words = ["localize", GOOD, "-m", "hostile", "-o", "e.csv", "--flags-out", "f.csv"]
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    ending = refused(folder, words, told)
    assert "hostile" in ending.err
    monkeypatch.delitem(sys.modules, "hostile", raising=False)


def package_trees() -> list[Any]:
    """Return each module of the package, parsed."""
    paths = sorted((ROOT / "nlosctl").rglob("*.py"))
    return [pytest.param(ast.parse(path.read_text()), id=str(path.relative_to(ROOT))) for path in paths]


FORBIDDEN_MODULES = {"pickle", "cPickle", "dill", "marshal", "shelve", "subprocess", "ctypes", "xml", "yaml", "code"}
FORBIDDEN_CALLS = {"eval", "exec", "compile", "__import__", "system", "popen", "fork", "spawnv", "execv", "read_pickle"}


@pytest.mark.parametrize("tree", package_trees())
def test_nothing_of_a_file_is_executed(tree: ast.Module) -> None:
    """The package has no pickle, no eval, no shell, and no XML parser that believes in entities."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            assert {alias.name.partition(".")[0] for alias in node.names} & FORBIDDEN_MODULES == set()
        elif isinstance(node, ast.ImportFrom):
            if node.module in ("xml.parsers", "xml.sax.saxutils"):  # expat told to refuse entities, and escaping
                continue
            assert (node.module or "").partition(".")[0] not in FORBIDDEN_MODULES
        elif isinstance(node, ast.Call) and not ast.unparse(node.func).startswith(("re.", "np.random.")):
            name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            assert name not in FORBIDDEN_CALLS
            allowed = {word.arg: ast.unparse(word.value) for word in node.keywords}
            assert allowed.get("allow_pickle", "False") == allowed.get("shell", "False") == "False"


def test_a_part_that_leads_out_of_its_folder(folder: Path) -> None:
    """What a manifest or a plan says of places outside of its folder is neither read, replaced nor removed."""
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
        told = json.loads(manifest.read_text().replace('"a.', f'{json.dumps(name)[:-1]}" , "was": "a.', 1))
        manifest.write_text(json.dumps(told))
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
def test_a_manifest_that_is_nonsense(place: str, text: str, option: str | None, folder: Path) -> None:
    """Whatever stands in a manifest, a plan or a record, a run over it ends well or in one clear line."""
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
    """An importer of XML refuses declared entities and foreign document types."""
    (folder / "h.xml").write_text(f"<?xml version='1.0'?>{declaration}<DATA><TIME>&a;&b;</TIME></DATA>")
    for ending in (
        run_guarded(["convert", "h.xml", "-o", "o.csv", "--from", "kraken-xml", "-q"]),
        run_guarded(["convert", "h.xml", "-o", "o.csv", "-q"]),
    ):
        assert ending.code in (1, 2)
        assert list(complaints(ending, folder, [], ["h.xml"])) == []
        assert "root:" not in ending.err


def test_a_gzip_within_a_gzip_is_no_table(folder: Path) -> None:
    """A file packed twice is told as no text."""
    (folder / "m.csv.gz").write_bytes(gzip.compress(gzip.compress(HEADER + ROW)))
    refused(folder, ["localize", "m.csv.gz", "-o", "e.csv"], "m.csv.gz")
