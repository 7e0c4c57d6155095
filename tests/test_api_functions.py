"""The functions of ``import nlosctl`` speak Python: names, paths, tables of other libraries, degrees, bad rows."""

from __future__ import annotations

import json
import os
import pydoc
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet
import pytest

import nlosctl
from nlosctl.cli.main import run
from nlosctl.errors import DataError, UsageError

PAGE = Path(__file__).parents[1] / "docs" / "python.md"
FUNCTIONS = [
    "bound",
    "convert",
    "describe",
    "detect_ip",
    "evaluate",
    "identify_los",
    "localize",
    "plot",
    "posterior",
    "read",
    "report",
    "simulate",
    "validate",
]


@pytest.fixture(scope="module")
def table() -> Any:
    """Measurements of 20 snapshots."""
    return nlosctl.simulate("ring", trials=20, seed=3, bearing_std_deg=2.0)


@pytest.mark.process
def test_the_functions_are_found_before_numpy_is_imported() -> None:
    """``dir`` has all functions, and neither it nor the import loads NumPy or pyarrow."""
    script = "import nlosctl, sys; print(*dir(nlosctl)); print(*({'numpy', 'pyarrow', 'scipy'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    names, loaded = done.stdout.split("\n")[:2]
    assert len(FUNCTIONS) == 13
    assert set(FUNCTIONS) <= set(names.split())
    assert loaded == ""


def test_help_lists_the_functions() -> None:
    """``help(nlosctl)`` has a heading and a signature for every function."""
    text = pydoc.render_doc(nlosctl, renderer=pydoc.plaintext)
    for name in FUNCTIONS:
        assert re.search(rf"^    {name}\(", text, re.MULTILINE), name


def test_the_page_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The blocks of docs/python.md run in order, in an empty folder."""
    pytest.importorskip("matplotlib")
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    assert len(blocks) == 6
    for block in blocks:
        exec(compile(block, str(PAGE), "exec"), names)  # noqa: S102 - the page is ours
    assert {"scene.png", "fixes.geojson"} <= {path.name for path in tmp_path.iterdir()}


@pytest.mark.parametrize(
    "form",
    [
        lambda table: table.to_pandas(),
        lambda table: table.to_pydict(),
        lambda table: {name: table[name].to_numpy(zero_copy_only=False) for name in table.column_names},
        lambda table: table.to_reader(),
    ],
    ids=["pandas", "dict of lists", "dict of arrays", "Arrow stream"],
)
def test_tables_of_other_libraries(table: Any, form: Callable[[Any], Any]) -> None:
    """A table gives the same estimates in any form."""
    assert nlosctl.localize(form(table)).estimates["x_m"] == nlosctl.localize(table).estimates["x_m"]


def test_polars(table: Any) -> None:
    """A DataFrame and a LazyFrame of polars are tables."""
    polars = pytest.importorskip("polars")
    frame = polars.from_arrow(table)
    for form in (frame, frame.lazy()):
        assert nlosctl.localize(form).estimates["x_m"] == nlosctl.localize(table).estimates["x_m"]


def test_a_lazy_frame_is_collected(table: Any) -> None:
    """An object with the methods of a LazyFrame is collected."""

    class Lazy:
        def collect_schema(self) -> Any:
            return table.schema

        def collect(self) -> Any:
            return table

    assert nlosctl.localize(Lazy()).estimates["x_m"] == nlosctl.localize(table).estimates["x_m"]


def test_paths(table: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A path, a glob and a list of paths are files, as on the command line."""
    monkeypatch.chdir(tmp_path)
    pyarrow.parquet.write_table(table, "a.parquet")
    pyarrow.parquet.write_table(table, "b.parquet")
    want = nlosctl.localize(table).estimates["x_m"].to_pylist()
    for given in ("a.parquet", Path("a.parquet"), tmp_path / "a.parquet"):
        assert nlosctl.localize(given).estimates["x_m"].to_pylist() == want
    for given in ("*.parquet", ["a.parquet", Path("b.parquet")]):
        assert nlosctl.localize(given).estimates["x_m"].to_pylist() == [*want, *want]
    assert nlosctl.validate("a.parquet")["snapshots"] == 20
    assert nlosctl.read("a.parquet").equals(nlosctl.read(Path("a.parquet")))
    assert nlosctl.bound("a.parquet").num_rows == 20
    with pytest.raises(DataError, match=r"c\.parquet: there is no such file"):
        nlosctl.localize("c.parquet")


