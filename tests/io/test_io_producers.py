"""Tables as polars, pandas, DuckDB and Arrow write them: every command reads each type as it reads plain text."""

from __future__ import annotations

import datetime
import decimal
import importlib.util
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq
import pytest

import nlosctl
from tests.support.program import run_here

_SENSOR = ["a", "b", "c", "a", "b", "c"]
_NOTE = ["x", "y", None, "x", "y", None]
_PLAIN: dict[str, Any] = {
    "snapshot": ["p", "p", "p", "q", "q", "q"],
    "sensor": _SENSOR,
    "sensor_x_m": [0.0, 100.0, 0.0] * 2,
    "sensor_y_m": [0.0, 0.0, 100.0] * 2,
    "bearing_deg": [45.0, 135.0, -45.0] * 2,
    "bearing_std_deg": [1.0] * 6,
    "truth_x_m": [50.0] * 6,
    "truth_y_m": [50.0] * 6,
    "note": _NOTE,
}
_TEXT = ("snapshot", "sensor", "note")


def _arrow(**replaced: Any) -> pa.Table:
    return pa.table({name: pa.array(values) for name, values in _PLAIN.items()} | replaced)


def _encoded(values: list[Any], value_type: pa.DataType, index_type: pa.DataType) -> pa.Array:
    encoded = pa.array(values).dictionary_encode()
    return pa.DictionaryArray.from_arrays(encoded.indices.cast(index_type), encoded.dictionary.cast(value_type))


def _runs(values: list[Any], value_type: pa.DataType) -> pa.Array:
    ends = pa.array(range(1, len(values) + 1), pa.int32())
    # pyarrow makes no such array of views by `run_end_encode`
    return pa.RunEndEncodedArray.from_arrays(ends, pa.array(values, value_type))


_TEXTS: dict[str, Callable[[list[Any]], pa.Array]] = {
    "large_string": lambda values: pa.array(values, pa.large_string()),
    "string_view": lambda values: pa.array(values, pa.string_view()),
    "dictionary": lambda values: _encoded(values, pa.string(), pa.uint8()),
    "dictionary of large_string": lambda values: _encoded(values, pa.large_string(), pa.int64()),
    "dictionary of string_view": lambda values: _encoded(values, pa.string_view(), pa.uint32()),
    "run ends": lambda values: _runs(values, pa.string()),
    "run ends of string_view": lambda values: _runs(values, pa.string_view()),
}


def _save(table: pa.Table, path: Path) -> Path:
    if path.suffix == ".parquet":
        pq.write_table(table, path)
        return path
    opener = pa.ipc.new_file if path.suffix == ".arrow" else pa.ipc.new_stream
    with opener(str(path), table.schema) as writer:
        writer.write_table(table)
    return path


def _outputs(file: Path, folder: Path) -> dict[str, bytes]:
    """Run every command that reads the table on a file; return what they write as text."""
    folder.mkdir()
    localize = ("localize", "-m", "ls", "-q", str(file), "--carry", "note")
    commands = [
        ("validate", str(file)),
        (*localize, "-o", "e.csv", "--flags-out", "f.csv"),
        (*localize, "-o", "e.parquet", "--flags-out", "f.jsonl"),
        (*localize, "-o", "e.jsonl", "--flags-out", "f.parquet"),
        ("localize", "-m", "ls", "-q", "f.parquet", "--carry", "note", "-o", "again.csv"),
        ("bound", "-q", str(file), "-o", "b.csv"),
        ("evaluate", "e.parquet", "--json"),
        ("convert", "-q", str(file), "-o", "c.csv"),
        ("convert", "-q", str(file), "-o", "c.jsonl"),
        ("convert", "-q", str(file), "-o", "c.parquet"),
        ("convert", "-q", "c.parquet", "-o", "p.csv"),
        ("convert", "-q", str(file), "-o", "c.arrow"),
        ("convert", "-q", "c.arrow", "-o", "a.csv"),
    ]
    results = {}
    for command in commands:
        done = run_here(*command, folder=folder)
        assert done.returncode == 0, (command, done.stderr)
        results[" ".join(command[:1])] = done.stdout if command[0] == "evaluate" else b""
    return results | {path.name: path.read_bytes() for path in folder.iterdir() if path.suffix in (".csv", ".jsonl")}


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """The outputs for the table of plain text."""
    folder = tmp_path_factory.mktemp("plain")
    return _outputs(_save(_arrow(), folder / "in.parquet"), folder / "out")


_NOT_IN_PARQUET = ("run ends", "run ends of string_view", "dictionary of string_view")


@pytest.mark.parametrize(
    ("kind", "suffix"),
    [
        (kind, suffix)
        for kind in _TEXTS
        for suffix in (".arrow", ".arrows", ".parquet")
        if suffix != ".parquet" or kind not in _NOT_IN_PARQUET
    ],
)
def test_text_of_every_type_gives_the_outputs_of_plain_text(
    tmp_path: Path, plain: dict[str, bytes], kind: str, suffix: str
) -> None:
    """Ids, names and notes as views, dictionaries, runs and large text give the same bytes in every command."""
    table = _arrow(**{name: _TEXTS[kind](_PLAIN[name]) for name in _TEXT})
    assert _outputs(_save(table, tmp_path / f"in{suffix}"), tmp_path / "out") == plain


