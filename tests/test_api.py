"""Convention 10: ``import nlosctl`` gives the tables of the command line to the bit."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest

import nlosctl
from nlosctl.cli.main import run
from nlosctl.errors import DataError, UsageError
from nlosctl.io.scenes.scene_file import scene_from_toml

FIXTURES = Path(__file__).parents[1] / "fixtures"
GOOD, SCENE = FIXTURES / "good_bearings.parquet", FIXTURES / "good_bearings.scene.toml"


def good() -> Any:
    """Return the good bearings."""
    return pyarrow.parquet.read_table(GOOD)


def by_program(folder: Path, *words: Any, source: Path = GOOD) -> tuple[Any, Any, dict[str, Any]]:
    """Return estimates, flags and report of the command line."""
    names = [folder / name for name in ("e.parquet", "f.parquet", "r.json")]
    options = ["-q", "--overwrite", "-o", names[0], "--flags-out", names[1], "--report", names[2]]
    assert run([str(word) for word in ("localize", source, *options, *words)]) == 0
    tables = [pyarrow.parquet.read_table(name).replace_schema_metadata(None) for name in names[:2]]
    return tables[0], tables[1], json.loads(names[2].read_text())


def same_bits(one: Any, other: Any) -> bool:
    """Return whether two tables have the same names, types, values, nulls and signs of zero."""

    def content(table: Any) -> bytes:
        plain = pa.table([column.combine_chunks() for column in table.columns], names=table.column_names)
        sink = io.BytesIO()
        rows = plain.take(pa.array(np.arange(plain.num_rows)))
        with pa.ipc.new_stream(sink, rows.schema) as writer:
            writer.write_table(rows)
        return sink.getvalue()

    return content(one.replace_schema_metadata(None)) == content(other)


CASES: list[tuple[dict[str, Any], list[str]]] = [
    ({}, []),
    ({"method": "stansfield"}, ["-m", "stansfield"]),
    ({"method": ["ls", "ml", "stansfield"]}, ["-m", "ls", "-m", "ml", "-m", "stansfield"]),
    ({"max_iterations": 1, "min_range_m": 0.5}, ["-p", "max_iterations=1", "-p", "min_range_m=0.5"]),
    ({"method": "ls", "jobs": 3, "block_size": 3}, ["-m", "ls", "--jobs", "2", "--block-size", "50"]),
    ({"carry": ["truth_los"], "seed": 4}, ["--carry", "truth_los", "--seed", "4"]),
]


@pytest.mark.extensive
@pytest.mark.parametrize(("keywords", "words"), CASES, ids=lambda value: str(value))
def test_tables_equal_those_of_the_command_line(tmp_path: Path, keywords: dict[str, Any], words: list[str]) -> None:
    """Estimates, flags and report are those of ``nlosctl localize``."""
    estimates, flags, report = by_program(tmp_path, *words)
    result = nlosctl.localize(good(), scene=SCENE, **keywords)
    assert same_bits(result.estimates, estimates)
    assert same_bits(result.flags, flags)
    report = result.report.as_dict()
    assert {key: report[key] for key in report if key not in ("inputs", "notes")} == {
        key: report[key] for key in report if key not in ("inputs", "notes")
    }


def test_columns_constants_and_rows_left_out(tmp_path: Path) -> None:
    """Renamed columns, a constant std and excluded rows work as on the command line."""
    table = good().drop_columns(["bearing_std_rad", "reflector", "path"])
    table = table.filter(pa.compute.is_null(good().column("reflector")))
    table = table.rename_columns(["AZ" if name == "bearing_rad" else name for name in table.column_names])
    table = table.append_column("los", pa.array([place % 6 != 0 for place in range(table.num_rows)]))
    pyarrow.parquet.write_table(table, tmp_path / "m.parquet")
    words = ["--column", "bearing_rad=AZ", "--bearing-std-deg", "2"]
    keywords: dict[str, Any] = {
        "columns": {"bearing_rad": "AZ"},
        "constants": {"bearing_std_rad": float(np.radians(2.0))},
    }
    for more, given in ((["--all-rows"], {"all_rows": True}), ([], {})):
        estimates, flags, _ = by_program(tmp_path, *words, *more, source=tmp_path / "m.parquet")
        result = nlosctl.localize(table, **keywords, **given)
        assert same_bits(result.estimates, estimates)
        assert same_bits(result.flags, flags)


def test_simulate_equals_the_command_line(tmp_path: Path) -> None:
    """``simulate`` gives the same table and metadata; ``localize`` finds its scene."""
    path = tmp_path / "m.parquet"
    assert run(["simulate", "song-flat", "-n", "70", "--seed", "3", "-q", "-o", str(path)]) == 0
    written = pyarrow.parquet.read_table(path)
    drawn = nlosctl.simulate("song-flat", trials=70, seed=3)
    assert same_bits(drawn, written.replace_schema_metadata(None))
    assert drawn.schema.metadata[b"nlosctl.scene"] == written.schema.metadata[b"nlosctl.scene"]
    assert drawn.schema.metadata[b"nlosctl"] == written.schema.metadata[b"nlosctl"]
    estimates, _, _ = by_program(tmp_path, source=path)
    assert same_bits(nlosctl.localize(drawn).estimates, estimates)


def test_evaluate_equals_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """``evaluate`` gives the metrics of ``nlosctl evaluate --json``."""
    result = nlosctl.localize(good(), scene=SCENE, method=["ml", "ls"])
    pyarrow.parquet.write_table(result.estimates, tmp_path / "e.parquet")
    assert run(["evaluate", str(tmp_path / "e.parquet"), "--json"]) == 0
    output = json.loads(capsys.readouterr().out)
    evaluation = nlosctl.evaluate(result.estimates)
    assert (evaluation.of, evaluation.groups) == (output["of"], output["groups"])
    assert evaluation.overall is output.get("overall") is None


def test_a_scene_can_be_an_object_a_path_or_text() -> None:
    """A Scene, a path and its text are equivalent."""
    scene = scene_from_toml(SCENE.read_text(), "scene")
    results = [nlosctl.localize(good(), scene=given).estimates for given in (scene, SCENE, str(SCENE))]
    assert results[0].equals(results[1])
    assert results[0].equals(results[2])


@pytest.mark.parametrize("form", ["sliced", "chunked", "dictionary", "plain", "batch"])
def test_the_form_of_a_table_does_not_matter(form: str) -> None:
    """Slices, chunks, dictionaries, plain Python columns and record batches give the same bits."""
    table = good()
    forms = {
        "sliced": pa.concat_tables([table.slice(200), table, table.slice(0, 9)]).slice(40, 240),
        "chunked": pa.concat_tables([table.slice(start, 7) for start in range(0, 240, 7)]),
        "dictionary": table.set_column(1, "sensor", table.column("sensor").dictionary_encode()),
        "plain": table.to_pydict(),
        "batch": table.combine_chunks().to_batches()[0],
    }
    result, expected = nlosctl.localize(forms[form], scene=SCENE), nlosctl.localize(table, scene=SCENE)
    assert same_bits(result.estimates, expected.estimates)
    assert same_bits(result.flags.select(["used", "residual_rad"]), expected.flags.select(["used", "residual_rad"]))


def test_the_input_is_not_modified() -> None:
    """Solving changes no bit of the caller's table."""
    table, before = good(), good()
    nlosctl.localize(table, scene=SCENE)
    assert table.equals(before, check_metadata=True)