@pytest.mark.parametrize("value", [5, [1, 2], None, object()])
def test_what_is_no_table_is_named(value: Any) -> None:
    """Anything else is a UsageError that names its type, not an error of pyarrow."""
    with pytest.raises(UsageError, match=f"got a {type(value).__name__}, expected a table"):
        nlosctl.localize(value)


def test_standard_deviations_in_degrees(table: Any) -> None:
    """A keyword or constant in degrees equals one in radians, and messages name no flag."""
    bare = table.drop_columns(["bearing_std_rad"])
    want = nlosctl.localize(bare, constants={"bearing_std_rad": np.radians(3.0)}).estimates
    for keywords in (
        {"bearing_std_deg": 3},
        {"bearing_std_rad": np.radians(3.0)},
        {"constants": {"bearing_std_deg": 3}},
    ):
        assert nlosctl.localize(bare, **keywords).estimates.equals(want)
    assert nlosctl.bound(bare, bearing_std_deg=3.0).num_rows == 20
    triplets = nlosctl.simulate("room", trials=3, seed=1)
    names = ["dod_std_rad", "doa_std_rad"]
    stds = {name.replace("rad", "deg"): float(np.degrees(triplets[name][0].as_py())) for name in names}
    found = nlosctl.detect_ip(triplets.drop_columns(names), **stds).flags["ip"]
    assert found == nlosctl.detect_ip(triplets).flags["ip"]
    for keywords in (
        {},
        {"bearing_std_deg": -1},
        {"bearing_std_deg": "two"},
        {"bearing_std_deg": 1, "bearing_std_rad": 1},
    ):
        with pytest.raises((DataError, UsageError)) as caught:
            nlosctl.localize(bare, **keywords)
        assert "bearing_std" in str(caught.value)
        assert "--" not in str(caught.value)


def test_bad_rows_are_set_aside(table: Any, tmp_path: Path) -> None:
    """``bad_rows=True`` returns bad rows, a name writes them; without it they are an error."""
    columns = table.to_pydict()
    columns["bearing_std_rad"][5] = -1.0
    with pytest.raises(DataError, match="row 6, column 'bearing_std_rad': got -1"):
        nlosctl.localize(columns)
    result = nlosctl.localize(columns, bad_rows=True)
    assert result.bad_rows is not None
    assert result.bad_rows["row"].to_pylist() == [6]
    assert nlosctl.localize(columns, bad_rows=tmp_path / "bad.csv").bad_rows is None
    assert "got -1" in (tmp_path / "bad.csv").read_text()
    assert nlosctl.validate(columns, bad_rows=True)["bad_rows"] == 1
    assert nlosctl.localize(table, bad_rows=True).bad_rows.num_rows == 0


def test_truth_from_another_table(table: Any, tmp_path: Path) -> None:
    """``evaluate(truth=)`` takes a table or path, with the figures of ``evaluate --truth``."""
    estimates = nlosctl.localize(table).estimates
    truth = estimates.select(["snapshot", "truth_x_m", "truth_y_m"])
    bare = estimates.drop_columns(["truth_x_m", "truth_y_m"])
    pyarrow.parquet.write_table(truth, tmp_path / "t.parquet")
    pyarrow.parquet.write_table(bare, tmp_path / "e.parquet")
    want = nlosctl.evaluate(estimates).overall
    assert nlosctl.evaluate(bare, truth=truth).overall == want
    assert nlosctl.evaluate(tmp_path / "e.parquet", truth=tmp_path / "t.parquet").overall == want