@pytest.mark.parametrize("kind", _TEXTS)
def test_tables_of_every_text_type_give_the_same_answers_in_python(kind: str) -> None:
    """The functions of Python give the same estimates and flags for every type of text."""
    table = _arrow(**{name: _TEXTS[kind](_PLAIN[name]) for name in _TEXT})
    expected, got = (nlosctl.localize(rows, method="ls", carry=["note"]) for rows in (_arrow(), table))
    assert got.estimates.to_pylist() == expected.estimates.to_pylist()
    assert got.flags.to_pylist() == expected.flags.to_pylist()


@pytest.mark.parametrize("kind", ["categorical", "enum", "text"])
def test_polars_frames_of_every_text_type(tmp_path: Path, plain: dict[str, bytes], kind: str) -> None:
    """Categorical, Enum and String of polars, in IPC files, streams and Parquet, and the frame itself."""
    polars = pytest.importorskip("polars")
    types = {"categorical": lambda name: polars.Categorical, "text": lambda name: polars.String}
    types["enum"] = lambda name: polars.Enum(sorted({value for value in _PLAIN[name] if value}))
    frame = polars.DataFrame(_PLAIN).with_columns([polars.col(name).cast(types[kind](name)) for name in _TEXT])
    frame.write_ipc(tmp_path / "in.arrow")
    frame.write_ipc_stream(tmp_path / "in.arrows")
    frame.write_parquet(tmp_path / "in.parquet")
    for suffix in ("arrow", "arrows", "parquet"):
        assert _outputs(tmp_path / f"in.{suffix}", tmp_path / suffix) == plain
    assert nlosctl.localize(frame, method="ls").estimates.equals(nlosctl.localize(_arrow(), method="ls").estimates)


@pytest.mark.parametrize("kind", ["object", "category", "string"])
def test_pandas_frames_of_every_text_type(tmp_path: Path, plain: dict[str, bytes], kind: str) -> None:
    """Text of pandas as objects, categories and strings, in Parquet and Feather, and the frame itself."""
    frame = pd.DataFrame(_PLAIN).astype(dict.fromkeys(_TEXT, kind))
    frame.to_parquet(tmp_path / "in.parquet")
    frame.to_feather(tmp_path / "in.feather")
    for suffix in ("parquet", "feather"):
        assert _outputs(tmp_path / f"in.{suffix}", tmp_path / suffix) == plain
    assert nlosctl.localize(frame, method="ls").estimates.num_rows == 2


def test_parquet_of_duckdb_with_an_enum(tmp_path: Path, plain: dict[str, bytes]) -> None:
    """An ENUM of DuckDB in Parquet is read as text."""
    assert importlib.util.find_spec("duckdb_cli") is not None
    _save(_arrow(), tmp_path / "plain.parquet")
    casts = ", ".join(f"{name}::t_{name} AS {name}" for name in _TEXT)
    statements = [
        f"CREATE TYPE t_{name} AS ENUM ({', '.join(repr(value) for value in sorted({*_PLAIN[name]} - {None}))})"
        for name in _TEXT
    ]
    copy = f"COPY (SELECT * REPLACE ({casts}) FROM 'plain.parquet') TO 'in.parquet'"  # noqa: S608
    duckdb = Path(sys.executable).with_name("duckdb")
    subprocess.run([duckdb, "-c", "; ".join([*statements, copy])], cwd=tmp_path, check=True)
    assert _outputs(tmp_path / "in.parquet", tmp_path / "out") == plain


_HALF = np.array([0.5, 0.25, 2.0] * 2, dtype=np.float16)
_DECIMALS = [decimal.Decimal("0.25"), None, decimal.Decimal("-1.00")] * 2
_ZURICH = [datetime.datetime(2024, 7, 1, 12, 0, second, tzinfo=datetime.UTC) for second in range(6)]


