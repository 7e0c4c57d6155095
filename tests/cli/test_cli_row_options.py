"""``--wide --missing --where --declination-deg`` on every command that reads measurements."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
import pytest
from cli_support import Outcome
from conftest import Cli

import nlosctl
from nlosctl.cli.main import run

SCENE = "".join(
    f'[[sensor]]\nname = "{name}"\nposition = [{x}.0, {y}.0]\n'
    for name, x, y in (("N", 0, 1000), ("S", -800, -1000), ("E", 1000, 0))
)
WIDE = b"snapshot,az_N,az_S,az_E,snr_db\n1,191.3,38.7,-999,9\n2,188.5,,278.5,12\n3,188.5,40,278.5,3\n"
OPTIONS = ("--wide", "azimuth_deg=az_*", "--missing", "-999", "--bearing-std-deg", "2")


def write(folder: Path) -> None:
    """Write the wide table and its scene."""
    (folder / "wide.csv").write_bytes(WIDE)
    (folder / "scene.toml").write_text(SCENE)


def test_localize_counts_the_rows_that_are_left_out(cli: Cli, tmp_path: Path) -> None:
    """The summary counts the rows by option; the flags have the rows that are left."""
    write(tmp_path)
    done = cli("localize", "wide.csv", *OPTIONS, "--where", "snr_db>5", "-o", "e.csv", "--flags-out", "f.csv")
    assert done.code == 0
    assert "note: 5 rows are left out: 1 by --missing, 3 by --where, 1 for empty cells of --wide" in done.err
    flags = pyarrow.csv.read_csv(tmp_path / "f.csv").to_pydict()
    assert flags["snapshot"] == [1, 1, 2, 2]
    assert flags["sensor"] == ["N", "S", "N", "E"]
    assert flags["azimuth_deg"] == [191.3, 38.7, 188.5, 278.5]


@pytest.mark.parametrize("command", ["localize", "bound", "validate", "plot", "convert"])
def test_every_command_takes_the_options(cli: Cli, tmp_path: Path, command: str) -> None:
    """Each command reads the wide table, and refuses one without a row left."""
    write(tmp_path)
    further = {
        "localize": ["-m", "ml", "-o", "out.csv"],
        "bound": ["--map", "-100,100,-100,100,100", "-o", "out.csv"],
        "plot": ["-o", "out.svg"],
        "convert": ["-o", "out.csv"],
        "validate": ["--json"],
    }[command]
    options = [word for word in OPTIONS if command != "convert" or word not in ("--bearing-std-deg", "2")]
    done = cli(command, "wide.csv", *options, "--where", "sensor != E", *further)
    assert done.code == 0, done.err
    if command == "validate":
        assert (json.loads(done.out)["rows"], json.loads(done.out)["sensors"]) == (5, 2)
    none: Outcome = cli(command, "wide.csv", *options, "--where", "sensor == X", *further, "--overwrite")
    assert none.code == 1
    assert "no rows left" in none.err
    assert cli(command, "wide.csv", *options, "--where", "sensor = X", *further, "--overwrite").code == 2


def test_convert_writes_the_long_table_with_true_azimuths(cli: Cli, tmp_path: Path) -> None:
    """``convert`` keeps what the options leave; localizing its output is the same as localizing with the options."""
    write(tmp_path)
    assert cli("convert", "wide.csv", *OPTIONS[:4], "--declination-deg", "3.5", "-o", "long.csv").code == 0
    long = pyarrow.csv.read_csv(tmp_path / "long.csv").to_pydict()
    assert long["azimuth_deg"] == [191.3 + 3.5, 38.7 + 3.5, 188.5 + 3.5, 278.5 + 3.5, 188.5 + 3.5, 43.5, 278.5 + 3.5]
    direct = cli("localize", "-m", "ml", "wide.csv", *OPTIONS, "--declination-deg", "3.5", "-o", "-")
    again = cli("localize", "-m", "ml", "long.csv", "--bearing-std-deg", "2", "-o", "-")
    assert direct.out == again.out


@pytest.mark.parametrize(("command", "scenario"), [("detect-ip", "room"), ("identify-los", "liang")])
def test_conditions_on_triplets_and_echoes(cli: Cli, command: str, scenario: str) -> None:
    """Flags of the rows of some snapshots are those of a run over all, for these rows."""
    assert cli("simulate", scenario, "-n", "6", "-o", "m.parquet", "-q").code == 0
    assert cli(command, "m.parquet", "-o", "all.parquet", "-q").code == 0
    assert cli(command, "m.parquet", "--where", "snapshot >= 3", "-o", "some.parquet", "-q").code == 0
    every, some = (pyarrow.parquet.read_table(name) for name in ("all.parquet", "some.parquet"))
    assert some.to_pylist() == [row for row in every.to_pylist() if row["snapshot"] >= 3]


@pytest.mark.process
def test_slices_and_folders_leave_out_the_same_rows(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Slices by processes and parts of folders give the bytes and the summary of one process."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("NLOSCTL_SLICE_ROWS", "1")
    rows = nlosctl.simulate("ring", trials=40)
    pyarrow.parquet.write_table(rows, "m.parquet", row_group_size=33)
    words = ["localize", "-m", "ml", "m.parquet", "--where", "sensor != s1", "--where", "snapshot < 31"]
    for jobs in "12":
        outputs = ["-o", f"e{jobs}.parquet", "--flags-out", f"f{jobs}.parquet", "--report", f"r{jobs}.json"]
        assert run([*words, *outputs, "--jobs", jobs, "-q"]) == 0
    for name in "efr":
        suffix = "json" if name == "r" else "parquet"
        assert Path(f"{name}1.{suffix}").read_bytes() == Path(f"{name}2.{suffix}").read_bytes()
    report = json.loads(Path("r1.json").read_text())
    assert run([*words, "-o", "parts/", "--report", "r3.json", "-q"]) == 0
    assert report["notes"] == json.loads(Path("r3.json").read_text())["notes"]
    assert any("left out" in note for note in report["notes"])
    for target in ("none.parquet", "none/"):
        assert run([*words, "--where", "snapshot > 99", "-o", target, "--jobs", "2", "-q"]) == 1


def test_functions_take_the_options(tmp_path: Path) -> None:
    """The functions of the package give the tables of the command line."""
    write(tmp_path)
    options: dict[str, Any] = {"wide": "azimuth_deg=az_*", "missing": -999, "where": ["snr_db>5", "sensor!=E"]}
    table = nlosctl.read(tmp_path / "wide.csv", **options, declination_deg=2)
    assert table["azimuth_deg"].to_pylist() == [193.3, 40.7, 190.5]
    found = nlosctl.localize(tmp_path / "wide.csv", method="ml", bearing_std_deg=2.0, declination_deg=2, **options)
    same = nlosctl.localize(table, method="ml", bearing_std_deg=2.0, scene=tmp_path / "scene.toml")
    assert found.estimates.equals(same.estimates)
    assert nlosctl.validate(tmp_path / "wide.csv", bearing_std_deg=2.0, **options)["rows"] == 3
    assert isinstance(table, pa.Table)


def test_a_condition_that_compares_texts_is_noted(cli: Cli, tmp_path: Path) -> None:
    """An order of texts that look like numbers is noted in the summary."""
    (tmp_path / "scene.toml").write_text(SCENE)
    text = b"snapshot,sensor,azimuth_deg,q\n1,N,191,9\n1,S,39,10\n1,E,279,bad\n"
    done = cli(
        "localize", "-m", "ml", "-", "--scene", "scene.toml", "--bearing-std-deg", "2", "--where", "q>5", stdin=text
    )
    assert done.code == 0
    assert "compares texts" in done.err
