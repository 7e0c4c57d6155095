"""``schema`` and ``validate``."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path

import pytest
from cli_support import FIXTURES, ROOT, Outcome, listing

from nlosctl.contract.tables import TABLES

Cli = Callable[..., Outcome]
GOOD_FILES = sorted(path for path in FIXTURES.glob("good_*") if not path.name.endswith(".toml"))
KINDS = {"ranges": "ranges", "echoes": "ranges", "triplets": "triplets"}
"""The kind of measurement by a word of the file's name; bearings otherwise."""


OPTIONS = {"good_triplets_toa.csv": ["--dod-std-deg", 1, "--doa-std-deg", 1, "--path-length-std-m", 0.1]}
"""What a file without columns of standard deviations needs."""


def counted(path: Path) -> tuple[int, int]:
    """Return rows and snapshots of a valid file, counted in the CSV file of the same data."""
    stem = path.name.split(".")[0]
    with (FIXTURES / f"{stem}.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    return len(rows), len({row["snapshot"] for row in rows})


def test_all_tables_are_listed(cli: Cli) -> None:
    """``schema`` lists every table with its title."""
    assert {row["table"] for row in cli("schema", "--json").json} == set(TABLES)
    assert all(name in cli("schema").text for name in TABLES)


@pytest.mark.extensive
@pytest.mark.parametrize("name", TABLES)
def test_a_table_is_shown_with_every_column(cli: Cli, name: str) -> None:
    """``schema TABLE`` lists every column with unit and meaning; ``--json`` is the file in schemas/."""
    shown, output = cli("schema", name).text, cli("schema", name, "--json").json
    for column in TABLES[name].columns:
        assert column.name in shown
        assert column.meaning in shown
    files = [json.loads(path.read_text()) for path in (ROOT / "schemas").glob("*.json")]
    assert output in files


def test_schemas_are_written(cli: Cli, tmp_path: Path) -> None:
    """``--write`` writes the files of schemas/ to the byte, and lists them."""
    outcome = cli("schema", "--write", "out")
    assert outcome.code == 0
    written = listing(tmp_path / "out")
    assert written == listing(ROOT / "schemas")
    assert sorted(outcome.text.splitlines()) == [f"out/{name}" for name in written]
    for name in written:
        assert (tmp_path / "out" / name).read_bytes() == (ROOT / "schemas" / name).read_bytes()


@pytest.mark.parametrize("path", GOOD_FILES, ids=lambda path: path.name)
def test_good_files_are_valid(cli: Cli, path: Path) -> None:
    """Every good fixture is valid, with its rows counted."""
    outcome = cli("validate", path, "--json", *OPTIONS.get(path.name, []))
    assert outcome.code == 0, outcome.err
    kind = next((kind for word, kind in KINDS.items() if word in path.name), "bearings")
    assert outcome.json["kind"] == kind
    assert (outcome.json["rows"], outcome.json["snapshots"]) == counted(path)
    assert outcome.json["bad_rows"] == 0


def test_validate_takes_the_options_of_reading(cli: Cli, tmp_path: Path) -> None:
    """Renamed columns and a constant std are checked as ``localize`` reads them."""
    (tmp_path / "m.csv").write_text("station,E,N,AZ\na,0,0,10\nb,5,0,350\n")
    names = ["--column", "azimuth_deg=AZ", "--column", "sensor=station", "--column", "sensor_x_m=E"]
    words = ["m.csv", *names, "--column", "sensor_y_m=N", "--bearing-std-deg", "2"]
    outcome = cli("validate", *words, "--json")
    assert outcome.code == 0, outcome.err
    assert (outcome.json["rows"], outcome.json["snapshots"]) == (2, 1)
    assert any("snapshot" in remark for remark in outcome.json["remarks"])
    assert cli("localize", *words, "-q").table.column("status").to_pylist() == ["ok"]