def test_an_evaluation_is_shown_in_short(table: Any) -> None:
    """Its text and HTML have a row per group and a few figures, however many it has."""
    triplets = nlosctl.simulate("shen", trials=200, seed=1)
    for evaluation in (
        nlosctl.evaluate(nlosctl.localize(table, method=["ml", "ls"]).estimates),
        nlosctl.evaluate(nlosctl.detect_ip(triplets).flags),
    ):
        text, html = repr(evaluation), evaluation._repr_html_()
        assert len(text) < 1000
        assert len(html) < 2000
        assert text.count("\n") == 1 + len(evaluation.groups) + len(evaluation.notes)
        assert html.count("<tr>") == 1 + len(evaluation.groups)


def test_convert_equals_the_command(table: Any, tmp_path: Path) -> None:
    """``convert`` writes the bytes of ``nlosctl convert``, and replaces nothing unless that is asked for."""
    pyarrow.parquet.write_table(table, tmp_path / "a.parquet")
    assert nlosctl.convert(tmp_path / "a.parquet", tmp_path / "b.csv").rows == table.num_rows
    assert nlosctl.convert(table, tmp_path / "c.csv").rows == table.num_rows
    assert run(["convert", str(tmp_path / "a.parquet"), "-o", str(tmp_path / "d.csv"), "-q"]) == 0
    contents = {(tmp_path / name).read_bytes() for name in ("b.csv", "c.csv", "d.csv")}
    assert len(contents) == 1
    with pytest.raises(DataError, match="exists already"):
        nlosctl.convert(table, tmp_path / "c.csv")
    fixes = nlosctl.localize(table).estimates
    nlosctl.convert(fixes, tmp_path / "f.geojson", metres=True)
    assert len(json.loads((tmp_path / "f.geojson").read_text())["features"]) >= 20


def test_a_report_is_the_page_of_the_command(table: Any, tmp_path: Path) -> None:
    """A report of tables is the page of their files of the same names; a notebook shows it in a frame."""
    estimates = nlosctl.localize(table).estimates
    pyarrow.parquet.write_table(table, tmp_path / "a.parquet")
    pyarrow.parquet.write_table(estimates, tmp_path / "e.parquet")
    words = [os.fspath(tmp_path / name) for name in ("a.parquet", "e.parquet")]
    page = nlosctl.report(*words, title="t")
    page.save(tmp_path / "p.html")
    assert run(["report", *words, "--title", "t", "-o", str(tmp_path / "q.html"), "-q"]) == 0
    assert (tmp_path / "p.html").read_bytes() == (tmp_path / "q.html").read_bytes() == page.html.encode()
    assert "<iframe" in nlosctl.report(table, estimates)._repr_html_()
    with pytest.raises(DataError, match="exists"):
        page.save(tmp_path / "p.html")
    with pytest.raises(UsageError, match="nothing to show"):
        nlosctl.report()


def test_a_plot_is_a_picture(table: Any, tmp_path: Path) -> None:
    """A plot of tables is the picture of their files."""
    pytest.importorskip("matplotlib")
    estimates = nlosctl.localize(table).estimates
    picture = nlosctl.plot(table, estimates, snapshot=3)
    assert picture._repr_png_()[:4] == b"\x89PNG"
    picture.save(tmp_path / "p.svg")
    pyarrow.parquet.write_table(table, tmp_path / "a.parquet")
    pyarrow.parquet.write_table(estimates, tmp_path / "e.parquet")
    words = [os.fspath(tmp_path / name) for name in ("a.parquet", "e.parquet")]
    assert run(["plot", *words, "--snapshot", "3", "-o", str(tmp_path / "q.svg"), "-q"]) == 0
    assert (tmp_path / "p.svg").read_bytes() == (tmp_path / "q.svg").read_bytes()
    assert nlosctl.plot(estimates).view == "estimates"
    with pytest.raises(UsageError, match="nothing to plot"):
        nlosctl.plot()
