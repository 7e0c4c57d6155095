"""Tables of ours from Parquet to CSV, TSV and JSON Lines and back: the same columns, types and values."""

from __future__ import annotations

import tempfile
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nlosctl.contract.tables import BEARINGS, BOUND, ESTIMATES, FLAGS, RANGES, TRACE, TRIPLETS, Column
from tests.support.program import run_here

_TYPES = {"number": pa.float64(), "integer": pa.int64(), "boolean": pa.bool_(), "text": pa.string()}
_WORDS = st.text("abcdefgh1.0 ,;\"'\t", min_size=1, max_size=5).map(lambda text: f"x{text.strip()}")
_VALUES = {
    "number": st.floats(-1e9, 1e9),
    "integer": st.integers(0, 2**53),
    "boolean": st.booleans(),
    "text": _WORDS,
    "words": _WORDS,
    "whole": st.integers(-5, 5),
}


def _columns(name: str) -> list[Column]:
    flagged = [*BEARINGS.columns, *(column for column in FLAGS.columns if column.name not in ("snapshot", "los", "ip"))]
    flagged = [column for column in flagged if column.name != "used"] + [FLAGS.column("used")]
    tables = {table.name: list(table.columns) for table in (ESTIMATES, BOUND, TRACE, RANGES, TRIPLETS)}
    return [column for column in {**tables, "flags": flagged}[name] if column.only_with is None]


@st.composite
def _tables(draw: st.DrawFn, name: str) -> pa.Table:
    """Return a table with all columns of a table of ours, and `path`, each full, with gaps, or all null."""
    rows = draw(st.integers(1, 4))
    columns = {column.name: column.type for column in _columns(name)} | {"path": "integer"}
    arrays = {}
    for column, kind in columns.items():
        chosen = draw(st.sampled_from(["words", "whole"])) if kind == "identifier" else kind
        nulls = draw(st.sampled_from(["none", "some", "all"])) if kind != "identifier" else "none"
        values = st.none() if nulls == "all" else _VALUES[chosen]
        cells = draw(st.lists(values if nulls != "some" else values | st.none(), min_size=rows, max_size=rows))
        arrays[column] = pa.array(cells, _TYPES.get(kind, pa.int64() if chosen == "whole" else pa.string()))
    return pa.table(arrays)


@pytest.mark.parametrize("name", ["estimates", "flags", "bound", "trace", "ranges", "triplets"])
@pytest.mark.parametrize("extension", ["csv", "tsv.zst", "jsonl"])
@settings(max_examples=8, deadline=None)
@given(data=st.data())
def test_text_formats_keep_columns_types_and_nulls(name: str, extension: str, data: st.DataObject) -> None:
    """A table of ours with null columns is the same after Parquet to text to Parquet."""
    table = data.draw(_tables(name))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder)
        pq.write_table(table, path / "in.parquet")
        for source, target in (("in.parquet", f"t.{extension}"), (f"t.{extension}", "out.parquet")):
            done = run_here("convert", "-q", source, "-o", target, folder=path)
            assert done.returncode == 0, done.stderr
        result = pq.read_table(path / "out.parquet")
    assert result.schema.remove_metadata().equals(table.schema)
    assert result.to_pylist() == table.to_pylist()


def test_a_joint_fix_has_its_picture_and_types_from_csv_too(tmp_path: Path) -> None:
    """The all-empty `path` of joint fixes is a column of integers in CSV too, and `plot` draws the same fix."""
    steps = [
        "simulate room -n 2 --seed 2 -q -o paths.csv",
        "detect-ip -m joint -q paths.csv -o joint.csv",
        "localize -p joint=true -q joint.csv -o fixes.csv",
        "localize -p joint=true -q joint.csv -o fixes.parquet",
        "convert -q fixes.csv -o converted.parquet",
        "plot joint.csv fixes.csv --snapshot 0 -q -o a.svg",
        "plot joint.csv fixes.parquet --snapshot 0 -q -o b.svg",
    ]
    for step in steps:
        done = run_here(*step.split(), folder=tmp_path)
        assert done.returncode == 0, (step, done.stderr)
    converted, direct = (pq.read_schema(tmp_path / f"{name}.parquet") for name in ("converted", "fixes"))
    assert converted.remove_metadata().equals(direct.remove_metadata())
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()
