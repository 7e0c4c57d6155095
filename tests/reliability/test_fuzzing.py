"""Randomly corrupted files and random tables: exit 0 with the content of the file, or one clear line."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
import pytest
from fuzz_files import TARGETS, case_of, check_case, seed_files
from guarded_run import complaints, run_guarded
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from independent_readers import differences, read_independently
from seed_files import table_of

pytestmark = pytest.mark.extensive

FORMATS = ("parquet", "arrow", "arrows", "csv", "csv.gz", "jsonl", "jsonl.gz")


def emptied(folder: Path) -> Path:
    """Remove the content of a folder."""
    for path in folder.iterdir():
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink()
    return folder


@pytest.mark.parametrize("target", TARGETS)
def test_corrupted_files(target: str, folder: Path) -> None:
    """A seeded sample of the fuzzer's inputs has no complaint."""
    assert {file.target for file in seed_files()} == set(TARGETS)
    for number in range({"manifest": 15, "cache": 4}.get(target, 50)):
        _, wrong = check_case(case_of(77, number, [target]), emptied(folder))
        assert wrong == [], f"python tests/reliability/fuzz_files.py --seed 77 --targets {target} --again {number}"


def test_the_fuzzer_detects_faults(folder: Path) -> None:
    """A run that writes a wrong number, a partial file or two lines is detected."""
    rows = [{"a": 1.0, "b": "x"}, {"a": None, "b": None}]
    assert list(differences(rows, pa.table({"a": [1.0, None], "b": ["x", None]}), {"a", "b"})) == []
    assert list(differences(rows, pa.table({"a": [1.5, None], "b": ["x", None]}), {"a", "b"})) != []
    assert list(differences(rows, pa.table({"a": [1.0], "b": ["x"]}), {"a", "b"})) != []
    ending = run_guarded(["localize", "absent.csv", "-q"])
    assert list(complaints(ending, folder, [], [])) == []
    (folder / "half").write_text("")
    assert list(complaints(ending, folder, [], [])) != []


NUMBERS = st.one_of(
    st.floats(),
    st.floats(-7.0, 7.0),
    st.sampled_from([0.0, -0.0, 5e-324, 1.7e308, float("nan"), float("inf"), None]),
    st.none(),
)
WHOLE = st.one_of(st.integers(0, 3), st.integers(-(2**63), 2**63 - 1), st.none())
WORDS = st.one_of(st.sampled_from(["a", "b", "", "1", "true"]), st.text(max_size=6), st.none())
TRUTHS = st.one_of(st.booleans(), st.none())
LARGE = st.integers(0, 2**63).map(lambda value: value if value % 3 else None)
TIMES = st.one_of(st.integers(0, 10**9), st.none())
PLAIN_KINDS = (
    (NUMBERS, pa.float64()),
    (NUMBERS.map(lambda value: value if value is None else float(f"{value:.3g}")), pa.float64()),
    (WHOLE, pa.int64()),
    (WORDS.filter(lambda text: text is None or text.isprintable()), pa.string()),
    (TRUTHS, pa.bool_()),
)


TYPED_KINDS = (
    *PLAIN_KINDS,
    (NUMBERS.map(lambda value: value if value is None else float(np.float32(value))), pa.float32()),
    (st.one_of(st.integers(-128, 127), st.none()), pa.int8()),
    (LARGE, pa.uint64()),
    (st.sampled_from(["a", "b", "", None]), pa.dictionary(pa.int8(), pa.string())),
    (st.sampled_from(["r1", "b", None]), pa.large_string()),
    (st.none(), pa.null()),
    (TIMES, pa.timestamp("s")),
    (st.lists(st.integers(0, 3), max_size=2), pa.list_(pa.int64())),
    (st.binary(max_size=3), pa.binary()),
    (st.one_of(st.none(), st.decimals(-9, 9, places=2)), pa.decimal128(9, 2)),
)
"""Beside what text can hold, what Parquet and Arrow can."""