def _carried() -> dict[str, tuple[pa.Array, list[str], list[Any]]]:
    """Return columns by name: as Arrow arrays, as the cells of CSV, and as the values of JSON."""
    lists = [["x", "y"], None, [None], [], ["z"], ["w"]]
    json_lists = ['["x", "y"]', "", "[null]", "[]", '["z"]', '["w"]']
    cases: dict[str, tuple[pa.Array, list[str], list[Any]]] = {
        "half floats": (pa.array(_HALF), ["0.5", "0.25", "2"] * 2, [0.5, 0.25, 2.0] * 2),
        "uint64": (
            pa.array([2**64 - 1, None, 3] * 2, pa.uint64()),
            [str(2**64 - 1), "", "3"] * 2,
            [2**64 - 1, None, 3] * 2,
        ),
        "uint8": (pa.array([255, None, 3] * 2, pa.uint8()), ["255", "", "3"] * 2, [255, None, 3] * 2),
        "zoned": (
            pa.array(_ZURICH, pa.timestamp("ms", "Europe/Zurich")),
            [f"2024-07-01 14:00:0{second}.000+0200" for second in range(6)],
            [f"2024-07-01 14:00:0{second}+02:00" for second in range(6)],
        ),
    }
    for kind in (pa.decimal128(10, 2), pa.decimal256(40, 2)):
        cases[str(kind)] = (pa.array(_DECIMALS, kind), ["0.25", "", "-1.00"] * 2, [0.25, None, -1.0] * 2)
    for inner in (pa.string_view(), pa.large_string(), pa.string()):
        for kind in (pa.list_(inner), pa.large_list(inner)):
            cases[str(kind)] = (pa.array(lists, kind), json_lists, lists)
        members = [{"u": "x"}, None, {"u": None}] * 2
        texts = ['{"u": "x"}', "", '{"u": null}'] * 2
        cases[f"struct of {inner}"] = (pa.array(members, pa.struct([("u", inner)])), texts, members)
    offsets = pa.array(range(7), pa.int32())
    encoded = pa.ListArray.from_arrays(offsets, _encoded(_SENSOR, pa.string_view(), pa.int8()))
    cases["list of dictionary"] = (encoded, [f'["{name}"]' for name in _SENSOR], [[name] for name in _SENSOR])
    return cases


@pytest.mark.parametrize(
    ("kind", "suffix"),
    [(kind, suffix) for kind in _carried() for suffix in (".arrow", ".arrows")]
    + [(kind, ".parquet") for kind in _carried() if kind != "list of dictionary"],
)
def test_carried_columns_of_every_type_keep_their_values(tmp_path: Path, kind: str, suffix: str) -> None:
    """A column that is only carried has its values in estimates, flags and converted tables of every format."""
    column, cells, values = _carried()[kind]
    snapshots = [str(number) for number in range(6)]
    file = _save(_arrow(snapshot=snapshots, note=column), tmp_path / f"in{suffix}")
    command = ("localize", "-m", "ls", "-q", str(file), "--carry", "note")
    for words in (
        (*command, "-o", "e.csv", "--flags-out", "f.jsonl"),
        (*command, "-o", "e.parquet", "--flags-out", "f.parquet"),
        ("convert", "-q", str(file), "-o", "c.jsonl"),
        ("convert", "-q", str(file), "-o", "c.csv"),
        ("convert", "-q", "f.parquet", "-o", "f.csv"),
        ("convert", "-q", "e.parquet", "-o", "e.arrow"),
        ("convert", "-q", "e.arrow", "-o", "again.csv"),
    ):
        done = run_here(*words, folder=tmp_path)
        assert done.returncode == 0, (words, done.stderr)
    text = pa.csv.ConvertOptions(column_types={"note": pa.string()})
    for name in ("e.csv", "f.csv", "c.csv", "again.csv"):
        assert pa.csv.read_csv(tmp_path / name, convert_options=text).column("note").to_pylist() == cells, name
    for name in ("f.jsonl", "c.jsonl"):
        assert [json.loads(line)["note"] for line in (tmp_path / name).read_text().splitlines()] == values, name


@pytest.mark.parametrize(
    "kind", [pa.decimal128(12, 3), pa.decimal256(50, 3), pa.float16(), pa.float32(), pa.uint8(), pa.uint64()], ids=str
)
def test_numbers_of_every_type_give_the_same_fix(tmp_path: Path, kind: pa.DataType) -> None:
    """Coordinates and truth as decimals, half floats and unsigned integers give the estimates of floats."""
    exact = [decimal.Decimal(100)] * 6 if pa.types.is_decimal(kind) else np.full(6, 100, dtype=np.float16)
    whole = pa.array(exact, kind) if pa.types.is_decimal(kind) else pa.array(exact).cast(kind)
    rows = {"sensor_x_m": whole, "truth_x_m": whole}
    expected = {name: values.cast(pa.float64()) for name, values in rows.items()}
    tables = [
        _arrow(bearing_deg=[10.0, 120.0, 250.0] * 2, sensor_y_m=[0.0, 7.0, 90.0] * 2, **columns)
        for columns in (rows, expected)
    ]
    results = []
    for number, table in enumerate(tables):
        file = _save(table, tmp_path / f"{number}.arrow")
        done = run_here("localize", "-m", "ls", "-q", str(file), "-o", "-")
        assert done.returncode == 0, done.stderr
        results.append(pa.csv.read_csv(pa.BufferReader(done.stdout)).drop_columns(["truth_x_m"]))
    assert results[0].equals(results[1])


def test_a_name_with_a_dot_beside_a_structure_with_that_member(tmp_path: Path) -> None:
    """`meta.sensor` is the column of that name, also where a structure `meta` has a member `sensor`."""
    members = pa.array([{"sensor": "inner"}] * 6)
    file = _save(_arrow(meta=members, **{"meta.sensor": pa.array(_SENSOR)}), tmp_path / "in.parquet")
    done = run_here("localize", "-m", "ls", "-q", str(file), "--carry", "meta.sensor", "-o", "-")
    assert done.returncode == 0, done.stderr
    assert pa.csv.read_csv(pa.BufferReader(done.stdout)).column("meta.sensor").to_pylist() == ["a", "a"]
