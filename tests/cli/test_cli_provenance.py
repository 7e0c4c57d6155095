"""Convention 8: what the metadata of a result says, and what it does not."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from pathlib import Path

import pyarrow as pa
import pytest
from cli_support import FIXTURES, GOOD, Outcome, good_table, provenance, write_parquet

from nlosctl import __version__

pytestmark = pytest.mark.extensive

Cli = Callable[..., Outcome]


def copy_inputs(folder: Path) -> None:
    """Put the good files into a folder."""
    for name in ("good_bearings.csv", "good_bearings.scene.toml"):
        (folder / name).write_bytes((FIXTURES / name).read_bytes())


def test_provenance_is_complete_and_nothing_more(cli: Cli, tmp_path: Path) -> None:
    """Version, command, methods, parameters, seed, field, input names, sizes and rows: these and no other key."""
    copy_inputs(tmp_path)
    words = ["localize", "good_bearings.csv", "-m", "ls", "--seed", 4, "-o", "e.parquet", "--flags-out", "f.parquet"]
    assert cli(*words).code == 0
    told = provenance(tmp_path / "e.parquet")
    assert told.keys() == {"version", "command", "methods", "seed", "field", "inputs"}
    assert (told["version"], told["command"], told["seed"]) == (__version__, "localize", 4)
    assert [method["name"] for method in told["methods"]] == ["bearings.ls"]
    size = (FIXTURES / "good_bearings.csv").stat().st_size
    assert told["inputs"] == [{"name": "good_bearings.csv", "bytes": size, "rows": 240}]
    assert provenance(tmp_path / "f.parquet") == told


def test_provenance_of_a_drawing(cli: Cli, tmp_path: Path) -> None:
    """``simulate`` tells scenario, parameters, seed and trials."""
    assert cli("simulate", "ring", "-n", 3, "-p", "sensors=4", "--seed", 7, "-o", "m.parquet").code == 0
    told = provenance(tmp_path / "m.parquet")
    assert told.keys() == {"version", "command", "scenario", "parameters", "seed", "trials"}
    assert (told["scenario"], told["seed"], told["trials"]) == ("ring", 7, 3)
    assert told["parameters"]["sensors"] == 4


@pytest.mark.parametrize("extension", ["parquet", "arrow", "arrows", "csv.gz"])
def test_equal_runs_give_equal_bytes(cli: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, extension: str) -> None:
    """No time, no host, no folder: the same words in two folders at two times give the same bytes."""
    content = []
    for name, seconds in (("here", 1e9), ("there", 1.7e9)):
        (tmp_path / name).mkdir()
        copy_inputs(tmp_path / name)
        monkeypatch.chdir(tmp_path / name)
        monkeypatch.setattr("time.time", lambda seconds=seconds: seconds)
        outputs = [f"e.{extension}", f"f.{extension}"]
        assert cli("localize", "good_bearings.csv", "-o", outputs[0], "--flags-out", outputs[1]).code == 0
        content.append([(tmp_path / name / output).read_bytes() for output in outputs])
    assert content[0] == content[1]
    assert all(str(tmp_path).encode() not in written for written in content[0])


def test_arrow_carries_the_same_as_parquet(cli: Cli, tmp_path: Path) -> None:
    """Parquet and Arrow hold the same provenance and the scene."""
    for extension in ("parquet", "arrow"):
        assert cli("localize", GOOD, "-o", f"e.{extension}").code == 0
    with pa.ipc.open_file(tmp_path / "e.arrow") as reader:
        metadata = reader.schema.metadata
    assert json.loads(metadata[b"nlosctl"]) == provenance(tmp_path / "e.parquet")
    assert b"wall" in metadata[b"nlosctl.scene"]


@pytest.mark.process
def test_hashes_only_when_asked_for(cli: Cli, tmp_path: Path) -> None:
    """``--hash`` adds the SHA-256 of every input; without it there is none."""
    copy_inputs(tmp_path)
    write_parquet(good_table(), tmp_path / "other.parquet")
    words = ["localize", "good_bearings.csv", "other.parquet", "--scene", "good_bearings.scene.toml"]
    assert cli(*words, "-o", "e.parquet", "--hash").code == 0
    assert cli(*words, "-o", "g.parquet").code == 0
    hashes = [given["sha256"] for given in provenance(tmp_path / "e.parquet")["inputs"]]
    names = ("good_bearings.csv", "other.parquet")
    assert hashes == [hashlib.sha256((tmp_path / name).read_bytes()).hexdigest() for name in names]
    assert all("sha256" not in given for given in provenance(tmp_path / "g.parquet")["inputs"])


def test_standard_input_is_named_as_such(cli: Cli, tmp_path: Path) -> None:
    """A pipe has rows but no size; its hash is left out rather than made up."""
    content = (FIXTURES / "good_bearings_azimuth.csv").read_bytes()
    assert cli("localize", "-", "-o", "e.parquet", "--hash", stdin=content).code == 0
    assert provenance(tmp_path / "e.parquet")["inputs"] == [{"name": "stdin", "rows": 173}]


@pytest.mark.parametrize("fault", ["zero_std", "ragged_line", "duplicate_bearing"])
def test_the_row_count_is_the_files(cli: Cli, tmp_path: Path, fault: str) -> None:
    """The row count of an input is that of its file, rows set aside included, whatever their fault."""
    path = FIXTURES / f"bad_{fault}.csv"
    assert cli("localize", path, "--bad-rows", "b.csv", "-o", "e.parquet").code == 0
    rows = len(path.read_text().splitlines()) - 1
    assert [given["rows"] for given in provenance(tmp_path / "e.parquet")["inputs"]] == [rows]