@st.composite
def tables(draw: Any, kinds: Any = PLAIN_KINDS) -> Any:
    """Draw a table: a valid one with columns replaced, added or removed, rows shuffled, in chunks of any size."""
    table = table_of(draw(st.sampled_from(["bearings", "ranges", "triplets", "echoes"])))
    table = table.take(draw(st.lists(st.integers(0, table.num_rows - 1), min_size=1, max_size=12)))
    for _ in range(draw(st.integers(0, 3))):
        name = draw(st.sampled_from([*table.column_names, "los", "ip", "range_m", "path", "source", "extra", "a b,c"]))
        values, kind = draw(st.sampled_from(kinds))
        column = pa.array([draw(values) for _ in range(table.num_rows)], kind)
        if name in table.column_names:
            table = table.set_column(table.column_names.index(name), name, column)
        else:
            table = table.append_column(name, column)
    left = draw(st.lists(st.sampled_from(table.column_names), max_size=1))
    names = draw(st.permutations([name for name in table.column_names if name not in left]))
    return table.select(names)


@st.composite
def files(draw: Any) -> Any:
    """Draw an extension, a table for such a file, and the rows of its chunks."""
    extension = draw(st.sampled_from(FORMATS))
    typed = extension in ("parquet", "arrow", "arrows")
    return extension, draw(tables(TYPED_KINDS if typed else PLAIN_KINDS)), draw(st.integers(1, 13))


def save(table: Any, path: Path, rows: int) -> None:
    """Write a table in the format of the path's extension, ``rows`` at a time, without the project's writers."""
    if path.name.endswith(".parquet"):
        pa.parquet.write_table(table, path, row_group_size=rows)
    elif ".arrow" in path.name:
        opener = pa.ipc.new_stream if path.suffix == ".arrows" else pa.ipc.new_file
        with pa.OSFile(str(path), "wb") as file, opener(file, table.schema) as writer:
            writer.write_table(table, max_chunksize=rows)
    else:
        with pa.output_stream(str(path)) as stream:  # zips by the extension
            if ".csv" in path.name:
                pa.csv.write_csv(table, stream)
            else:
                stream.write("".join(json.dumps(row) + "\n" for row in table.to_pylist()).encode())


@pytest.mark.usefixtures("small_chunks")
@pytest.mark.parametrize(
    "command", ["localize", "detect-ip", "identify-los", "bound", "evaluate", "validate", "convert"]
)
def test_random_tables(command: str, folder: Path) -> None:
    """Any mix of columns, types, nulls, orders and extreme values, in any format, for any command."""

    @settings(max_examples=25, deadline=None, derandomize=True, database=None, suppress_health_check=list(HealthCheck))
    @given(file=files(), aside=st.booleans())
    def hold(file: Any, aside: bool) -> None:
        extension, table, rows = file
        source = emptied(folder) / f"m.{extension}"
        save(table, source, rows)
        outputs = [] if command in ("evaluate", "validate") else ["o.arrow"]
        words = [command, source.name, "-q", *(["-o", "o.arrow"] if outputs else [])]
        if command in ("localize", "detect-ip", "identify-los"):
            words += ["--jobs", "1"]
            if command == "localize":
                words += ["--flags-out", "f.arrow"]
                outputs = ["o.arrow", "f.arrow"]
            if aside:
                words += ["--bad-rows", "b.arrow"]
                outputs = [*outputs, "b.arrow"]
        ending = run_guarded(words)
        assert list(complaints(ending, folder, outputs, [source.name])) == []
        if ending.code == 0 and command == "localize" and not aside:
            with pa.OSFile(str(folder / "f.arrow")) as written:
                flags = pa.ipc.open_file(written).read_all()
            held = read_independently(source.name, source.read_bytes())
            names = {name for row in held for name in row} - {"los", "ip", "used"}
            assert list(differences(held, flags, names)) == []

    hold()
