"""Convention 8: the metadata of results."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable
from pathlib import Path

import pyarrow as pa
import pytest
from cli_support import FIXTURES, GOOD, Outcome, good_table, provenance, write_parquet

from nlosctl import __version__

pytestmark = pytest.mark.extensive

Cli = Callable[..., Outcome]


def copy_inputs(folder: Path) -> None:
    """Copy the valid files to a folder."""
    for name in ("good_bearings.csv", "good_bearings.scene.toml"):
        (folder / name).write_bytes((FIXTURES / name).read_bytes())


def test_the_keys_of_the_provenance(cli: Cli, tmp_path: Path) -> None:
    """Version, command, methods, parameters, seed, region, input names, sizes and rows, and no other key."""
    copy_inputs(tmp_path)
    words = ["localize", "good_bearings.csv", "-m", "ls", "--seed", 4, "-o", "e.parquet", "--flags-out", "f.parquet"]
    assert cli(*words).code == 0
    recorded = provenance(tmp_path / "e.parquet")
    assert recorded.keys() == {"version", "command", "methods", "seed", "field", "inputs"}
    assert (recorded["version"], recorded["command"], recorded["seed"]) == (__version__, "localize", 4)
    assert [method["name"] for method in recorded["methods"]] == ["bearings.ls"]
    size = (FIXTURES / "good_bearings.csv").stat().st_size
    assert recorded["inputs"] == [{"name": "good_bearings.csv", "bytes": size, "rows": 240}]
    assert provenance(tmp_path / "f.parquet") == recorded


def test_the_provenance_allows_the_run_to_be_repeated(cli: Cli, tmp_path: Path) -> None:
    """Region, renamed columns and constants are recorded exactly: the run repeated from them gives the same bytes."""
    rows = "snapshot,sensor,sensor_x_m,sensor_y_m,angle\n1,a,0,0,0.7\n1,b,100,0,2.2\n1,c,50,90,-1.5\n"
    (tmp_path / "in.csv").write_text(rows)
    (tmp_path / "p.txt").write_text("-1,-1\n100.1234567,0\n100,99\n0,99.000001\n")
    words = [
        "localize",
        "in.csv",
        "-m",
        "mixture-ml",
        "--column",
        "bearing_rad=angle",
        "--bearing-std-deg",
        "1.23456789",
    ]
    assert cli(*words, "--field", "polygon:p.txt", "-o", "e.parquet").code == 0
    recorded = provenance(tmp_path / "e.parquet")
    std_deg = math.degrees(recorded["constants"]["bearing_std_rad"])
    again = ["--field", recorded["field"], "--bearing-std-deg", repr(std_deg), "-o", "f.parquet"]
    again += [word for name, header in recorded["columns"].items() for word in ("--column", f"{name}={header}")]
    assert cli("localize", recorded["inputs"][0]["name"], "-m", "mixture-ml", *again).code == 0
    assert (tmp_path / "e.parquet").read_bytes() == (tmp_path / "f.parquet").read_bytes()


def test_provenance_of_a_simulation(cli: Cli, tmp_path: Path) -> None:
    """``simulate`` records scenario, parameters, seed and trials."""
    assert cli("simulate", "ring", "-n", 3, "-p", "sensors=4", "--seed", 7, "-o", "m.parquet").code == 0
    recorded = provenance(tmp_path / "m.parquet")
    assert recorded.keys() == {"version", "command", "scenario", "parameters", "seed", "trials"}
    assert (recorded["scenario"], recorded["seed"], recorded["trials"]) == ("ring", 7, 3)
    assert recorded["parameters"]["sensors"] == 4


@pytest.mark.parametrize("extension", ["parquet", "arrow", "arrows", "csv.gz"])
def test_equal_runs_give_equal_bytes(cli: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, extension: str) -> None:
    """Without times, hosts and paths: equal arguments in two folders give the same bytes."""
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
    """Parquet and Arrow have the same provenance and scene."""
    for extension in ("parquet", "arrow"):
        assert cli("localize", GOOD, "-o", f"e.{extension}").code == 0
    with pa.ipc.open_file(tmp_path / "e.arrow") as reader:
        metadata = reader.schema.metadata
    assert json.loads(metadata[b"nlosctl"]) == provenance(tmp_path / "e.parquet")
    assert b"wall" in metadata[b"nlosctl.scene"]


@pytest.mark.process
def test_hashes_are_optional(cli: Cli, tmp_path: Path) -> None:
    """``--hash`` adds the SHA-256 of every input."""
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
    """A pipe has rows but neither size nor hash."""
    content = (FIXTURES / "good_bearings_azimuth.csv").read_bytes()
    assert cli("localize", "-", "-o", "e.parquet", "--hash", stdin=content).code == 0
    assert provenance(tmp_path / "e.parquet")["inputs"] == [{"name": "stdin", "rows": 173}]


@pytest.mark.parametrize("fault", ["zero_std", "ragged_line", "duplicate_bearing"])
def test_row_counts_include_bad_rows(cli: Cli, tmp_path: Path, fault: str) -> None:
    """The row count of an input is that of its file, bad rows included."""
    path = FIXTURES / f"bad_{fault}.csv"
    assert cli("localize", path, "--bad-rows", "b.csv", "-o", "e.parquet").code == 0
    rows = len(path.read_text().splitlines()) - 1
    assert [given["rows"] for given in provenance(tmp_path / "e.parquet")["inputs"]] == [rows]