def test_tables_without_rows() -> None:
    """A table without rows is a data error in one line."""
    with pytest.raises(DataError, match="no rows"):
        nlosctl.localize(good().slice(0, 0), scene=SCENE)


@pytest.mark.parametrize(
    ("keywords", "error", "message"),
    [
        ({"method": "mll"}, UsageError, "did you mean 'ml'"),
        ({"max_iteration": 3}, UsageError, "did you mean 'max_iterations'"),
        ({"max_iterations": "many"}, UsageError, "must be an int in the range"),
        ({"max_iterations": 2.5}, UsageError, "must be an int in the range"),
        ({"min_range_m": -1.0}, UsageError, r"must be a float in the range \[0, inf\)"),
        ({"kind": "bearing"}, UsageError, "did you mean 'bearings'"),
        ({"scene": "absent.toml"}, DataError, "absent.toml"),
        ({"carry": ["truth"]}, DataError, "truth"),
    ],
)
def test_errors_agree_with_the_command_line(keywords: dict[str, Any], error: type, message: str) -> None:
    """Unknown names, invalid values and missing files raise errors with the same text."""
    with pytest.raises(error, match=message) as caught:
        nlosctl.localize(good(), **{"scene": SCENE, **keywords})
    assert "\n" not in str(caught.value)


def test_faults_of_the_data_raise_data_error() -> None:
    """A bad row raises DataError with row and column."""
    table = good()
    std = pa.array([0.0 if place == 4 else 0.1 for place in range(240)])
    table = table.set_column(table.column_names.index("bearing_std_rad"), "bearing_std_rad", std)
    with pytest.raises(DataError, match=r"row 5.*'bearing_std_rad'"):
        nlosctl.localize(table, scene=SCENE)


def test_messages_name_arguments_of_the_functions() -> None:
    """A missing standard deviation is reported with the argument that supplies it, and that argument works."""
    table = good().drop_columns(["bearing_std_rad"])
    with pytest.raises(DataError, match=r"set `constants\['bearing_std_rad'\]`.*The file has: snapshot") as caught:
        nlosctl.localize(table, scene=SCENE)
    assert "--" not in str(caught.value)
    assert nlosctl.localize(table, scene=SCENE, constants={"bearing_std_rad": 0.02}).report.rows == table.num_rows


def test_one_name_needs_no_list() -> None:
    """A single added or carried column is a string or a list of one."""
    listed = nlosctl.localize(good(), scene=SCENE, add=["cep50"], carry=["truth_x_m"])
    assert nlosctl.localize(good(), scene=SCENE, add="cep50", carry="truth_x_m").estimates.equals(listed.estimates)


def test_public_names() -> None:
    """Every public name exists, and an unknown one is an AttributeError."""
    assert all(getattr(nlosctl, name) is not None for name in nlosctl.__all__)
    assert set(nlosctl.__all__) <= set(dir(nlosctl))
    with pytest.raises(AttributeError, match="nope"):
        _ = nlosctl.nope


@pytest.mark.parametrize("trials", [0, -1])
def test_a_simulation_has_snapshots(trials: int) -> None:
    """``trials`` below 1 is a usage error, as on the command line."""
    with pytest.raises(UsageError, match=f"`trials` must be an int of at least 1. Got {trials} instead"):
        nlosctl.simulate("ring", trials=trials)
